"""Runs that failed: what the result tells of them, and what to do about them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from aleator.inference.diagnostics.naming import named
from aleator.laws.inputs import Inputs
from aleator.results.values import Diagnostic, FailureReport
from aleator.simulators import NoOutcome, Runner, working_box
from aleator.types import Array, Indices

MOST = 300
"""Failed runs of which the result tells where they were."""


def failure_report(runner: Runner) -> FailureReport | None:
    """What a runner's failures have in common; None without any.

    In the order of conditions and parameters: that of the runs depends on what a store knew.
    """
    lost, straight = runner.lost
    kept = runner.failures
    if not len(kept) and not lost:
        return None
    told = kept if len(kept) else straight
    first = told.failures[int(_in_order(told.case, told.x)[0])]
    case, x = np.concatenate([kept.case, straight.case]), np.concatenate([kept.x, straight.x])
    x = x[_in_order(case, x)]
    lowest, highest = x.min(axis=0).tolist(), x.max(axis=0).tolist()
    return FailureReport(
        len(kept) + lost,
        runner.runs,
        tuple(runner.ids[k] for k in np.unique(runner.experiment[runner.cases.first[case]])),
        dict(zip(runner.parameters, zip(lowest, highest, strict=True), strict=True)),
        first.message,
        _points(runner.parameters, x),
    )


def _in_order(case: Indices, x: Array) -> Indices:
    return np.lexsort((*x.T[::-1], case))


def _points(parameters: Sequence[str], x: Array) -> dict[str, tuple[float, ...]]:
    """Columns of some of the points x (F, n), evenly chosen."""
    chosen = np.unique(np.linspace(0, len(x) - 1, MOST).round().astype(int))
    return {name: tuple(x[chosen, k].tolist()) for k, name in enumerate(parameters)}


def failure_warnings(report: FailureReport | None) -> list[Diagnostic]:
    """That runs failed, where, and what that means for the answer."""
    if report is None:
        return []
    where = ", ".join(f"{k} in [{low:.4g}, {high:.4g}]" for k, (low, high) in report.region.items())
    which = named(np.arange(len(report.experiments)), report.experiments)
    return [
        Diagnostic(
            "simulator",
            f"{report.runs:,} of {report.needed:,} runs failed ({which}), with {where}; the first: "
            f"{report.message}. Response surfaces and check leave these runs out; where they "
            "failed a surface extrapolates, and its estimated error is larger",
            "see them with `aleator runs show STUDY.toml --failures`, mend the simulator and "
            "`aleator runs retry` them, or narrow the box (`aleator box STUDY.toml`)",
            report.experiments,
        )
    ]


@contextmanager
def boxes_proposed(runner: Runner, inputs: Inputs) -> Iterator[None]:
    """Add to the remedy of a failed run the sections of a study that keep the law where runs work.

    Nothing is added where every law has a box: the remedy then says which box to narrow.
    """
    try:
        yield
    except NoOutcome as error:
        remedy = f"{error.remedy}{_sections(error, runner, inputs)}"
        raise NoOutcome(error.problem, remedy, error.failed, error.index) from error


def _sections(error: NoOutcome, runner: Runner, inputs: Inputs) -> str:
    laws = inputs.laws.values()
    reaching = [i for i, law in enumerate(laws) if law.scatters and not law.bounded]
    worked = runner.completed.x
    if not reaching:
        return "; or let `aleator box STUDY.toml` find the largest box in which every run works"
    if len(worked) < 2:
        return ""
    names = ", ".join(inputs.names[i] for i in reaching)
    box = working_box(worked, error.failed, reaching)
    sections = "".join(
        f'\n    [parameters.{inputs.names[i]}]\n    law = "truncated_normal"\n'
        f"    box = [{box[i, 0]:.4g}, {box[i, 1]:.4g}]"
        for i in reaching
    )
    return (
        f"; the law of {names} gives weight to values at which the simulator fails: give it a box, "
        f"such as that of the runs that worked so far,{sections}\n  and let `aleator box "
        "STUDY.toml` find the largest box that works"
    )
