"""An emulator as control, samples drawn far out, and the score of the exact density."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from problems import (
    BINDING,
    FRONTIER,
    GROWTH,
    NOISY,
    PRODUCT,
    REGRESSION,
    SAMPLE,
    SQUARE,
    Problem,
    title,
)
from scipy import optimize

from aleator import MonteCarlo
from aleator.inference.verification import Verification, movement, near, verify
from aleator.types import Array


@dataclass(frozen=True)
class Wrong:
    """The simulator itself with an error of this size, that oscillates in the parameters.

    That of the next experiment is out of phase by so much.
    """

    problem: Problem
    error: float
    phase: float = 1.0

    def at(self, index: NDArray[np.intp], x: Array) -> Array:
        return self.problem.run(index, x) + self.error * np.sin(
            5.0 * x.sum(axis=1) + self.phase * index
        )

    def evaluate(self, x: Array, rows: NDArray[np.intp]) -> Array:
        flat = self.at(np.repeat(rows, len(x)), np.tile(x, (rows.size, 1)))
        return flat.reshape(rows.size, len(x))


@dataclass(frozen=True)
class Shifted:
    """The simulator itself, with a constant error (N,) for each experiment."""

    problem: Problem
    shift: Array

    def at(self, index: NDArray[np.intp], x: Array) -> Array:
        return self.problem.run(index, x) + self.shift[index]

    def evaluate(self, x: Array, rows: NDArray[np.intp]) -> Array:
        flat = self.problem.run(np.repeat(rows, len(x)), np.tile(x, (rows.size, 1)))
        return flat.reshape(rows.size, len(x)) + self.shift[rows, None]


@dataclass(frozen=True)
class Beyond:
    """The simulator itself up to an outcome (N,), and above it an error (N,) upward."""

    problem: Problem
    end: Array
    error: Array

    def at(self, index: NDArray[np.intp], x: Array) -> Array:
        outcome = self.problem.run(index, x)
        return outcome + self.error[index] * (outcome > self.end[index])

    def evaluate(self, x: Array, rows: NDArray[np.intp]) -> Array:
        flat = self.at(np.repeat(rows, len(x)), np.tile(x, (rows.size, 1)))
        return flat.reshape(rows.size, len(x))


def checked(
    problem: Problem,
    y: Array,
    error: float | None,
    seed: int = 0,
    samples: int | None = None,
    steps: Array | None = None,
    alpha: Array | None = None,
) -> Verification:
    lower, upper = problem.limits(problem.z)
    alpha = problem.alpha if alpha is None else alpha
    return verify(
        problem.run, problem.inputs, alpha, float(alpha[-1]) if problem.noise else 0.0, y,
        MonteCarlo(samples), seed=seed, lower=lower, upper=upper,
        emulator=None if error is None else Wrong(problem, error), steps=steps,
    )  # fmt: skip


# ------------------------------------------------------------------------------ the control


@pytest.mark.parametrize("samples", [None, 128])
@pytest.mark.parametrize("error", [0.0, 0.003, 0.03])
@pytest.mark.parametrize(
    "problem", [SAMPLE, GROWTH, SQUARE, BINDING, PRODUCT, REGRESSION, NOISY], ids=title
)
def test_a_control_however_wrong_leaves_an_honest_error(
    problem: Problem, error: float, samples: int | None
) -> None:
    y = problem.draw(2)
    truth = problem.log_density(problem.alpha, problem.z, y)
    found = [checked(problem, y, error, seed, samples) for seed in range(8)]
    assert all(one.reached.all() for one in found)
    pulls = np.array([(one.each - truth) / one.each_error for one in found])
    # ten pairs of draws: Student's t with 10 degrees of freedom has a mean square of 1.25; 56 of
    # them are not independent
    assert np.mean(pulls**2) < 2.5
    totals = np.array([(one.total - truth.sum()) / one.standard_error for one in found])
    assert np.mean(totals**2) < 3.0


@pytest.mark.parametrize("problem", [SAMPLE, GROWTH, SQUARE, BINDING, REGRESSION], ids=title)
def test_twenty_runs_on_a_good_control_know_more_than_512_without(problem: Problem) -> None:
    y = problem.draw(2)
    alone, held = checked(problem, y, None, samples=512), checked(problem, y, 0.003)
    assert held.standard_error < 0.7 * alone.standard_error
    assert np.median(held.each_error) < 0.01


def test_twenty_runs_tell_surfaces_that_are_off_by_a_share_of_the_scatter() -> None:
    """A constant error of the surfaces, that a wrong density shows in closed form too."""
    problem = replace(SAMPLE, z=np.tile(SAMPLE.z, 20))
    y = problem.draw(2)
    _, sd, _ = problem.exact_moments(2)
    shift = np.where(np.arange(y.size) % 2, 0.05, 0.0) * sd
    found = verify(
        problem.run, problem.inputs, problem.alpha, 0.0, y, MonteCarlo(), seed=0,
        emulator=Shifted(problem, shift),
    )  # fmt: skip
    truth = problem.log_density(problem.alpha, problem.z, y)
    np.testing.assert_allclose(found.surface_error, shift, atol=1e-12)
    np.testing.assert_allclose(found.near_error, shift, atol=1e-12)
    assert abs(found.total - truth.sum()) < 3.0 * found.standard_error
    assert np.mean(((found.each - truth) / found.each_error)[shift > 0.0] ** 2) < 2.0


def test_what_surfaces_have_wrong_far_from_an_outcome_is_not_near_it() -> None:
    problem = replace(SAMPLE, z=np.zeros(40))
    y = problem.draw(2)
    _, sd, _ = problem.exact_moments(2)
    emulator = Beyond(problem, y + sd, 0.1 * sd)
    found = verify(
        problem.run, problem.inputs, problem.alpha, 0.0, y, MonteCarlo(), seed=0, emulator=emulator
    )
    assert np.any(found.surface_error > 0.0)
    assert np.all(found.near_error == 0.0)


def test_a_useless_control_is_no_worse_than_its_few_runs() -> None:
    y = SAMPLE.draw(2)
    truth = SAMPLE.log_density(SAMPLE.alpha, SAMPLE.z, y)
    found = [checked(SAMPLE, y, 5.0, seed) for seed in range(8)]
    pulls = [((one.each - truth) / one.each_error)[one.reached] for one in found]
    assert np.mean(np.concatenate(pulls) ** 2) < 4.0
    assert np.median([one.standard_error for one in found]) > 0.5


def test_experiments_far_from_where_the_control_has_them_are_contradicted() -> None:
    """Surfaces that are off by four standard deviations explain what the simulator does not."""
    problem = replace(SAMPLE, z=np.zeros(40))
    y = problem.draw(2)
    _, sd, _ = problem.exact_moments(2)
    found = verify(
        problem.run, problem.inputs, problem.alpha, 0.0, y + 4.0 * sd, MonteCarlo(), seed=0,
        emulator=Shifted(problem, 4.0 * sd),
    )  # fmt: skip
    assert np.mean(found.contradicted) > 0.5


def test_equal_conditions_share_their_runs() -> None:
    problem = replace(SAMPLE, z=np.zeros(60))
    y, runs = problem.draw(3), 0

    def run(index: NDArray[np.intp], x: Array) -> Array:
        nonlocal runs
        runs += index.size
        return problem.run(index, x)

    truth = problem.log_density(problem.alpha, problem.z, y).sum()
    pulls = []
    for seed in range(12):
        found = verify(
            run, problem.inputs, problem.alpha, 0.0, y, MonteCarlo(), seed=seed,
            emulator=Wrong(problem, 0.02, phase=0.0), condition=np.zeros(60, dtype=np.intp),
        )  # fmt: skip
        pulls.append((found.total - truth) / found.standard_error)
    assert runs == 12 * 8 * 20
    assert np.mean(np.square(pulls)) < 2.5


# ------------------------------------------------------------------------------ far out


@pytest.mark.parametrize("error", [None, 0.003])
@pytest.mark.parametrize("problem", [SAMPLE, GROWTH, FRONTIER, REGRESSION, PRODUCT], ids=title)
def test_an_outcome_far_out_is_verified_by_germs_drawn_there(
    problem: Problem, error: float | None
) -> None:
    """Four to five standard deviations out, where 512 samples of the law hold none."""
    y = problem.draw(2)
    mean, sd, _ = problem.exact_moments(2)
    y[3] = mean[3] + 4.5 * np.hypot(sd[3], problem.noise_sd)
    truth = problem.log_density(problem.alpha, problem.z, y)[3]
    assert truth < -5.0
    samples = 512 if error is None else None
    found = [checked(problem, y, error, seed, samples) for seed in range(8)]
    off = np.array([one.each[3] for one in found]) - truth
    told = np.array([one.each_error[3] for one in found])
    assert min(one.effective[3] for one in found) > 10.0
    assert np.mean((off / told) ** 2) < 4.0
    assert np.median(told) < 0.25


# ------------------------------------------------------------------------------ the score


def exact_score(problem: Problem, y: Array) -> Array:
    def total(alpha: Array) -> float:
        return float(problem.log_density(alpha, problem.z, y).sum())

    return np.asarray(optimize.approx_fprime(problem.alpha, total, 1e-6))


@pytest.mark.parametrize("error", [0.0, 0.01])
@pytest.mark.parametrize(
    "problem", [SAMPLE, GROWTH, SQUARE, BINDING, NOISY, REGRESSION, FRONTIER], ids=title
)
def test_the_score_is_that_of_the_exact_density(problem: Problem, error: float) -> None:
    problem = replace(problem, z=np.tile(problem.z, 6))
    y = problem.draw(4)
    truth = exact_score(problem, y)
    moving = problem.free
    steps = np.zeros(problem.alpha.size)
    steps[moving] = 0.01
    found = checked(problem, y, error, steps=steps).score
    assert found is not None
    size = np.sqrt(np.sum(found.each[:, moving] ** 2, axis=0))  # of a score, in a sample
    told = np.sqrt(np.diag(found.covariance))[moving]
    # five errors of eight copies, and the differences; without noise the score is that of the
    # emulator, whose error is up to a tenth of the scatter here
    off = 0.03 if problem.noise or error == 0.0 else 0.08
    assert np.all(np.abs(found.value[moving] - truth[moving]) < 5.0 * told + off * size)
    assert np.all(told < 0.3 * size)


def test_a_step_leads_from_a_wrong_estimate_to_the_maximum() -> None:
    """A mean and an sd half a standard error off: the step is minus that."""
    problem = replace(SAMPLE, z=np.zeros(200))
    y = problem.draw(5)
    error = y.std() / np.sqrt(np.array([200.0, 400.0]))
    wrong = np.array([y.mean(), y.std()]) + np.array([0.5, -0.5]) * error
    found = checked(problem, y, 0.003, steps=0.25 * error, alpha=wrong)
    assert found.score is not None
    step = movement(found.score, np.array([0, 1]), error)
    assert step is not None
    # the outer products of 200 scores, squares in the second, are a third too large here
    assert -0.6 < step.step[0] < -0.3 < 0.3 < step.step[1] < 0.6
    assert np.all(step.error < 0.01)


def test_no_score_is_told_without_steps_or_without_a_density() -> None:
    y = BINDING.draw(2)
    assert checked(BINDING, y, 0.0).score is None
    y[2] = 2.0 * BINDING.z[2]
    assert checked(BINDING, y, 0.0, steps=np.full(2, 0.01)).score is None


def test_candidates_are_looked_at_in_parts_that_change_nothing(monkeypatch) -> None:
    whole = checked(GROWTH, GROWTH.draw(3), 1e-3)
    monkeypatch.setattr(near, "TOGETHER", 5_000)
    parts = checked(GROWTH, GROWTH.draw(3), 1e-3)
    np.testing.assert_allclose(parts.each, whole.each, rtol=1e-12)
    np.testing.assert_allclose(parts.each_error, whole.each_error, rtol=1e-9)
