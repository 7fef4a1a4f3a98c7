"""What can be decided by an identification: predictions, probabilities, limits."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from aleator.inference.decisions.alpha_draws import DRAWS, WIDE, AlphaDraws, alpha_draws
from aleator.laws import Hyperparameter
from aleator.observations.experiments import Conditions
from aleator.observations.transform import Transform
from aleator.progress import Progress
from aleator.tasks.decide.known import estimated
from aleator.tasks.decide.limits import Tolerance, limits
from aleator.tasks.decide.probability import probabilities
from aleator.tasks.decide.question import events_asked, responses_asked
from aleator.tasks.decide.simulator_check import CHECKS
from aleator.tasks.results.session import Session, kept, missing
from aleator.tasks.results.values import QUANTILES, Estimate, in_order


class Decided:
    """The part of an identification that looks forward, by its estimates and its session."""

    alpha: Mapping[str, Estimate]
    correlation_names: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    transform: Transform
    session: Session

    def draws(
        self, count: int = DRAWS, *, seed: int = 0, by_likelihood: bool = False
    ) -> AlphaDraws:
        """Values of alpha that the experiments leave plausible, with weights; none leaves limits.

        By the estimates, their intervals and correlations (see `alpha_draws`), which a file holds
        too. With `by_likelihood` they are weighted by the likelihood itself, which is exact
        where the intervals are very skew or experiments few; that takes an evaluation of the
        likelihood for each. Raises AleatorError where the identification was read from a file
        without inputs, and for `by_likelihood` from any file.
        """
        found = alpha_draws(
            estimated(self.alpha, self.correlation_names, self.correlation, self._hyperparameters),
            count,
            seed,
            WIDE if by_likelihood else 1.0,
        )
        return found.reweighted(kept(self.session.fit).objective()) if by_likelihood else found

    def predict(
        self,
        conditions: Conditions | pd.DataFrame,
        *,
        of: str | None = None,
        noise: bool = True,
        uncertainty: bool | AlphaDraws = True,
        quantiles: tuple[float, ...] = QUANTILES,
        progress: Progress | None = None,
    ) -> pd.DataFrame:
        """The distribution of the outcome under conditions that need not have been tested.

        It is that of a measurement of a new experiment. With `noise` False it is that of the
        simulated value. `of` names an experiment that was measured, or a column of the conditions
        with such names ("id": their own ids): the distribution is then that of a further
        measurement of it.

        The uncertainty of alpha is part of it: a mixture over plausible laws (see `draws`), and
        columns ``q<p>.lower`` and ``q<p>.upper`` have a 95 % interval of each quantile. With
        `uncertainty` False alpha is taken at its estimate; draws are taken as they are.

        As `aleator.predict`, with the simulator, inputs and noise of the identification. A data
        frame may have further columns, and the `transform` of the experiments holds for it too.
        Raises AleatorError where the identification was read from a file without the simulator.
        """
        return self.session.predict(
            conditions, self._taken(uncertainty), self.transform, quantiles, progress, of, noise
        )

    def probability(
        self,
        conditions: Conditions | pd.DataFrame,
        *,
        above: float | None = None,
        below: float | None = None,
        between: tuple[float, float] | None = None,
        response: str | None = None,
        of: str | None = None,
        noise: bool = True,
        uncertainty: bool | AlphaDraws = True,
        checks: int = CHECKS,
        progress: Progress | None = None,
    ) -> pd.DataFrame:
        """The probability that an outcome is above, below or between values, rare or not.

        Values are in the unit of the outcome, of one `response` where there are several. With
        `noise` it is that of a measured value; whether something fails is asked of the true one,
        `noise=False`. Columns: ``probability`` with alpha's uncertainty, its 95 % interval
        ``lower`` and ``upper``, that ``at_estimate`` alone, the standard ``error`` of the
        computation, ``distance`` of the most probable point of a rare event in standard deviations,
        ``checks``, the runs of the simulator that a surface was held against (each row takes as
        many besides those of its surface; 0 for none), ``beyond``, and a ``status``: "not_reached"
        where no parameters within 6.5 standard deviations lead there, "unsettled" where the last
        runs of the simulator still change it, or leave open which outcomes are in the event.
        ``unseen`` is the largest probability of a region that the runs beside a surface do not
        exclude with 95 % confidence, by these runs alone.

        Raises InputsError unless one event of one response is asked for, AleatorError as `predict`.
        """
        draws = self._taken(uncertainty)
        ground = self.session.ground(conditions, draws.estimate, self.transform, of, noise)
        events = events_asked(ground, response, above, below, between)
        return probabilities(ground, draws, events, checks, progress)

    def tolerance(
        self,
        conditions: Conditions | pd.DataFrame,
        *,
        content: float = 0.95,
        confidence: float = 0.95,
        side: str = "both",
        response: str | None = None,
        of: str | None = None,
        noise: bool = True,
        uncertainty: bool | AlphaDraws = True,
        progress: Progress | None = None,
    ) -> pd.DataFrame:
        """Limits that hold the share `content` of all outcomes, with a confidence.

        Between two limits ``lower`` and ``upper``; or with the `side` "upper" below one limit, the
        design value of that reliability, and with "lower" above one: then also the standard
        ``error`` of its computation. Limits are in the unit of the outcome. Raises InputsError
        for a share that is not between 0 and 1, AleatorError as `predict`.
        """
        draws, asked = self._taken(uncertainty), Tolerance(content, confidence, side)
        ground = self.session.ground(conditions, draws.estimate, self.transform, of, noise)
        which = np.flatnonzero(np.isin(ground.seen.response, responses_asked(ground, response)))
        return limits(ground, draws, asked, which, progress)

    def _taken(self, uncertainty: bool | AlphaDraws) -> AlphaDraws:
        if isinstance(uncertainty, AlphaDraws):
            return uncertainty
        if uncertainty:
            return self.draws()
        return AlphaDraws.at(in_order(self.alpha, self._hyperparameters))

    @property
    def _hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of the model; raises AleatorError where there is none."""
        known = self.session.hyperparameters
        if not known:
            raise missing(
                "this needs the inputs, and for predictions the simulator",
                "aleator.load(path, simulator=..., inputs=..., noise=...)",
            )
        return known
