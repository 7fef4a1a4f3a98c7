"""Results show themselves in a notebook as small tables, and progress is heard by all tasks."""

import pandas as pd
import pytest
from springs import asked, found_with, springs

import aleator
from aleator import ProgressLine


def test_each_result_has_a_small_table_with_its_numbers() -> None:
    found = found_with()
    inputs = aleator.Inputs({"x": aleator.Normal(aleator.Free(-3.0, 3.0), 0.4)})
    table = pd.DataFrame({"load": [1.0, 2.0]})
    results = {
        "bca_lower": aleator.bootstrap(found, replicates=20),
        "elpd": aleator.compare(found, found),
        "probability": aleator.ceiling(found, replicates=0),
        "standard_error": aleator.next_experiments(found, asked(), count=2),
        "mean_total": aleator.screen(springs, table, inputs, vectorized=True),
    }
    for word, result in results.items():
        text = result._repr_html_()  # type: ignore[attr-defined]
        assert "<table" in text
        assert word in text
        assert len(text) < 20_000
    assert "Log-likelihood of the best of all laws" in repr(results["probability"])


def test_progress_without_a_notebook_is_lines(capfd: pytest.CaptureFixture[str]) -> None:
    line = ProgressLine()
    line.stage("search")
    line.update("start 3 of 10", 3, 10)
    line.stage("inference")
    told = capfd.readouterr().err.splitlines()
    assert [text.split(" ", 1)[1] for text in told] == ["search ...", "inference ..."]
