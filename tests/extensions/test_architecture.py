"""docs/architecture.md: the files that it names are there, and its code is that of the plug-ins."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import numpy as np
import pandas as pd
import pytest

from aleator import (
    Convolution,
    Free,
    GradientMultistart,
    Inputs,
    MonteCarlo,
    Noise,
    Normal,
    identify,
)
from aleator.likelihood.likelihood import Continued
from aleator.study.laws import LAWS
from aleator.study.noise import OBSERVATIONS
from aleator.study.propagation import PROPAGATIONS, RULES
from aleator.study.sections import DENSITIES, SEARCHES
from aleator.study.simulators import SIMULATORS
from aleator.tasks.individual.session import IndividualSession

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "aleator"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PLUGINS = [
    path.read_text(encoding="utf-8") for path in (ROOT / "tests/extensions/plugins").glob("*.py")
]
ALL = (LAWS, DENSITIES, OBSERVATIONS, SIMULATORS, SEARCHES, PROPAGATIONS, RULES)


@pytest.mark.parametrize("file", sorted({*re.findall(r"`([\w/]+\.(?:py|toml|md))`", PAGE)}))
def test_a_file_that_the_page_names_is_there(file: str) -> None:
    assert (ROOT / file).is_file() or (PACKAGE / file).is_file()


def test_the_rooms_of_the_page_are_those_of_the_package() -> None:
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()}
    modules = {path.stem for path in PACKAGE.glob("*.py") if not path.stem.startswith("_")}
    named = {*re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.*?) \|", PAGE, re.M)))}
    assert named == (rooms - {"clutch"}) | modules


def test_the_code_of_the_page_is_that_of_a_plugin() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.S | re.M)
    assert len(blocks) == 5
    assert [block for block in blocks if not any(block in text for text in PLUGINS)] == []


def test_every_group_of_entry_points_is_named() -> None:
    assert [kinds.group for kinds in ALL if f"`{kinds.group}`" not in PAGE] == []


HELPERS = {"blocks.py", "threads.py", "densities/interface.py"}
"""Files that every room calls for, and that no array passes."""


def test_one_alpha_passes_the_files_of_the_first_walk(monkeypatch: pytest.MonkeyPatch) -> None:
    z = np.linspace(0.5, 1.5, 12)
    table = pd.DataFrame({"z": z, "y": z + 0.1 * np.sin(40.0 * z)})
    inputs = Inputs({"x": Normal(Free(0.5, 1.5), Free(0.02, 1.0))})
    asked: list[tuple[Continued, np.ndarray]] = []
    plain = Continued.__call__

    def noted(self: Continued, alpha: np.ndarray) -> object:
        asked.append((self, alpha))
        return plain(self, alpha)

    monkeypatch.setattr(Continued, "__call__", noted)
    identify(
        lambda z, x: z * x, table, inputs, outcome="y", vectorized=True,
        verification=MonteCarlo(0), density=Convolution(),
    )  # fmt: skip
    densities = [objective.likelihood.predictive.density for objective, _ in asked]
    last = max(k for k, density in enumerate(densities) if isinstance(density, Convolution))
    objective, alpha = asked[last]
    fresh = Continued(objective.likelihood)
    assert passed_by(lambda: plain(fresh, alpha)) - HELPERS == walks()[0]


def test_one_alpha_passes_the_files_of_the_second_way() -> None:
    ids, t = np.repeat(np.arange(6), 3), np.tile([1.0, 2.0, 3.0], 6)
    table = pd.DataFrame({"id": ids, "t": t, "y": t + 0.1 * np.sin(7.0 * ids * t)})
    inputs = Inputs({"x": Normal(Free(0.5, 1.5), Free(0.02, 1.0))})
    found = identify(
        lambda t, x: t * x, table, inputs, outcome="y", noise=Noise(Free(0.01, 1.0)),
        vectorized=True, search=GradientMultistart(1),
    )  # fmt: skip
    assert isinstance(found.session, IndividualSession)
    assert found.session.fit is not None
    objective = found.session.fit.likelihood.continued
    away = 1.01 * found.values.to_numpy()
    passed = passed_by(lambda: objective(away))
    within = {file for file in passed if file.startswith("simulators/")}
    assert (passed - within - HELPERS) | {"simulators/runner.py"} == walks()[1]


def passed_by(work: Callable[[], object]) -> set[str]:
    """The files of the package that calls pass."""
    passed: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(str(PACKAGE)):
            passed.add(str(Path(frame.f_code.co_filename).relative_to(PACKAGE)))

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return passed


def walks() -> list[set[str]]:
    """The files of each walk that the page has as a table."""
    parts = PAGE.partition("## Four walks")[2].split("|---|---|")[1:]
    return [{*re.findall(r"^\| `([\w/]+\.py)` \|", part, re.M)} for part in parts]
