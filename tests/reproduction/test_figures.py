"""Figures of the paper that take little time, and the parts of those that take long."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from aleator.laws.quadrature import TensorGauss
from reproduction.canvas import drawn
from reproduction.clutch.reference import expansion_moments, node_outcomes
from reproduction.clutch.response import density, grid, masses
from reproduction.clutch.study import GIVEN, SHOWN, ClutchStudy
from reproduction.context import Context
from reproduction.figures import chosen

QUICK = (
    "sets",
    "illustrative-transform",
    "illustrative-coefficients",
    "clutch-pressure",
    "clutch-position",
    "clutch-speed",
    "clutch-clipped",
)


@pytest.fixture(scope="module")
def context() -> Context:
    return Context(seed=0)


@pytest.mark.parametrize("name", QUICK)
def test_a_figure_has_tables_claims_and_a_drawing(name: str, context: Context) -> None:
    (figure,) = chosen([name])
    result = figure.make(context)
    assert len(result.tables[""]) > 0
    assert result.claims
    assert all(claim.statement and claim.paper and claim.ours for claim in result.claims)
    assert drawn(result, figure.title).axes


def test_the_sets_have_the_numbers_of_the_paper(context: Context) -> None:
    result = chosen(["sets"])[0].make(context)
    table, walk = result.tables[""], result.tables["push-fork"]
    indices = table.drop(columns="nonzero").to_numpy()
    assert indices.shape == (2002, 10)
    assert set(indices.sum(axis=1)) == {5}
    assert len(np.unique(indices, axis=0)) == 2002
    assert len(walk) == 56  # C(8, 5)
    assert walk["made_by"].value_counts().sum() == 56


def test_the_transition_and_the_plates_follow_the_papers_equations(context: Context) -> None:
    course = chosen(["clutch-position"])[0].make(context).tables[""]
    z = course["piston_mm"]
    assert (course["transition"][z <= 1.32] == 0.0).all()
    assert (course["transition"][z >= 2.0] == 1.0).all()
    pressure = chosen(["clutch-pressure"])[0].make(context).tables[""]
    share = ((z - 1.32) / (2.0 - 1.32)).clip(0.0, 1.0)
    np.testing.assert_allclose(
        pressure["plate_pressure_bar"], share * pressure["pressure_bar"], atol=1e-9
    )


def test_the_clipped_density_integrates_to_one_and_ends_at_the_box() -> None:
    study, alpha = ClutchStudy(), np.array([1.0, 0.25, 0.9, 0.25])
    x = grid(study.box, 401)
    cell = np.prod(np.diff(study.box, axis=1)) / 400**2
    assert density(study, alpha, x).sum() * cell == pytest.approx(1.0, abs=0.01)
    assert density(study, alpha, np.array([[1.0, 1.21]]))[0] == 0.0
    expected = norm.cdf(1.4, 1.0, 0.25) - norm.cdf(0.5, 1.0, 0.25)
    assert masses(study.box, alpha)[0] == pytest.approx(expected, rel=1e-12)


def test_the_papers_expansion_takes_25_runs_and_agrees_with_its_coefficients() -> None:
    study, one = ClutchStudy(), np.array([SHOWN - 1])
    y = node_outcomes(study, GIVEN, one)
    assert y.shape == (1, 25)
    nodes = TensorGauss(5).nodes(study.law("hermite"), GIVEN)
    found = expansion_moments(study, GIVEN, one)
    assert found.mean[0] == pytest.approx(float(y[0] @ nodes.weights), rel=1e-12)
    # projection: the variance of the expansion is at most that of the quadrature
    variance = float((y[0] - found.mean[0]) ** 2 @ nodes.weights)
    assert 0.9 * variance < found.sd[0] ** 2 <= variance
