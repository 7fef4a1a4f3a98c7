"""What `aleator predict` is asked for: distributions, probabilities or limits."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import click
import numpy as np
import pandas as pd

from aleator.errors import AleatorError
from aleator.inference.alpha_draws import AlphaDraws
from aleator.progress import Progress
from aleator.report import decisions
from aleator.tasks.decide.ground import Ground
from aleator.tasks.decide.limits import Tolerance, limits
from aleator.tasks.decide.probability import events_asked, probabilities, responses_asked
from aleator.tasks.decide.sample import CHECKS

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Asked:
    """The options of a probability or of limits; none of them asks for the distribution."""

    above: float | None
    below: float | None
    between: tuple[float, float] | None
    response: str | None
    tolerance: tuple[float, float] | None
    reliability: float | None
    confidence: float
    side: str
    checks: int

    def __post_init__(self) -> None:
        ways = {
            "--above": self.above, "--below": self.below, "--between": self.between,
            "--tolerance": self.tolerance, "--reliability": self.reliability,
        }  # fmt: skip
        chosen = [name for name, value in ways.items() if value is not None]
        if len(chosen) > 1:
            raise AleatorError(
                f"{' and '.join(chosen)} contradict each other", "choose one of them"
            )

    @property
    def limits(self) -> Tolerance | None:
        """The limits that are asked for, if they are."""
        if self.tolerance is not None:
            return Tolerance(*self.tolerance)
        if self.reliability is not None:
            return Tolerance(self.reliability, self.confidence, self.side)
        return None

    @property
    def distribution(self) -> bool:
        """Whether nothing else than the distribution is asked for."""
        return self.limits is None and not any(
            part is not None for part in (self.above, self.below, self.between)
        )

    def table(self, ground: Ground, draws: AlphaDraws, progress: Progress) -> pd.DataFrame:
        """The probabilities or the limits, a row for each row of the conditions."""
        if self.limits is not None:
            numbers = responses_asked(ground, self.response)
            which = np.flatnonzero(np.isin(ground.seen.response, numbers))
            return limits(ground, draws, self.limits, which, progress)
        events = events_asked(ground, self.response, self.above, self.below, self.between)
        return probabilities(ground, draws, events, self.checks, progress)

    def rendered(self, found: pd.DataFrame, outcome: str) -> Any:
        """The table with its title, for the terminal."""
        columns = found.to_dict("list")
        if self.limits is None:
            return decisions.render_probabilities(
                columns, f"Probability of {outcome} {self._event}"
            )
        asked = self.limits
        if asked.side == "both":
            words = f"Limits that hold {asked.content:g} of {outcome}"
        else:
            words = (
                f"Value that {outcome} is {_SIDES[asked.side]} with reliability {asked.content:g}"
            )
        return decisions.render_limits(columns, f"{words}, with confidence {asked.confidence:g}")

    @property
    def _event(self) -> str:
        if self.between is not None:
            return f"between {self.between[0]:g} and {self.between[1]:g}"
        return f"above {self.above:g}" if self.above is not None else f"below {self.below:g}"


_SIDES = {"upper": "below", "lower": "above"}


def asks(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of what is asked for, as the one argument `asked`."""

    @click.option("--above", type=float, metavar="X", help="Probability of outcomes above X.")
    @click.option("--below", type=float, metavar="X", help="Probability of outcomes below X.")
    @click.option(
        "--between", type=float, nargs=2, metavar="A B", help="Probability of outcomes between."
    )
    @click.option("--response", metavar="NAME", help="Of this response, where there are several.")
    @click.option(
        "--tolerance",
        type=float,
        nargs=2,
        metavar="P C",
        help="Two limits that hold the share P of the outcomes with confidence C (0.95 0.95).",
    )
    @click.option(
        "--reliability",
        type=float,
        metavar="R",
        help="The design value: the outcome stays on one side of it with probability R (0.999).",
    )
    @click.option(
        "--confidence",
        type=float,
        default=CONFIDENCE,
        show_default=True,
        metavar="C",
        help="Confidence of the design value.",
    )
    @click.option(
        "--side",
        type=click.Choice(["upper", "lower"]),
        default="upper",
        show_default=True,
        help="The design value is an upper limit (of a load) or a lower one (of a strength).",
    )
    @click.option(
        "--checks",
        type=click.IntRange(min=0),
        default=CHECKS,
        show_default=True,
        metavar="N",
        help="Runs of the simulator for each row that a probability by a surface is held against.",
    )
    @functools.wraps(command)
    def collected(**given: Any) -> Any:
        chosen = {field.name: given.pop(field.name) for field in fields(Asked)}
        return command(asked=Asked(**chosen), **given)

    return collected
