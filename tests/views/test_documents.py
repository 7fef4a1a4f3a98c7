import json
from pathlib import Path

import numpy as np
import pytest

from aleator.errors import AleatorError
from aleator.results import documents
from aleator.results.schema import read_answer


def test_what_is_not_finite_is_null_and_arrays_are_lists() -> None:
    value = {"a": np.float32(0.5), "b": (np.inf, np.nan, -0.0), "c": np.array([[1, 2]]), 3: True}
    assert documents.plain(value) == {"a": 0.5, "b": [None, None, 0.0], "c": [[1, 2]], "3": True}
    assert documents.plain(np.True_) is True


def test_floats_read_back_exactly() -> None:
    values = np.random.default_rng(0).normal(size=100) * 10.0 ** np.arange(-50, 50)
    text = documents.to_json({"values": values})
    assert json.loads(text)["values"] == values.tolist()


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(AleatorError, match=r"(?s)cannot be made.*--output"):
        documents.write_json({}, tmp_path / "file" / "identification.json")

    (tmp_path / "folder").mkdir()
    with pytest.raises(AleatorError, match=r"(?s)cannot be written.*--output"):
        documents.write_json({}, tmp_path / "folder")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "cannot be read"),
        ("{", "this is not JSON"),
        ("[1]", "it lacks alpha, log_likelihood, experiments"),
        ('{"alpha": {}}', "it lacks log_likelihood, experiments"),
    ],
)
def test_what_is_not_an_identification_is_told(
    tmp_path: Path, text: str | None, words: str
) -> None:
    path = tmp_path / "identification.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(AleatorError, match=words) as caught:
        read_answer(path)
    assert str(path) in str(caught.value)


def test_the_result_of_another_study_is_not_replaced_and_an_older_one_not_silently(
    tmp_path: Path,
) -> None:
    path, study = tmp_path / "out" / "identification.json", tmp_path / "study.toml"
    assert documents.replaced(path, study) is None
    documents.write_json({"study": {"file": "../study.toml"}}, path)
    assert "will be replaced" in str(documents.replaced(path, study))
    with pytest.raises(AleatorError, match="another study"):
        documents.replaced(path, tmp_path / "study_b.toml")
