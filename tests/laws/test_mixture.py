"""A mixture against its components: densities, tails, derivatives by differences, images."""

import numpy as np
import pandas as pd
import pytest
from scipy import integrate, stats

from aleator import By, Free, Inputs, Normal
from aleator.errors import InputsError
from aleator.laws import Gamma, LogNormal, Mixture, TruncatedNormal

MEAN, SD = Free(-3.0, 8.0), Free(0.01, 4.0)
TWO = Mixture((Normal(MEAN, SD), Normal(MEAN, SD)))
ALIKE = np.array([0.5, 0.3, 2.0, 0.6, 0.3])
THREE = Mixture((Normal(MEAN, SD), LogNormal(Free(0.5, 8.0), SD), Gamma(Free(0.5, 8.0), SD)))
OTHERS = np.array([-1.0, 0.4, 1.5, 0.3, 4.0, 1.2, 0.2, 0.6])
THETA = np.linspace(-6.0, 6.0, 61)
BOTH = pytest.mark.parametrize(("law", "values"), [(TWO, ALIKE), (THREE, OTHERS)])


def test_the_density_is_the_weighted_sum():
    x = np.linspace(-1.0, 5.0, 50)
    wanted = 0.3 * stats.norm.pdf(x, 0.5, 0.3) + 0.7 * stats.norm.pdf(x, 2.0, 0.6)
    assert np.exp(TWO.log_density(ALIKE, x)) == pytest.approx(wanted, rel=1e-12)


@BOTH
def test_the_density_integrates_to_one(law, values):
    whole = integrate.quad(
        lambda x: np.exp(law.log_density(values, np.array([x])))[0], -8.0, 30.0, points=[0, 2, 4],
        limit=200,
    )  # fmt: skip
    assert whole[0] == pytest.approx(1.0, abs=1e-7)


@BOTH
def test_quantile_and_normal_score_are_each_others_inverse_far_into_the_tails(law, values):
    x = law.standard(values, THETA).x
    assert np.all(np.diff(x) > 0.0)
    assert law.normal_score(values, x) == pytest.approx(THETA, abs=1e-9)


@BOTH
def test_derivatives_are_those_of_differences(law, values):
    found, h = law.standard(values, THETA), 1e-6
    along = (law.standard(values, THETA + h).x - law.standard(values, THETA - h).x) / (2.0 * h)
    assert found.dtheta == pytest.approx(along, rel=1e-4, abs=1e-7)
    for k in range(values.size):
        move = h * np.eye(values.size)[k]
        ends = [law.standard(values + sign * move, THETA).x for sign in (1.0, -1.0)]
        difference = (ends[0] - ends[1]) / (2.0 * h)
        assert found.dvalues[:, k] == pytest.approx(difference, rel=1e-4, abs=1e-6)


def test_mean_and_sd_are_those_of_the_components():
    found = TWO.mean_and_sd(ALIKE)
    assert found.mean == pytest.approx(0.3 * 0.5 + 0.7 * 2.0, rel=1e-12)
    variance = 0.3 * (0.3**2 + 0.5**2) + 0.7 * (0.6**2 + 2.0**2) - found.mean**2
    assert found.sd == pytest.approx(variance**0.5, rel=1e-12)
    assert found.dmean == pytest.approx([0.3, 0.0, 0.7, 0.0, 0.5 - 2.0], abs=1e-8)


def test_each_share_is_of_what_the_components_before_it_leave():
    weights = np.exp(THREE.log_weights(OTHERS)[0])
    assert weights == pytest.approx([0.2, 0.48, 0.32])


def test_equal_components_are_put_in_order_without_a_change_of_the_law():
    law = Mixture((Normal(MEAN, SD),) * 3)
    values = np.array([4.0, 0.1, 0.0, 0.2, 2.0, 0.3, 0.5, 0.4])
    found = law.ordered(values)
    assert found[:6].tolist() == [0.0, 0.2, 2.0, 0.3, 4.0, 0.1]
    x = np.linspace(-1.0, 5.0, 40)
    assert law.log_density(found, x) == pytest.approx(law.log_density(values, x), rel=1e-12)


