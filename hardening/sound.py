"""Small sound studies, which are damaged: what they are made of, and the folders they lie in."""

from __future__ import annotations

import json
import math
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from aleator.cli import main


def as_toml(tree: dict[str, Any]) -> str:
    """A tree as TOML, each key of the root on a line of its own.

    >>> as_toml({"search": {"starts": 1}, "x": [0.5, float("inf")]})
    'search = {"starts" = 1}\\nx = [0.5, inf]\\n'
    """
    return "".join(f"{_key(name)} = {_value(value)}\n" for name, value in tree.items())


def _key(name: str) -> str:
    return name if name.isidentifier() and name.isascii() else json.dumps(name)


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value)


MODEL = """\
def length(load, softness):
    return load * softness
def both(load, softness):
    return {"length": load * softness, "width": load + softness}
def path(time, speed):
    return speed * time
"""
STUDY: dict[str, Any] = {
    "experiments": {"file": "table.csv", "outcome": "length"},
    "simulator": {"function": "model.py:length"},
    "parameters": {
        "softness": {
            "law": "truncated_normal",
            "box": [0.5, 1.5],
            "mean": {"lower": 0.6, "upper": 1.4},
            "sd": {"lower": 0.01, "upper": 0.4},
        }
    },
    "search": {"starts": 1},
    "verification": {"samples": 0},
}
TABLE = "id,load,length\nA,1,0.93\nB,2,2.1\nC,3,3.2\nD,4,3.7\nE,5,5.4\n"
REPEATED = {
    "experiments": {
        "file": "table.csv",
        "outcomes": ["length", "width"],
        "id": "unit",
        "conditions": ["load"],
        "censored": {"length": {"column": "state", "right": "above"}},
    },
    "simulator": {"function": "model.py:both", "timeout": 5},
    "parameters": {
        "softness": {
            "law": "normal",
            "mean": {"formula": "1 + temperature", "lower": 0.5, "upper": 1.5},
            "sd": {"lower": 0.01, "upper": 0.5},
        },
    },
    "noise": {
        "length": {"sd": 0.1},
        "width": {"sd": 0.1, "kind": "student_t", "df": 4},
    },
    "search": {"starts": 1},
}
UNITS = """\
unit,load,temperature,length,width,state
A,1,20,0.93,1.9,
A,2,20,1.9,2.9,
B,1,30,1.1,2.2,
B,2,30,2.2,,
C,1,40,1.2,2.3,
C,2,40,2.5,3.2,above
D,1,25,1.0,2.0,
D,2,25,2.1,3.1,
"""
SERIES = {
    "experiments": {"file": "table.csv", "outcome": "way", "id": "unit", "conditions": ["time"]},
    "simulator": {"function": "model.py:path", "series": True},
    "parameters": {
        "speed": {
            "law": "lognormal",
            "mean": {"lower": 0.5, "upper": 2.0},
            "sd": {"lower": 0.01, "upper": 1.0},
        }
    },
    "noise": {"sd": 0.05, "relative": 0.02},
    "search": {"starts": 1},
}
TIMES = "unit,time,way\nA,1,0.9\nA,2,1.9\nB,1,1.2\nB,2,2.5\nC,1,1.0\nC,2,2.1\nC,3,2.9\n"
PROGRAM = {
    **STUDY,
    "simulator": {
        "command": ["awk", "{{print $1 * $2}}", "input.txt"],
        "template": "input.tmpl",
        "input": "input.txt",
        "output": {"file": "stdout"},
        "timeout": 5,
        "keep": "none",
    },
}
NEW = {
    "plain": "load\n2.5\n6\n",
    "repeated": "unit,load,temperature\nN,1.5,35\n",
    "series": "unit,time\nN,1.5\n",
}


@dataclass(frozen=True)
class Sound:
    """A study: its keys, its table, and the new conditions that predictions are made of."""

    study: dict[str, Any]
    table: str
    new: str


