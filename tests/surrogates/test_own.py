"""Surfaces that are sharpened where a law is: nested runs, honest errors, nothing lost."""

import numpy as np
import pytest

from aleator.core.types import Array, Indices
from aleator.simulators.response_functions import Run
from aleator.surrogates.emulator import OwnSurfaces
from aleator.surrogates.fit import SmoothnessPrior, continued, judged, shares, spread, weights
from aleator.surrogates.samples import Samples
from aleator.surrogates.surface import products

BOX = np.tile([0.0, 1.0], (2, 1))


def waves(index: Indices, x: Array) -> Array:
    return np.cos(6.0 * x[:, 0] + 4.0 * x[:, 1] + index)


def law(count: int = 256, sd: float = 0.06) -> Array:
    return np.array([0.4, 0.6]) + sd * np.random.default_rng(1).standard_normal((count, 2))


def first(run: Run, experiments: int) -> OwnSurfaces:
    """Surfaces of a dozen runs all over the box."""
    return OwnSurfaces(run, BOX, Samples.none(experiments, 2), 12)


def true_error(state: OwnSurfaces, x: Array, experiments: int) -> Array:
    surface = state.surface(np.ones(experiments, dtype=np.bool_))
    truth = waves(np.repeat(np.arange(experiments), len(x)), np.tile(x, (experiments, 1)))
    return np.sqrt(((surface.evaluate(x) - truth.reshape(experiments, -1)) ** 2).mean(axis=1))


# ------------------------------------------------------------------------------ points


def test_points_continue_where_the_draws_are() -> None:
    known, draws = spread(12, 2), np.clip(law(512) * 2.0 - 1.0, -1.0, 1.0)
    more = continued(known, draws, 20)
    assert np.array_equal(continued(known, draws, 10), more[:10])
    near = np.linalg.norm(more - draws.mean(axis=0), axis=1) / draws.std()
    assert (near < 5.0).all()
    assert np.median(near) > 0.5  # spread over the law, not heaped in its middle
    every = np.vstack([known, more])
    distance = np.linalg.norm(every[:, None] - every, axis=2)
    assert distance[~np.eye(32, dtype=np.bool_)].min() > 0.01


def test_shares_of_a_law_are_those_of_its_points() -> None:
    points = np.array([[-0.5], [0.5]])
    assert shares(points, np.array([[-0.9], [-0.1], [0.2], [0.3]])).tolist() == [0.5, 0.5]


# ------------------------------------------------------------------------------ errors


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_the_error_at_points_is_that_of_outcomes_drawn_from_the_prior(noise: float) -> None:
    prior = SmoothnessPrior((1.0, 1.6), 2.0, 2.5, 0.25, noise)
    z, at = spread(25, 2), 2.0 * law() - 1.0
    random = np.random.default_rng(0)
    indices, weight = weights(prior, 25)
    draw = np.where(weight > 1.0, 3.0, weight)[:, None] * random.normal(size=(len(weight), 2000))
    y = products(indices, z).T @ draw + noise * random.normal(size=(25, 2000))
    fit = judged(prior, z, y, at)
    true = products(indices, at).T @ (fit.coefficients - draw)
    assert (fit.there**2).mean() == pytest.approx((true**2).mean(), rel=0.1)
    assert fit.expected == pytest.approx(judged(prior, z, y).expected)


def test_errors_fall_where_the_law_is_and_are_told() -> None:
    where = law()
    state = first(waves, 6)
    errors = []
    for _ in range(5):
        state.judge(where)
        errors.append(state.error.copy())
        # of a dozen runs all over the box the estimate is up to three times too small
        factor = 1.5 if len(errors) > 1 else 3.0
        assert (true_error(state, where, 6) < factor * state.error).mean() > 0.8
        state.sharpen(np.arange(6), law(512, 0.08), 0.3, 1000)
    assert (errors[-1] < 0.1 * errors[0]).all()
    assert state.scatter == pytest.approx(
        waves(np.repeat(np.arange(6), 256), np.tile(where, (6, 1))).reshape(6, -1).std(axis=1),
        rel=0.05,
    )
    everywhere = np.random.default_rng(3).random((500, 2))
    assert (true_error(state, everywhere, 6) > 3.0 * true_error(state, where, 6)).all()


# ------------------------------------------------------------------------------ runs


def test_runs_inside_serve_another_region_and_none_is_repeated() -> None:
    asked: list[tuple[int, bytes]] = []

    def run(index: Indices, x: Array) -> Array:
        asked.extend(zip(index.tolist(), [row.tobytes() for row in x], strict=True))
        return waves(index, x)

    state = first(run, 2)
    state.sharpen(np.array([1]), law(512), 0.5, 1000)
    narrow = np.array([[0.2, 0.7], [0.3, 0.9]])
    inside = state.samples.inside(narrow)
    assert 0 < len(inside.x) < len(state.samples.x)
    state.move(narrow)
    state.judge(law())
    assert np.isfinite(state.error[1])
    state.sharpen(np.arange(2), law(512), 0.3, 1000)
    assert len(state.samples.inside(narrow).x) > len(inside.x)
    state.move(BOX)
    assert len(asked) == len(set(asked)) == state.runs.sum()
    assert state.runs[1] > state.runs[0]


def test_a_hole_raises_the_error_of_a_law_that_lies_in_it_only() -> None:
    def run(index: Indices, x: Array) -> Array:
        return np.where(np.all(x > 0.6, axis=1), np.nan, waves(index, x))

    whole, holed = (first(function, 2) for function in (waves, run))
    for state in (whole, holed):
        state.sharpen(np.arange(2), np.random.default_rng(0).random((512, 2)), 2.0, 1000)
    corner, away = law() + np.array([0.4, 0.2]), law() - np.array([0.1, 0.3])
    for where, factor in ((corner, 3.0), (away, 0.5)):
        whole.judge(where)
        holed.judge(where)
        assert (holed.error > factor * whole.error).all()
    assert (holed.error < 2.0 * whole.error).all()
    failed = holed.surface(np.ones(2, dtype=np.bool_)).failed
    assert (failed > 0).all()


def test_samples_tell_what_failed_from_what_was_never_run() -> None:
    none = Samples.none(2, 2)
    places = np.arange(3)
    some = none.joined(law(3), np.ones(3, dtype=np.intp), places, np.array([1.0, np.nan, 2.0]))
    assert some.runs.tolist() == [0, 3]
    assert some.failed.tolist() == [0, 1]
    index, x, outcome = some.listed
    assert index.tolist() == [1, 1]
    assert np.array_equal(x, law(3)[[0, 2]])
    assert outcome.tolist() == [1.0, 2.0]
