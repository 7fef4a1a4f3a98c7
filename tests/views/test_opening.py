"""The first screen: how a law and a new outcome are told, and what the two charts show."""

import dataclasses
import sys
from typing import Any

import numpy as np
import pandas as pd
import pytest
from reports import experiment, printed, result
from scipy import optimize, stats

from aleator import (
    AleatorError,
    By,
    Check,
    Experiments,
    Free,
    Inputs,
    Noise,
    Normal,
    Uniform,
    identify,
)
from aleator.inference.alpha_draws import AlphaDraws
from aleator.inference.law_ranges import law_ranges
from aleator.inference.pictures import PICTURES, law_bands, law_bands_by_level
from aleator.inference.profile import DROP
from aleator.results.findings import findings
from aleator.tasks.identification import Identification, pictured
from aleator.views.chart import Chart
from aleator.views.figures import experiments_figure
from aleator.views.identification import identification, render
from aleator.views.law_charts import law_chart, profile_chart, profile_line
from aleator.views.measured import measured
from aleator.views.opening import opening_charts, outcome_chart

END = 1.959963984540054


def draws(estimate: list[float], alpha: Any, fixed: tuple[int, ...] = ()) -> AlphaDraws:
    alpha = np.array(alpha, dtype=float)
    size = len(alpha)
    return AlphaDraws(np.array(estimate), alpha, np.full(size, 1.0 / size), np.zeros(alpha.shape),
                      np.zeros(size), np.array(fixed, dtype=np.intp))  # fmt: skip


# ------------------------------------------------------------------------------------ the ranges


def test_the_ends_of_a_normal_law_are_sure_to_the_error_of_its_mean() -> None:
    inputs = Inputs({"k": Normal(Free(0.0, 10.0), 0.5)})
    z = stats.norm.ppf((np.arange(4000) + 0.5) / 4000)
    means = np.column_stack([5.0 + 0.2 * z, np.full(4000, 0.5)])
    found = law_ranges(inputs, inputs.hyperparameters, draws([5.0, 0.5], means), 1)["k"]
    assert (found.lower, found.upper) == pytest.approx((5.0 - 0.5 * END, 5.0 + 0.5 * END))
    assert found.lower_interval is not None
    half = 0.5 * np.diff(found.lower_interval)[0]
    assert half == pytest.approx(0.2 * END, rel=1e-3)
    assert not found.follows
    assert found.level is None


def test_intervals_hold_the_estimate_where_an_sd_ends_on_its_limit() -> None:
    """All draws of an sd at its lower limit of 0.1 are larger: those of its law are wider."""
    inputs = Inputs({"k": Uniform(1.0, Free(0.1, 1.0))})
    sds = 0.1 + 0.05 * stats.halfnorm.ppf((np.arange(400) + 0.5) / 400)
    alpha = np.column_stack([np.ones(400), sds])
    found = law_ranges(inputs, inputs.hyperparameters, draws([1.0, 0.1], alpha), 1)["k"]
    assert found.lower_interval is not None
    assert found.lower_interval[1] == found.lower == pytest.approx(1.0 - 0.95 * 0.1 * 3.0**0.5)
    interval = found.quantities["upper"].interval
    assert interval is not None
    assert interval[0] == found.quantities["upper"].estimate == pytest.approx(1.0 + 0.1 * 3.0**0.5)
    assert interval[1] == pytest.approx(1.0 + (0.1 + 0.05 * 2.2414) * 3.0**0.5, rel=1e-3)


def test_where_a_hyperparameter_has_no_error_the_ends_have_none() -> None:
    inputs = Inputs({"k": Normal(Free(0.0, 10.0), Free(0.1, 1.0)), "own": Normal(0.0, 1.0)})
    some = draws([5.0, 0.5, 0.0, 1.0], [[5.0, 0.5, 0.0, 1.0]] * 2, fixed=(1,))
    found = law_ranges(inputs, inputs.hyperparameters, some, 1)
    assert found["k"].lower_interval is None
    assert found["own"].lower_interval == pytest.approx((-END, -END))


