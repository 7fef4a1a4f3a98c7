import numpy as np
import pytest
from normal_levels import judged
from scipy import stats

from aleator.core.types import Array
from aleator.results.values import Consistency, Statistic

N = 108
LOAD = np.tile([0.0, 1.0, 2.0], 36)
HOT = np.random.default_rng(0).permutation(np.repeat([20.0, 60.0, 100.0], 36))


def normal(seed: int) -> tuple[np.random.Generator, Array]:
    rng = np.random.default_rng(seed)
    return rng, rng.standard_normal(N)


def first(found: Consistency) -> tuple[str, str, str | None, float]:
    assert found.consistent is False
    test = found.discrepancies[0].test
    return test.kind, test.of, test.column, np.sign(test.z)


def test_right_models_are_seldom_called_wrong() -> None:
    verdicts = [judged(normal(seed)[1], seed, load=LOAD, hot=HOT) for seed in range(40)]
    assert sum(found.consistent is False for found in verdicts) <= 5
    assert np.mean([found.p for found in verdicts]) > 0.3
    assert sum(found.covariate is not None for found in verdicts) <= 5


def test_a_trend_is_named_with_its_direction() -> None:
    found = judged(normal(1)[1] - 0.02 * HOT, load=LOAD, hot=HOT)
    assert first(found) == ("contrast", "outcomes", "hot", -1.0)
    assert "`hot`" in found.discrepancies[0].message
    assert "smaller" in found.discrepancies[0].message
    assert "1 + hot" in found.discrepancies[0].remedy


def test_dependence_that_is_not_monotone_is_seen() -> None:
    found = judged(normal(2)[1] + 1.5 * (HOT == 60.0), load=LOAD, hot=HOT)
    assert first(found) == ("contrast", "outcomes", "hot", 1.0)
    assert found.discrepancies[0].test.where == "hot = 60"


def test_scatter_that_differs_is_seen() -> None:
    found = judged(normal(3)[1] * np.where(LOAD == 2.0, 3.0, 1.0), load=LOAD, hot=HOT)
    assert first(found)[1:] == ("scatter", "load", 1.0)


@pytest.mark.parametrize("seed", range(3))
def test_two_modes_are_seen(seed: int) -> None:
    rng, z = normal(seed)
    found = judged(rng.choice([-1.0, 1.0], N) + 0.4 * z, load=LOAD)
    assert first(found)[0] in {"light tails", "uniformity"}


def test_heavy_tails_and_their_outliers_are_seen() -> None:
    y = stats.t.rvs(2, size=N, random_state=4)
    found = judged(y, load=LOAD)
    assert found.consistent is False
    by_kind = {test.kind: test for test in found.tests if test.of == "outcomes"}
    assert by_kind["heavy tails"].corrected < 0.01 < 0.9 < by_kind["light tails"].p
    assert found.outliers[0].id == f"s{np.abs(y - y.mean()).argmax()}"


def test_one_gross_error_is_named() -> None:
    y = normal(5)[1]
    y[17] = 12.0
    found = judged(y, load=LOAD, hot=HOT)
    assert found.consistent is False
    assert found.outliers[0].id == "s17"


def test_repeated_subjects_are_told_with_the_remedy() -> None:
    rng, z = normal(6)
    subject = rng.permutation(np.repeat(np.arange(27), 4))
    found = judged(0.6 * z + rng.standard_normal(27)[subject], panel=[f"p{k}" for k in subject])
    assert first(found) == ("groups", "outcomes", "panel", 1.0)
    assert 'id = "panel"' in found.discrepancies[0].remedy


def test_a_drift_while_experiments_were_made_is_seen() -> None:
    found = judged(normal(7)[1] + 0.02 * np.arange(N), load=LOAD)
    assert first(found) == ("contrast", "outcomes", "the order of the rows", 1.0)


def test_a_table_that_was_sorted_by_its_outcomes_is_not_told_to_drift() -> None:
    y = np.sort(normal(8)[1].reshape(3, 36), axis=1).ravel()
    assert judged(y, hot=np.sort(HOT)).consistent


def test_a_table_without_any_column_or_order_is_judged_by_its_shape() -> None:
    assert judged(np.sort(normal(8)[1]), load=np.ones(N)).consistent


def test_a_coefficient_that_follows_a_condition_is_seen_in_its_hyperparameter() -> None:
    rng, z = normal(9)
    y = (z + 0.02 * HOT)[:, None] + 0.5 * rng.standard_normal((N, 4))
    assert first(judged(y, hot=HOT))[:3] == ("contrast", "a.mean", "hot")


def test_experiments_that_scatter_unequally_are_seen() -> None:
    named = 0
    for seed in range(10, 16):
        rng, z = normal(seed)
        y = z[:, None] + rng.choice([0.3, 0.9], (N, 1)) * rng.standard_normal((N, 4))
        found = judged(y)
        assert found.consistent is False
        named += found.discrepancies[0].test.kind == "unequal"
    assert named >= 3


def test_errors_that_depend_on_each_other_are_seen() -> None:
    rng, z = normal(11)
    steps = 0.5 * rng.standard_normal((N, 6))
    assert judged(z[:, None] + np.cumsum(steps, axis=1)).consistent is False


def test_the_same_seed_says_the_same() -> None:
    one, two = (judged(normal(12)[1], 5, load=LOAD) for _ in range(2))
    assert one == two


def test_few_observations_are_not_tested() -> None:
    found = judged(np.arange(4.0))
    assert found.consistent is None
    assert "4 observations" in found.reason


def test_trends_along_conditions_have_a_larger_share_than_parts_and_the_order() -> None:
    found = judged(normal(1)[1], hot=HOT)
    trend, part, order = (
        next(
            t
            for t in found.tests
            if (t.kind, t.of, t.column, t.where) == ("contrast", "outcomes", *at)
        )
        for at in (("hot", None), ("hot", "hot = 20"), ("the order of the rows", None))
    )

    def tests(statistic: Statistic) -> float:
        return float(np.log1p(-statistic.corrected) / np.log1p(-statistic.p))

    assert tests(trend) < 0.5 * tests(part)
    assert tests(order) > 2.0 * tests(trend)