STUDIES = {
    "plain": Sound(STUDY, TABLE, NEW["plain"]),
    "noisy": Sound({**STUDY, "noise": {"sd": 0.1}}, TABLE, NEW["plain"]),
    "repeated": Sound(REPEATED, UNITS, NEW["repeated"]),
    "series": Sound(SERIES, TIMES, NEW["series"]),
    "program": Sound(PROGRAM, TABLE, NEW["plain"]),
}
MOMENTS = {"mean": {"lower": 0.7, "upper": 1.3}, "sd": {"lower": 0.02, "upper": 0.3}}
OPTIONS: tuple[tuple[tuple[str, ...], tuple[Any, ...]], ...] = (
    (("title",), ("", "Springs", "$x$ & <b>", "é" * 100)),
    (("seed",), (0, 1, 12345, 2**31)),
    (("search", "starts"), (1, 2, 3)),
    (("search", "evaluations"), (20, 100)),
    (("verification", "samples"), (0, 10, 100)),
    (("noise",), ({"sd": 0.05}, {"sd": 0.1, "kind": "student_t", "df": 5}, {"relative": 0.05})),
    (("noise",), ({"sd": {"lower": 0.01, "upper": 0.5}},)),
    (("density",), ({"kind": "gaussian"}, {"kind": "maximum_entropy", "order": 6})),
    (("density",), ({"kind": "automatic"},)),
    (("propagation",), ({"method": "collocation", "nodes": 7}, {"method": "response_surface"})),
    (("propagation",), ({"method": "response_surface", "nodes": 4, "max_runs": 60},)),
    (("experiments", "transform"), ("none", "log")),
    (("experiments", "delimiter"), (",",)),
    (
        ("parameters", "*"),
        tuple({"law": law, **MOMENTS} for law in ("normal", "gamma", "lognormal")),
    ),
    (("parameters", "*"), ({"law": "beta", "box": [0.3, 1.7], **MOMENTS},)),
    (("parameters", "*"), ({"law": "truncated_normal", "box": [0.2, 3.0], **MOMENTS},)),
    (("parameters", "*", "mean"), (1.0, {"lower": 0.7, "upper": 1.3, "start": 1.1})),
    (("parameters", "*", "sd"), (0.1, {"lower": 0.02, "upper": 0.3})),
    (("parameters", "*", "unit"), ("1/N", "%", "")),
    (("simulator", "retries"), (0, 1)),
    (("simulator", "max_failed"), (0.0, 0.5)),
    (("simulator", "store"), ("other.sqlite",)),
)
"""Keys of every study (`*`: of each parameter) with values that are valid by themselves."""
RESULTS = ("plain", "noisy", "repeated")
"""Studies whose results are damaged, too."""
REPLICATED = "noisy"
"""The one of them that has replicates of a bootstrap, too."""
STORE = "plain"
"""The study whose store of runs is damaged."""


def written(sound: Sound, folder: Path) -> Path:
    """A folder with the files of a study."""
    folder.mkdir(parents=True)
    (folder / "study.toml").write_text(as_toml(sound.study))
    (folder / "table.csv").write_text(sound.table)
    (folder / "model.py").write_text(MODEL)
    (folder / "new.csv").write_text(sound.new)
    (folder / "input.tmpl").write_text("{load} {softness}\n")
    return folder


def prepared(folder: Path) -> None:
    """Folders of all studies, with results, replicates, and runs as a store and as a table."""
    here = Path.cwd()
    for name, sound in STUDIES.items():
        os.chdir(written(sound, folder / name))
        if name in RESULTS:
            _run("identify", "study.toml", "--quiet", "--no-figures", "--output", "out")
        if name == STORE:
            _run("runs", "export", "study.toml", "runs.csv")
        if name == REPLICATED:
            _run("bootstrap", "study.toml", "--quiet", "--replicates", "3", "--output", "out")
        shutil.rmtree("__pycache__", ignore_errors=True)
    os.chdir(here)


def _run(*arguments: str) -> None:
    done = CliRunner().invoke(main, arguments)
    if done.exit_code != 0:
        raise RuntimeError(f"aleator {' '.join(arguments)}: {done.output}")