def test_a_law_that_follows_a_covariate_has_the_range_of_the_mean_law() -> None:
    table = pd.DataFrame({"t": np.linspace(0.0, 1.0, 30)})
    inputs = Inputs({"k": Normal(By("1 + t", -9.0, 9.0), 0.5)}).resolved(table)
    alpha = np.array([1.0, 3.0, 0.5])
    found = law_ranges(inputs, inputs.hyperparameters, AlphaDraws.at(alpha), 30)["k"]

    def below(x: float) -> float:
        return float(stats.norm.cdf(x, 1.0 + 3.0 * table["t"], 0.5).mean())

    ends = [optimize.brentq(lambda x, p=p: below(x) - p, -9.0, 9.0) for p in (0.025, 0.975)]
    assert (found.lower, found.upper) == pytest.approx(ends, abs=2e-3)
    assert found.follows


def test_a_law_that_follows_a_factor_has_the_range_of_each_level() -> None:
    table = pd.DataFrame({"by": ["a", "b"] * 15, "t": np.arange(30.0)})
    inputs = Inputs({"k": Normal(By("0 + C(by) + t", -99.0, 99.0), 0.5)}).resolved(table)
    alpha = np.array([1.0, 3.0, 0.2, 0.5])
    z = stats.norm.ppf((np.arange(4000) + 0.5) / 4000)
    sure = draws(alpha.tolist(), alpha + np.outer(z, [0.1, 0.3, 0.0, 0.0]))
    found = law_ranges(inputs, inputs.hyperparameters, sure, 30, table)["k"]
    assert (found.factor, found.at) == ("by", {"t": 14.5})
    for level, mean, error in (("a", 1.0, 0.1), ("b", 3.0, 0.3)):
        own = found.by_level[level]
        middle = mean + 0.2 * 14.5
        assert (own.lower, own.upper) == pytest.approx((middle - 0.5 * END, middle + 0.5 * END))
        assert own.upper_interval is not None
        assert 0.5 * np.diff(own.upper_interval)[0] == pytest.approx(error * END, rel=1e-2)
    said = told(ranges={"k": dataclasses.asdict(found)}, units={"t": "s"})
    assert ["by a, t 14.5 s" in said[0], "by b, t 14.5 s" in said[1]] == [True, True]


@pytest.mark.parametrize("levels", [1, 5])
def test_a_factor_of_one_or_many_levels_is_not_told_apart(levels: int) -> None:
    table = pd.DataFrame({"by": [f"{k % levels}" for k in range(30)], "t": np.arange(30.0)})
    formula = "1 + t + C(by)" if levels > 1 else "1 + t"
    inputs = Inputs({"k": Normal(By(formula, -99.0, 99.0), 0.5)}).resolved(table)
    alpha = AlphaDraws.at(np.array([h.start for h in inputs.hyperparameters]))
    assert not law_ranges(inputs, inputs.hyperparameters, alpha, 30, table)["k"].by_level


def test_the_chart_of_such_a_law_has_the_density_of_each_level() -> None:
    table = pd.DataFrame({"by": ["a", "b"] * 15})
    inputs = Inputs({"k": Normal(By("0 + C(by)", -9.0, 9.0), 0.5)}).resolved(table)
    alpha = AlphaDraws.at(np.array([1.0, 3.0, 0.5]))
    pictures = {"laws": law_bands(inputs, alpha, 30),
                "laws_by_level": law_bands_by_level(inputs, alpha, table)}  # fmt: skip
    chart = law_chart({"pictures": pictures, "ranges": {"k": {"factor": "by"}}}, "k")
    lines = {mark.legend: mark for mark in chart.marks if mark.legend}
    assert [*lines] == ["by a", "by b"]
    for mark, mean in zip(lines.values(), (1.0, 3.0), strict=True):
        expected = stats.norm.pdf(mark.array("x"), mean, 0.5)
        assert mark.series.array("density") == pytest.approx(expected, abs=1e-4)


# ------------------------------------------------------------------------------------ the sentences


