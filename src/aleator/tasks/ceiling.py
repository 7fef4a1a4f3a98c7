"""The best possible law: the law of any shape with the largest likelihood, and its test.

It is the nonparametric maximum likelihood estimate (`inference/npmle.py`). Its gap to the
identified law is tested by a bootstrap. `ceiling` returns all of it, `best_possible` three numbers
for the report of `identify`, if they are quick to compute.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy import special
from scipy.stats import qmc

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.fit.regions import REGIONS, padded, region_of, within
from aleator.fit.result import law_curves
from aleator.inference.fit import Fit
from aleator.inference.likelihood_at import IndividualsAt
from aleator.inference.npmle import NPMLE, GapTest, gap_test, gradient, mixed, npmle
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import OnSurfaces
from aleator.results import printed
from aleator.results.printed import number
from aleator.tasks.identification import Identification


@dataclass(frozen=True)
class CeilingSettings:
    """Settings for computing, plotting and reporting the best law; chosen by judgement.

    The best law has its mass at some of many candidate points. `points` is the number of these for
    one, two, and more parameters. With many observations there are fewer, but at least `fewest`, so
    that candidates times observations are at most `values`. Half of them are drawn from the
    identified law, widened by the factor `wider`. With more than `covered` parameters they leave
    gaps. A point is on an edge of the region if it is within the share `edge` of its width.

    Curves have 2 `line` points, each averaged over `across` draws of the other parameters; maps
    have `side` points along each axis. `seed` and `start` are the seeds of these draws and of the
    starting points.

    The report of `identify` has the best law, tested with `replicates`, if it is quick to compute.
    This needs at least `experiments` experiments (fewer do not restrict a law), at most
    `parameters` scattering parameters, and at most `nodes` quadrature nodes over all observations.
    A replicate must need at most `direct` values of the simulator itself, or at most `surfaces`
    values of response surfaces.
    """

    points: tuple[int, int, int] = (256, 1024, 2048)
    values: int = 4_000_000
    fewest: int = 128
    wider: float = 1.5
    covered: int = 3
    edge: float = 1e-3
    line: int = 121
    side: int = 61
    across: int = 64
    experiments: int = 5
    parameters: int = 2
    nodes: int = 20_000
    direct: int = 100_000
    surfaces: int = 300_000
    replicates: int = 39
    seed: int = 11
    start: int = 7


CEILING = CeilingSettings()


@dataclass(frozen=True, eq=False, repr=False)
class Ceiling:
    """The largest log-likelihood that any law of the parameters can have, and that law.

    `points` has a row for each point of the best law: its `probability` and its parameters.
    `log_likelihood` is the value of the best law, accurate to `error`. `estimated` is the value of
    the identified law. `verified` is the value of a law on the same points by the simulator itself;
    None without surfaces. `judged` is the parametric bootstrap of the gap between the two laws, or
    None. `gains` are the differences of the log-densities of each experiment.

    `region` is the range of each parameter in which laws were searched for. `held` are the
    hyperparameters kept at their estimates: constants, and the noise. `covered` is false for more
    than three scattering parameters: the value is then a lower bound. `edges` are the parameters
    whose best law has mass on an edge of the region that is not an end of the parameter's range.
    `curves` and `map` have the gradient function (see `gradient_curves`).
    """

    log_likelihood: float
    error: float
    estimated: float
    verified: float | None
    points: pd.DataFrame
    gains: pd.Series[float]
    judged: GapTest | None
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
        """The log-likelihood of the best law minus that of the identified one."""
        return self.log_likelihood - self.estimated

    @property
    def p_value(self) -> float:
        """The p value of the gap under the identified law; NaN without a bootstrap."""
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

    The best law maximizes sum_l log int p(y_l | x) dG(x) over all probability laws G on the region,
    with constants and noise at their estimates (Kiefer and Wolfowitz, 1956). It has at most N
    points. The gap is tested with at most `replicates` data sets drawn from the identified law; 0
    means no test. With response surfaces, `verify` runs the simulator at these points, once for
    each point and experiment.

    Raises InputsError without noise, for laws that depend on covariates, and if no parameter
    scatters. Raises AleatorError if `found` was read from a file and has no fit (see
    `Identification.with_fit`). Cost: some seconds for a hundred
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
    found = found.with_fit(progress)
    fit, exact = found.fit, found.session.exact_fit() if verify else None
    return ceiling_of(fit, exact, replicates, seed, progress or Silent())


def ceiling_of(
    fit: Fit, exact: Fit | None, replicates: int, seed: int, progress: Progress
) -> Ceiling:
    """The best possible law of a fit; `exact` is the fit on the simulator itself, or None."""
    sought = LawRegion.of(fit)
    progress.stage("best possible law")
    best = best_of(sought, seed)
    estimated = fit.scored()
    verified = None if exact is None else _on_points(exact, sought, best)
    test = None
    if replicates:
        progress.stage("bootstrap of the gap")
        test = gap_test(fit.for_replicates(), sought.points, replicates, seed, progress)
    names = sought.names
    x = sought.x(best.points)[:, sought.moving]
    order = np.lexsort((*x.T[::-1],))
    points = pd.DataFrame(x[order], columns=[*names])
    points.insert(0, "probability", best.weights[order])
    gains = pd.Series(best.each - estimated.each, index=pd.Index(fit.table.ids, name="id"))
    return Ceiling(
        best.log_likelihood, best.gap, estimated.likelihood, verified, points, gains, test,
        dict(zip(names, map(tuple, sought.region.tolist()), strict=True)),
        sought.held, len(names) <= sought.settings.covered, sought.edges(x),
        gradient_curves(sought), gradient_map(sought),
    )  # fmt: skip


def _on_points(exact: Fit, sought: LawRegion, best: NPMLE) -> float:
    there = replace(sought, fit=exact)
    return mixed(there.log_density(best.points)).log_likelihood


def gap_of(fit: Fit, seed: int) -> float:
    """The log-likelihood of the best law minus that of a fit.

    Raises InputsError without noise, for laws that depend on covariates, and if no parameter
    scatters.
    """
    return best_of(LawRegion.of(fit), seed).log_likelihood - fit.scored().likelihood


def best_of(sought: LawRegion, seed: int) -> NPMLE:
    """The best law of a fit, with support in its region."""
    own = sought.candidates(np.random.default_rng([seed, 0]))
    points = np.concatenate([sought.cover(0, sought.count), own])
    return npmle(sought.log_density, points, sought.cover(sought.settings.start, 2 * sought.count))


def best_possible(
    fit: Fit, seed: int, progress: Progress, settings: CeilingSettings = CEILING
) -> dict[str, float] | None:
    """The log-likelihood, gap and p value of the best law for a report; None if it takes long.

    They are computed for fits with noise and one or two scattering parameters, if the numbers of
    quadrature nodes and of simulated values are small (see `CeilingSettings`). These are counted,
    not timed, so that the same study always has the same report.
    """
    here, inputs, observations = fit.likelihood, fit.inputs, len(fit.table.observations)
    small = 1 <= inputs.scattering <= settings.parameters and fit.count >= settings.experiments
    if not (isinstance(here, IndividualsAt) and small and not inputs.individual_laws):
        return None
    on_surfaces = isinstance(here.integral.predictor, OnSurfaces)
    allowed = settings.surfaces if on_surfaces else settings.direct
    if observations * here.integral.nodes.xi.shape[1] > settings.nodes:
        return None
    sought = LawRegion.of(fit, settings)
    if observations * sought.count > allowed:
        return None
    best = best_of(sought, seed).log_likelihood
    test = gap_test(fit.for_replicates(), sought.points, settings.replicates, seed, progress)
    if test is None:
        return None
    return {
        "log_likelihood": best,
        "gap": best - fit.scored().likelihood,
        "p_value": test.p_value,
        "replicates": float(test.replicates),
    }


def require_one_law(inputs: Inputs) -> None:
    """Raise InputsError for laws with covariates or levels, and if no parameter scatters."""
    if inputs.levels:
        raise InputsError(
            "the best possible law is one for independent experiments, but some parameters belong "
            f"to the level {', '.join(dict.fromkeys(inputs.levels.values()))}",
            "ask for it without levels; the two verdicts of `aleator identify` do not need it",
        )
    if inputs.regressed:
        raise InputsError(
            "the best possible law is one for all experiments, but these laws follow "
            f"{', '.join(inputs.covariates)}",
            "ask for it with laws that follow no column; the two verdicts of `aleator identify` "
            "do not need it",
        )
    if not inputs.scattering:
        raise InputsError(
            "no parameter scatters: there is no law to compare with the best possible one",
            "give a parameter a law, such as normal",
        )


@dataclass(frozen=True, eq=False)
class LawRegion:
    """The region (s, 2) of the scattering parameters in which the best law is searched for."""

    fit: Fit
    moving: list[int]
    region: Array
    settings: CeilingSettings = CEILING

    @classmethod
    def of(cls, fit: Fit, settings: CeilingSettings = CEILING) -> LawRegion:
        """The region of a fit, within that of its response surfaces.

        For a parameter without a finite range it is where the identified law has its mass. Raises
        InputsError for laws that depend on covariates, and if no parameter scatters.
        """
        inputs = fit.inputs
        require_one_law(inputs)
        moving = [*inputs.scattered]
        mass = padded(region_of(inputs, [fit.alpha], 1, REGIONS.far), inputs.box)
        laws = [*inputs.laws.values()]
        bounded = np.array([law.bounded for law in laws])[:, None]
        region = within(fit.likelihood.region, np.where(bounded, fit.likelihood.region, mass))
        return cls(fit, moving, region[moving], settings)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the scattering parameters."""
        return tuple(self.fit.inputs.names[i] for i in self.moving)

    @cached_property
    def still(self) -> Array:
        """The medians (n,) of the parameters; for a constant its value."""
        inputs, alpha = self.fit.inputs, self.fit.alpha
        middle = np.full((1, len(inputs.names)), 0.5)
        return np.asarray(inputs.marginal(alpha[: inputs.size], middle)[0])

    @property
    def held(self) -> dict[str, float]:
        """The estimates of constants and noise, which stay fixed in the search for the best law."""
        inputs = self.fit.inputs
        kept = set(range(inputs.size))
        for i, part in enumerate(inputs.parts):
            if i not in self.moving:
                kept -= set(range(inputs.size)[part])
        return {
            h.name: float(value)
            for k, (h, value) in enumerate(
                zip(self.fit.hyperparameters, self.fit.alpha, strict=True)
            )
            if k not in kept and h.free
        }

    def x(self, z: Array) -> Array:
        """The parameters (J, n) at points (J, s) of the unit cube."""
        low, high = self.region.T
        x = np.tile(self.still, (len(z), 1))
        x[:, self.moving] = low + (high - low) * z
        return x

    def z(self, x: Array) -> Array:
        """The points (J, s) of the unit cube for parameters x (J, n), clipped to the cube."""
        low, high = self.region.T
        return np.asarray(np.clip((x[:, self.moving] - low) / (high - low), 0.0, 1.0))

    def log_density(self, z: Array) -> Array:
        """log p(observations | parameters) (N, J) of each experiment at points (J, s)."""
        return self.fit.likelihood.log_density_at(self.x(z))

    @property
    def count(self) -> int:
        """The number of points that cover the region."""
        most = self.settings.points[min(len(self.moving), 3) - 1]
        allowed = max(
            self.settings.values // len(self.fit.table.observations), self.settings.fewest
        )
        return most if allowed >= most else int(2 ** np.floor(np.log2(allowed)))

    def cover(self, seed: int, count: int) -> Array:
        """Points (J, s) of the unit cube: half fill the region, half are drawn from the law."""
        s, inputs = len(self.moving), self.fit.inputs
        uniform = qmc.Sobol(s, rng=seed).random(count // 2)
        scores = self.settings.wider * special.ndtri(qmc.Sobol(s, rng=seed + 1).random(count // 2))
        probability = np.full((len(scores), len(inputs.names)), 0.5)
        probability[:, self.moving] = special.ndtr(scores)
        x = inputs.sample(self.fit.alpha[: inputs.size], probability)
        return np.concatenate([uniform, self.z(x)])

    def points(self, fit: Fit, rng: np.random.Generator) -> Array:
        """Support points x (J, n) in this region for a fit to other data, such as a replicate."""
        there = replace(self, fit=fit)
        return there.x(np.concatenate([self._covering, there.candidates(rng)]))

    def candidates(self, rng: np.random.Generator) -> Array:
        """Points (N, s) of the unit cube: a draw of the parameters of each experiment.

        The draws are from the distribution of the parameters under the experiment's observations.
        """
        x = self.fit.likelihood.individuals(rng)
        step = max(1, len(x) // self.count)
        return self.z(x[::step][np.all(np.isfinite(x[::step]), axis=1)])

    def edges(self, x: Array) -> tuple[str, ...]:
        """The names of parameters for which points x (S, s) lie on an edge of the region.

        Edges that are ends of the parameter's range do not count.
        """
        box = self.fit.inputs.box[self.moving]
        slack = self.settings.edge * np.diff(self.region, axis=1)[:, 0]
        low = (x.min(axis=0) < self.region[:, 0] + slack) & (self.region[:, 0] > box[:, 0])
        high = (x.max(axis=0) > self.region[:, 1] - slack) & (self.region[:, 1] < box[:, 1])
        return tuple(name for name, on in zip(self.names, low | high, strict=True) if on)

    @cached_property
    def _covering(self) -> Array:
        return self.cover(0, self.count)


def gradient_curves(sought: LawRegion) -> dict[str, pd.DataFrame]:
    """The gradient function D over each parameter `x`, with the `density` of its law.

    D(x_i) is the mean of D over the other parameters, drawn from the identified law. If a small
    share h of the law's mass is moved to x_i, the log-likelihood grows by N h D(x_i).
    """
    found = {}
    drawn = _draws(sought)
    densities = law_curves(sought.fit.inputs, sought.fit.alpha, 1)
    for s, name in enumerate(sought.names):
        at = _places(sought, s)
        points = np.tile(drawn, (len(at), 1, 1))
        points[:, :, s] = at[:, None]
        d = _lacking(sought, points.reshape(-1, drawn.shape[1])).reshape(len(at), -1).mean(axis=1)
        low, high = sought.region[s]
        x = low + (high - low) * at
        curve = densities.get(name, {"x": [low], "density": [np.nan]})
        density = np.interp(x, curve["x"], curve["density"], 0.0, 0.0)
        found[name] = pd.DataFrame({"x": x, "gradient": d, "density": density})
    return found


def gradient_map(sought: LawRegion) -> pd.DataFrame | None:
    """The gradient function on a grid of two parameters; None if not exactly two scatter."""
    if len(sought.names) != 2:
        return None
    count = sought.settings.side
    side = np.linspace(0.0, 1.0, count)
    z = np.stack(np.meshgrid(side, side, indexing="xy"), axis=-1).reshape(-1, 2)
    first, second = (low + (high - low) * side for low, high in sought.region)
    return pd.DataFrame(_lacking(sought, z).reshape(count, count), index=second, columns=first)


def _places(sought: LawRegion, s: int) -> Array:
    """Points of the unit interval for a curve: half equidistant, half at quantiles of the law."""
    inputs, alpha = sought.fit.inputs, sought.fit.alpha
    line = sought.settings.line
    level = (np.arange(line) + 0.5) / line
    probability = np.tile(level[:, None], (1, len(inputs.names)))
    of_law = sought.z(inputs.marginal(alpha[: inputs.size], probability))[:, s]
    return np.unique(np.concatenate([np.linspace(0.0, 1.0, line), of_law]))


def _draws(sought: LawRegion) -> Array:
    inputs, alpha = sought.fit.inputs, sought.fit.alpha
    count = sought.settings.across if len(sought.names) > 1 else 1
    uniform = qmc.Sobol(len(inputs.names), rng=sought.settings.seed).random(count)
    return sought.z(inputs.sample(alpha[: inputs.size], uniform))


def _lacking(sought: LawRegion, points: Array) -> Array:
    """The gradient function (J,) of the identified law at points (J, s), computed in parts."""
    each = sought.fit.scored().each
    parts = np.array_split(points, -(-len(points) // sought.count))
    return np.concatenate([gradient(sought.log_density, each, part) for part in parts])
