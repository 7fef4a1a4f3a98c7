"""The sleep study: its table, and the published answers that its pages tell."""

from pathlib import Path

import pytest
from identifications import of_study

from aleator import Check

STUDY = Path(__file__).parents[2] / "examples" / "sleep_study"
DATA = Path(__file__).parents[1] / "data" / "sleepstudy.csv"


def test_the_table_is_the_measured_one() -> None:
    assert (STUDY / "reactions.csv").read_bytes() == DATA.read_bytes()


@pytest.mark.parametrize(
    ("name", "value"), [("alike", -897.0393), ("own", -876.0016), ("correlated", -875.9697)]
)
def test_the_maximum_is_the_published_one(name: str, value: float) -> None:
    """lme4 by maximum likelihood: (1 | unit), (days || unit), (days | unit)."""
    found = of_study(STUDY / f"{name}.toml", Check(0))
    assert found.log_likelihood.estimated == pytest.approx(value, abs=2e-3)
    # The nodes are exact here, so that no interval's end is maximized with more of them.
    runs = found.runs_by_stage
    assert runs["inference"] < 1.2 * runs["search"]
    page = (STUDY / "README.md").read_text(encoding="utf-8")
    assert f"{value:.2f}" in page