def told(**changes: Any) -> list[str]:
    return [str(sentence) for sentence in findings(result(**changes))]


LAW = {"lower": 0.1012, "upper": 0.1788, "lower_interval": [0.0932, 0.1092],
       "upper_interval": [0.1708, 0.1868], "level": None, "follows": False}  # fmt: skip


@pytest.mark.parametrize(
    "entry",
    [
        {"c.sd": {"estimate": 1e-4, "interval": [1e-4, 0.021], "at_bound": "lower"}},
        {"c.sd": {"estimate": 0.01, "interval": [1e-4, 0.021], "cut": "lower"}},
        {"c.mean": {"estimate": 0.14, "interval": [1e-4, 0.021], "cut": "upper"}},
    ],
)
def test_a_range_by_an_interval_that_runs_to_a_limit_is_not_offered(
    entry: dict[str, Any],
) -> None:
    said, *_ = told(ranges={"c": LAW}, alpha=entry, units={"c": "N"})
    for end in ("0.0932", "0.1868", "0.0001 N", "0.021 N"):
        assert end in said
    assert "0.1012" not in said
    assert "0.1788" not in said


@pytest.mark.parametrize("correlation", [-0.93, 0.0])
def test_two_sds_that_replace_each_other_are_not_both_told_to_be_zero(correlation: float) -> None:
    """Each is 1.2 standard errors from zero; with -0.93 both are zero at 41 of chi-square (2)."""
    sd = {"estimate": 0.12, "standard_error": 0.1, "interval": [1e-4, 0.3], "cut": "lower"}
    table = {"names": ["c.sd", "d.sd"], "matrix": [[1.0, correlation], [correlation, 1.0]]}
    said = told(ranges={"c": LAW, "d": LAW}, alpha={"c.sd": sd, "d.sd": sd}, correlation=table)
    for sentence in said[:2]:
        assert "no scatter" not in sentence
        assert ("at least one" in sentence) is (correlation < 0.0)


def test_the_law_of_a_group_is_left_open_by_its_own_coefficients_only() -> None:
    open_ = {"estimate": 2.0, "interval": [1.0, 3.0], "cut": "lower"}
    law = LAW | {"factor": "by", "by_level": {"a": LAW, "b": LAW}}
    a, b = told(ranges={"c": law}, alpha={"c.mean[by=a]": open_})[:2]
    assert "c.mean[by=a]" in a
    assert "c.mean" not in b


def test_an_inner_interval_leaves_the_range_at_the_estimate() -> None:
    inner = {"estimate": 0.02, "interval": [0.01, 0.03], "cut": "upper"}
    said, *_ = told(ranges={"c": LAW}, alpha={"d.sd": inner, "c.sd": inner | {"cut": None}})
    assert "0.1012 to 0.1788" in said


@pytest.mark.parametrize(("count", "named"), [(5, [1, 2, 3, 4, 5]), (7, [4])])
def test_a_new_experiment_is_told_under_few_conditions_or_the_middle_one(
    count: int, named: list[int]
) -> None:
    force = [float(1 + k % count) for k in range(2 * count)]
    document = {**spring(force=force, serial=[*range(2 * count)]), "alpha": {}}
    (sentence,) = findings({**document, "units": {"force": "kN"}})
    for f in range(1, count + 1):
        assert (f"force {f} kN" in str(sentence)) == (f in named)
    assert "serial" not in str(sentence)


def test_each_sentence_has_the_numbers_and_the_unit_of_its_quantity() -> None:
    alpha = {
        "drag.value": {"estimate": 0.31, "standard_error": 0.02, "interval": [0.27, 0.35]},
        "noise.sd": {"estimate": 0.52, "standard_error": 0.05, "interval": [0.43, 0.63]},
        "known.value": {"estimate": 1.0, "fixed": True},
    }
    said = told(ranges={"c": LAW}, alpha=alpha, outcome="travel",
                simulator={"name": "spring", "defaults": {"gap": 2.0}},
                units={"c": "N/mm", "drag": "N", "travel": "mm", "gap": "mm"})  # fmt: skip
    assert len(said) == 5
    for sentence, numbers in zip(
        said,
        (
            "0.1012 to 0.1788 N/mm",
            "0.310 N",
            "known 1, gap 2 mm",
            "0.520 mm",
            "travel 0.76 to 0.84 mm",
        ),
        strict=True,
    ):
        assert numbers in sentence
    assert "+- 0.0080 N/mm" in said[0]
    assert "0.270 to 0.350 N" in said[1]


