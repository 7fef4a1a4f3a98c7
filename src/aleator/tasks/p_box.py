"""The task `p_box`: bounds of a prediction, where hyperparameters are only bounded.

A probability box is the band between two distribution functions (Ferson et al., 2003): the smallest
and the largest P(y <= t) that bounded hyperparameters leave possible.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.errors import InputsError, count, nearest
from aleator.fit.question import DEFAULT_PROPAGATION, way_of
from aleator.fit.regions import REGIONS, plausible_alphas, region_of
from aleator.inference.alpha_draws import AlphaDraws, quantiles
from aleator.inference.extremes import (
    Extremes,
    PossibleAlphas,
    Statistic,
    extremes,
    extremes_with_uncertainty,
)
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.profile import DROP, ENDS
from aleator.inference.rare_events import Event
from aleator.laws import Hyperparameter
from aleator.observations.experiments import Conditions
from aleator.results.values import Estimate, in_order
from aleator.surrogates import ResponseSurface
from aleator.tasks.arguments import (
    AnyNoise,
    Columns,
    Laws,
    RequestedConditions,
    conditions_in,
    inputs_of,
    noise_of,
)
from aleator.tasks.event_points import SAMPLE, event_sample, often
from aleator.tasks.new_experiments import (
    Points,
    PredictedValue,
    PredictionContext,
    measured,
    parameters,
    predictor_for,
    simulated,
)
from aleator.tasks.prediction import PREDICTION, in_rows
from aleator.tasks.probability import (
    CERTAIN,
    Probability,
    probability,
    requested_responses,
)
from aleator.tasks.runs import AnySimulator, runner_on
from aleator.tasks.session import Session, kept


@dataclass(frozen=True)
class PBoxSettings:
    """Settings of the search for the bounds of a probability; chosen by judgement.

    smooth: in the search an outcome counts as in the event with probability Phi(a/h), where a is
    its distance from the end of the event and h this share of the scatter of the sampled outcomes,
    which is the distance between the two quantiles `middle`. The bounds that are reported are
    computed without it.
    """

    smooth: float = 0.05
    middle: tuple[float, float] = (0.25, 0.75)


P_BOX = PBoxSettings()


@dataclass(frozen=True, eq=False, repr=False)
class PBox:
    """The distributions of new outcomes that bounded hyperparameters leave possible.

    `quantiles` has the band of distribution functions, `probability` the bounds of a probability,
    and `pinched` tells which bound is worth reducing. Made by `Identification.p_box`, or without
    experiments by the function `p_box`. `sound` is that of the identification.

    >>> from aleator.laws import Between, Constant
    >>> box = p_box(lambda load, x: load * x, {"load": 10.0}, {"x": Constant(Between(0.9, 1.1))})
    >>> box
    p-box of 1 outcome; only bounded: x.value 0.9 .. 1.1
    """

    context: PredictionContext
    possible: PossibleAlphas
    sound: bool = True
    units: Mapping[str, str] = field(default_factory=dict)
    progress: Progress | None = None

    def __repr__(self) -> str:
        bounded = [self.possible.hyperparameters[k] for k in self.possible.bounded.tolist()]
        told = ", ".join(f"{h.name} {h.lower:g} .. {h.upper:g}" for h in bounded)
        return f"p-box of {count(len(self.context.seen), 'outcome')}; only bounded: {told}"

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the hyperparameters that are only bounded."""
        return tuple(self.possible.hyperparameters[k].name for k in self.possible.bounded.tolist())

    def quantiles(
        self,
        levels: tuple[float, ...] = PREDICTION.quantiles,
        *,
        outcome: str | None = None,
        uncertainty: bool = True,
    ) -> pd.DataFrame:
        """The bounds of quantiles, which are the band of distribution functions read sideways.

        A row for each new outcome and each probability of `levels`. Columns ``lower`` and ``upper``
        are the smallest and the largest quantile over the bounded hyperparameters, the identified
        ones at alpha(b). Columns ``lowest`` and ``highest`` have the uncertainty of the identified
        ones too (see `extremes_with_uncertainty`); they are left out without experiments or with
        `uncertainty` False. ``at lower`` and ``at upper`` tell the bounded values of an end. The
        unit is that of the outcome. The status is "not_converged" where a conditional maximum was
        not reached, and "not_sound" if the identification is not.

        Raises InputsError for levels that are not between 0 and 1. Cost: no runs of a fast
        simulator are counted apart; with a slow one the runs of a response surface for each
        condition, over all laws within the bounds.
        """
        wanted = np.array(levels, dtype=float)
        if not (wanted.size and np.all((wanted > 0.0) & (wanted < 1.0))):
            raise InputsError(f"levels {levels}", "give probabilities between 0 and 1, as 0.95")
        context = self.context
        places = np.flatnonzero(
            np.isin(context.seen.response, requested_responses(context, outcome))
        )
        band = self._band(_quantiles_of(self, wanted, places), uncertainty)
        which = np.repeat(places, wanted.size)
        columns: dict[str, Any] = {"probability": np.tile(wanted, places.size)}
        for name, (values, _) in band.ends.items():
            columns[name] = values.copy()
            for k, place in enumerate(which.tolist()):
                transform = context.seen.responses[context.seen.response[place]].transform
                columns[name][k] = float(transform.inverse(values[k : k + 1])[0])
        columns |= self._told(band)
        return in_rows(context, columns, [self._status(band.left)] * which.size, which)

    def probability(
        self, event: str, *, uncertainty: bool = True, checks: int = SAMPLE.checks
    ) -> pd.DataFrame:
        """The bounds of the probability of an event such as "travel > 26" or "20 < travel < 26".

        A row for each new outcome, with the columns of `quantiles` and the largest standard
        ``error`` of the computation at the ends. Each end is computed as by
        `Identification.probability` at its alpha, by importance sampling; `checks` and the statuses
        are explained there.

        Raises InputsError for a text that is no event of one outcome.
        """
        context = self.context
        asked = OutcomeEvent.of(event, [each.name for each in context.seen.responses], self.units)
        (which,) = requested_responses(context, asked.outcome).tolist()
        wanted = asked.on(context.seen.responses[which].transform)
        places = np.flatnonzero(context.seen.response == which)
        parts: list[dict[str, Any]] = []
        for place in places.tolist():
            predicted = PredictedValue.of(context, place, self._laws, self.progress)
            band = self._band(_log_probability(predicted, self._laws, wanted), uncertainty)
            ends: dict[bytes, Probability] = {}
            for _, alphas in band.ends.values():
                if (key := alphas[0].tobytes()) not in ends:
                    law = AlphaDraws.at(alphas[0])
                    ends[key] = probability(predicted, law, wanted, checks, self.progress)
            found = {name: ends[alphas[0].tobytes()] for name, (_, alphas) in band.ends.items()}
            bad = [p.status for p in found.values() if p.status not in ("solved", *CERTAIN)]
            bad += ["never"] * (found["upper"].status == "never")
            bad += ["always"] * (found["lower"].status == "always")
            parts.append(
                _in_order({name: p.probability for name, p in found.items()})
                | {name: column[0] for name, column in self._told(band).items()}
                | {"error": max(p.error for p in found.values())}
                | {"status": bad[0] if bad else self._status(band.left)}
            )
        table = pd.DataFrame(parts)
        columns = {str(name): table[name].to_numpy() for name in table if name != "status"}
        return in_rows(context, columns, table["status"].tolist(), places)

    def pinned(self, name: str, value: float | None = None) -> PBox:
        """The p-box with one bounded hyperparameter known.

        By default its value is the start of its bounds (the middle), or the most likely one if the
        experiments rule that out. Raises InputsError for an unknown name, and for a value beyond
        the bounds.
        """
        possible = self.possible
        if name not in self.names:
            raise InputsError(
                f"no hyperparameter '{name}' is only bounded{nearest(name, self.names)}",
                f"there are {', '.join(self.names)}",
            )
        k = int(possible.bounded[self.names.index(name)])
        h = possible.hyperparameters[k]
        if value is not None and not h.lower <= value <= h.upper:
            raise InputsError(
                f"{name} = {value:g} is beyond its bounds {h.lower:g} .. {h.upper:g}",
                "choose a value between them",
            )
        left = possible.pinned(k, float(possible.center[k]) if value is None else value)
        if value is None and possible.best.value - left.best.value > DROP:
            left = possible.pinned(k, float(possible.best.alpha[k]))
        return replace(self, possible=left)

    def pinched(
        self, event: str | None = None, *, quantile: float | None = None, outcome: str | None = None
    ) -> pd.DataFrame:
        """How much narrower the band becomes when one bounded hyperparameter becomes known.

        The band is that of the probability of an `event`, or of a `quantile` (default: the median).
        A row for each new outcome and each bounded hyperparameter (`pinned` at its default):
        ``lower``, ``upper``, their difference ``width``, and ``reduction``, by what share this is
        below the width of the whole band
        (Ferson & Tucker, 2006). The largest reduction names the bound to reduce first. Reductions
        do not add up. Cost: a `quantiles` or a `probability` for each bounded hyperparameter.
        """

        def asked(box: PBox) -> pd.DataFrame:
            if event is not None:
                return box.probability(event, uncertainty=False)
            return box.quantiles(
                (0.5 if quantile is None else quantile,), outcome=outcome, uncertainty=False
            )

        whole, parts = asked(self), []
        width = (whole["upper"] - whole["lower"]).to_numpy()
        for name in self.names:
            box = self.pinned(name)
            k = self.possible.bounded[self.names.index(name)]
            found = asked(box)
            part = found.loc[:, :"outcome"].copy()
            part["pinched"], part["at"] = name, float(box.possible.center[k])
            part["lower"], part["upper"] = found["lower"], found["upper"]
            part["width"] = part["upper"] - part["lower"]
            with np.errstate(invalid="ignore", divide="ignore"):
                part["reduction"] = 1.0 - part["width"].to_numpy() / width
            parts.append(part)
        return pd.concat(parts, ignore_index=True)

    def _band(self, statistic: Statistic, uncertainty: bool) -> _Band:
        """The extremes of a statistic, with those that include uncertainty where asked for."""
        if self.progress is not None:
            self.progress.stage("bounds")
        found = extremes(self.possible, statistic, self.progress)
        if not uncertainty or self.possible.fit is None:
            return _Band(found, None)
        return _Band(
            found, extremes_with_uncertainty(self.possible, statistic, found, self.progress)
        )

    def _told(self, band: _Band) -> dict[str, list[str]]:
        """Columns that tell the values of the bounded hyperparameters at the ends of the band."""
        which = self.possible.bounded.tolist()
        return {
            f"at {name}": [
                ", ".join(f"{n} = {alpha[k]:.4g}" for n, k in zip(self.names, which, strict=True))
                for alpha in alphas
            ]
            for name, alphas in (("lower", band.bounds.at_lower), ("upper", band.bounds.at_upper))
        }

    def _status(self, left: float) -> str:
        if not self.sound:
            return "not_sound"
        return "not_converged" if left > ENDS.left else "solved"

    @cached_property
    def _laws(self) -> AlphaDraws:
        """Laws all over the bounds, by which runs of response surfaces are placed."""
        possible = self.possible
        alphas = [possible.conditional(share).alpha for share in possible.starts]
        if possible.fit is not None:
            inference, known = possible.fit.inference, possible.hyperparameters
            alphas += [*plausible_alphas(possible.center, inference, known)]
        whole, one = np.stack(alphas), np.ones(len(alphas))
        return replace(
            AlphaDraws.at(possible.center), alpha=whole, weights=one / len(whole),
            z=np.zeros_like(whole), log_density=0.0 * one,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Band:
    """The `bounds` over bounded hyperparameters, and the `uncertain` ones if asked for."""

    bounds: Extremes
    uncertain: Extremes | None

    @property
    def left(self) -> float:
        """The largest gain in log-likelihood that was left at a conditional maximum."""
        return self.bounds.left

    @property
    def ends(self) -> dict[str, tuple[Array, Array]]:
        """The values (T,) and alphas (T, K) of each end, by the name of its column."""
        found, wide = self.bounds, self.uncertain
        ends = {
            "lower": (found.lower, found.at_lower),
            "upper": (found.upper, found.at_upper),
        }
        if wide is not None:
            ends["lowest"] = (wide.lower, wide.at_lower)
            ends["highest"] = (wide.upper, wide.at_upper)
        return ends


def _in_order(ends: Mapping[str, float]) -> dict[str, float]:
    """The ends of bounds in ascending order: errors of computation may exchange near ones."""
    order = [name for name in ("lowest", "lower", "upper", "highest") if name in ends]
    found = dict(zip(order, sorted(ends.values()), strict=True))
    return {name: found[name] for name in ends}


def _quantiles_of(box: PBox, levels: Array, places: Indices) -> Statistic:
    """The quantiles of the outcomes `places` as a function of alphas, from points held fixed."""
    context = box.context
    predictor = predictor_for(context, box._laws, box.progress)
    points = Points.standard(PREDICTION.law_points, context.inputs.scattering)

    def statistic(alphas: Array) -> Array:
        found = np.full((len(alphas), len(context.seen), levels.size), np.nan)
        known = None
        for l in range(context.count):
            if known is None or context.inputs.regressed:
                known = parameters(context, alphas, l, points)
            block = context.layout.alone(l)
            eta = simulated(predictor.values, block, known.x)
            y = measured(context, alphas, eta, known.score, block.rows)
            for k, own in enumerate(y, block.rows.start):
                found[:, k] = quantiles(own, known.weights, levels)
        return found[:, places].reshape(len(alphas), -1)

    return statistic


def _log_probability(
    predicted: PredictedValue, laws: AlphaDraws, event: Event, settings: PBoxSettings = P_BOX
) -> Statistic:
    """The logarithm of the probability of an event as a smooth function of alphas.

    It is computed from points of one importance density for all laws, held fixed.
    """
    turned = often(predicted, laws, event)
    rare = event.contrary if turned else event
    points = event_sample(predicted, laws, rare).joined

    def statistic(alphas: Array) -> Array:
        y, found = predicted.outcomes(alphas, points)
        with np.errstate(all="ignore"):
            away = rare.contrary.missed(y) - rare.missed(y)
            scatter = float(np.ptp(np.quantile(y[np.isfinite(y)], settings.middle)))
            inside = np.nan_to_num(special.ndtr(away / max(settings.smooth * scatter, TINY)))
        share = np.log(np.sum(inside * found.weights, axis=1) + TINY)
        return np.asarray(-share if turned else share)[:, None]

    return statistic


TINY = float(np.finfo(float).tiny)


def p_box(
    simulator: AnySimulator,
    at: Conditions | pd.DataFrame | Columns,
    inputs: Laws,
    alpha: Mapping[str, float | Estimate] | None = None,
    *,
    vectorized: bool | None = None,
    noise: AnyNoise = None,
    propagation: ResponseSurface = DEFAULT_PROPAGATION,
    progress: Progress | None = None,
) -> PBox:
    """The distributions of new outcomes that bounded hyperparameters leave possible.

    P(y <= t) lies between min_b F(t | alpha, b) and max_b F(t | alpha, b), where b are the
    hyperparameters that `inputs` or `noise` give as `Between`. No probability is assumed for b.
    Free hyperparameters need a value in `alpha`, which may be that of an identification; known ones
    need none. Without experiments, as here, nothing narrows the bounds (see
    `Identification.p_box`).

    Raises InputsError if nothing is only bounded, and if alpha lacks a free hyperparameter.
    `PBox.quantiles` and `PBox.probability` make the runs: with a slow simulator those of a response
    surface for each condition. It fails where the prediction has a peak within the bounds that no
    search climbs.

    >>> from aleator.laws import Between, Normal
    >>> box = p_box(lambda load, x: load * x, {"load": 10.0},
    ...             {"x": Normal(Between(0.9, 1.1), Between(0.05, 0.1))}, vectorized=True)
    >>> box.quantiles((0.5, 0.975))[["lower", "upper"]].round(2).to_numpy().tolist()
    [[9.0, 11.0], [9.98, 12.96]]
    >>> box.probability("outcome > 12")[["lower", "upper"]].round(3).to_numpy().tolist()
    [[0.0, 0.159]]
    """
    inputs, noise = inputs_of(inputs), noise_of(noise)
    conditions = conditions_in(at, "at", noise)
    runner = runner_on(simulator, conditions, inputs.names, vectorized)
    session = Session(inputs, noise, conditions.responses, None, lambda _: runner, None)
    known = session.hyperparameters
    held = {h.name: h.start for h in known if not h.free}
    possible = PossibleAlphas(known, in_order({**held, **(alpha or {})}, known))
    require_bounded(possible.hyperparameters)
    alphas = [possible.conditional(share).alpha for share in possible.starts]
    own = [one[: inputs.size] for one in alphas]
    region = region_of(inputs, own, len(conditions.ids), REGIONS.far)
    middle = np.zeros((len(conditions.ids), len(inputs.classes), inputs.scattering))
    x = inputs.individual(own[0], middle, slice(0, len(conditions.ids))).x[0, 0]
    way = way_of(runner, propagation, x, region)
    session = replace(session, on_simulator=way.direct, surfaces=propagation)
    context = session.context(conditions, possible.center, noise=noise is not None)
    return PBox(context, possible, progress=progress)


def p_box_of(
    session: Session,
    center: Array,
    at: RequestedConditions,
    *,
    noise: bool,
    sound: bool,
    units: Mapping[str, str],
    progress: Progress | None,
) -> PBox:
    """The p-box of an identification, whose estimates are `center` (K,); see there.

    Raises InputsError if nothing is only bounded, and for studies with levels. Raises AleatorError
    if the identification was read from a file.
    """
    fit = kept(session.fit)
    possible = PossibleAlphas(session.hyperparameters, center, fit)
    require_bounded(possible.hyperparameters)
    if fit.inputs.levels:
        raise InputsError(
            "a p-box of a study with levels is not computed",
            "identify and predict at single values between the bounds",
        )
    context = session.context(at, center, noise=noise)
    return PBox(context, possible, sound, units, progress)


def require_bounded(hyperparameters: Sequence[Hyperparameter]) -> None:
    """Raise InputsError unless a hyperparameter is only bounded: else there is no p-box."""
    if not any(h.bounded for h in hyperparameters):
        raise InputsError(
            "no hyperparameter is only bounded, so that there is one distribution",
            "ask predict for it; or give bounds: Between(lower, upper), in study.toml "
            "{between = [lower, upper]}",
        )


def require_one_law(hyperparameters: Sequence[Hyperparameter]) -> None:
    """Raise InputsError if a hyperparameter is only bounded: there is no single distribution."""
    bounded = [h.name for h in hyperparameters if h.bounded]
    if bounded:
        raise InputsError(
            f"{', '.join(bounded)} is only bounded, so that there is no single distribution",
            "ask for its bounds: found.p_box(at), aleator pbox",
        )
