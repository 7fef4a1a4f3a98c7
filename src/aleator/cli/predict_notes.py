"""What `aleator predict` says beside its table: what it costs, and what it stands on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from aleator.inference.alpha_draws import AlphaDraws
from aleator.inference.extrapolation import compared
from aleator.observations.experiments import Conditions
from aleator.results.printed import number
from aleator.simulators import Runner
from aleator.study import Study
from aleator.tasks.session import Session

TOLD = 5
"""Rows beyond the tested conditions that are named."""


def expected_runs(document: Mapping[str, Any], runner: Runner) -> Iterator[str]:
    """A note where surfaces of new conditions have to be made, by what those of the study took."""
    surface = document.get("surface") or {}
    if not (surface.get("runs") and surface.get("experiments")):
        return
    each = max(round(surface["runs"] / surface["experiments"]), 1)
    count = len(runner.cases)
    of = "the new condition" if count == 1 else f"each of {count} new conditions"
    runs = f"{each} runs" if count == 1 else f"{each} runs each"
    known = None if runner.cache is None else runner.cache.at_start
    took = ""
    if known is not None and known.runs:
        second = known.seconds / known.runs
        took = f", {number(second, 2)} s a run, {number(count * each * second, 2)} s in all"
    yield (
        f"note: a surface is made for {of}: {runs}{took}, if it needs as many as in "
        "the identification and none is stored"
    )


def made_runs(runner: Runner) -> Iterator[str]:
    """A note of the runs that were made, if there were any."""
    if runner.fresh:
        yield f"note: {runner.fresh} runs of the simulator were made"


def held(draws: AlphaDraws, session: Session) -> list[str]:
    """A note where of the uncertainty of some hyperparameters nothing is known."""
    names = [session.hyperparameters[k].name for k in draws.held.tolist()]
    if not names:
        return []
    return [
        f"note: the identification tells no uncertainty of {', '.join(names)}, taken as estimated"
    ]


def untested(value: Study, table: Conditions) -> list[str]:
    """A note for each row of new conditions that is beyond the tested ones."""
    tested, new = value.experiments.table, table.table
    asked = [*table.conditions, *value.inputs.covariates]
    names = [name for name in dict.fromkeys(asked) if name in tested and name in new]
    found = compared(tested[names], new[names])
    every = [
        f"note: beyond the tested conditions: {place}: {why}"
        for place, why in zip(table.places, found.why, strict=True)
        if why
    ]
    rest = len(every) - TOLD
    return every if rest <= 0 else [*every[:TOLD], f"note: and {rest} more rows"]