def test_what_is_not_known_is_not_told_as_sure() -> None:
    unknown = told(ranges={"c": LAW | {"upper_interval": None}})[0]
    assert "+-" not in unknown
    assert "not known" in unknown
    given = told(
        ranges={"c": LAW | {"lower_interval": [0.1012] * 2, "upper_interval": [0.1788] * 2}}
    )
    assert "+-" not in given[0]


def test_a_shared_parameter_is_told_by_its_groups() -> None:
    assert "batch" in told(ranges={"c": LAW | {"level": "batch"}})[0]


def test_an_outcome_of_logarithms_is_told_in_its_unit() -> None:
    ends = {"0.025": np.log(100.0), "0.5": np.log(200.0), "0.975": np.log(400.0)}
    said = told(
        transform="log", outcome="cycles", experiments=[experiment("1", 0.5, quantiles=ends)]
    )
    assert "cycles 100 to 400" in said[-1]


# ------------------------------------------------------------------------------------ the charts


def spring(**conditions: Any) -> dict[str, Any]:
    """An answer with exact outcomes force/k of a normal 1/k, and the conditions of each spring."""
    force = np.array(conditions["force"])
    rows = [
        experiment(str(k), 0.5, outcome=f, quantiles={
            str(p): f * (1.0 + 0.1 * stats.norm.ppf(p)) for p in (0.025, 0.25, 0.5, 0.75, 0.975)
        })
        for k, f in enumerate(force)
    ]  # fmt: skip
    return {"outcome": "travel", "experiments": rows, "pictures": {"conditions": conditions}}


def test_the_band_lies_over_the_condition_that_determines_the_prediction() -> None:
    document = spring(force=[3.0, 1.0, 2.0, 1.0], humidity=[0.1, 0.9, 0.3, 0.2])
    (seen,) = measured(document)
    chart = outcome_chart(seen, seen.series(), None, noise=False)
    assert chart.x.title == "force"
    band = chart.marks[0]
    assert band.shape == "band"
    assert band.array("x").tolist() == [1.0, 2.0, 3.0]
    assert band.array("high") == pytest.approx(np.arange(1.0, 4.0) * (1.0 + 0.1 * END))


def test_where_several_conditions_decide_each_row_has_its_own_span() -> None:
    document = spring(force=[3.0, 1.0, 2.0, 1.0], speed=[1.0, 1.0, 2.0, 2.0])
    for k, row in enumerate(document["experiments"]):
        row["quantiles"] = {p: q + 5.0 * (k % 2) for p, q in row["quantiles"].items()}
    document["pictures"]["conditions"]["force"] = [1.0, 1.0, 2.0, 2.0]
    (seen,) = measured(document)
    chart = outcome_chart(seen, seen.series(), None, noise=False)
    assert chart.marks[0].shape == "spans"
    assert len(chart.marks[0].array("x")) == 4


def test_rows_stand_one_name_of_a_column_after_the_other_where_predictions_depend_on_it() -> None:
    force, maker = [3.0, 1.0, 2.0, 1.0, 2.0, 2.5], ["B", "A", "B", "B", "A", "A"]
    document = spring(force=force, maker=maker, observer=["x", "y", "y", "x", "x", "y"])
    for k, row in enumerate(document["experiments"]):
        more = 5.0 * (k % 2) + 3.0 * (maker[k] == "A")
        row["quantiles"] = {p: q + more for p, q in row["quantiles"].items()}
    document["pictures"]["conditions"]["speed"] = [1.0, 2.0] * 3
    (seen,) = measured(document)
    chart = outcome_chart(seen, seen.series(), None, noise=False)
    points = chart.marks[-1]
    x, ids = points.array("x"), np.array(chart.source.columns["id"])
    middle = seen.array("q0.5")[[int(one) for one in ids]]
    (a, first), (b, second) = chart.x.names
    assert (first, second) == ("A", "B")
    own = {name: x[[maker[int(one)] == name for one in ids]] for name in "AB"}
    assert own["A"].min() < a < own["A"].max() < own["B"].min() < b < own["B"].max()
    for name in "AB":
        rows = [maker[int(one)] == name for one in ids]
        assert np.all(np.diff(middle[rows][np.argsort(x[rows])]) >= 0.0)


