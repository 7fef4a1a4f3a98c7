"""The best possible law of the experiments that were identified, and what the chosen one lacks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from aleator.inference.ceiling.best import BestLaw, best_law
from aleator.inference.ceiling.bootstrap import Judged, judged
from aleator.inference.ceiling.mixing import mixed
from aleator.inference.fit import Fit
from aleator.progress import Progress, Silent
from aleator.results import printed
from aleator.results.printed import number
from aleator.tasks.ceiling.curves import gradient_curves, gradient_map
from aleator.tasks.ceiling.sought import Sought
from aleator.tasks.identification import Identification

SURE = 3
"""Scattering parameters up to which the points cover their region."""


@dataclass(frozen=True, eq=False, repr=False)
class Ceiling:
    """The largest log-likelihood that any law of the parameters can have, and where it is reached.

    `points` has a row for each point of the best law: its `probability` and its parameters.
    `log_likelihood` is that of the best law, known to `error`; `estimated` that of the chosen one;
    `verified` that of a law on the same points by the simulator itself, None without surfaces.
    `judged` is the parametric bootstrap of the gap, None where none was asked for. `region` is
    where laws were sought, and `held` what was kept at its estimate meanwhile: constants, and the
    noise. `covered` is false for more than three scattering parameters: points of the region may
    then have been missed, and the value is a lower bound. `edges` are the parameters whose best law
    has mass on an edge of the region where the laws do not end. `gains` are log f_l of the best law
    above that of the chosen one, by experiment. `curves` and `map` hold the gradient function.
    """

    log_likelihood: float
    error: float
    estimated: float
    verified: float | None
    points: pd.DataFrame
    gains: pd.Series[float]
    judged: Judged | None
    region: Mapping[str, tuple[float, float]]
    held: Mapping[str, float]
    covered: bool
    edges: tuple[str, ...]
    curves: Mapping[str, pd.DataFrame]
    map: pd.DataFrame | None

    def __repr__(self) -> str:
        return f"{self._head}\n{self.points.to_string()}\n{self._told}"

    def _repr_html_(self) -> str:
        """The points of the best law in a notebook."""
        return printed.shown(self._head, self.points, self._told)

    @property
    def _head(self) -> str:
        best, chosen = number(self.log_likelihood, 6), number(self.estimated, 6)
        least = "" if self.covered else "at least "
        return (
            f"Log-likelihood of the best of all laws {least}{best}, of the identified one {chosen}"
        )

    @property
    def _told(self) -> str:
        chance = "" if np.isnan(self.p_value) else f", p = {number(self.p_value, 2)}"
        return f"Gap {number(self.gap, 3)}{chance}."

    @property
    def gap(self) -> float:
        """How much larger than that of the chosen law."""
        return self.log_likelihood - self.estimated

    @property
    def p_value(self) -> float:
        """Of so large a gap under the chosen law; NaN where it was not asked for."""
        return np.nan if self.judged is None else self.judged.p_value


def ceiling(
    found: Identification,
    *,
    replicates: int = 99,
    verify: bool = True,
    seed: int = 0,
    progress: Progress | None = None,
) -> Ceiling:
    """The best of all laws of the scattering parameters, and the gap of the identified one to it.

    The maximum over all probability laws G on the region of sum_l log int p(y_l | x) dG(x), with
    constants and noise at their estimates (Kiefer and Wolfowitz, 1956). It is a law of at most N
    points. The gap is judged by at most `replicates` data sets drawn from the identified law, none
    for 0. On surfaces `verify` asks the simulator at these points: a run for each point and
    experiment. Raises InputsError without noise, where laws follow covariates, and where nothing
    scatters; AleatorError where `found` was read from a file. Cost: some seconds for a hundred
    experiments.

    >>> from aleator import Free, Inputs, Check, Noise, Normal, identify
    >>> table = pd.DataFrame({"y": [0.9, 1.1, 0.9, 1.1, 0.9, 1.1]})
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> found = identify(lambda x: x, table, law, outcome="y", noise=Noise(0.01),
    ...                  verification=Check(0))
    >>> best = ceiling(found, replicates=0)
    >>> best.points.round(3).to_numpy().tolist()
    [[0.5, 0.9], [0.5, 1.1]]
    >>> round(best.log_likelihood, 3), round(best.gap, 2)     # 6 log(phi(0)/0.01/2)
    (17.959, 12.66)
    """
    progress, fit = progress or Silent(), found.fit
    sought = Sought.of(fit)
    progress.stage("best possible law")
    best = best_of(sought, seed)
    estimated = fit.scored()
    exact = found.session.exact_fit() if verify else None
    verified = None if exact is None else _on_points(exact, sought, best)
    test = None
    if replicates:
        progress.stage("bootstrap of the gap")
        test = judged(fit, sought.points, replicates, seed, progress)
    names = sought.names
    x = sought.x(best.points)[:, sought.moving]
    order = np.lexsort((*x.T[::-1],))
    points = pd.DataFrame(x[order], columns=[*names])
    points.insert(0, "probability", best.weights[order])
    gains = pd.Series(best.each - estimated.each, index=pd.Index(fit.table.ids, name="id"))
    return Ceiling(
        best.log_likelihood, best.gap, estimated.likelihood, verified, points, gains, test,
        dict(zip(names, map(tuple, sought.region.tolist()), strict=True)),
        sought.held, len(names) <= SURE, sought.edges(x), gradient_curves(sought),
        gradient_map(sought),
    )  # fmt: skip


def _on_points(exact: Fit, sought: Sought, best: BestLaw) -> float:
    """The log-likelihood of the best weights of the same points on the simulator itself."""
    there = replace(sought, fit=exact)
    return mixed(there.log_density(best.points)).log_likelihood


def gap_of(fit: Fit, seed: int) -> float:
    """How much larger the log-likelihood of the best law is than that of a fit; no runs.

    Raises InputsError without noise, where laws follow covariates, and where nothing scatters.
    """
    return best_of(Sought.of(fit), seed).log_likelihood - fit.scored().likelihood


def best_of(sought: Sought, seed: int) -> BestLaw:
    """The best law of a fit, on points of its region."""
    own = sought.own(np.random.default_rng([seed, 0]))
    points = np.concatenate([sought.cover(0, sought.count), own])
    return best_law(sought.log_density, points, sought.cover(7, 2 * sought.count))
