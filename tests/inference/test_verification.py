"""Monte Carlo log-densities against closed forms, and their standard errors against repetition."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from problems import BINDING, FRONTIER, GROWTH, NOISY, PRODUCT, SAMPLE, SQUARE, Problem, title
from scipy import special

from aleator import Inputs, MonteCarlo, Normal
from aleator.errors import InputsError
from aleator.inference.verification import Verification, verify
from aleator.types import Array


@dataclass
class Recording:
    """A simulator that remembers its runs."""

    problem: Problem
    index: list[NDArray[np.intp]] = field(default_factory=list)
    x: list[Array] = field(default_factory=list)

    def __call__(self, index: NDArray[np.intp], x: Array) -> Array:
        self.index.append(index)
        self.x.append(x)
        return self.problem.run(index, x)

    def of(self, experiment: int) -> Array:
        """The points (R, n) of an experiment."""
        return np.concatenate(self.x)[np.concatenate(self.index) == experiment]


def checked(
    problem: Problem,
    y: Array,
    samples: int = 512,
    seed: int = 0,
    run: Callable[[NDArray[np.intp], Array], Array] | None = None,
) -> Verification:
    return verify(
        run or problem.run,
        problem.inputs,
        problem.alpha,
        problem.noise_sd,
        y,
        MonteCarlo(samples),
        seed=seed,
        lower=problem.limits(problem.z)[0],
        upper=problem.limits(problem.z)[1],
    )


def pulls(problem: Problem, seeds: int, samples: int = 512) -> tuple[Array, Array]:
    """(estimate - exact)/error of every experiment and of the total, over seeds."""
    y = problem.draw(1)
    truth = problem.log_density(problem.alpha, problem.z, y)
    each, total = [], []
    for seed in range(seeds):
        found = checked(problem, y, samples, seed)
        each.append((found.each - truth) / found.each_error)
        total.append((found.total - truth.sum()) / found.standard_error)
    return np.array(each), np.array(total)


# ------------------------------------------------------------------------------ right


@pytest.mark.parametrize("problem", [SAMPLE, GROWTH, SQUARE, BINDING, PRODUCT], ids=title)
def test_the_kernel_route_agrees_with_the_closed_form(problem) -> None:
    y = problem.draw(2)
    truth = problem.log_density(problem.alpha, problem.z, y)
    found = checked(problem, y, 2048)
    # an error is estimated from eight copies: t with 7 degrees of freedom, 5 in a thousand
    assert np.all(np.abs(found.each - truth) < 5.0 * found.each_error)
    assert abs(found.total - truth.sum()) < 4.0 * found.standard_error
    assert found.total == pytest.approx(found.each.sum(), abs=1e-12)
    # ... and is of use: a third of what separates a good density from a poor one
    assert np.median(found.each_error) < 0.1


@pytest.mark.parametrize("problem", [NOISY, FRONTIER], ids=title)
def test_the_noise_route_agrees_with_the_closed_form_and_is_sharp(problem) -> None:
    y = problem.draw(2)
    truth = problem.log_density(problem.alpha, problem.z, y)
    found = checked(problem, y, 1024)
    assert np.all(np.abs(found.each - truth) < 5.0 * found.each_error)
    assert np.all(found.each_error < 0.01)


@pytest.mark.parametrize("problem", [NOISY, FRONTIER], ids=title)
def test_the_error_of_the_noise_route_is_calibrated(problem) -> None:
    """Pulls are Student's t with 7 degrees of freedom: their mean square is 7/5."""
    each, total = pulls(problem, 60, samples=64)
    # 420 squares of variance 2.2 * 1.4^2 each: 0.1 of standard error, if they were independent
    assert 0.9 < np.mean(each**2) < 2.0
    assert abs(np.mean(each)) < 0.2
    # the sum over seven experiments has 49 degrees of freedom: a mean square of 1.04
    assert 0.6 < np.mean(total**2) < 1.6


@pytest.mark.parametrize("problem", [SAMPLE, GROWTH, BINDING], ids=title)
def test_the_error_of_the_kernel_route_bounds_its_bias(problem) -> None:
    """The smoothing bias is added to the error, so that pulls are smaller than Student's."""
    each, total = pulls(problem, 30)
    # Student's t with 7 degrees of freedom has a mean square of 1.4. Where the two orders agree by
    # chance the bound of the bias vanishes, and with it the allowance: one outcome in seven here
    assert np.mean(each**2) < 2.5
    assert np.mean(np.abs(each) < 2.5) > 0.9
    assert np.mean(total**2) < 2.0
    # an error many times too large would be no error
    assert np.median(np.abs(each)) > 0.15


