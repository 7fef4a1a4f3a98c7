"""The scoring step against its definition, J^-1 (s + prior) by a general solver."""

from __future__ import annotations

import numpy as np

from aleator.likelihood.scoring import scoring_step


def test_the_step_solves_the_equations_of_scores_and_prior() -> None:
    rng = np.random.default_rng(8)
    scores, prior = rng.normal(size=(40, 3)) * [1.0, 1e3, 1e-4], np.array([0.3, -200.0, 2e-5])
    information = scores.T @ scores
    errors = np.sqrt(np.diag(np.linalg.inv(information)))
    for of_prior, whole in ((None, scores.sum(axis=0)), (prior, scores.sum(axis=0) + prior)):
        found = scoring_step(scores, of_prior)
        assert found is not None
        step = np.linalg.solve(information, whole)
        np.testing.assert_allclose(found.step, step, rtol=1e-9)
        np.testing.assert_allclose(found.in_standard_errors, step / errors, rtol=1e-9)


def test_scores_that_hang_together_have_no_step() -> None:
    scores = np.random.default_rng(9).normal(size=(40, 2))
    assert scoring_step(np.column_stack([scores, scores @ [2.0, -1.0]])) is None
    assert scoring_step(np.column_stack([scores, np.zeros(40)])) is None
