"""Bounds of predictions where hyperparameters are only bounded, against closed forms."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy import stats

from aleator import (
    AleatorError,
    Between,
    Check,
    Constant,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    PBox,
    identify,
    load,
    p_box,
    plot,
)
from aleator.cli import main
from aleator.study import load_study

LEVELS = (0.01, 0.1, 0.5, 0.9, 0.99)
Z = stats.norm.ppf(LEVELS)
END = np.sqrt(stats.chi2.ppf(0.95, 1))


def line(load: Any, a: Any, b: Any) -> Any:
    return a * load + b


def ends(box: PBox, levels: tuple[float, ...] = LEVELS, **how: Any) -> tuple[Any, Any]:
    band = box.quantiles(levels, **how)
    return band["lower"].to_numpy(), band["upper"].to_numpy()


# --------------------------------------------------------------------------- without experiments


@pytest.fixture(scope="module")
def two_laws() -> PBox:
    """y = 2 a + b of normal laws: the mean and the sd of a, and the mean of b are bounded."""
    laws = {"a": Normal(Between(0.9, 1.1), Between(0.1, 0.2)), "b": Normal(Between(0.0, 0.5), 0.3)}
    return p_box(line, pd.DataFrame({"load": [2.0]}), Inputs(laws), vectorized=True)


SD = np.sqrt(4.0 * np.array([0.1, 0.2]) ** 2 + 0.3**2)
"""The least and the largest standard deviation of the outcome; its mean is 1.8 to 2.7."""


def test_the_band_of_a_sum_of_normal_laws_is_the_known_one(two_laws: PBox) -> None:
    low, high = ends(two_laws)
    assert low == pytest.approx(1.8 + np.where(Z < 0.0, SD[1], SD[0]) * Z, abs=0.02)
    assert high == pytest.approx(2.7 + np.where(Z < 0.0, SD[0], SD[1]) * Z, abs=0.02)


@pytest.mark.parametrize("limit", [1.0, 2.3, 4.0])
def test_the_bounds_of_a_probability_are_the_known_ones(two_laws: PBox, limit: float) -> None:
    corners = [stats.norm.sf(limit, mean, sd) for mean in (1.8, 2.7) for sd in SD]
    found = two_laws.probability(f"outcome > {limit}").loc[0]
    assert abs(found["lower"] - min(corners)) < 4.0 * found["error"] + 1e-9
    assert abs(found["upper"] - max(corners)) < 4.0 * found["error"] + 1e-9


def test_an_event_between_values_is_most_probable_inside_the_bounds(two_laws: PBox) -> None:
    """P(2.2 < y < 2.4) is largest for the mean 2.3, which is not at a corner."""
    found = two_laws.probability("2.2 < outcome < 2.4").loc[0]
    largest = 2.0 * stats.norm.cdf(0.1, 0.0, SD[0]) - 1.0
    assert found["upper"] == pytest.approx(largest, abs=4.0 * found["error"] + 0.005)
    means = np.array([1.8, 2.7])[:, None]
    corners = stats.norm.cdf(2.4, means, SD) - stats.norm.cdf(2.2, means, SD)
    assert found["lower"] == pytest.approx(corners.min(), abs=4.0 * found["error"] + 0.005)


def test_what_a_known_bound_would_be_worth_is_told(two_laws: PBox) -> None:
    """The width of the median is 0.9: 0.4 of a.mean, 0.5 of b.mean."""
    found = two_laws.pinched(quantile=0.5).set_index("pinched")
    assert found["width"].tolist() == pytest.approx([0.5, 0.9, 0.4], abs=0.01)
    assert found["reduction"].tolist() == pytest.approx([4.0 / 9.0, 0.0, 5.0 / 9.0], abs=0.01)
    assert found["at"].tolist() == pytest.approx([1.0, 0.15, 0.25])
    assert ends(two_laws.pinned("b.mean", 0.5), (0.5,))[0] == pytest.approx([2.3], abs=0.01)


def test_an_interval_goes_through_a_simulator_with_its_ends_or_with_its_peak() -> None:
    table, interval = pd.DataFrame({"load": [1.0, 2.0]}), Inputs({"b": Constant(Between(0.1, 0.8))})
    rising = p_box(lambda load, b: load * np.exp(b), table, interval, vectorized=True)
    low, high = ends(rising, (0.5,))
    assert low == pytest.approx([np.exp(0.1), 2.0 * np.exp(0.1)])
    assert high == pytest.approx([np.exp(0.8), 2.0 * np.exp(0.8)])
    peaked = p_box(lambda load, b: load * b * (1.0 - b), table, interval, vectorized=True)
    low, high = ends(peaked, (0.5,))
    assert low == pytest.approx([0.09, 0.18])
    assert high == pytest.approx([0.25, 0.5], rel=1e-3)


def test_noise_widens_the_band_and_may_be_bounded_itself() -> None:
    inputs = Inputs({"b": Constant(Between(0.0, 1.0))})
    table = pd.DataFrame({"load": [1.0]})
    box = p_box(lambda load, b: load * b, table, inputs, noise=Noise(Between(0.1, 0.3)))
    low, high = ends(box)
    assert box.names == ("b.value", "noise.sd")
    assert low == pytest.approx(np.where(Z < 0.0, 0.3, 0.1) * Z, abs=0.01)
    assert high == pytest.approx(1.0 + np.where(Z < 0.0, 0.1, 0.3) * Z, abs=0.01)


# --------------------------------------------------------------------------- with experiments


def drawn(loads: Any, seed: int = 3) -> pd.DataFrame:
    rng, loads = np.random.default_rng(seed), np.asarray(loads)
    y = loads * rng.normal(2.0, 0.3, loads.size) + 1.4 + rng.normal(0.0, 0.1, loads.size)
    return pd.DataFrame({"load": loads, "y": y})


def identified(table: pd.DataFrame, laws: dict[str, Any], **how: Any) -> Identification:
    how = {"noise": Noise(0.1), "vectorized": True, "consistency": False, "best_law": False, **how}
    return identify(line, table, Inputs(laws), outcome="y", verification=Check(0), **how)


ALIKE = drawn(np.ones(25))
"""Experiments that tell only the sum a + b."""
LAWS = {"a": Normal(Free(-5.0, 5.0), Free(0.01, 2.0)), "b": Constant(Between(1.0, 2.0))}


@pytest.fixture(scope="module")
def unseen() -> PBox:
    """The bounds of b are not narrowed: for each b the mean of a is that of y, minus b."""
    return identified(ALIKE, LAWS).p_box(pd.DataFrame({"load": [3.0]}), noise=False)


def test_the_others_are_identified_again_for_each_bounded_value(unseen: PBox) -> None:
    """y at load 3 is 3 (m - b) + b, with sd 3 s: the maximum of the likelihood in closed form."""
    mean, sd = ALIKE["y"].mean(), np.sqrt(ALIKE["y"].var(ddof=0) - 0.01)
    low, high = ends(unseen, uncertainty=False)
    assert low == pytest.approx(3.0 * mean - 4.0 + 3.0 * sd * Z, abs=0.02)
    assert high == pytest.approx(3.0 * mean - 2.0 + 3.0 * sd * Z, abs=0.02)
    event = unseen.probability("y > 8", uncertainty=False).loc[0]
    exact = stats.norm.sf(8.0, 3.0 * mean - np.array([4.0, 2.0]), 3.0 * sd)
    assert event[["lower", "upper"]].to_numpy(float) == pytest.approx(exact, abs=0.01)
    assert event["at upper"] == "b.value = 1"


def test_the_outer_bounds_are_those_of_the_profile_likelihood(unseen: PBox) -> None:
    """The profile interval of a mean with unknown sd is m -+ s sqrt(exp(3.84/n) - 1)."""
    band = unseen.quantiles((0.5,)).loc[0]
    mean, size = ALIKE["y"].mean(), len(ALIKE)
    half = ALIKE["y"].std(ddof=0) * np.sqrt(np.expm1(END**2 / size))
    assert band["lowest"] == pytest.approx(3.0 * (mean - half) - 4.0, abs=0.02)
    assert band["highest"] == pytest.approx(3.0 * (mean + half) - 2.0, abs=0.02)


def test_experiments_that_tell_the_bounded_value_narrow_the_band() -> None:
    """Loads of zero measure b: b is within 1.96 x 0.1/2 of their mean; all is a known normal."""
    table = pd.concat([ALIKE, drawn(np.zeros(4))], ignore_index=True)
    found = identified(table, {"a": Normal(Free(-5.0, 5.0), 0.3), "b": Constant(Between(0.0, 4.0))})
    band = found.p_box(pd.DataFrame({"load": [3.0]}), noise=False).quantiles((0.5,)).loc[0]
    of_sum, of_b = ALIKE["y"].mean(), table["y"][25:].mean()
    middle, of_bound = 3.0 * of_sum - 2.0 * of_b, 2.0 * END * 0.05
    whole = END * np.sqrt(9.0 * 0.1 / 25 + 4.0 * 0.0025)
    told = band[["lowest", "lower", "upper", "highest"]].to_numpy(float)
    exact = middle + np.array([-whole, -of_bound, of_bound, whole])
    assert told == pytest.approx(exact, abs=0.02)


def test_exact_outcomes_narrow_nothing_that_they_do_not_tell() -> None:
    found = identified(ALIKE, LAWS, noise=None)
    box = found.p_box(pd.DataFrame({"load": [3.0]}))
    mean, sd = ALIKE["y"].mean(), ALIKE["y"].std(ddof=0)
    low, high = ends(box, uncertainty=False)
    assert low == pytest.approx(3.0 * mean - 4.0 + 3.0 * sd * Z, abs=0.03)
    assert high == pytest.approx(3.0 * mean - 2.0 + 3.0 * sd * Z, abs=0.03)


@pytest.mark.long
def test_response_surfaces_reach_over_the_bounds() -> None:
    """A simulator that takes numbers only is replaced by surfaces, in fit and prediction."""

    def slow(load: float, a: float, b: float) -> float:
        return float(a) * float(load) + float(b) + 0.02 * float(a) ** 2

    laws = {"a": Normal(Free(-5.0, 5.0), Free(0.01, 2.0)), "b": Normal(Between(1.0, 2.0), 0.05)}
    bands = []
    for vectorized in (False, True):
        model = slow if not vectorized else lambda load, a, b: a * load + b + 0.02 * a**2
        found = identify(
            model, ALIKE, Inputs(laws), outcome="y", noise=Noise(0.1), vectorized=vectorized,
            verification=Check(0), consistency=False, best_law=False,
        )  # fmt: skip
        box = found.p_box(pd.DataFrame({"load": [3.0]}), noise=False)
        bands.append(np.array(ends(box, uncertainty=False)))
    assert bands[0] == pytest.approx(bands[1], abs=0.02)


# --------------------------------------------------------------------------- misuse, files, charts


def test_a_single_distribution_is_refused_where_a_law_is_only_bounded(tmp_path: Path) -> None:
    found, new = identified(ALIKE, LAWS), pd.DataFrame({"load": [3.0]})
    assert found.alpha["b.value"].estimate == 1.5
    assert found.alpha["b.value"].fixed
    for asked in (
        lambda: found.predict(new),
        lambda: found.tolerance(at=new),
        lambda: found.probability("y > 8", new),
    ):
        with pytest.raises(AleatorError, match=r"b\.value"):
            asked()
    found.save(tmp_path / "found.json")
    again = load(tmp_path / "found.json", simulator=line, inputs=Inputs(LAWS), noise=Noise(0.1))
    assert again == found
    with pytest.raises(AleatorError):
        again.p_box(new)


def test_misuse_is_told() -> None:
    new, known = pd.DataFrame({"load": [3.0]}), {"a": Normal(1.0, 0.1), "b": Constant(1.0)}
    with pytest.raises(AleatorError, match="only bounded"):
        p_box(line, new, Inputs(known))
    with pytest.raises(AleatorError, match="only bounded"):
        identified(ALIKE, {**LAWS, "b": Constant(1.5)}).p_box(new)
    with pytest.raises(AleatorError, match="write 1, 2"):
        Normal(Between(2.0, 1.0), 0.1)
    with pytest.raises(AleatorError, match=r"a\.mean"):
        p_box(line, new, Inputs({**LAWS, "b": Constant(Between(1.0, 2.0))}), {"a.sd": 0.1})
    box = p_box(line, new, Inputs({**known, "b": Constant(Between(1.0, 2.0))}))
    for asked in (lambda: box.quantiles((0.0, 0.5)), lambda: box.pinned("b.valu"),
                  lambda: box.pinned("b.value", 3.0), lambda: box.probability("b")):  # fmt: skip
        with pytest.raises(AleatorError):
            asked()


STUDY = """
[experiments]
file = "table.csv"
outcome = "y"
[simulator]
function = "model.py:line"
vectorized = true
[parameters.a]
law = "normal"
mean = {lower = -5.0, upper = 5.0}
sd = {lower = 0.01, upper = 2.0}
[parameters.b]
law = "constant"
value = {between = [1.0, 2.0]}
[noise]
sd = 0.1
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    ALIKE.to_csv(tmp_path / "table.csv", index=False)
    (tmp_path / "new.csv").write_text("load\n3.0\n")
    (tmp_path / "model.py").write_text("def line(load, a, b):\n    return a * load + b\n")
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def test_the_command_tells_what_python_does(folder: Path, unseen: PBox) -> None:
    told = CliRunner().invoke(
        main,
        ["pbox", str(folder / "study.toml"), "--at", "load=3", "--event", "y > 8", "--no-noise",
         "--output", str(folder / "out")],
    )  # fmt: skip
    assert told.exit_code == 0, told.output
    found = json.loads((folder / "out" / "pbox.json").read_text())
    assert found["bounded"] == {"b.value": [1.0, 2.0]}
    exact = unseen.probability("y > 8").loc[0]
    for name in ("lower", "upper", "lowest", "highest"):
        assert found["rows"][0][name] == pytest.approx(exact[name], rel=0.05)