def test_a_density_that_ends_abruptly_is_not_smeared_over_its_edge() -> None:
    """At an edge a symmetric kernel sees half of the density: log f would be 0.69 too low."""
    share = np.array([0.0, 1e-3, 0.02, 0.1, 0.5, 0.9, 0.98, 0.999, 1.0])
    problem = replace(BINDING, z=np.full(9, 1.5))
    truth = problem.log_density(problem.alpha, problem.z, problem.z * share)
    found = [checked(problem, problem.z * share, 2048, seed) for seed in range(20)]
    off = np.array([one.each for one in found]) - truth
    error = np.array([one.each_error for one in found])
    # twenty repetitions: the mean is known to a quarter of the error of one
    assert np.all(np.abs(off.mean(axis=0)) < error.mean(axis=0))
    assert np.all(error.mean(axis=0) < 0.25)
    assert 0.3 < np.mean((off / error) ** 2) < 2.5


def test_more_samples_give_a_smaller_error() -> None:
    y = NOISY.draw(3)
    errors = [checked(NOISY, y, samples).standard_error for samples in (64, 512, 4096)]
    # randomized quasi-Monte Carlo of a smooth function: faster than the square root, which is 64
    assert errors[0] > 4.0 * errors[1] > 16.0 * errors[2]


def test_an_outcome_that_the_law_does_not_reach_has_no_density() -> None:
    y = BINDING.draw(4)
    y[3] = 3.0 * BINDING.z[3]
    found = checked(BINDING, y)
    assert found.each[3] == -np.inf or found.each[3] < -50.0
    assert np.isfinite(np.delete(found.each, 3)).all()


def test_a_wrong_density_is_seen() -> None:
    """A log-density that is 0.3 off, at four in a hundred noise, is ten errors off."""
    y = NOISY.draw(5)
    wrong = NOISY.log_density(NOISY.alpha * np.array([1.2, 1.0, 1.0]), NOISY.z, y)
    found = checked(NOISY, y, 1024)
    assert abs(found.total - wrong.sum()) > 5.0 * found.standard_error


# ------------------------------------------------------------------------------ reproducible


def test_a_seed_gives_the_same_and_another_seed_other_points() -> None:
    y = GROWTH.draw(6)
    one, two, other = (Recording(GROWTH) for _ in range(3))
    found = [
        checked(GROWTH, y, seed=s, run=r) for s, r in zip((1, 1, 2), (one, two, other), strict=True)
    ]
    np.testing.assert_array_equal(found[0].each, found[1].each)
    np.testing.assert_array_equal(one.of(0), two.of(0))
    assert not np.array_equal(one.of(0), other.of(0))


def test_points_are_of_the_law() -> None:
    y, runs = PRODUCT.draw(7), Recording(PRODUCT)
    found = checked(PRODUCT, y, run=runs)
    mean, sd, _ = PRODUCT.exact_moments(2)
    outcomes = np.array([PRODUCT.run(np.full(512, l), runs.of(l)) for l in range(7)])
    # 512 points of quasi-Monte Carlo: a hundredth of a standard deviation
    np.testing.assert_allclose(outcomes.mean(axis=1), mean, atol=0.02 * sd.max())
    np.testing.assert_allclose(found.scatter, sd, rtol=0.05)


def test_every_experiment_has_points_of_its_own() -> None:
    """Equal conditions get different points, so that errors of a sum are independent."""
    problem = replace(SAMPLE, z=np.zeros(4))
    runs = Recording(problem)
    checked(problem, problem.draw(8), run=runs)
    assert not np.array_equal(runs.of(0), runs.of(1))


# ------------------------------------------------------------------------------ the choice


@pytest.mark.parametrize("samples", [1, 15, -5])
def test_too_few_samples_are_refused(samples) -> None:
    with pytest.raises(InputsError, match="samples"):
        MonteCarlo(samples)


def test_samples_are_rounded_up_to_eight_times_a_power_of_two() -> None:
    assert not MonteCarlo(0).wanted
    assert MonteCarlo(16).points == 8
    for samples, points in ((50, 8), (64, 8), (65, 16), (1000, 128), (1024, 128), (1025, 256)):
        assert MonteCarlo(samples).points == points
        assert 8 * MonteCarlo(samples).points >= samples


def test_the_error_tells_of_an_edge_that_nobody_told_of() -> None:
    """Outcomes uniform on (0, 1): near an edge a kernel sees half, and its error says so.

    By half of the difference of two orders alone pulls had a root mean square of 15.
    """
    y = np.array([0.01, 0.02, 0.03, 0.05, 0.08, 0.2, 0.5])
    inputs = Inputs({"x": Normal(0.0, 1.0)})
    found = [
        verify(
            lambda _, x: special.ndtr(x[:, 0]), inputs, np.array([0.0, 1.0]), 0.0, y,
            MonteCarlo(1024), seed=seed,
        )
        for seed in range(10)
    ]  # fmt: skip
    each = np.array([one.each / one.each_error for one in found])
    assert np.all(np.sqrt(np.mean(each**2, axis=0)) < 3.0)
    assert abs(np.mean([one.total / one.standard_error for one in found])) < 2.0
    # in the middle nothing is smeared
    assert np.mean([one.each_error[-1] for one in found]) < 0.01
