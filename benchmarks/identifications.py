"""What users do: `identify()` of both examples, as their study files ask for it.

Seconds and runs are those that the result itself tells, by stage. Nothing is kept between studies:
every run is made here.
"""

from __future__ import annotations

import time
from pathlib import Path

from aleator.cli.running import identified
from aleator.core.progress import Silent
from aleator.study import Study, load_study
from aleator.tasks.identification import Identification
from benchmarks.row import Row, seconds_row

EXAMPLES = Path(__file__).parent.parent / "examples"
CLUTCH = EXAMPLES / "wet_clutch" / "study.toml"
STUDIES = {"wet clutch": CLUTCH, "fatigue limit": EXAMPLES / "fatigue_limit" / "study.toml"}

CHECK = "verification"
"""The stage of the check on the simulator."""
TARGET_SECONDS, TARGET_RUNS = 20.0, 12_000
"""Of an identification without its check."""
TARGET_GAP = 0.5
"""Of the log-likelihood, from that of the simulator itself."""
TARGET_ERROR = 0.05
"""Of a surface under the identified law, over the outcome's standard deviation."""
PAPER_GENERATION = 50 * 25
"""Runs of an experiment for one population of the paper's search: fifty alpha of 25 nodes."""


def identification_rows() -> list[Row]:
    """Both examples, from nothing to the answer."""
    return [row for name, path in STUDIES.items() for row in study_rows(name, load_study(path))]


def study_rows(name: str, study: Study) -> list[Row]:
    """Seconds, runs and exactness of one study."""
    began = time.perf_counter()
    found = identified(study, study.runner(), Silent())
    whole = time.perf_counter() - began
    check = found.seconds.get(CHECK, 0.0)
    searched = found.runs - found.runs_by_stage.get(CHECK, 0)
    paper = PAPER_GENERATION * len(study.experiments)
    what = f"{name}, {len(study.experiments)} experiments"
    return [
        seconds_row(f"{what}: identify without its check", whole - check, TARGET_SECONDS),
        seconds_row(f"{what}: identify with its check", whole, TARGET_SECONDS),
        Row(f"{what}: runs without the check", f"{searched:,}", f"target {TARGET_RUNS:,}",
            searched / TARGET_RUNS),
        Row(f"{what}: runs without the check / the paper's, one population of 50",
            f"{searched:,}", f"{paper:,}", searched / paper),
        Row(f"{what}: runs with the check / the same", f"{found.runs:,}", f"{paper:,}",
            found.runs / paper),
        *exactness_rows(what, found),
    ]  # fmt: skip


def exactness_rows(what: str, found: Identification) -> list[Row]:
    """How far the answer is from the simulator itself, where the check measured it."""
    told = found.log_likelihood
    if told.verified is None:
        return []
    gap = abs(told.estimated - told.verified)
    errors = [getattr(e, "surface_error", None) for e in found.experiments]
    worst = max(error for error in errors if error is not None)
    return [
        Row(f"{what}: log-likelihood {told.estimated:.2f}, off the simulator's by", f"{gap:.2f}",
            f"target {TARGET_GAP}", gap / TARGET_GAP),
        Row(f"{what}: largest error of a surface under the law", f"{worst:.1%}",
            f"target {TARGET_ERROR:.0%}", worst / TARGET_ERROR),
    ]  # fmt: skip
