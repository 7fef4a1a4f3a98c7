"""Maximize the likelihood on Gaussian processes, with runs until their error does not move alpha.

The processes of all outputs (`surrogates.processes`) begin with a few runs of each experiment. Each
round makes runs where the parameters agree with the measured values, and maximizes again. The error
of alpha that the processes cause is computed to first order: the score is a function of the errors
of all values, so that its covariance follows from theirs. The rounds end when it is small.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.fit.ledger import SEARCH, SURFACE, Ledger
from aleator.fit.quadrature import AnyLikelihood, Maximum, nearest_maximum, several_modes
from aleator.fit.question import Question
from aleator.fit.regions import REGIONS, draws, hull, padded, plausible_alphas, reaching_out, region_of
from aleator.fit.search import searched
from aleator.inference.check import smoothed
from aleator.inference.information import Inference, infer
from aleator.likelihood.individual import ImportancePoints, RidgePoints, GaussHermite, IndividualLikelihood, Layout, OnSurfaces
from aleator.likelihood.individual.likelihood import mean_of
from aleator.likelihood.problem import Problem, prepare
from aleator.simulators.response_functions import completed, moving_parameters
from aleator.surrogates.fit import fixed_shift, low_discrepancy
from aleator.surrogates.processes import Processes
from aleator.surrogates.samples import Sites, features
from aleator.surrogates.surface import Surface


@dataclass(frozen=True)
class EmulationSettings:
    """Settings of the rounds of runs of Gaussian processes; measured by `benchmarks emulators`."""

    enough: float = 0.2
    """The error of alpha in standard errors, caused by the processes, at which the rounds end."""
    first: int = 3
    """The number of first runs of each case."""
    least: int = 6
    """The first runs of all cases together are at least this many for each input of a process."""
    draws: int = 2048
    """The number of draws of the law among which those are sought that agree with the values."""
    wide: float = 1.3
    """The factor by which these draws scatter more than the law."""
    near: int = 96
    """The number of draws that agree best with an experiment, at which errors count."""
    sites: int = 24
    aside: float = 0.25
    """The number of points for each observation at which the error of its value is taken."""
    step: float = 1e-4
    """The step of differences of the score by the values, over the scatter of the outcome."""
    share: float = 0.8
    """A round makes runs for the fewest experiments that cause this share of the error."""
    part: float = 0.5
    """A round makes runs for at least this share of the experiments."""
    density: float = 0.3
    several: int = 400
    nodes: int = 5
    smooth: float = 0.1
    most: int = 40
    """The largest number of rounds."""


EMULATION = EmulationSettings()


@dataclass(frozen=True)
class Functional:
    """How alpha and the log-likelihood depend on errors of the values, to first order.

    The change of (alpha, log L) is the sum of e(u_r, x_r) times weights[r] (K + 1,) over points r,
    where e is the error of output site[r] at x[r].
    """

    site: Indices
    x: Array
    weights: Array


def next_region(inputs, region, alpha, likely, count, shrink):
    certain = region_of(inputs, [alpha], count, REGIONS.far)
    possible = region_of(inputs, [*likely], count, REGIONS.plausible)
    wanted = padded(hull(certain, possible), inputs.box)
    if reaching_out(region, inputs.box, certain).any():
        way = np.diff(region, axis=1) * np.array([-1.0, 1.0])
        return np.clip(wanted, region[:, :1] + way[:, :1], region[:, 1:] + way[:, 1:])
    moving = moving_parameters(region)
    share = np.prod(np.diff(wanted, axis=1)[moving, 0] / np.diff(region, axis=1)[moving, 0])
    return wanted if share < shrink else region


def agreeing(
    likelihood: AnyLikelihood, alpha: Array, of: Indices, x: Array, values: Array, near: int
) -> Indices:
    """The numbers (N, near) of the draws x that agree best with the observations of experiments.

    `values` (U, D) are the values of all outputs at the draws, `of` (M,) the output of each
    observation.
    """
    if isinstance(likelihood, Problem):
        off = np.abs(values[of] - likelihood.outcomes[:, None])
        return np.argsort(off, axis=1, kind="stable")[:, :near]
    out = np.empty((likelihood.count, min(near, len(x))), dtype=np.intp)
    for block in likelihood.layout.blocks(len(x)):
        each = np.nan_to_num(likelihood.sums_of(alpha, block, values[of[block.rows]]), nan=-np.inf)
        out[block.experiments] = np.argsort(-each, axis=1, kind="stable")[:, :near]
    return out


def quadratic(n: int) -> Indices:
    """The multi-indices (Q, n) of all terms up to degree two."""
    eye = np.eye(n, dtype=np.intp)
    pairs = [eye[i] + eye[j] for i in range(n) for j in range(i, n)]
    return np.vstack([np.zeros((1, n), dtype=np.intp), eye, *pairs])


import os
LEAST=float(os.environ.get('LEAST','0.05'))
def _powers(t: Array, indices: Indices) -> tuple[Array, Array]:
    """Monomials (..., Q) of points t (..., n), and their derivatives (..., n, Q)."""
    value = np.stack([np.prod(t**nu, axis=-1) for nu in indices], axis=-1)
    slope = np.zeros((*t.shape, len(indices)))
    for q, nu in enumerate(indices):
        for i in np.flatnonzero(nu):
            less = nu - (np.arange(len(nu)) == i)
            slope[..., i, q] = nu[i] * np.prod(t**less, axis=-1)
    return value, slope


@dataclass(frozen=True)
class _Local:
    """Polynomials of degree two for each of B experiments, orthonormal over weighted points.

    `value` (B, S, Q) and `slope` (B, S, n, Q) are those at the points, and `known` (B, Q) says
    which of them the points determine. A function with values e (B, S) has the coefficients
    sum_s e_s share_s value_sq.
    """

    value: Array
    slope: Array
    share: Array
    known: Flags

    @classmethod
    def over(cls, x: Array, share: Array, least: float = LEAST) -> _Local:
        indices = quadratic(x.shape[2])
        middle = np.einsum("bs,bsn->bn", share, x)[:, None]
        off = (x - middle) * np.sqrt(share)[..., None]
        turn, size, _ = np.linalg.svd(off.transpose(0, 2, 1), full_matrices=False)
        size = np.maximum(size, 1e-9 * size[:, :1] + 1e-300)
        into = turn / size[:, None, :]
        value, slope = _powers(np.einsum("bsi,bij->bsj", x - middle, into), indices)
        _, s, v = np.linalg.svd(value * np.sqrt(share)[..., None], full_matrices=False)
        known = s > least * s[:, :1]
        inverse = v.transpose(0, 2, 1) * np.where(known, 1.0 / np.where(known, s, 1.0), 0.0)[:, None]
        slope = np.einsum("bij,bsjq,bqk->bsik", into, slope, inverse, optimize=True)
        return cls(value @ inverse, slope, share, known)


def _thinned(share: Array, count: int) -> Array:
    """Shares (B, J) of the points that remain of `count` systematic draws; most become zero."""
    ends = np.round(np.cumsum(share, axis=1) * count)
    return np.diff(ends, axis=1, prepend=0.0) / count


def functional(
    likelihood: IndividualLikelihood,
    alpha: Array,
    inference: Inference,
    moving: Indices,
    spread: Array,
    of: Indices,
    scatter: Array,
    settings: EmulationSettings = EMULATION,
) -> Functional:
    """The dependence of alpha and log L on errors of the values at the nodes of the likelihood.

    About the nodes of an experiment, the error of each value is a polynomial of degree two. Scores
    are differentiated by its coefficients. Constants have the same value at all nodes; further
    points lie `spread` (n,) above and below it.
    """
    free, inputs = inference.free, likelihood.inputs
    steady = [k for k, i in enumerate(moving) if i not in inputs.scattered]
    parts = []
    for block in likelihood.blocks:
        part = block.experiments
        found = likelihood.at(alpha, block, likelihood.nodes.xi[part])
        log_weight = likelihood.nodes.log_weight[part]
        each, share = mean_of(found.sums + log_weight)
        base = np.column_stack([found.scores(share)[:, free], each])
        x = found.individual.x[..., moving]
        nodes = x.shape[1]
        middle = np.einsum("bj,bjn->bn", share, x)
        aside = [middle + by * spread[k] * np.eye(moving.size)[k] for k in steady for by in (1.0, -1.0)]
        points = np.concatenate([x, *(one[:, None] for one in aside)], axis=1)
        rest = np.full((len(share), len(aside)), settings.aside)
        weight = np.hstack([_thinned(share, settings.sites), rest])
        local = _Local.over(points, weight / weight.sum(axis=1, keepdims=True))
        rank = np.arange(len(block.owner)) - block.starts[block.owner]
        rows_of = np.arange(part.start, part.stop)
        slopes = np.zeros((len(block.owner), local.value.shape[2], free.size + 1))
        step = settings.step * scatter[of[block.rows]]
        for r in range(int(rank.max()) + 1):
            here = np.flatnonzero(rank == r)
            own = block.owner[here]
            for q in range(local.value.shape[2]):
                eta, slope = found.eta.copy(), found.slopes.copy()
                eta[here] += step[here, None] * local.value[own, :nodes, q]
                slope[np.ix_(moving, here)] += step[here, None] * local.slope[own, :nodes, :, q].transpose(2, 0, 1)
                moved = replace(found, eta=eta, slopes=slope, terms=likelihood._terms(alpha, block, eta))
                there, shared = mean_of(moved.sums + log_weight)
                change = np.column_stack([moved.scores(shared)[:, free], there]) - base
                slopes[here, q] = change[own] / step[here, None]
        weights = np.einsum("msq,mqk->msk", (local.value * local.share[..., None])[block.owner], slopes)
        weights[..., :-1] = weights[..., :-1] @ inference.covariance
        keep = local.share[block.owner] > 0.0
        site = np.broadcast_to(of[block.rows][:, None], keep.shape)[keep]
        parts.append((site, points[block.owner][keep], weights[keep]))
    site, x, weights = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Functional(site, x, weights)


def near_outcomes(problem: Problem, alpha: Array, of: Indices, share: float, nodes: int) -> IndividualLikelihood:
    """The likelihood of exact outcomes with a small auxiliary error, on the same surfaces."""
    y, rows = problem.outcomes, np.arange(problem.count)
    assert problem.surface is not None
    predictor = OnSurfaces(problem.surface, problem.region, of)
    layout = Layout(y.size, rows, rows, np.zeros(y.size, dtype=np.intp))
    return smoothed(problem.inputs, alpha, predictor, layout, y, share).ruled(GaussHermite(nodes))


@dataclass(frozen=True)
class Emulated:
    """The end of the rounds: the processes, and what they leave unknown.

    `error` is the error of alpha in standard errors, in the worst direction, and `log_error` that
    of the log-likelihood.
    """

    error: float
    log_error: float
    surprise: float
    rounds: int


class Emulation:
    """The rounds of runs of Gaussian processes for one question."""

    def __init__(self, question: Question, ledger: Ledger, region: Array,
                 settings: EmulationSettings = EMULATION) -> None:
        self.question, self.ledger, self.region, self.settings = question, ledger, region, settings
        runner = question.runner
        self.sites = Sites.seen(runner, question.unit, question.column)
        first, case = runner.cases.first, runner.cases.condition[self.sites.unit]
        moving = moving_parameters(region)
        self.processes = Processes(
            lambda index, x: runner.values(first[index], completed(region, x)),
            region[moving], features(runner.cases.columns, len(runner.cases)), case,
            self.sites.column,
        )  # fmt: skip
        self.surprise = 1.0

    def answer(self, reason: str) -> tuple[Refined, Emulated]:
        question, ledger, processes, settings = self.question, self.ledger, self.processes, self.settings
        cases, inputs = len(question.runner.cases), processes.conditions.shape[1] + len(processes.box)
        import time
        with ledger.stage(SURFACE):
            processes.begin(max(settings.first, -(-settings.least * (inputs + 1) // cases)))
            processes.learn()
            u = low_discrepancy(512, len(processes.box), fixed_shift(len(processes.box)))
            likelihood = self._likelihood(processes.axes.outward(u))
        found = searched(question, likelihood, [], ledger)
        end = self._climbed(likelihood, found.alpha)
        for number in range(settings.most):
            inference = infer(end.likelihood.followed, end.alpha, end.likelihood.hyperparameters)
            with ledger.stage("emulator"):
                x, chosen = self._near(end, inference)
                held = end.likelihood
                if isinstance(held, Problem):
                    held = near_outcomes(held, end.alpha, self.sites.of, settings.smooth, settings.nodes)
                held = held.adapted(end.alpha)
                functional_ = functional(held, end.alpha, inference, moving_parameters(self.region),
                    x.std(axis=0), self.sites.of, np.where(self.surface.scatter>0,self.surface.scatter,1.0))
                told, each = self._told(functional_, inference)
            if DEBUG: DEBUG(self, end, told, number)
            if number >= 2 and told.error <= settings.enough and told.log_error <= settings.density:
                break
            with ledger.stage(SURFACE):
                self._round(each, x, chosen)
                self._moved(end, inference)
                processes.learn()
                likelihood = self._likelihood(self._draws(end, inference, 1.0, 512))
            with ledger.stage(SEARCH):
                end = self._climbed(likelihood, end.alpha)
        return end, told, found

    def _climbed(self, likelihood, alpha):
        if isinstance(likelihood, IndividualLikelihood):
            s = likelihood.inputs.scattering
            rule = GaussHermite(5 if s < 3 else 3) if s <= 4 else RidgePoints()
            likelihood = likelihood.ruled(rule)
            if 2 <= s and several_modes(likelihood, alpha):
                likelihood = likelihood.ruled(ImportancePoints(self.settings.several))
        held, alpha = nearest_maximum(likelihood, alpha)
        return Maximum(held, alpha, 0.0, None)

    def _likelihood(self, where):
        question = self.question
        self.surface = self.processes.surface(where)
        if question.exact:
            return prepare(question.runner, question.measured, question.choices.model, self.region,
                           None, self.surface)
        return question.integral(OnSurfaces(self.surface, self.region, self.sites.of))

    def _draws(self, end, inference, wide, count):
        likely = plausible_alphas(end.alpha, inference, end.likelihood.hyperparameters)
        x = draws(end.likelihood.inputs, [end.alpha, *likely[:31]], end.likelihood.count, wide, count)
        return np.clip(x, *self.region.T)[:, moving_parameters(self.region)]

    def _near(self, end, inference):
        x = self._draws(end, inference, self.settings.wide, self.settings.draws)
        values = self.surface.evaluate(x)
        chosen = agreeing(end.likelihood, end.alpha, self.sites.of, x, values, self.settings.near)
        return x, chosen

    def _told(self, f, inference):
        processes, k = self.processes, inference.free.size
        site, x, w = f.site, f.x, f.weights
        total = processes.covariance(site, x, w) * self.surprise**2
        # Polynomials miss the processes differently for each output.
        missed = (self.surface.at(site, x) - processes.at(site, x)[0])[:, None] * w
        each_of = np.zeros((len(processes.case), k + 1))
        np.add.at(each_of, site, missed)
        total += each_of.T @ each_of
        information = np.linalg.inv(inference.covariance)
        error = np.sqrt(max(np.trace(information @ total[:k, :k]), 0.0))
        root = np.linalg.cholesky(information)
        white = np.hstack([w[:, :k] @ root, w[:, k:]])
        n_case = len(processes.conditions)
        case = processes.case[site]
        each = processes.shares(site, x, white[:, :k], case, n_case)
        return Emulated(float(error), float(np.sqrt(max(total[k, k], 0.0))), self.surprise, 0), each

    def _round(self, each, x, chosen):
        processes, settings = self.processes, self.settings
        order = np.argsort(-each, kind="stable")
        share = np.cumsum(each[order]) / each.sum()
        count = max(int(np.searchsorted(share, settings.share)) + 1, int(settings.part * len(each)))
        cases = np.sort(order[:count])
        experiment = self.question.table.observations.experiment
        of_case = processes.case[self.sites.of]
        made_case, made_x = [], []
        for case in cases:
            owners = np.unique(experiment[of_case == case])
            points = x[np.unique(chosen[owners][:, ::3])]
            if len(points) > 256:
                points = points[:: len(points) // 256 + 1]
            made_x.append(processes.placed(case, points, 1))
            made_case.append(np.full(1, case))
        made_case, made_x = np.concatenate(made_case), np.vstack(made_x)
        before = len(processes.x)
        processes.make(made_case, made_x)
        z = processes.surprises(made_case, made_x, processes.y[before:])
        self.surprise = max(1.0, float(np.sqrt(np.mean(z**2))))

    def _moved(self, end, inference):
        likelihood = end.likelihood
        inputs = likelihood.inputs
        likely = plausible_alphas(end.alpha, inference, likelihood.hyperparameters)
        region = next_region(inputs, self.region, end.alpha, likely, likelihood.count, 0.6)
        if region is not self.region:
            self.region = region
            self.processes.move(region[moving_parameters(region)])


DEBUG = None