@pytest.mark.parametrize(("effect", "names"), [(0.0, []), (0.5, ["x", "y"])])
def test_a_column_on_which_no_prediction_depends_is_not_on_the_axis(
    effect: float, names: list[str]
) -> None:
    rows = [(a, b, c, who) for a in (0.0, 1.0) for b in (0.0, 1.0) for c in (0.0, 1.0)
            for who in "xy"]  # fmt: skip
    force = [1.0 + a + 2.0 * b + 4.0 * c + effect * (who == "y") for a, b, c, who in rows]
    document = spring(force=force)
    document["pictures"]["conditions"] = dict(zip("abc", zip(*rows, strict=True), strict=False))
    document["pictures"]["conditions"]["who"] = [who for *_, who in rows]
    (seen,) = measured(document)
    chart = outcome_chart(seen, seen.series(), None, noise=False)
    assert [name for _, name in chart.x.names] == names


def test_two_conditions_that_decide_together_are_told_apart_by_color() -> None:
    """Widths of 0.4 on a range of 60 could not be seen: deviations from the median are drawn."""
    document = spring(force=[1.0, 1.0, 50.0, 50.0, 1.0], speed=[1.0, 3.0, 1.0, 3.0, 3.0])
    for k in (1, 3, 4):
        row = document["experiments"][k]
        row["quantiles"] = {p: q + 5.0 for p, q in row["quantiles"].items()}
    (seen,) = measured(document)
    chart = outcome_chart(seen, seen.series(), None, noise=False)
    lines = [mark for mark in chart.marks if mark.shape == "line"]
    assert [mark.legend for mark in lines] == ["speed 1", "speed 3"]
    assert len({mark.color for mark in lines}) == 2
    assert [mark.array("y").tolist() for mark in lines] == [[0.0, 0.0], [0.0, 0.0]]
    assert chart.marks[0].array("high") == pytest.approx(np.array([1.0, 50.0]) * 0.1 * END)
    points = chart.marks[-1]
    assert points.array("y").tolist() == [0.0, -5.0, 0.0, -5.0, -5.0]
    assert points.array("x").round(-1).tolist() == [0.0, 0.0, 50.0, 50.0, 0.0]
    ordered = points.array("x")[:2]
    assert ordered[0] < 1.0 < ordered[1]


def test_a_series_is_drawn_as_curves_and_what_is_asked_about_comes_first() -> None:
    amplitude, time = {"A": 20.0, "B": 40.0, "C": 40.0, "D": 30.0}, [1.0, 2.0, 3.0]
    rows = [(one, at, amplitude[one] * np.cos(at)) for one in amplitude for at in time]
    document = {
        "responses": {"angle": "none"},
        "experiments": [experiment(one, 0.5) for one in amplitude],
        "observations": [
            {"id": one, "row": k, "response": "angle", "lower": angle, "upper": angle,
             "predicted": angle, "scale": 0.1, "pit": 0.5, "conditions": {"time": at}}
            for k, (one, at, angle) in enumerate(rows)
        ],
        "pictures": {
            "conditions": {"amplitude": [*amplitude.values()]},
            "predicted": {str(p): [angle + stats.norm.ppf(p) for _, _, angle in rows]
                          for p in (0.025, 0.25, 0.5, 0.75, 0.975)},
        },
    }  # fmt: skip
    (seen,) = measured(document)
    sway = dataclasses.replace(seen, response="sway")
    pairs = [(seen, seen.series(0)), (sway, sway.series(1))]
    for asked, first in ((), "angle"), (("length", "sway", "angle"), "sway"):
        answers = [{"outcome": name} for name in asked]
        (opened,) = opening_charts({**document, "answers": answers}, pairs)
        assert opened.title.startswith(first)
    chart = outcome_chart(seen, seen.series(), "time", noise=True)
    assert (chart.x.title, chart.marks[0].shape) == ("time", "band")
    assert chart.marks[0].array("high") == pytest.approx(40.0 * np.cos(time) + END)
    assert {*chart.source.columns["id"]} == {"B", "C"}
    (curves,) = [mark for mark in chart.marks if mark.shape == "lines"]
    assert np.allclose(curves.series.columns["y"], 40.0 * np.cos([time, time]))


