"""Laws that follow covariates: values, derivatives and limits by hand, and misuse."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aleator import By, Constant, Free, LogNormal, Normal, TruncatedNormal
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws import Law
from aleator.laws.covariates import DesignMatrix
from aleator.laws.inputs import Inputs

TABLE = pd.DataFrame(
    {
        "t": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
        "by": ["a", "a", "b", "b", "c", "c"],
        "kelvin": [290.0, 294.0, 300.0, 301.0, 305.0, 310.0],
    },
    index=[f"e{i}" for i in range(6)],
)
ALL = slice(0, 6)


def one(law: Law) -> Inputs:
    return Inputs({"k": law}).resolved(TABLE)


def names(inputs: Inputs) -> list[str]:
    return [h.name for h in inputs.hyperparameters]


# ------------------------------------------------------------------------------ values


def test_each_experiment_has_the_law_of_its_own_covariates() -> None:
    inputs = one(Normal(By("1 + t + C(by)", 0.0, 100.0), By("0 + C(by)", 0.1, 9.0)))
    assert names(inputs) == [
        "k.mean[Intercept]", "k.mean[t]", "k.mean[by=b]", "k.mean[by=c]",
        "k.sd[by=a]", "k.sd[by=b]", "k.sd[by=c]",
    ]  # fmt: skip
    alpha = np.array([10.0, 2.0, 5.0, 20.0, 1.0, 2.0, 3.0])
    xi = np.random.default_rng(1).normal(size=(6, 4, 1))
    mean = np.array([10.0, 12.0, 19.0, 21.0, 38.0, 40.0])
    sd = np.array([1.0, 1.0, 2.0, 2.0, 3.0, 3.0])
    found = inputs.individual(alpha, xi, ALL).x
    np.testing.assert_allclose(found[..., 0], mean[:, None] + sd[:, None] * xi[..., 0], rtol=1e-14)
    part = inputs.individual(alpha, xi[2:5], slice(2, 5)).x
    assert np.array_equal(part, found[2:5])


def test_scores_are_those_of_differences_for_tied_laws_with_covariates() -> None:
    laws: dict[str, Law] = {
        "a": LogNormal(By("1 + t", 1.0, 50.0), Free(0.1, 5.0)),
        "b": TruncatedNormal((-1.0, 8.0), By("0 + C(by)", 0.0, 6.0), By("0 + C(by)", 0.1, 3.0)),
        "c": Constant(By("1 + by + t", -10.0, 10.0)),
    }
    inputs = Inputs(laws, {("a", "b"): Free(-0.9, 0.9)}).resolved(TABLE)
    alpha = np.array([
        3.0, 2.0, 1.5,  # a
        1.0, 2.0, 3.0, 0.5, 0.9, 2.0,  # b
        1.0, -2.0, 3.0, 0.7,  # c
        0.4,
    ])  # fmt: skip
    rng = np.random.default_rng(2)
    xi, weight = rng.normal(size=(6, 3, 2)), rng.normal(size=(6, 3, 3))
    score = inputs.individual(alpha, xi, ALL).score(weight, np.ones(weight.shape[:2]))
    for k in range(alpha.size):
        h = 1e-6 * np.eye(alpha.size)[k]
        ends = [inputs.individual(alpha + sign * h, xi, ALL).x for sign in (1.0, -1.0)]
        slope = np.sum(weight * (ends[0] - ends[1]) / 2e-6, axis=(1, 2))
        np.testing.assert_allclose(score[:, k], slope, rtol=1e-6, atol=1e-7)


def test_a_value_is_held_within_its_limits_and_no_longer_moves() -> None:
    inputs = one(Normal(By("1 + t", 0.0, 10.0), 1.0))
    alpha = np.array([5.0, 2.0, 1.0])
    individual = inputs.individual(alpha, np.zeros((6, 1, 1)), ALL)
    assert individual.x.ravel().tolist() == [5.0, 7.0, 9.0, 10.0, 10.0, 10.0]
    score = individual.score(np.ones((6, 1, 1)), np.ones((6, 1)))
    assert score[:, 1].tolist() == [0.0, 1.0, 2.0, 0.0, 0.0, 0.0]
    assert inputs.covariate_model is not None
    assert inputs.covariate_model.on_limits(alpha)["k.mean"].tolist() == [3, 4, 5]


def test_other_experiments_have_the_coefficients_of_those_that_were_identified() -> None:
    inputs = one(Normal(By("1 + center(t) + C(by)", 0.0, 10.0), 1.0))
    new = pd.DataFrame({"t": [3.5, 2.5], "by": ["c", "a"]}, index=["n1", "n2"])
    there = inputs.resolved(new)
    assert names(there) == names(inputs)
    alpha = np.array([1.0, 2.0, 3.0, 4.0, 1.0])
    # centered at the mean 2.5 of the first table
    found = there.individual(alpha, np.zeros((2, 1, 1)), slice(0, 2)).x
    assert found.ravel().tolist() == [7.0, 1.0]


# ------------------------------------------------------------------------------ limits


def limits(inputs: Inputs) -> list[tuple[float, float]]:
    return [(h.lower, h.upper) for h in inputs.hyperparameters]


def test_coefficients_have_the_limits_of_the_value_and_of_its_slopes() -> None:
    inputs = one(Normal(By("1 + t + C(by)", 2.0, 12.0), By("0 + C(by)", 0.5, 3.0)))
    assert limits(inputs) == [(2.0, 12.0), (-2.0, 2.0), (-10.0, 10.0), (-10.0, 10.0)] + 3 * [
        (0.5, 3.0)
    ]
    start = np.array([h.start for h in inputs.hyperparameters])
    assert start[:4].tolist() == [7.0, 0.0, 0.0, 0.0]
    assert [h.log for h in inputs.hyperparameters] == 4 * [False] + 3 * [True]


def test_limits_by_term_are_the_users() -> None:
    terms = {"t": Free(0.0, 0.5), "by=b": 3.0}
    found = one(Normal(By("1 + t + C(by)", 2.0, 12.0, terms=terms), 1.0)).hyperparameters
    assert (found[1].lower, found[1].upper, found[1].start) == (0.0, 0.5, 0.0)
    assert (found[2].start, found[2].free) == (3.0, False)


def values(inputs: Inputs, alpha: Array) -> Array:
    return inputs.individual(alpha, np.zeros((6, 1, 1)), ALL).x.ravel()


def test_the_intercept_far_from_all_experiments_may_be_where_any_line_has_it() -> None:
    inputs = one(Normal(By("1 + kelvin", 2.0, 12.0), 1.0))
    intercept, slope = inputs.hyperparameters[:2]
    # the steepest line within the limits: 2 at 290, 12 at 310
    assert slope.upper == pytest.approx(0.5)
    assert intercept.lower < 2.0 - 290.0 * 0.5
    steepest = np.array([2.0 - 290.0 * 0.5, 0.5, 1.0])
    np.testing.assert_allclose(values(inputs, steepest)[[0, -1]], [2.0, 12.0])
    # the search looks at the value at the mean of the covariate
    assert intercept.beside is not None
    assert intercept.beside.terms == (("k.mean[kelvin]", pytest.approx(300.0)),)


def test_a_formula_without_intercept_has_limits_too() -> None:
    (slope, _) = one(Normal(By("0 + t", 0.0, 10.0), 1.0)).hyperparameters
    assert (slope.lower, slope.upper) == (-2.0, 2.0)


# ------------------------------------------------------------------------------ what a formula is


@pytest.mark.parametrize(
    ("term", "column"),
    [
        ("I(t**2)", lambda t: t**2),
        ("{(t + 1)/(kelvin - 280)}", lambda t: (t + 1.0) / (TABLE["kelvin"] - 280.0)),
        ("sqrt(t)", np.sqrt),
        ("max(t, 2.5)", lambda t: np.maximum(t, 2.5)),
        ("center(exp(t))", lambda t: np.exp(t) - np.exp(t).mean()),
        ("I(2**t)", lambda t: 2.0**t),
        ("log(`my col`)", lambda t: np.log(t + 1.0)),
        ("t:kelvin", lambda t: t * TABLE["kelvin"]),
    ],
)
def test_a_term_is_the_column_that_it_says(term: str, column: Callable[[Array], Array]) -> None:
    table = TABLE.assign(**{"my col": TABLE["t"] + 1.0})
    found = DesignMatrix.of(f"1 + {term}", table).matrix[:, 1]
    np.testing.assert_allclose(found, column(np.asarray(TABLE["t"])), rtol=1e-14)


def test_a_power_of_whole_numbers_does_not_overflow() -> None:
    table = pd.DataFrame({"n": [10, 20, 30, 40]})
    found = DesignMatrix.of("1 + I(n**20)", table).matrix[:, 1]
    np.testing.assert_allclose(found, [10.0**20, 20.0**20, 30.0**20, 40.0**20], rtol=1e-14)


def test_levels_are_coded_as_is_asked_for() -> None:
    found = DesignMatrix.of("1 + C(by, contr.treatment(base='b'))", TABLE)
    assert found.matrix[:, 1:].sum(axis=0).tolist() == [2.0, 2.0]
    assert np.all(found.matrix[2:4, 1:] == 0.0)


@pytest.mark.parametrize(
    "formula",
    [
        "{np.f2py.os.system('touch X')*t}",
        "t.__init__.__globals__['sys'].modules['os'].system('touch X')",
        "I(t.__init__.__globals__['sys'].modules['os'].system('touch X')*t)",
        "{np.load('evil.npy', allow_pickle=True)}",
        "{np.savetxt('X', [1])}",
        "{t.to_csv('X')}",
        "I(t.to_csv('X'))",
        "I(open('X','w').write('x')*t)",
        "1 + np.save('X', t)",
        "1 + log(np.save('X', t))",
        "1 + center(np.save('X', t))",
        "t[t.to_csv('X')]",
        "__import__('os').system('touch X')",
        "C(by, contr.treatment(base=open('X', 'w')))",
        "bs(t, df=4, constraints=open('X', 'w'))",
        "{(lambda: open('X', 'w'))() and t}",
        "{[open('X', 'w') for i in t]}",
        "np",
        "1 + `np`",
    ],
)
def test_a_formula_runs_no_code(
    formula: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with (tmp_path / "evil.npy").open("wb") as file:
        np.save(file, np.array([Evil(), None]), allow_pickle=True)
    with pytest.raises(InputsError) as caught:
        DesignMatrix.of(formula, TABLE)
    assert [path.name for path in tmp_path.iterdir()] == ["evil.npy"]
    assert caught.value.remedy


class Evil:
    """What makes a file X when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return open, ("X", "w")


