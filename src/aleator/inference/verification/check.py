"""The log-likelihood at alpha* by Monte Carlo on the simulator itself, with its standard error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.inference.verification.choice import REPLICATES, MonteCarlo, Score, Verification
from aleator.inference.verification.control_variate import (
    Control,
    Corrected,
    Made,
    corrected,
    near_error,
    surface_error,
    variance,
)
from aleator.inference.verification.emulator import Emulator
from aleator.inference.verification.kernel import NORMAL, Kernel, Noise, Window, error_of
from aleator.inference.verification.near import (
    drawn,
    effective,
    enough,
    sizes_of,
    tried,
)
from aleator.inference.verification.samples import Alone, Run, Sampler, made, with_rows, within
from aleator.laws.inputs import Inputs
from aleator.observations.model import ObservationModel
from aleator.progress import Progress, Silent
from aleator.types import Array, Indices

FEW_SAMPLES = 10
"""Effective samples below which variates are drawn anew, and a density is not verified."""
ROUGH = 0.5
"""Relative error of a density at which it verifies nothing."""
AGAIN, ONE_IN = 32, 64
"""Points of each copy for an experiment that is looked at again, and how many there may be."""


def verify(
    run: Run,
    inputs: Inputs,
    alpha: Array,
    noise_sd: float,
    measured: Array,
    choice: MonteCarlo,
    *,
    seed: int,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
    observation: ObservationModel = NORMAL,
    emulator: Emulator | None = None,
    condition: Indices | None = None,
    expected: Array | None = None,
    known: Array | None = None,
    steps: Array | None = None,
    most: int | None = None,
    progress: Progress | None = None,
) -> Verification:
    """Estimate every log f_l(y_l | alpha) from runs of the simulator itself.

    With an `emulator` and normal noise a few runs near each outcome correct the emulator's exact
    density (modules `near` and `control_variate`). Where these runs contradict it, and without an
    emulator, many are drawn from the law: randomly shifted Sobol' points mapped by its quantiles
    (randomized quasi-Monte Carlo: unbiased, and the scatter of the eight copies gives its error).
    With noise the density is the mean of p(y | Y_s, noise_sd) by the `observation` model, unbiased.
    Without noise it is a kernel estimate of fourth order (Wand and Jones, 1995, sec. 2.8), and half
    its difference from the estimate of second order is added to the standard error as a bound of
    the smoothing bias; so is that of a correction.
    `lower` and `upper` (N,) are the ends of the noise-free outcome's range, where its density may
    end abruptly; the kernel is then one-sided. `condition` (N,) numbers the conditions: equal ones
    share runs. `expected` (N,) are the errors that the emulator expects of itself, in units of the
    outcome: the smaller they are, the fewer runs are made if the choice leaves them open. `known`
    (N,) are the emulator's densities where they are known exactly, by level sets; otherwise they
    are found along lines. Where `steps` (K,) are positive, of about a quarter of a standard error,
    and the densities are those of lines, the score is told too. With `most`, from 2 on, no
    experiment has more runs near its outcome, and none is looked at again. The bias -var/2 of the
    logarithm is corrected. A run that failed, NaN, is left out: the density is that of an outcome
    where there is one. Cost: see `MonteCarlo`, and LEVELS times 512 runs for an experiment far out
    without an emulator.
    """
    count = measured.size
    bench = _Bench(
        Sampler(
            run, inputs, alpha, choice.points, np.random.default_rng(seed), progress or Silent()
        ),
        noise_sd,
        measured,
        (np.broadcast_to(lower, (count,)), np.broadcast_to(upper, (count,))),
        observation,
        seed,
    )
    if emulator is None or observation != NORMAL:
        return bench.by_samples(emulator)
    of_whom = np.arange(count) if condition is None else condition
    return bench.by_control(emulator, of_whom, choice, expected, known, steps, most)


@dataclass(frozen=True)
class _Densities:
    """Densities of m experiments, with relative errors and bounds of relative biases.

    `lines` (m, C) are relative densities of the emulator by each copy of its lines and `coarse`
    (m,) their discretization: errors that the experiments have in common.
    """

    density: Array
    error: Array
    bias: Array
    lines: Array
    coarse: Array
    effective: Array
    reached: NDArray[np.bool_]

    @property
    def of_each(self) -> Array:
        """(m,) the relative error of each, without its bias."""
        return np.sqrt(self.error**2 + error_of(self.lines) ** 2 + self.coarse**2)


@dataclass(frozen=True)
class _Bench:
    """Outcomes (N,) to be judged at one alpha, and what makes samples of them."""

    sampler: Sampler
    noise_sd: float
    y: Array
    ends: tuple[Array, Array]
    observation: ObservationModel
    seed: int

    def by_samples(self, emulator: Emulator | None) -> Verification:
        """By samples alone; an emulator only tells where outcomes far out are explained."""
        found, scatter = self._alone(np.arange(self.y.size), emulator, self.sampler)
        squares = float(np.sum(found.error[found.reached] ** 2))
        bias = float(np.sum(found.bias[found.reached]))
        none = np.zeros(self.y.size, dtype=np.bool_)
        unknown = np.full(self.y.size, np.nan)
        return _verification(found, squares, bias, scatter, (unknown, unknown), none)

    def by_control(
        self,
        emulator: Emulator,
        condition: Indices,
        choice: MonteCarlo,
        expected: Array | None,
        exact: Array | None,
        steps: Array | None,
        most: int | None,
    ) -> Verification:
        """By the emulator's densities and a few runs near each outcome."""
        sampler = self.sampler
        inputs = sampler.inputs
        candidates = tried(
            emulator, inputs, sampler.alpha, sizes_of(condition, choice.near), sampler.rng
        )
        kernel: Kernel = Noise(self.y, self.noise_sd)
        if self.noise_sd == 0.0:
            kernel = Window(self.y, *self.ends, candidates.bandwidth(self.y))
        if not np.all(kernel.scale > 0.0):
            # an emulator that is flat does not tell which runs are near
            return self.by_samples(emulator)
        runs = choice.near
        if choice.samples is None and expected is not None:
            runs = enough(expected / kernel.scale, runs)
        if most is not None:
            runs = min(runs, most - most % 2)
        sizes = sizes_of(condition, runs if inputs.scattering else 2)
        sample = [
            Made(near, made(sampler.run, near.first, candidates.x[near.chosen], sampler.progress))
            for near in drawn(candidates, kernel, condition, sizes, sampler.rng)
        ]
        control = Control(emulator, inputs, sampler.alpha, self.y, candidates.steepest, self.seed)
        by = corrected(candidates, sample, kernel)
        found = self._controlled(control, by, effective(candidates, kernel), exact)
        doubtful = np.flatnonzero(~found.reached & within(self.y, self.ends, self.noise_sd))
        told = found.effective >= FEW_SAMPLES
        again = doubtful[np.argsort(found.effective[doubtful])][: max(2, self.y.size // ONE_IN)]
        by_control = found.reached
        if again.size and inputs.scattering and most is None:
            more = self._alone(again, emulator, replace(sampler, points=AGAIN))[0]
            found = with_rows(found, again, more)
        alone = found.reached & ~by_control
        squares = np.sum(found.error[alone] ** 2)
        factor = np.where(by_control, 1.0 / np.where(by_control, found.density, 1.0), 0.0)
        squares += variance(candidates, sample, kernel, factor)
        bias = by.bias_of_sum(factor) + float(np.abs(found.bias[alone].sum()))
        score = None
        if steps is not None and exact is None and by_control.all():
            score = control.score(
                candidates, sample, found.density, self.noise_sd, steps, condition
            )
        rough = surface_error(candidates, sample), near_error(candidates, sample, kernel)
        contradicted = ~found.reached & told
        return _verification(found, squares, bias, candidates.scatter, rough, contradicted, score)

    def _controlled(
        self, control: Control, by: Corrected, many: Array, exact: Array | None
    ) -> _Densities:
        coarse = 0.0
        if exact is None:
            lines = control.lines()
            known, coarse = control.known(lines, self.noise_sd), lines[0][1].coarseness
        else:
            known = np.repeat(exact[:, None], REPLICATES, axis=1)
        density = known.mean(axis=1) + by.correction
        f = np.where(density > 0.0, density, 1.0)
        sure = (density > 0.0) & (np.hypot(by.error, by.lower) < ROUGH * f)
        return _Densities(
            density,
            by.error / f,
            by.bias / f,
            known / f[:, None],
            np.full(self.y.size, coarse),
            many,
            sure & (many >= FEW_SAMPLES),
        )

    def _alone(
        self, rows: Indices, emulator: Emulator | None, sampler: Sampler
    ) -> tuple[_Densities, Array]:
        """Densities of some experiments by samples alone, and their outcomes' scatter."""
        y, ends = self.y[rows], (self.ends[0][rows], self.ends[1][rows])
        noise = Noise(y, self.noise_sd, self.observation) if self.noise_sd > 0.0 else None
        law = sampler.of_law(rows, y, ends, noise)
        found = Alone.of(law)
        inside = within(y, ends, self.noise_sd)
        far = np.flatnonzero((found.effective < FEW_SAMPLES) & inside)
        if far.size and sampler.inputs.scattering:
            guess = None if emulator is None else emulator.at
            found = found.replaced(Alone.of(sampler.explaining(law, far, guess)), far)
        positive = found.density > 0.0
        relative = found.error / np.where(positive, found.density, 1.0)
        return _Densities(
            found.density,
            relative,
            found.bias,
            np.ones((rows.size, REPLICATES)),
            np.zeros(rows.size),
            found.effective,
            positive & (found.effective >= FEW_SAMPLES),
        ), law.scatter


def _verification(
    found: _Densities,
    squares: float,
    bias: float,
    scatter: Array,
    rough: tuple[Array, Array],
    contradicted: NDArray[np.bool_],
    score: Score | None = None,
) -> Verification:
    """All together; `squares` is the variance of the sum by samples, `bias` bounds its bias."""
    with np.errstate(divide="ignore"):
        log_density = np.log(np.maximum(found.density, 0.0))
    # E log f^ = log f - var(f^)/(2 f^2); of use only where the relative error is small
    each = log_density + 0.5 * np.minimum(found.of_each, 1.0) ** 2
    reached = found.reached
    # biases have signs: their sum is what they do together, their squares what may remain; the
    # lines are common to all experiments, so that their errors add
    squares += float(np.sum(found.bias[reached] ** 2))
    lines = error_of(found.lines[reached].sum(axis=0))
    common = np.array([bias, lines, np.sum(found.coarse[reached])])
    return Verification(
        each,
        np.hypot(found.of_each, found.bias),
        found.effective,
        reached,
        float(each[reached].sum()),
        float(np.sqrt(squares + common @ common)),
        scatter,
        *rough,
        contradicted,
        score,
    )
