"""New experiments, and what makes their outcomes: what every decision about them stands on."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import special

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import IndividualLikelihood, Layout
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Conditions, Experiments
from aleator.observations.responses import Observations
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.types import Array, Indices

MOST = 64
"""Draws of alpha for experiments that were measured."""


@dataclass(frozen=True, eq=False)
class Measured:
    """Experiments that were measured already: `which` (B,) of those of a likelihood each is.

    Nodes are adapted to each alpha once: given its observations the variates of an experiment move
    far with alpha.
    """

    likelihood: IndividualLikelihood
    which: Indices
    _adapted: dict[bytes, IndividualLikelihood] = field(default_factory=dict, repr=False)

    def at(self, alpha: Array) -> IndividualLikelihood:
        """The likelihood with nodes adapted to alpha (K,)."""
        key = alpha.tobytes()
        if key not in self._adapted:
            self._adapted[key] = self.likelihood.adapted(alpha)
        return self._adapted[key]


@dataclass(frozen=True, eq=False)
class Ground:
    """B experiments with m values that are asked for, under laws `inputs` of their own.

    `errors` are those of a measurement; without them the values are the simulated ones.
    `on_simulator` says whether the simulator itself is asked, or surfaces of it. Experiments are
    new ones unless they were `measured`. `tested` are those that the laws were identified from.
    """

    conditions: Conditions
    inputs: Inputs
    errors: MeasurementErrors | None
    runner: Runner
    on_simulator: bool
    surfaces: ResponseSurface
    measured: Measured | None = None
    tested: Experiments | None = None

    @property
    def count(self) -> int:
        """B."""
        return len(self.conditions.ids)

    @cached_property
    def seen(self) -> Observations:
        """The values that are asked for."""
        return self.conditions.observations

    @cached_property
    def layout(self) -> Layout:
        """Which run gives which of them."""
        return Layout(self.count, self.seen.experiment, self.runner.unit, self.runner.column)

    def experiment(self, place: int) -> int:
        """The experiment that a value is of."""
        return int(self.seen.experiment[place])

    def taken(self, draws: AlphaDraws) -> AlphaDraws:
        """The draws; of measured experiments 64 at most, for each of which nodes are adapted."""
        return draws if self.measured is None else draws.fewer(MOST)

    def law(self, alpha: Array) -> Array:
        """The law's part of alpha (K,)."""
        return alpha[: self.inputs.size]

    def values(self, alpha: Array, eta: Array, score: Array, rows: slice) -> Array:
        """What is measured (m, J) of the observations `rows` where eta (m, J) is simulated.

        `score` (J,) are the standard normal variates of the errors, which make y increase.
        """
        if self.errors is None:
            return eta
        share = np.broadcast_to(_below(score), eta.shape)
        with np.errstate(all="ignore"):
            y = self.errors.quantile(alpha[self.inputs.size :], share, eta, rows)
        return np.where(np.isfinite(eta), y, eta)


FARTHEST = 7.9
"""Scores beyond which the probability of a smaller one is one, as numbers are kept."""


def _below(score: Array) -> Array:
    return np.asarray(special.ndtr(np.clip(score, -FARTHEST, FARTHEST)))