def test_a_study_says_what_is_only_bounded(folder: Path) -> None:
    assert load_study(folder / "study.toml").inputs.law(1) == Constant(Between(1.0, 2.0))
    for wrong in ("between = [2.0, 1.0]", "between = [1.0]", "between = [1.0, 2.0], lower = 1.0"):
        text = STUDY.replace("between = [1.0, 2.0]", wrong)
        (folder / "study.toml").write_text(text)
        with pytest.raises(AleatorError, match="value"):
            load_study(folder / "study.toml")
    (folder / "study.toml").write_text(STUDY.replace("{between = [1.0, 2.0]}", "1.5"))
    told = CliRunner().invoke(
        main, ["pbox", str(folder / "study.toml"), "--at", str(folder / "new.csv")]
    )
    assert told.exit_code == 2


def test_the_chart_shows_the_band_of_distribution_functions(two_laws: PBox) -> None:
    levels = tuple(np.linspace(0.02, 0.98, 25).tolist())
    band = two_laws.quantiles(levels)
    (drawn_band,) = plot.p_box(band, outcome="y").collections
    (path,) = drawn_band.get_paths()
    at = np.array([[x, y] for x, y in path.vertices if 1.8 < x < 2.7])
    low = stats.norm.cdf(at[:, 0], 2.7, SD[0])
    high = stats.norm.cdf(at[:, 0], 1.8, SD[0])
    assert np.minimum(abs(at[:, 1] - low), abs(at[:, 1] - high)).max() < 0.02
    with pytest.raises(AleatorError):
        plot.p_box(pd.concat([band, band]))
