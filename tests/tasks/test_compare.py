"""Models of the same data: published criteria, exact ratios, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import stats

from aleator import (
    AR1,
    AleatorError,
    Censoring,
    Check,
    CompoundSymmetry,
    Constant,
    Experiments,
    Free,
    GaussianProcess,
    Identification,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    TruncatedNormal,
    ceiling,
    compare,
    load,
)
from aleator.core.progress import Silent
from aleator.laws import By
from aleator.tasks.compare import Comparison, compared
from aleator.tasks.nesting import Embedding, matched

DATA = Path(__file__).parents[1] / "data"


def line(days: np.ndarray, start: np.ndarray, slope: np.ndarray) -> np.ndarray:
    return start + slope * days


def found_by(model, table: Experiments, noise: Noise, correlation=None, **laws) -> Identification:
    return unjudged(
        model, table, Inputs(laws, correlation), noise=noise, vectorized=True,
        verification=Check(0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def sleep() -> dict[str, Identification]:
    table = Experiments.from_csv(DATA / "sleepstudy.csv", outcome="reaction", id="unit")
    noise, start = Noise(Free(1.0, 200.0)), Normal(Free(100.0, 400.0), Free(0.0, 200.0))
    slope = Normal(Free(-50.0, 50.0), Free(0.0, 50.0))
    both = {("start", "slope"): Free(-0.99, 0.99)}
    fixed = Constant(Free(-50.0, 50.0))
    return {
        "intercepts": found_by(line, table, noise, start=start, slope=fixed),
        "independent": found_by(line, table, noise, start=start, slope=slope),
        "correlated": found_by(line, table, noise, both, start=start, slope=slope),
    }


@pytest.fixture(scope="module")
def sleep_compared(sleep: dict[str, Identification]) -> Comparison:
    return compare(**sleep, ceilings=False)


@pytest.fixture(scope="module")
def dyestuff() -> dict[str, Identification]:
    table = Experiments.from_csv(DATA / "dyestuff.csv", outcome="yield", id="unit")
    noise, limits = Noise(Free(1.0, 500.0)), Free(1000.0, 2000.0)
    return {
        "alike": found_by(lambda m: m, table, noise, m=Constant(limits)),
        "differing": found_by(lambda m: m, table, noise, m=Normal(limits, Free(0.0, 500.0))),
    }


# Maxima of the closed form and standard errors; those of "correlated" are published too.
MAXIMA = {
    "independent": (-876.001628, {
        "start.mean": (251.405105, 6.669), "start.sd": (24.1712652, 5.37),
        "slope.mean": (10.467286, 1.502), "slope.sd": (5.79940841, 1.16),
        "noise.sd": (25.5561347, 1.5),
    }),
    "correlated": (-875.969672, {
        "start.mean": (251.405105, 6.632), "start.sd": (23.7805672, 5.577),
        "slope.mean": (10.467286, 1.502), "slope.sd": (5.71683448, 1.187),
        "correlation.start.slope": (0.0813200, 0.324), "noise.sd": (25.5918156, 1.508),
    }),
    "differing": (-163.663530, {
        "m.mean": (1527.5, 17.69), "m.sd": (37.2603453, 15.5), "noise.sd": (49.5101000, 7.1),
    }),
}  # fmt: skip


@pytest.mark.parametrize("name", MAXIMA)
def test_published_maxima_are_met(
    name: str, sleep: dict[str, Identification], dyestuff: dict[str, Identification]
) -> None:
    answer, (value, wanted) = (sleep | dyestuff)[name], MAXIMA[name]
    assert answer.sound
    assert answer.log_likelihood.estimated == pytest.approx(value, abs=0.01)
    for key, (estimate, error) in wanted.items():
        entry = answer.alpha[key]
        assert entry.estimate == pytest.approx(estimate, abs=0.05 * error), key
        if name == "correlated":
            assert entry.standard_error == pytest.approx(error, rel=0.01), key


def test_the_sleep_study_is_as_lme4_has_it(sleep_compared: Comparison) -> None:
    found = sleep_compared
    table = found.table()
    published = {"intercepts": 1802.1, "independent": 1762.0, "correlated": 1763.9}
    for name, aic in published.items():
        assert table.loc[name, "aic"] == pytest.approx(aic, abs=0.06)
    ratios = found.nested().set_index(["smaller", "larger"])
    assert ratios.loc[("independent", "correlated"), "ratio"] == pytest.approx(0.0639, abs=2e-3)
    assert ratios.loc[("independent", "correlated"), "p"] == pytest.approx(0.8004, abs=3e-3)
    assert len(ratios) == 3


def test_a_new_scale_with_its_correlation_has_the_mixture_of_one_and_two(
    sleep_compared: Comparison,
) -> None:
    """Stram and Lee 1994, case 3; against the correlated model."""
    (ratio,) = (r for r in sleep_compared.ratios if r.df == 2)
    assert (ratio.smaller, ratio.larger) == ("intercepts", "correlated")
    assert ratio.reference == "1/2 chi2(1) + 1/2 chi2(2)"
    assert (ratio.df, ratio.on_boundary) == (2, 1)


def test_the_ratio_of_a_scale_of_zero_is_that_of_the_analysis_of_variance(
    dyestuff: dict[str, Identification],
) -> None:
    found = compare(**dyestuff)
    (ratio,) = found.ratios
    table = pd.read_csv(DATA / "dyestuff.csv")
    pooled = stats.norm.logpdf(table["yield"], table["yield"].mean(), table["yield"].std(ddof=0))
    assert ratio.statistic == pytest.approx(2.0 * (-163.663530 - pooled.sum()), abs=1e-3)
    assert ratio.p == pytest.approx(0.5 * stats.chi2.sf(ratio.statistic, 1))
    assert [m.name for m in found.models] == ["differing", "alike"]


@pytest.mark.slow
def test_drawn_ratios_are_those_of_the_f_distribution(dyestuff: dict[str, Identification]) -> None:
    """The ratio is zero where F <= a/(a-1), with 6 batches of 5: more often than half."""
    (ratio,) = compare(**dyestuff, bootstrap=60, seed=3).ratios
    assert np.all(np.isfinite(ratio.bootstrap))
    assert np.min(ratio.bootstrap) > -1e-6
    zero = stats.f.cdf(6 / 5, 5, 24)
    assert np.mean(ratio.bootstrap < 1e-4) == pytest.approx(zero, abs=0.15)
    assert ratio.bootstrap_p < 0.03


def test_the_order_is_that_of_predictions_and_the_error_that_of_pairs(
    dyestuff: dict[str, Identification],
) -> None:
    found = compare(**dyestuff)
    each, table = found.experiments(), found.table()
    gap = each["alike"] - each["differing"]
    assert table.loc["alike", "difference"] == pytest.approx(gap.sum())
    assert table.loc["alike", "difference_error"] == pytest.approx(np.sqrt(6) * gap.std(ddof=1))
    assert table.index[0] == table["elpd"].idxmax()


def made(seed: int = 0) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    frame = pd.DataFrame({"id": np.repeat(np.arange(10), 3), "t": np.tile([0.5, 1.0, 2.0], 10)})
    x = np.repeat(rng.normal(2.0, 0.3, 10), 3)
    return frame.assign(y=x * frame["t"] + rng.normal(0.0, 0.1, 30), z=np.repeat(x, 3)[:30])


def proportional(frame: pd.DataFrame, law=None, scale: float = 1.0, **options) -> Identification:
    table = Experiments.from_frame(frame, outcome="y", conditions=["t"], **options)
    law = law or Normal(Free(0.5, 4.0), Free(0.0, 2.0))
    return found_by(lambda t, x: scale * x * t, table, Noise(Free(0.01, 1.0)), x=law)


@cache
def usual() -> Identification:
    return proportional(made())


def test_a_number_and_fewer_terms_are_special_cases() -> None:
    frame = made().assign(load=np.repeat(np.linspace(0.0, 1.0, 10), 3))
    followed = Normal(By("1 + load", 0.1, 6.0), Free(0.0, 2.0))
    found = compare(
        fixed=proportional(frame, Normal(2.0, Free(0.0, 2.0))), free=proportional(frame),
        followed=proportional(frame, followed),
    )  # fmt: skip
    pairs = {(r.smaller, r.larger): r for r in found.ratios}
    assert pairs["fixed", "free"].reference == "chi2(1)"
    assert pairs["free", "followed"].reference == "chi2(1)"
    assert all(r.statistic > -1e-3 for r in found.ratios)


def test_errors_that_are_not_tied_are_a_special_case_of_tied_ones() -> None:
    tied = Noise(Free(0.01, 1.0), correlation=AR1())
    law = Normal(Free(0.5, 4.0), Free(0.0, 2.0))
    table = Experiments.from_frame(made(), outcome="y", conditions=["t"])
    found = compare(free=usual(), ar1=found_by(lambda t, x: x * t, table, tied, x=law))
    (ratio,) = found.ratios
    assert (ratio.smaller, ratio.larger, ratio.reference) == ("free", "ar1", "chi2(1)")
    assert ratio.p == pytest.approx(stats.chi2.sf(ratio.statistic, 1))


@pytest.mark.parametrize(
    ("tie", "on_boundary", "regular"),
    [
        (AR1(), 0, True),
        (CompoundSymmetry(), 1, True),
        (AR1(Free(0.1, 0.9)), None, None),  # its limits leave zero out
        (GaussianProcess("t", sd=Free(0.0, 1.0), length=2.0), 1, True),
        # Without a process its length has no effect (Davies, 1987).
        (GaussianProcess("t", sd=Free(0.0, 1.0), length=Free(0.1, 9.0)), 1, False),
    ],
)
def test_the_reference_of_a_tie_is_that_of_where_it_vanishes(
    tie, on_boundary: int | None, regular: bool | None
) -> None:
    limits = Free(0.01, 1.0)
    small, large = Noise(limits).hyperparameters, Noise(limits, correlation=tie).hyperparameters
    found = matched(small, large)
    if on_boundary is None:
        assert isinstance(found, str)
        return
    assert isinstance(found, Embedding)
    assert (found.on_boundary, found.regular) == (on_boundary, regular)
    assert found.of(np.array([0.3]))[0] == 0.3


def test_a_larger_model_whose_search_stopped_early_is_maximized_from_the_smaller() -> None:
    small, large = proportional(made(), Normal(2.0, Free(0.0, 2.0))).fit, usual().fit
    stopped = large.at(np.array([0.6, 0.1, 0.9]))
    verdicts = {"s": (True, None), "l": (True, None)}
    right, mended = (
        compared({"s": small, "l": one}, verdicts, (), 0, False, 0, Silent())
        for one in (large, stopped)
    )
    assert mended.ratios[0].statistic == pytest.approx(right.ratios[0].statistic, abs=1e-3)
    assert {m.name: m.raised_from for m in mended.models} == {"s": "", "l": "s"}
    assert not any(model.raised_from for model in right.models)


def test_a_formula_is_nested_by_its_columns_and_not_by_its_spelling() -> None:
    rng = np.random.default_rng(4)
    frame = pd.DataFrame({"id": range(20), "by": ["a", "b"] * 10, "t": rng.uniform(0.0, 1.0, 20)})
    frame["y"] = rng.normal(2.0 + (frame["by"] == "b"), 0.5)
    table = Experiments.from_frame(frame, outcome="y", id="id")

    def model(mean: Free | By) -> Identification:
        return found_by(lambda m: m, table, Noise(0.1), m=Normal(mean, Free(0.01, 3.0)))

    equal = model(Free(-9.0, 9.0))
    found = compare(
        equal=equal, zero=model(By("0 + C(by)", -9.0, 9.0)), one=model(By("1 + C(by)", -9.0, 9.0)),
        sum=model(By("1 + C(by, contr.sum) + t", -9.0, 9.0)), slope=model(By("1 + t", -9.0, 9.0)),
        ceilings=False,
    )  # fmt: skip
    rows = {(r["smaller"], r["larger"]): r for r in found.nested().to_dict("records")}
    assert {*rows} == {("equal", "zero"), ("equal", "one"), ("equal", "slope"), ("equal", "sum"),
                       ("zero", "sum"), ("one", "sum"), ("slope", "sum")}  # fmt: skip
    first, second = rows["equal", "zero"], rows["equal", "one"]
    assert (first["df"], first["reference"]) == (1, "chi2(1)")
    assert first["ratio"] == pytest.approx(second["ratio"], abs=1e-4)
    # Equal means and equal variances of two normal samples: the variance of the residuals decides.
    y, by = frame["y"], frame.groupby("by")["y"].transform("mean")
    exact = 20.0 * np.log(np.sum((y - y.mean()) ** 2) / np.sum((y - by) ** 2))
    assert first["ratio"] == pytest.approx(exact, abs=1e-3)
    assert {frozenset(pair[:2]) for pair in found.without} == {
        frozenset(pair) for pair in (("zero", "one"), ("zero", "slope"), ("one", "slope"))
    }


def test_a_model_without_the_shift_of_groups_is_a_special_case_under_another_name() -> None:
    """y = own + shift of a group: the ratio of the analysis of variance, balanced (5 groups of 4).

    The maximum has the variances SSE/15 within and SSB/5 between groups (Searle et al. 1992, 4.2).
    """
    rng = np.random.default_rng(1)
    group = np.repeat([*"abcde"], 4)
    y = 3.0 + np.repeat(rng.normal(0.0, 0.8, 5), 4) + rng.normal(0.0, 0.5, 20)
    frame = pd.DataFrame({"id": range(20), "y": y, "group": group})
    table = Experiments.from_frame(frame, outcome="y", id="id")
    own, noise = Normal(Free(-9.0, 9.0), Free(0.0, 3.0)), Noise(0.1)
    shift = Normal(0.0, Free(0.0, 3.0))
    shifted = unjudged(
        lambda own, shift: own + shift, table,
        Inputs({"own": own, "shift": shift}, levels={"shift": "group"}), noise=noise,
        vectorized=True,
    )  # fmt: skip
    plain = found_by(lambda m: m, table, noise, m=own)
    (ratio,) = compare(plain=plain, shifted=shifted, ceilings=False).ratios
    mean = frame.groupby("group")["y"].transform("mean")
    within, between = ((y - mean) ** 2).sum(), ((mean - y.mean()) ** 2).sum()
    exact = 20.0 * np.log((within + between) / 20.0) - 15.0 * np.log(within / 15.0)
    exact -= 5.0 * np.log(between / 5.0)
    assert (ratio.smaller, ratio.larger) == ("plain", "shifted")
    assert ratio.reference == "1/2 chi2(0) + 1/2 chi2(1)"
    assert ratio.statistic == pytest.approx(exact, abs=2e-3)


def test_other_families_and_other_simulators_are_no_special_cases() -> None:
    """Their hyperparameters have the same names; their log-likelihoods there differ."""
    frame, fixed = made(), LogNormal(2.0, Free(0.0, 2.0))
    found = compare(proportional(frame, fixed), usual(), ceilings=False)
    assert found.ratios == ()
    assert found.nested().empty
    assert "elpd" in repr(found)
    boxes = [
        TruncatedNormal((low, 4.0), mean, Free(0.01, 2.0))
        for low, mean in ((0.0, 2.0), (1.0, Free(1.5, 3.0)))
    ]
    assert compare(*(proportional(frame, law) for law in boxes)).ratios == ()
    narrow = Normal(2.0, Free(0.0, 2.0))
    assert compare(proportional(frame, narrow), proportional(frame, scale=0.9)).ratios == ()


def test_a_pair_that_the_user_names_is_judged_by_drawn_data() -> None:
    frame = made()
    one = LogNormal(2.0, Free(0.0, 2.0))
    models = {"one": proportional(frame, one), "two": proportional(frame)}
    (ratio,) = compare(**models, nested=[("one", "two")], bootstrap=3).ratios
    assert ratio.reference == "bootstrap"
    assert np.isnan(ratio.p)
    assert ratio.bootstrap_p >= 0.25
    with pytest.raises(AleatorError, match="name the smaller model first"):
        compare(**models, nested=[("two", "one")])


def test_an_unsound_answer_is_marked() -> None:
    found = usual()
    contradicted = replace(found.consistency, consistent=False)
    marked = replace(found, sound=False, consistency=contradicted)
    compared = compare(a=found, b=marked, ceilings=False)
    table = compared.table()
    assert table["sound"].to_dict() == {"a": True, "b": False}
    assert table["consistent"].to_dict() == {"a": None, "b": False}
    assert np.all(np.isnan(table["below_ceiling"]))
    assert "below_ceiling" not in repr(compared)


def test_with_a_prior_there_is_no_reference_but_drawn_data() -> None:
    """And the likelihood is told without the prior."""
    frame = made()
    believed = Normal(Free(0.5, 4.0, prior=Normal(2.0, 0.1)), Free(0.0, 2.0))
    models = {"fixed": proportional(frame, Normal(2.0, Free(0.0, 2.0)))}
    models["believed"] = proportional(frame, believed)
    found = compare(**models, ceilings=False)
    (ratio,) = found.ratios
    assert ratio.reference == "bootstrap"
    likelihood = found.table().loc["believed", "log_likelihood"]
    assert likelihood == pytest.approx(models["believed"].fit.scored().each.sum())


def changed(**columns) -> pd.DataFrame:
    frame = made()
    for name, value in columns.items():
        frame.loc[4, name] = value
    return frame


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (changed(y=9.0), "experiment '1', 'y': the lower end is"),
        (made().iloc[:-1], "3 observations in model 'A' and 2"),
        (made().iloc[:-3], "experiment '9', which 'B' has not"),
        (made().iloc[::-1], "in another order"),
    ],
    ids=["value", "observation", "experiment", "order"],
)
def test_different_data_are_refused(other: pd.DataFrame, told: str) -> None:
    with pytest.raises(AleatorError, match=told):
        compare(usual(), proportional(other))


def test_a_bound_in_place_of_a_value_is_refused() -> None:
    bounded = made().assign(status=[*["seen"] * 4, "more", *["seen"] * 25])
    options = {"censored": Censoring("status", right="more")}
    with pytest.raises(AleatorError, match="the upper end is"):
        compare(usual(), proportional(bounded, **options))


def test_another_transform_is_refused_with_the_jacobian() -> None:
    frame = made()
    apart = np.log(frame["y"]).sum()
    with pytest.raises(AleatorError, match=f"{apart:.6g} apart by the Jacobian"):
        compare(proportional(frame), proportional(frame, transform="log"))


def test_misuse_is_told() -> None:
    found = usual()
    for arguments, told in [
        (((found,), {}), "1 models"),
        (((found, found), {"bootstrap": -1}), "-1 data sets"),
        (((found, found), {"nested": [("A", "C")]}), "no model 'C'"),
    ]:
        with pytest.raises(AleatorError, match=told):
            compare(*arguments[0], **arguments[1])


def test_a_comparison_makes_no_run() -> None:
    """Not for the best possible law either: on surfaces it is that of the surfaces."""
    runs = []

    def sprung(load: float, k: float) -> float:
        runs.append(k)
        return load * np.exp(k)

    rng = np.random.default_rng(8)
    load = np.linspace(0.5, 2.0, 10)
    y = load * np.exp(rng.normal(0.3, 0.2, 10)) + 0.02 * rng.standard_normal(10)
    frame = pd.DataFrame({"load": load, "y": y})
    laws = {"normal": Normal(Free(-1.0, 1.0), Free(0.01, 1.0)), "alike": Constant(Free(-1.0, 1.0))}
    models = {
        name: unjudged(
            sprung, frame, Inputs({"k": law}), outcome="y", noise=Noise(0.02), vectorized=False,
            verification=Check(0),
        )
        for name, law in laws.items()
    }  # fmt: skip
    made = len(runs)
    compared = compare(**models)
    table = compared.table()
    assert len(runs) == made > 0
    best = ceiling(models["normal"], replicates=0)
    assert len(runs) > made
    assert best.verified == pytest.approx(best.log_likelihood, abs=0.05)
    assert table.loc["normal", "below_ceiling"] == pytest.approx(best.gap)
    assert np.isnan(table.loc["alike", "below_ceiling"])
    (why,) = (model.no_ceiling for model in compared.models if model.name == "alike")
    assert f"alike: {why}" in repr(compared)


def test_a_default_of_the_simulator_is_a_constant_and_a_stored_answer_is_taken(
    tmp_path: Path,
) -> None:
    frame = made()
    table = Experiments.from_frame(frame, outcome="y", id="id")
    noise, law = Noise(Free(0.01, 2.0)), Normal(Free(0.5, 4.0), Free(0.0, 2.0))

    def model(x, offset=0.25):
        return x + offset

    def found(law: Normal = law, **laws: Constant) -> Identification:
        return found_by(model, table, noise, x=law, **laws)

    left, fixed = found(), Constant(0.25)
    free, known = found(offset=Constant(Free(0.0, 0.5))), Normal(2.0, Free(0.0, 2.0))
    left.save(tmp_path / "left.json")
    again = load(
        tmp_path / "left.json", simulator=model, inputs={"x": law}, vectorized=True, noise=noise,
        experiments=table,
    )  # fmt: skip
    other = found(known, offset=Constant(0.2))
    compared = compare(
        again=again, free=free, fixed=found(known, offset=fixed), other=other, ceilings=False
    )
    pairs = {(r.smaller, r.larger): r for r in compared.ratios}
    assert {("again", "free"), ("fixed", "again")} <= {*pairs}
    assert pairs["again", "free"].statistic == pytest.approx(0.0, abs=2e-3)  # not identifiable
    reasons = {frozenset(pair[:2]): pair[2] for pair in compared.without}
    assert "offset.value" in reasons[frozenset(("other", "again"))]
    assert all(reason in repr(compared) for reason in reasons.values())
    row = compared.table().loc["again"]
    assert (row["aic"], row["bic"]) == pytest.approx((left.aic, left.bic), abs=1e-9)
    assert left.to_dict()["criteria"]["free"] == 3
