"""What to do where the simulator fails at parameters that a law without a box can take."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from aleator.inputs import Inputs
from aleator.simulate import NoOutcome, Runner, working_box


@contextmanager
def boxes_proposed(runner: Runner, inputs: Inputs) -> Iterator[None]:
    """Add to the remedy of a failed run the sections of a study that keep the law where runs work.

    Nothing is added where every law has a box: the remedy then says which box to narrow.
    """
    try:
        yield
    except NoOutcome as error:
        remedy = f"{error.remedy}{_sections(error, runner, inputs)}"
        raise NoOutcome(error.problem, remedy, error.failed) from error


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
        f"; the law of {names} reaches beyond the runs that work: give it a box, such as that of "
        f"the runs that worked so far,{sections}\n  and let `aleator box STUDY.toml` find the "
        "largest that works"
    )
