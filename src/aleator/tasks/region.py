"""Where response surfaces are worth building: the region in which the law has its mass.

A surface on a region much wider than the law spends its runs, and measures its error, where no
experiment ever is. So an identification starts from the box that the user states, or from a pilot
where a law has none; and after each search it asks whether the region still fits the answer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aleator.inference.information import infer
from aleator.laws.inputs import IMAGES, Inputs, law_region
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem
from aleator.search import GradientMultistart
from aleator.simulators import NoOutcome, Runner
from aleator.surrogates.responses import DirectResponse
from aleator.tasks.baselines import least_squares, linear_gaussian, start_point
from aleator.types import Array

OPEN_TAIL = 1e-3
"""The same of laws that are only possible."""
SURE = 3.0
"""Standard errors of alpha by which the region is widened."""
PAD = 0.1
"""Share of its width by which a region is widened on either side."""
LEAST = 0.01
"""The same of the box, at least."""
FINE = 0.15
"""Surface error, over the outcome's sd under the law, that needs no narrower region."""
SHRINK = 0.6
"""A region is made anew only if that makes it smaller than this share of itself."""
SLIGHT = 0.8
"""The same where the runs inside serve the new region."""
PILOT = 40
"""Experiments that the pilot looks at."""
NEAR = 0.03
"""Share of its sum of squares by which a step of the pilot has to lower it to go on."""


def first_region(runner: Runner, model: Model, outcomes: Array, seed: int) -> Array:
    """The inputs' box where every law states one, or none is needed; else a region from a pilot.

    The pilot fits one point to at most 40 experiments by least squares on the simulator itself,
    and a linear-Gaussian law at that point; some ten to forty runs for each of these experiments.
    Those of which a run fails are left out, up to half of them; then the failure is raised.
    """
    inputs = model.inputs
    if inputs.bounded or model.surfaces is None:
        return inputs.box
    count = len(runner.cases)
    chosen = np.unique(np.linspace(0, count - 1, PILOT).astype(np.intp))
    enough = 0.5 * chosen.size
    while True:
        try:
            return _pilot_region(runner, model, outcomes, chosen, seed)
        except NoOutcome as failure:
            chosen = chosen[~np.isin(chosen, runner.cases.condition[failure.index])]
            if chosen.size < enough:
                raise


def _pilot_region(
    runner: Runner, model: Model, outcomes: Array, chosen: NDArray[np.intp], seed: int
) -> Array:
    """The region that the `chosen` of the different conditions tell."""
    inputs = model.inputs
    first, condition = runner.cases.first, runner.cases.condition
    rows = np.flatnonzero(np.isin(condition, chosen))
    local = np.searchsorted(chosen, condition[rows])
    response = DirectResponse(
        lambda index, x: runner(first[chosen[index]], x), chosen.size, inputs.box
    )
    start = np.clip(start_point(inputs), *inputs.box.T)
    fit = least_squares(response, local, outcomes[rows], inputs.box, start, NEAR)
    linear = linear_gaussian(
        response, model, fit.x, local, outcomes[rows], GradientMultistart(3), seed=seed
    )
    return within(inputs.box, known_region(model, linear.alpha))


def known_region(model: Model, alpha: Array) -> Array:
    """A generous region around a law: standard deviations three times, constants a tenth wider."""
    inputs = model.inputs
    wide = [alpha]
    for k, h in enumerate(inputs.hyperparameters):
        changes = [3.0 * alpha[k]] if h.log else [alpha[k] + s * 0.1 * (h.upper - h.lower)
                                                  for s in (-1.0, 1.0)]  # fmt: skip
        for value in changes:
            moved = alpha.copy()
            moved[k] = min(max(value, h.lower), h.upper)
            wide.append(moved)
    return padded(law_region(inputs, wide), inputs.box)


def own_region(inputs: Inputs, alpha: Array) -> Array:
    """The region of one law, for when alpha is not to be moved: a tenth wider on either side."""
    return padded(law_region(inputs, [alpha]), inputs.box)