@pytest.mark.parametrize(
    "formula",
    [
        "2**2**2**2**2**2",
        "I(9**9**9*t)",
        "I((9**9)**9**9*t)",
        "(t + kelvin)**50",
        "((((t + by)**9)**9)**9)**9",
        "*".join(f"x{k}" for k in range(40)),
        "t**1000000000",
        "bs(t, df=10**9)",
        "bs(t, df=1000000000)",
        "poly(t, 1000000000)",
        "I(by*1000000000)",
        "1" + " + t" * 3000,
        "I(" + "-" * 1500 + "t)",
        ".",
        "1 + .",
    ],
)
def test_a_formula_of_endless_work_is_refused_at_once(formula: str) -> None:
    began = time.process_time()
    with pytest.raises(InputsError) as caught:
        DesignMatrix.of(formula, TABLE)
    assert time.process_time() - began < 5.0
    assert "__formulaic" not in str(caught.value)


# ------------------------------------------------------------------------------ misuse


@pytest.mark.parametrize(
    ("formula", "told"),
    [
        ("1 + tt", ["tt", "did you mean 't'", "by"]),
        ("1 + t + I(2*t)", ["I(2 * t)"]),
        ("1 + log(t)", ["e0"]),
        ("1 + t +", ["formula"]),
        ("1 + foo(t)", ["foo"]),
        ("k ~ t", ["k"]),
        ("t ~ by", ["one side"]),
        ("0", ["no terms"]),
    ],
)
def test_a_formula_that_says_nothing_sensible_is_told(formula: str, told: list[str]) -> None:
    with pytest.raises(InputsError) as caught:
        one(Normal(By(formula, 0.0, 1.0), 1.0))
    assert all(part in str(caught.value) for part in ["k.mean", *told])