def test_several_laws_open_a_report_and_the_others_follow() -> None:
    curve = {"x": [0.0, 1.0], "density": [1.0, 1.0]}
    document = result(pictures={"laws": dict.fromkeys("abcdef", curve)})
    content, _ = identification(document)
    drawn = [part.name for part in content.opening if isinstance(part, Chart)]
    assert [name for name in drawn if name.startswith("law")] == [f"law-{k}" for k in "abcd"]
    below = [part.name for one in content.sections for part in one.parts if isinstance(part, Chart)]
    assert [name for name in below if name.startswith("law")] == ["law-e", "law-f"]


def test_a_profile_is_drawn_to_some_units_below_its_interval() -> None:
    at = np.array([-40.0, -2.0, 0.0, 2.0, 3.0])
    x, y = profile_line(at, 0.5 * at**2)
    deepest = -(DROP + PICTURES.depth)
    assert y[0] == pytest.approx(deepest)
    assert x[0] == pytest.approx(-np.sqrt(-2.0 * deepest))
    assert x[-1] == 3.0
    pictures = {"profiles": {"k": {"at": at.tolist(), "below": (0.5 * at**2).tolist()}}}
    chart = profile_chart({"pictures": pictures}, "k")
    assert all(np.nanmin(mark.array("y")) >= deepest - 1e-9 for mark in chart.marks)


def test_a_quantile_beyond_all_numbers_is_drawn_to_the_top() -> None:
    document = spring(force=[1.0, 2.0])
    document["experiments"][1]["quantiles"]["0.975"] = None
    (seen,) = measured(document)
    band = outcome_chart(seen, seen.series(), None, noise=False).marks[0]
    assert np.all(np.isfinite(band.array("high")))
    assert band.array("high")[1] >= max(seen.array("value"))


@pytest.fixture(scope="module")
def found() -> Identification:
    """Twelve synthetic springs of three loads, once measured each."""
    rng = np.random.default_rng(3)
    table = pd.DataFrame({"load": np.repeat([1.0, 2.0, 3.0], 4)})
    table["way"] = table["load"] * rng.normal(1.0, 0.2, 12) + rng.normal(0.0, 0.05, 12)
    inputs = Inputs({"give": Normal(Free(0.5, 1.5), Free(0.01, 0.6))})
    return identify(
        lambda load, give: load * give, Experiments.from_frame(table, outcome="way"), inputs,
        noise=Noise(0.05), vectorized=True, verification=Check(0), best_law=False,
        consistency=False, units={"way": "mm", "give": "mm/N"},
    )  # fmt: skip


def test_the_range_of_an_answer_is_that_of_its_law_and_its_draws(found: Identification) -> None:
    own, law = found.ranges["give"], found.law.marginals["give"]
    assert [own.lower, own.upper] == pytest.approx(law.quantile([0.025, 0.975]))
    alpha = found.draws().alpha
    ends = np.quantile(alpha[:, 0] + END * alpha[:, 1], [0.025, 0.975])
    assert own.upper_interval == pytest.approx(ends, rel=0.02)