def test_components_that_differ_keep_their_places():
    assert THREE.ordered(OTHERS) is OTHERS
    known = Mixture((Normal(MEAN, SD), Normal(MEAN, SD)), shares=(0.3,))
    assert known.ordered(ALIKE) is ALIKE


def test_the_individual_image_has_a_part_for_each_class():
    inputs = Inputs({"a": TWO, "b": Normal(0.0, 1.0), "c": THREE})
    alpha = np.concatenate([ALIKE, [0.0, 1.0], OTHERS])
    xi = np.random.default_rng(0).standard_normal((3, 6 * 4, 3))
    found = inputs.individual(alpha, xi, slice(0, 3))
    assert np.exp(found.log_weight[0, ::4]).sum() == pytest.approx(1.0)
    assert np.exp(found.log_weight[0, 0]) == pytest.approx(0.3 * 0.2)
    # the last class: the last component of each
    last = found.x[:, 20:]
    assert last[..., 0] == pytest.approx(2.0 + 0.6 * xi[:, 20:, 0])
    assert np.all(last[..., 2] > 0.0)


@pytest.mark.parametrize("followed", [0, 1], ids=["mean", "share"])
def test_scores_are_those_of_differences_with_covariates_too(followed):
    by = [Normal(By("1 + t", -3.0, 8.0), SD), Normal(MEAN, SD)]
    law = Mixture((by[0], by[1])) if followed == 0 else Mixture(
        (Normal(MEAN, SD), Normal(MEAN, SD)), shares=(By("1 + t", 0.1, 0.9),)
    )  # fmt: skip
    table = pd.DataFrame({"t": [0.0, 0.5, 1.0, 1.5]})
    inputs = Inputs({"a": law, "b": Normal(MEAN, SD)}).resolved(table)
    mean, share = ([0.5, 0.2], [0.3]) if followed == 0 else ([0.5], [0.2, 0.1])
    alpha = np.array([*mean, 0.3, 2.0, 0.6, *share, 1.0, 0.5])
    rng = np.random.default_rng(1)
    xi, weight = rng.standard_normal((4, 6, 2)), rng.standard_normal((4, 6, 2))
    share_of = rng.random((4, 6))

    def summed(at):
        found = inputs.individual(at, xi, slice(0, 4))
        prior = np.broadcast_to(found.log_weight, share_of.shape)
        return np.sum(weight * found.x, axis=(1, 2)) + np.sum(share_of * prior, axis=1)

    score = inputs.individual(alpha, xi, slice(0, 4)).score(weight, share_of)
    h = 1e-6
    for k in range(alpha.size):
        move = h * np.eye(alpha.size)[k]
        difference = (summed(alpha + move) - summed(alpha - move)) / (2.0 * h)
        assert score[:, k] == pytest.approx(difference, abs=1e-6)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Mixture((Normal(0.0, 1.0),)),
        lambda: Mixture((Normal(0.0, 1.0), TWO)),
        lambda: Mixture((Normal(0.0, 1.0),) * 2, shares=(0.5, 0.5)),
        lambda: Mixture((Normal(0.0, 1.0),) * 2, shares=(Free(0.5, 1.5),)),
        lambda: Inputs({"a": TWO, "b": Normal(0.0, 1.0)}, {("a", "b"): 0.5}),
    ],
)
def test_what_is_no_mixture_is_refused(make):
    with pytest.raises(InputsError):
        make()


def test_a_mixture_of_bounded_laws_is_bounded_by_what_holds_them_all():
    law = Mixture(tuple(TruncatedNormal(box, sd=SD) for box in ((0.0, 1.0), (0.5, 3.0))))
    assert law.bounded
    assert law.box == (0.0, 3.0)