def test_a_level_of_one_experiment_and_an_empty_cell_are_told_with_the_experiment() -> None:
    lonely = TABLE.assign(by=["a", "a", "b", "b", "b", "c"])
    inputs = Inputs({"k": Normal(By("1 + by", 0.0, 1.0), 1.0)})
    with pytest.raises(InputsError, match="'e5' is the only one with by = c"):
        inputs.resolved(lonely)
    with pytest.raises(InputsError, match="experiment 'e1' has no by"):
        inputs.resolved(TABLE.assign(by=["a", None, "b", "b", "a", "b"]))


def test_a_level_that_no_experiment_had_is_told() -> None:
    inputs = one(Normal(By("1 + by", 0.0, 1.0), 1.0))
    with pytest.raises(InputsError, match="'z' is not among") as caught:
        inputs.resolved(TABLE.assign(by="z"))
    assert caught.value.remedy.endswith(f"one of {', '.join(sorted({*TABLE['by']}))}")
    levels = TABLE.assign(by=[1, 1, 2, 2, 3, 3])
    design = DesignMatrix.of("1 + C(by) + t", levels)
    assert design.at(levels).matrix.tolist() == design.matrix.tolist()
    with pytest.raises(InputsError, match="'4' is not among") as caught:
        design.at(levels.assign(by=4))
    assert caught.value.remedy.endswith("one of 1, 2, 3")
    with pytest.raises(InputsError, match="'c' is not among those of the formula"):
        DesignMatrix.of("1 + C(by, levels=['a', 'b'])", TABLE.assign(by=[*"aabbcc"]))


def test_what_asks_for_one_law_of_all_experiments_is_refused() -> None:
    inputs = Inputs({"k": Normal(By("1 + t + C(by)", 0.0, 1.0), 1.0)})
    assert inputs.regressed
    assert inputs.covariates == ("by", "t")
    for asked in (inputs, inputs.resolved(TABLE)):
        with pytest.raises(InputsError, match="differ between experiments"):
            asked.image(np.ones(3), np.zeros((1, 1)))