def test_a_point_does_not_move_the_band_that_it_is_judged_by(found: Identification) -> None:
    content, _ = identification(pictured(found).to_dict())
    chart = next(part for part in content.opening if getattr(part, "name", "") == "outcomes")
    mean, sd = found.values["give.mean"], found.values["give.sd"]
    load = np.array([1.0, 2.0, 3.0])
    high = load * mean + END * np.sqrt((load * sd) ** 2 + 0.05**2)
    assert chart.marks[0].array("high") == pytest.approx(high, rel=5e-3)  # type: ignore[union-attr]
    assert len(chart.marks[-1].array("y")) == 12  # type: ignore[union-attr]


def test_print_terminal_and_page_begin_with_the_same_sentences(found: Identification) -> None:
    whole = pictured(found)
    first = str(findings(whole.to_dict())[0])
    assert "mm/N" in first
    assert repr(whole).startswith(first[:40])
    assert printed(render(whole.to_dict()), 200).splitlines()[1] == first
    assert whole.report().text.index("give") < whole.report().text.index("Computed soundly")


def test_no_backtick_is_printed() -> None:
    row = {"message": "outcomes under high `hot` differ", "remedy": "see `aleator box`",
           "test": {"corrected": 0.01}}  # fmt: skip
    second = {"p": 0.01, "tests": [], "discrepancies": [row], "copies": ["class"]}
    document = result(consistent=False, consistency=second)
    assert "`" not in printed(render(document))
    assert "'hot'" in printed(render(document))


def test_points_under_equal_conditions_are_in_the_order_of_the_table() -> None:
    """Sorted by value they would rise along any prediction."""
    document = spring(force=[2.0] * 4)
    for row, value in zip(document["experiments"], (2.4, 1.6, 2.2, 1.9), strict=True):
        row["outcome"] = value
    (seen,) = measured(document)
    assert seen.columns["order"] == [1, 2, 3, 4]


def test_without_predictions_by_the_law_a_figure_draws_no_prediction(found: Identification) -> None:
    (axes,) = experiments_figure(found.to_dict()).axes
    assert not axes.lines
    assert not axes.collections
    assert "not in this document" in axes.get_title(loc="left")


def test_a_profile_is_drawn_to_the_ends_of_its_interval(found: Identification) -> None:
    profiles = pictured(found).pictures["profiles"]
    assert set(profiles) == {"give.mean", "give.sd"}
    for name, curve in profiles.items():
        estimate = found.alpha[name]
        assert estimate.interval is not None
        assert estimate.drops is not None
        for end, drop in zip(estimate.interval, estimate.drops, strict=True):
            place = int(np.argmin(np.abs(np.array(curve["at"]) - end)))
            assert curve["at"][place] == pytest.approx(end, rel=1e-9)
            assert curve["below"][place] == pytest.approx(drop, rel=1e-4)


# ------------------------------------------------------------------------------------ in Python


def test_a_notebook_shows_the_first_screen_without_a_script(found: Identification) -> None:
    shown = found._repr_html_()
    assert shown.count("<svg") == 2
    assert "<script" not in shown
    assert len(shown) < 200_000
    assert shown == found._repr_html_()
    for part in ("mm/N", "Computed soundly", "give.sd"):
        assert part in shown


def test_the_charts_of_an_answer_are_drawn_on_given_axes_or_new_ones(found: Identification) -> None:
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    assert found.plot.law(ax=axes) is axes
    assert axes.get_xlabel() == "give [mm/N]"
    assert found.plot.outcomes().get_ylabel() == "way [mm]"
    every = found.plot.profiles()
    assert [one.get_xlabel() for one in every] == ["give.mean [mm/N]", "give.sd [mm/N]"]
    assert len(found.plot.profiles("give.sd")) == 1
    with pytest.raises(AleatorError, match=r"give\.men"):
        found.plot.profiles("give.men")


def test_without_matplotlib_charts_are_an_error_and_a_notebook_shows_the_rest(
    found: Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.style", None)
    with pytest.raises(AleatorError, match="pip install matplotlib"):
        found.plot.law()
    shown = found._repr_html_()
    assert "<svg" not in shown
    assert "give.mean" in shown
