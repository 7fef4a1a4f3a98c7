"""A file of replicates whose head was damaged is that of another study."""

import json
from pathlib import Path

import pytest

from aleator.errors import AleatorError
from aleator.tasks.bootstrap import ReplicateFile

HEAD = {"kind": "parametric", "seed": 0, "alpha": [1.0, 0.1], "log_likelihood": -3.5}


def test_a_head_is_that_of_the_same_study_up_to_rounding(tmp_path: Path) -> None:
    kept = ReplicateFile(tmp_path / "replicates.jsonl", HEAD)
    assert kept.begun() == {}
    moved = {**HEAD, "alpha": [1.0 + 1e-13, 0.1]}
    assert ReplicateFile(kept.path, moved).begun() == {}


@pytest.mark.parametrize(
    "damage",
    [
        {"alpha": ["one", 0.1]}, {"alpha": [1.0, [0.1]]}, {"alpha": [1.0, 0.1, 2.0]},
        {"alpha": None}, {"alpha": {"x": 1.0}}, {"log_likelihood": "low"},
        {"log_likelihood": 10**400}, {"log_likelihood": []}, {"seed": 1}, {"kind": None},
    ],
)  # fmt: skip
def test_a_damaged_head_is_told(tmp_path: Path, damage: dict[str, object]) -> None:
    path = tmp_path / "replicates.jsonl"
    path.write_text(json.dumps({**HEAD, **damage}) + "\n")
    with pytest.raises(AleatorError, match="those of another study"):
        ReplicateFile(path, HEAD).begun()
    path.write_text(json.dumps({key: HEAD[key] for key in ("kind", "seed")}) + "\n")
    with pytest.raises(AleatorError, match="those of another study"):
        ReplicateFile(path, HEAD).begun()
