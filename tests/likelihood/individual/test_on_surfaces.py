import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from individual_cases import ALPHA, PAIR, likelihood_of, straight_line, table

from aleator.likelihood.individual import Layout, OnSurfaces
from aleator.likelihood.individual.predictors import PREDICTORS
from aleator.surrogates import build_surface
from aleator.surrogates.surface import Axes, Group, Surface, ball, products_with_gradient

REGION = np.array([[-6.0, 9.0], [-4.0, 3.0]])


def on_surfaces(frame, model, region=REGION):
    """Surfaces of every row, exact all over the region."""
    time = frame["time"].to_numpy()
    surface = build_surface(lambda index, x: model(time[index], x.T), region, len(frame))
    direct = likelihood_of(model, frame)
    rows = np.concatenate([block.units[block.place] for block in direct.blocks])
    return direct, OnSurfaces(surface, region, rows)


def bent(time, x):
    return x[0] + x[1] * time + 0.1 * x[0] * x[1]


def steep(time, x):
    return np.exp(0.2 * bent(time, x))


@pytest.mark.parametrize(("model", "logarithmic"), [(bent, False), (steep, True)])
def test_surfaces_of_a_polynomial_give_its_values_and_slopes(model, logarithmic):
    frame = table(model)
    direct, surfaces = on_surfaces(frame, model)
    assert np.all(surfaces.surface.logarithmic == logarithmic)
    (block,) = direct.blocks
    x = np.random.default_rng(1).uniform(*REGION.T, (len(block), 5, 2))
    value, slopes = surfaces.with_slopes(block, x)
    wanted, slope = direct.predictor.with_slopes(block, x)
    assert value == pytest.approx(wanted, rel=1e-9, abs=1e-9)
    assert slopes == pytest.approx(slope, rel=1e-6, abs=1e-6)
    assert surfaces.values(block, x) == pytest.approx(value)


def test_surfaces_of_a_logarithm_have_slopes_by_the_parameter():
    region = np.array([[0.1, 9.0], [-4.0, 3.0]])
    frame = table(straight_line)
    _, surfaces = on_surfaces(frame, lambda time, x: (2.0 + time) * np.log(x[0]) + x[1], region)
    assert surfaces.surface.axes.logarithmic.tolist() == [True, False]
    (block,) = likelihood_of(straight_line, frame).blocks
    x = np.random.default_rng(1).uniform(*region.T, (len(block), 5, 2))
    time = frame["time"].to_numpy()[surfaces.of[block.rows], None]
    slopes = surfaces.with_slopes(block, x)[1]
    assert slopes[0] == pytest.approx((2.0 + time) / x[block.owner, :, 0], rel=1e-6)
    assert slopes[1] == pytest.approx(1.0, rel=1e-6)


def test_beyond_the_region_a_surface_is_flat():
    frame = table(bent)
    direct, surfaces = on_surfaces(frame, bent)
    (block,) = direct.blocks
    beyond = np.full((len(block), 1, 2), 1.0)
    beyond[..., 0] = 20.0
    inside = beyond.copy()
    inside[..., 0] = REGION[0, 1]
    value, slopes = surfaces.with_slopes(block, beyond)
    assert value == pytest.approx(surfaces.values(block, inside))
    assert np.all(slopes[0] == 0.0)
    assert np.any(slopes[1] != 0.0)


def test_experiments_of_which_nothing_was_observed_have_no_values():
    frame = table(bent)
    direct, surfaces = on_surfaces(frame, bent)
    old = direct.layout
    layout = Layout(old.count + 2, old.experiment, old.unit, old.column)
    one_by_one = replace(surfaces, settings=replace(PREDICTORS, basis=1))
    (block,) = layout.blocks(5)
    x = np.random.default_rng(1).uniform(*REGION.T, (len(block), 5, 2))
    value, slopes = one_by_one.with_slopes(block, x)
    assert value == pytest.approx(direct.predictor.values(block, x), rel=1e-9, abs=1e-9)
    assert slopes.shape == (2, *value.shape)


def test_the_likelihood_on_surfaces_is_that_of_the_simulator():
    frame = table(straight_line)
    direct, surfaces = on_surfaces(frame, straight_line)
    again = type(direct).of(PAIR, direct.errors, surfaces, direct.layout, direct.rule)
    wanted, found = direct.adapted(ALPHA)(ALPHA), again.adapted(ALPHA)(ALPHA)
    assert found.each == pytest.approx(wanted.each, abs=1e-6)
    assert found.scores == pytest.approx(wanted.scores, abs=1e-4)


def test_surfaces_of_many_terms_are_summed_in_the_memory_of_few():
    # 153 terms of two parameters are 17 sums over one of them: two times 17 basis functions.
    rng, nodes, experiments = np.random.default_rng(4), 400, 7
    indices = ball((1.0, 1.0), 1.0, 153)[0]
    axes, none = Axes.plain(REGION), np.zeros(experiments)
    coefficients = rng.standard_normal((experiments, len(indices)))
    every = np.arange(experiments)
    surface = Surface(
        axes, indices, (Group(every, coefficients),), none, none, none == 0.0, 0 * every, 0 * every,
        none > 0.0,
    )  # fmt: skip
    (block,) = Layout(experiments, every, every, 0 * every).blocks(nodes)
    surfaces = OnSurfaces(surface, REGION, every)
    x = rng.uniform(*REGION.T, (experiments, nodes, 2))
    surfaces.values(block, x)
    tracemalloc.start()
    value, slopes = surfaces.with_slopes(block, x)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    for k in range(experiments):
        legendre = products_with_gradient(indices, axes.inward(x[k]))
        wanted = np.einsum("p,pdj->dj", coefficients[k], legendre)
        wanted[1:] *= axes.rates(x[k]).T
        assert value[k] == pytest.approx(wanted[0], rel=1e-9, abs=1e-9)
        assert slopes[:, k] == pytest.approx(wanted[1:], rel=1e-9, abs=1e-8)
    assert peak < 2.0 * len(indices) * x[..., 0].nbytes
