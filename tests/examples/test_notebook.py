"""The notebook runs from its first cell to its last, and shows what it says."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[2] / "examples" / "springs.ipynb"


@pytest.fixture(scope="module")
def outputs() -> list[str]:
    """What each cell of code showed, in HTML or as the word image; errors are raised."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return [
        "".join(
            part.data.get("text/html") or "image" * ("image/png" in part.data)
            for part in cell.outputs
            if "data" in part
        )
        for cell in cells
    ]


@pytest.mark.slow
def test_the_notebook_shows_results_with_units_and_both_verdicts(outputs: list[str]) -> None:
    answer = outputs[2]
    assert "stiffness.mean [N/mm]" in answer
    assert "Computed soundly" in answer
    assert "onsistent with the experiments" in answer
    assert "<table" in answer
    assert answer.count("<svg") == 2
    assert "<script" not in answer
    assert outputs[3:5] == ["image", "image"]
    assert "q0.975" in outputs[5]
    assert "<table" in outputs[6]


def test_the_notebook_is_kept_without_outputs() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells)
