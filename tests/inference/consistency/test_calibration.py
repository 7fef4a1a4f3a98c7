import numpy as np
import pytest
from scipy import stats

from aleator.inference.consistency.judged import corrected, effective, probabilities

NONE = np.zeros(1, dtype=bool)
ZERO = np.zeros(1)


def test_probabilities_of_normal_statistics_are_those_of_student() -> None:
    rng = np.random.default_rng(1)
    replicates = rng.normal(3.0, 2.0, (50, 1))
    p, _, _ = probabilities(np.array([9.0]), replicates, NONE, NONE, ZERO)
    t = (9.0 - replicates.mean()) / (replicates.std(ddof=1) * np.sqrt(1.0 + 1.0 / 50))
    assert p[0] == pytest.approx(2.0 * stats.t.sf(t, 49))


def test_each_replicate_is_judged_by_the_others() -> None:
    rng = np.random.default_rng(2)
    replicates = rng.normal(size=(40, 3))
    none = np.zeros(3, dtype=bool)
    _, own, _ = probabilities(np.zeros(3), replicates, none, none, np.zeros(3))
    others = replicates[1:]
    alone, _, _ = probabilities(replicates[0], others, none, none, np.zeros(3))
    assert own[0] == pytest.approx(alone)


@pytest.mark.parametrize("freedom", [3, 10])
def test_tails_of_skewed_statistics_are_right_within_a_third(freedom: int) -> None:
    rng = np.random.default_rng(3)
    replicates = rng.chisquare(freedom, (4000, 1))
    for level in (0.05, 0.001):
        at = np.array([stats.chi2.isf(level, freedom)])
        p, _, _ = probabilities(at, replicates, ~NONE, ~NONE, ZERO)
        assert p[0] == pytest.approx(level, rel=0.34)


def test_statistics_that_do_not_scatter_say_nothing() -> None:
    p, own, z = probabilities(np.array([5.0]), np.full((40, 1), 2.0), NONE, NONE, ZERO)
    assert (p[0], own[0, 0], z[0]) == (1.0, 1.0, 0.0)


def test_what_hardly_scatters_is_judged_as_if_it_did() -> None:
    replicates = np.random.default_rng(6).normal(0.0, 1e-4, (60, 1))
    at = np.array([1e-3])
    assert probabilities(at, replicates, NONE, NONE, ZERO)[0][0] < 1e-6
    assert probabilities(at, replicates, NONE, NONE, np.array([0.05]))[0][0] > 0.9


@pytest.mark.parametrize("copies", [1, 4])
def test_copies_of_a_test_do_not_count(copies: int) -> None:
    rng = np.random.default_rng(4)
    p = np.repeat(rng.random((2000, 10)), copies, axis=1)
    assert effective(p.min(axis=1)) == pytest.approx(10.0, rel=0.1)


def test_the_smallest_of_independent_p_is_corrected_as_sidak_does() -> None:
    assert corrected(np.array([0.01]), 5.0)[0] == pytest.approx(1.0 - 0.99**5)