def next_region(
    problem: Problem, alpha: Array, likely: Sequence[Array] | None = None
) -> Array | None:
    """A region that fits the answer alpha better, or None where the present one does.

    It holds the laws of the alphas that are `likely`: three standard errors either way unless they
    are given.

    It moves when the law reaches out of it, and narrows when the surfaces are too rough for the
    outcome's scatter under the law and a region of less than 0.6 of the volume suffices.
    """
    surface = problem.surface
    if surface is None:
        return None
    region, box = problem.region, problem.model.inputs.box
    width = np.diff(region, axis=1)[:, 0]
    if np.any(_beyond(region, law_region(problem.model.inputs, [alpha]))):
        # beyond the region the likelihood is flat, so that how far beyond alpha lies says nothing
        wanted = padded(_likely_region(problem, alpha, likely), box)
        reach = region + width[:, None] * np.array([-1.0, 1.0])
        return hull(region, np.clip(wanted, reach[:, :1], reach[:, 1:]))
    sd = problem.predictor.under(alpha).sd
    rough = surface.error[problem.condition] / np.where(sd > 0.0, sd, np.inf)
    if np.quantile(rough, 0.9 if likely is None else 1.0) <= FINE:
        return None
    wanted = padded(_likely_region(problem, alpha, likely), box)
    if likely is not None:
        # these laws are wide enough, and no run inside is lost
        wanted = within(region, _likely_region(problem, alpha, likely))
    shares = np.diff(wanted, axis=1)[problem.moving, 0] / width[problem.moving]
    return wanted if np.prod(shares) < (SHRINK if likely is None else SLIGHT) else None


def interval_region(
    problem: Problem, alpha: Array, intervals: Array, *, generous: bool = True
) -> Array | None:
    """A region that holds the laws at the ends of the intervals (K, 2), or None if it does.

    Half as wide again where it has to be wider, if `generous`; else just wide enough for all but a
    thousandth of these laws at either end.
    Beyond its region a surface is flat, and the profile of the likelihood means nothing there.
    """
    if problem.surface is None:
        return None
    inputs = problem.model.inputs
    alphas = [alpha]
    for k in range(inputs.size):
        for end in intervals[k][np.isfinite(intervals[k])]:
            moved = alpha.copy()
            moved[k] = end
            alphas.append(moved)
    wanted = law_region(inputs, alphas, IMAGES.region if generous else OPEN_TAIL)
    beyond = _beyond(problem.region, wanted)
    if not np.any(beyond):
        return None
    whole = hull(problem.region, wanted)
    if not generous:
        return within(inputs.box, whole)
    pad = 0.5 * np.diff(whole, axis=1) * np.array([-1.0, 1.0])
    return within(inputs.box, whole + np.where(beyond, pad, 0.0))


def _likely_region(problem: Problem, alpha: Array, likely: Sequence[Array] | None) -> Array:
    """Region of the laws at alpha and at the likely ones, or some standard errors off."""
    inputs, hyperparameters = problem.model.inputs, problem.model.hyperparameters
    if likely is not None:
        some = law_region(inputs, [other[: inputs.size] for other in likely], OPEN_TAIL)
        return hull(law_region(inputs, [alpha]), some)
    alphas = [alpha]
    error = infer(problem.objective, alpha, hyperparameters).standard_error
    for k in np.flatnonzero(np.isfinite(error[: inputs.size])):
        h = hyperparameters[k]
        reach = min(SURE * error[k], 0.25 * (h.upper - h.lower))
        for sign in (-1.0, 1.0):
            moved = alpha.copy()
            moved[k] = min(max(alpha[k] + sign * reach, h.lower), h.upper)
            alphas.append(moved)
    return law_region(inputs, alphas)


def _beyond(region: Array, other: Array) -> NDArray[np.bool_]:
    """Which ends (n, 2) of the other region lie beyond those of the first, by 2 % of its width."""
    slack = 0.02 * np.diff(region, axis=1)[:, 0]
    below, above = other[:, 0] < region[:, 0] - slack, other[:, 1] > region[:, 1] + slack
    return np.stack([below, above], axis=1)


def hull(region: Array, other: Array) -> Array:
    """The smallest region (n, 2) that holds both."""
    return np.stack(
        [np.minimum(region[:, 0], other[:, 0]), np.maximum(region[:, 1], other[:, 1])], axis=1
    )


def padded(region: Array, box: Array, share: float = PAD, least: float = LEAST) -> Array:
    """The region wider by a share on either side, at least by one of the box.

    At most by half of the way to the end of the box: an end that no law reaches is not reached.
    """
    pad = np.maximum(share * np.diff(region, axis=1), least * np.diff(box, axis=1))
    room = 0.5 * np.abs(box - region)
    return within(box, region + np.minimum(pad, room) * np.array([-1.0, 1.0]))


def within(box: Array, region: Array) -> Array:
    """The part of a region that lies in the box."""
    return np.stack(
        [np.maximum(region[:, 0], box[:, 0]), np.minimum(region[:, 1], box[:, 1])], axis=1
    )
