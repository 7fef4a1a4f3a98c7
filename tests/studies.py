"""A small study in a folder, and the command line in this process."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from aleator.cli import main

SPRINGS = """\
title = "Springs"
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
vectorized = false
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
sd = {lower = 0.01, upper = 0.4}
[search]
starts = 2
"""
MODEL = "def length(load, softness):\n    return load * softness\n"
LENGTHS = (0.93, 2.1, 3.2, 3.7, 5.4, 5.8, 7.9, 7.6)


def table(lengths: tuple[float, ...] = LENGTHS) -> str:
    """A load of 1, 2, .. of each spring A, B, .. and its length."""
    rows = [f"{chr(65 + k)},{k + 1},{length}" for k, length in enumerate(lengths)]
    return "\n".join(["id,load,length", *rows, ""])


def springs(
    folder: Path, study: str = SPRINGS, model: str = MODEL, lengths: tuple[float, ...] = LENGTHS
) -> Path:
    """The path of a study with its table and its simulator, in a folder that is made."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "springs.csv").write_text(table(lengths))
    (folder / "model.py").write_text(model)
    (folder / "study.toml").write_text(study)
    return folder / "study.toml"


def run(*arguments: object, typed: str = "") -> Result:
    """`aleator` with these words, and what is typed at its questions."""
    return CliRunner().invoke(main, [str(word) for word in arguments], input=typed)


def done(*arguments: object) -> Result:
    """The same where it must succeed."""
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    return result


def shown_again(printed: Result, path: str | Path) -> None:
    """`aleator show` prints what the command printed that wrote the file, without its files."""
    report = printed.stdout.partition("\nWritten: ")[0]
    assert len(report) > 100
    assert done("show", path).stdout.strip() == report.strip()


def refused(*arguments: object) -> str:
    """What is said of misuse: exit code 2, one message with a remedy, no traceback."""
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert len(re.findall(r"^(?:aleator: e|E)rror: ", result.stderr, re.MULTILINE)) == 1
    assert "Traceback" not in result.output
    return result.stderr


def read(path: str | Path) -> dict[str, Any]:
    """A result as it is in its file."""
    found: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
    return found


def estimate(name: str, path: str | Path = "out/identification.json") -> float:
    """The estimate of a hyperparameter in a result."""
    return float(read(path)["alpha"][name]["estimate"])
