"""Wrong models of every kind: are they found, is the cause named, and does its remedy mend them?

Each case is made for one test of consistency: data that the first model contradicts, and the model
as the remedy has it. `python -m benchmarks findings --replicates 100` prints how many data sets are
called inconsistent, how many have the cause as their first finding, and how many of the mended
models are called inconsistent: 5 % would be right. Then right models of all kinds of noise. Lines
with normal laws are fitted in closed form (`mixed`), the others identified by Aleator. All data are
synthetic. The data sets are kept in a file, and none is judged twice. Of 443 right models
with seeds from 52000 29 were called inconsistent; docs/statistics/consistency.md has all shares.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from aleator import (
    AR1,
    Check,
    Free,
    Inputs,
    LogNormal,
    Mixture,
    Noise,
    Normal,
    StudentError,
    identify,
)
from aleator.core.progress import Silent
from aleator.core.types import Array
from aleator.inference.consistency import consistency_of
from aleator.inference.fit import Fit
from aleator.laws.hyperparameter import Hyperparameter
from aleator.results.values import Consistency
from benchmarks.kept import Entry, kept
from benchmarks.mixed import Mixed, Plan

LOADS, HOT, BENCHES = (1.0, 2.0, 3.0), (20.0, 50.0, 80.0), ("A", "B", "C")
MEAN, SD, NOISE = 1.0, 0.2, 0.1
HIDDEN = "true "
"""Columns of the data whose names begin so are in no table."""


@dataclass(frozen=True)
class Term:
    """A parameter of a line: what it multiplies (R,), and where its law is searched.

    What is not `free` keeps the value of `near`, of mean, coefficient and standard deviation. The
    mean follows a column `by` (R,), or none.
    """

    name: str
    along: Array | float = 1.0
    near: tuple[float, float] = (MEAN, SD)
    free: tuple[bool, bool] = (True, True)
    by: Array | None = None


def line(
    data: pd.DataFrame, terms: list[Term], noise: float | None = None,
    sds: Array | float = 1.0, tied: bool = False,
) -> Mixed:  # fmt: skip
    """A sum of terms with noise, at its maximum; sds (R,) multiply the noise, None is free."""
    m = len(data) // data["id"].nunique()
    shape, scale = (len(data) // m, m), np.broadcast_to(sds, len(data)).reshape(-1, m)
    curves = [np.broadcast_to(term.along, len(data)).reshape(shape) / scale for term in terms]
    designs, alpha, hyperparameters = [], list[float](), list[Hyperparameter]()
    for term in terms:
        columns = [np.ones(shape[0])]
        if term.by is not None:
            columns.append(term.by.reshape(shape)[:, 0])
        designs.append(np.stack(columns, axis=1))
        for k in range(len(columns)):
            name = f"{term.name}.mean{k or ''}"
            hyperparameters.append(Hyperparameter(name, -1e3, 1e3, 0.0, term.free[0]))
            alpha.append(0.0 if k else term.near[0])
        hyperparameters.append(_scale(f"{term.name}.sd", term.free[1]))
        alpha.append(term.near[1])
    if tied:
        hyperparameters.append(Hyperparameter("correlation", -0.99, 0.99, 0.0, True))
        alpha.append(0.0)
    hyperparameters.append(_scale("noise.sd", noise is None))
    alpha.append(NOISE if noise is None else noise)
    names = tuple(term.name for term in terms)
    plan = Plan(names, np.stack(curves, axis=2), tuple(designs), tuple(hyperparameters), tied)
    shown = data[[name for name in data if not str(name).startswith(HIDDEN)]]
    y = data["y"].to_numpy().reshape(shape) / scale
    return Mixed.of(plan, y, np.array(alpha), shown)


def _scale(name: str, free: bool) -> Hyperparameter:
    return Hyperparameter(name, 1e-4, 1e2, 0.1, free, log=True)


def experiments(rng: np.random.Generator, values: int = 1) -> pd.DataFrame:
    """108 experiments in a random order: loads, temperatures, benches, and batches of nine."""
    plan = pd.DataFrame(
        product(LOADS, HOT, BENCHES, range(4)), columns=["load", "hot", "bench", "k"]
    )
    plan = plan.drop(columns="k").sample(frac=1.0, random_state=rng).reset_index(drop=True)
    plan["batch"] = [f"batch {k}" for k in rng.permutation(np.arange(len(plan)) // 9)]
    plan["id"] = [f"e{k}" for k in range(len(plan))]
    if values > 1:
        plan = plan.loc[plan.index.repeat(values)].reset_index(drop=True)
        plan["load"] = np.tile(np.linspace(1.0, 3.0, values), len(plan) // values)
    return plan


def drawn(
    rng: np.random.Generator, plan: pd.DataFrame, a: Array | None = None,
    errors: Array | None = None, noise: Array | float = NOISE,
) -> pd.DataFrame:  # fmt: skip
    """y = a load + noise, of standard normal a (N,) and errors (R,) where none are given."""
    own = pd.factorize(plan["id"])[0]
    z = rng.standard_normal(own.max() + 1) if a is None else a
    e = rng.standard_normal(len(plan)) if errors is None else errors
    return plan.assign(y=plan["load"] * (MEAN + SD * z[own]) + noise * e)


def judged(fit: Mixed, seed: int) -> Consistency:
    """The second verdict of a fit."""
    return consistency_of(cast(Fit, fit), True, seed, Silent(), requested=("load",))


Verdict = Callable[[pd.DataFrame, int], Consistency]


@dataclass(frozen=True)
class Case:
    """Data, a model of them that is wrong, the model that its remedy makes, and what is named.

    `named` are the first findings, by kind and column, that say what is wrong.
    """

    draw: Callable[[np.random.Generator], pd.DataFrame]
    wrong: Verdict
    mended: Verdict
    named: frozenset[tuple[str, str | None]] = frozenset()
    slow: bool = False


def load(data: pd.DataFrame) -> Array:
    """The loads (R,)."""
    return np.asarray(data["load"], dtype=float)


def plain(data: pd.DataFrame, seed: int) -> Consistency:
    """The model y = a load + noise, all of it identified."""
    return judged(line(data, [Term("a", load(data))]), seed)


def known(data: pd.DataFrame, seed: int) -> Consistency:
    """The same whose noise is known."""
    return judged(line(data, [Term("a", load(data))], NOISE), seed)


def exact(data: pd.DataFrame, seed: int) -> Consistency:
    """The same without noise."""
    return judged(line(data, [Term("a", load(data))], 0.0), seed)


def weighted(data: pd.DataFrame, seed: int) -> Consistency:
    """The same with a column of standard deviations, the true ones."""
    sds = data[f"{HIDDEN}sd"].to_numpy()
    return judged(line(data, [Term("a", load(data))], 1.0, sds), seed)


def followed(column: str) -> Verdict:
    """The same with a mean that follows a column."""

    def verdict(data: pd.DataFrame, seed: int) -> Consistency:
        by = data[column].to_numpy(dtype=float)
        return judged(line(data, [Term("a", load(data), by=(by - by.mean()) / np.ptp(by))]), seed)

    return verdict


def identified(law: Any, noise: Noise | None) -> Verdict:
    """y = a load by Aleator altogether, with another law or noise."""

    def verdict(data: pd.DataFrame, seed: int) -> Consistency:
        shown = data[[name for name in data if not str(name).startswith(HIDDEN)]]
        return identify(
            lambda load, a: a * load, shown, Inputs({"a": law}), outcome="y", noise=noise,
            vectorized=True, verification=Check(0), seed=seed, best_law=False,
        ).consistency  # fmt: skip

    return verdict


def loud(rng: np.random.Generator, values: int, by: str, noise: float) -> pd.DataFrame:
    """Noise three times as large in a third of the experiments: at the last of three, or four of
    twelve batches, or in experiments that no column tells."""
    plan = experiments(rng, values)
    own = pd.factorize(plan["id"])[0]
    marks = {
        "hot": plan["hot"] == 50.0,
        "bench": plan["bench"] == "C",
        "batch": plan["batch"].str.split().str[1].astype(int) < 4,
        "no column": pd.Series((rng.permutation(own.max() + 1) % 3 == 0)[own]),
    }
    plan[f"{HIDDEN}sd"] = noise * np.where(marks[by], 3.0, 1.0)
    return drawn(rng, plan, noise=plan[f"{HIDDEN}sd"].to_numpy())


def _biased(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng)
    return drawn(rng, plan, 0.6 + rng.standard_normal(len(plan)))


def _lognormal(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng)
    return plan.assign(y=plan["load"] * np.exp(0.5 * rng.standard_normal(len(plan))))


def _logarithms(data: pd.DataFrame, seed: int) -> Consistency:
    shown = data.assign(y=np.log(data["y"] / data["load"]))
    return judged(line(shown, [Term("a")], 0.0), seed)


def _two_modes(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng)
    z = rng.choice([-0.9, 0.9], len(plan)) + 0.45 * rng.standard_normal(len(plan))
    return drawn(rng, plan, z, noise=0.5 * NOISE)


def _heavy_noise(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng)
    return drawn(rng, plan, errors=rng.standard_t(2.5, len(plan)), noise=3.0 * NOISE)


def _gross_error(rng: np.random.Generator) -> pd.DataFrame:
    data = drawn(rng, experiments(rng))
    at = int(rng.integers(len(data)))
    y = data["y"].to_numpy(copy=True)
    y[at] += 8.0 * np.hypot(NOISE, SD * data["load"].to_numpy()[at])
    data["y"] = y
    data[f"{HIDDEN}error"] = np.arange(len(data)) == at
    return data


def _without_error(data: pd.DataFrame, seed: int) -> Consistency:
    return exact(data[~data[f"{HIDDEN}error"]].reset_index(drop=True), seed)


def _drift(values: int) -> Callable[[np.random.Generator], pd.DataFrame]:
    def draw(rng: np.random.Generator) -> pd.DataFrame:
        plan = experiments(rng, values)
        own = plan.groupby("id", sort=False).first()
        return drawn(rng, plan, (own["hot"].to_numpy() - 50.0) / 60.0 + rng.standard_normal(108))

    return draw


def _other_bench(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng)
    plan[f"{HIDDEN}bench"] = 1.0 * (plan["bench"] == "B")
    return drawn(rng, plan, 1.0 * plan[f"{HIDDEN}bench"].to_numpy() + rng.standard_normal(108))


def _other_curve(rng: np.random.Generator) -> pd.DataFrame:
    data = drawn(rng, experiments(rng, 5))
    return data.assign(y=data["y"] + 0.08 * (data["load"] - 2.0) ** 2)


def _mended_curve(data: pd.DataFrame, seed: int) -> Consistency:
    bend = Term("c", (load(data) - 2.0) ** 2, (0.0, 0.0), (True, False))
    return judged(line(data, [Term("a", load(data)), bend]), seed)


def _unlike_parameters(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng, 3)
    own = plan.groupby("id", sort=False)["bench"].first().to_numpy()
    return drawn(rng, plan, np.where(own == "C", 3.0, 1.0) * rng.standard_normal(108))


def _own_scatter(data: pd.DataFrame, seed: int) -> Consistency:
    there = (data["bench"] == "C").to_numpy()
    terms = [Term("a", load(data) * ~there), Term("c", load(data) * there)]
    return judged(line(data, terms), seed)


def _growing_noise(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng, 5)
    plan[f"{HIDDEN}sd"] = 0.5 * NOISE * plan["load"]
    return drawn(rng, plan, noise=plan[f"{HIDDEN}sd"].to_numpy())


def _moving_average(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng, 12)
    u = rng.standard_normal((108, 13))
    return drawn(rng, plan, errors=((u[:, 1:] + u[:, :-1]) / np.sqrt(2.0)).ravel())


def _autoregressive(rng: np.random.Generator) -> pd.DataFrame:
    """20 series of ten values whose neighbours are correlated by 0.5."""
    plan = experiments(rng, 10)[:200]
    lags = np.abs(np.subtract.outer(np.arange(10), np.arange(10)))
    root = np.linalg.cholesky(0.5**lags)
    return drawn(rng, plan, errors=(rng.standard_normal((20, 10)) @ root.T).ravel())


def _every_second(data: pd.DataFrame, seed: int) -> Consistency:
    return plain(data.iloc[::2].reset_index(drop=True), seed)


def _subjects(shuffled: bool) -> Callable[[np.random.Generator], pd.DataFrame]:
    """36 subjects of three rows each, which the table takes as experiments."""

    def draw(rng: np.random.Generator) -> pd.DataFrame:
        plan = experiments(rng)
        subject = np.repeat([f"s{k}" for k in range(36)], 3)
        a = np.repeat(rng.standard_normal(36), 3)
        data = drawn(rng, plan, a)
        data["panel" if shuffled else f"{HIDDEN}panel"] = subject
        return data.sample(frac=1.0, random_state=rng).reset_index(drop=True) if shuffled else data

    return draw


def _by_subject(data: pd.DataFrame, seed: int) -> Consistency:
    panel = "panel" if "panel" in data else f"{HIDDEN}panel"
    sorted_ = data.sort_values(panel, kind="stable").reset_index(drop=True)
    return plain(sorted_.assign(id=sorted_[panel]).drop(columns=panel), seed)


def _biased_times(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng, 10)[:400]
    bias = 0.5 * NOISE * rng.standard_normal(10)
    data = drawn(rng, plan)
    return data.assign(y=data["y"] + np.tile(bias, 40))


def _free_times(data: pd.DataFrame, seed: int) -> Consistency:
    terms = [Term("a", load(data))]
    for k, value in enumerate(np.unique(load(data))):
        at = 1.0 * (load(data) == value)
        terms.append(Term(f"c{k}", at, (0.0, 0.0), (k > 0, False)))
    return judged(line(data, terms), seed)


def _heavy_times(rng: np.random.Generator) -> pd.DataFrame:
    """A free mean for every time, as the model has it, and noise of Student's t."""
    plan = experiments(rng, 10)[:400]
    return drawn(rng, plan, errors=rng.standard_t(4.0, len(plan)))


def _correlated(rng: np.random.Generator) -> pd.DataFrame:
    plan = experiments(rng, 4)
    u, v = rng.standard_normal((2, 108))
    own = pd.factorize(plan["id"])[0]
    b = 1.0 + SD * (0.7 * u + np.sqrt(1.0 - 0.49) * v)
    return drawn(rng, plan, u).assign(y=lambda data: data["y"] + b[own])


def _lines(tied: bool) -> Verdict:
    def verdict(data: pd.DataFrame, seed: int) -> Consistency:
        return judged(line(data, [Term("a", load(data)), Term("b")], tied=tied), seed)

    return verdict


def _skewed_series(rng: np.random.Generator) -> pd.DataFrame:
    a = np.exp(0.5 * rng.standard_normal(60))
    return drawn(rng, experiments(rng, 3)[:180], (a - MEAN) / SD)


ORDER = "the order of the rows"
WIDE, NARROW = Free(-3.0, 5.0), Free(0.01, 3.0)
CASES: Mapping[str, Case] = {
    "a mean known wrongly": Case(
        _biased,
        lambda data, seed: judged(line(data, [Term("a", load(data), free=(False, True))]), seed),
        plain, frozenset({("level", None)}),
    ),
    "noise known wrongly": Case(
        lambda rng: drawn(rng, experiments(rng, 3), noise=2.0 * NOISE), known, plain,
        frozenset({("scale", None)}),
    ),
    "a lognormal law": Case(_lognormal, exact, _logarithms, frozenset({("skewness", None)})),
    "a lognormal law, series": Case(
        _skewed_series, plain, identified(LogNormal(Free(0.1, 5.0), NARROW), Noise(NARROW)),
        frozenset({("skewness", None)}), slow=True,
    ),
    "two modes": Case(
        _two_modes, known,
        identified(Mixture((Normal(WIDE, NARROW), Normal(WIDE, NARROW))), Noise(0.5 * NOISE)),
        frozenset({("light tails", None)}), slow=True,
    ),
    "Student's noise": Case(
        _heavy_noise, plain, identified(Normal(WIDE, NARROW), Noise(NARROW, StudentError(2.5))),
        frozenset({("heavy tails", None), ("outlier", None)}), slow=True,
    ),
    "Student's noise, free means": Case(
        _heavy_times, _free_times, _free_times,
        frozenset({("heavy tails", None), ("outlier", None)}),
    ),
    "a gross error": Case(
        _gross_error, exact, _without_error, frozenset({("outlier", None), ("heavy tails", None)})
    ),
    "a mean with a drift": Case(
        _drift(1), plain, followed("hot"), frozenset({("contrast", "hot")})
    ),
    "the same, series": Case(
        _drift(3), plain, followed("hot"), frozenset({("contrast", "hot"), ("relation", "hot")})
    ),
    "a mean of its own on one bench": Case(
        _other_bench, plain, followed(f"{HIDDEN}bench"), frozenset({("contrast", "bench")})
    ),
    "another curve": Case(
        _other_curve, plain, _mended_curve, frozenset({("contrast", "load")})
    ),
    "an sd of its own on one bench": Case(
        _unlike_parameters, plain, _own_scatter, frozenset({("contrast", "bench")})
    ),
    "noise that grows": Case(
        _growing_noise, plain, weighted, frozenset({("contrast", "load")})
    ),
    "errors that depend on each other": Case(
        _moving_average, plain, _every_second, frozenset({("neighbours", None), ("groups", ORDER)})
    ),
    "errors of AR(1)": Case(
        _autoregressive, plain, identified(Normal(WIDE, NARROW), Noise(NARROW, correlation=AR1())),
        frozenset({("neighbours", None)}), slow=True,
    ),
    "subjects by a column": Case(
        _subjects(True), plain, _by_subject, frozenset({("groups", "panel")})
    ),
    "subjects in the rows": Case(
        _subjects(False), plain, _by_subject, frozenset({("neighbours", None)})
    ),
    "biased times": Case(
        _biased_times, plain, _free_times, frozenset({("groups", "load"), ("contrast", "load")})
    ),
    "parameters that are correlated": Case(
        _correlated, _lines(False), _lines(True), frozenset({("pair", "b")})
    ),
} | {
    f"loud by {by}, {kind.__name__}, {values}, {noise}": Case(
        partial(loud, values=values, by=by, noise=noise),
        kind, weighted,
        frozenset({("contrast", by), ("unequal", ORDER if by == "no column" else by)}),
    )
    for kind, values, noise, by in (
        (plain, 1, 0.3, "hot"), (plain, 1, 0.3, "bench"), (plain, 1, 0.3, "batch"),
        (plain, 1, 0.3, "no column"), (known, 1, 0.1, "hot"),
        (plain, 3, 0.1, "hot"), (plain, 3, 0.1, "batch"), (plain, 3, 0.1, "no column"),
        (known, 3, 0.1, "hot"), (known, 3, 0.1, "no column"),
    )
}  # fmt: skip
RIGHT: Mapping[str, tuple[int, int, Verdict]] = {
    "noise known": (108, 1, known),
    "noise identified": (108, 1, plain),
    "without noise": (108, 1, exact),
    "noise known, series": (108, 3, known),
    "noise identified, series": (108, 3, plain),
    "20 experiments, without noise": (20, 1, exact),
    "15 series, noise identified": (15, 3, plain),
}


def judge(name: str, seed: int) -> Entry:
    """One data set of a case by both models, or of a right model."""
    rng = np.random.default_rng([seed, *name.encode()])
    if name in RIGHT:
        count, values, model = RIGHT[name]
        return {"right": _told(model(drawn(rng, experiments(rng, values))[: count * values], seed))}
    case = CASES[name]
    data = case.draw(rng)
    return {"wrong": _told(case.wrong(data, seed)), "mended": _told(case.mended(data, seed))}


def _told(found: Consistency) -> dict[str, Any]:
    tests, hint = [d.test for d in found.discrepancies], found.covariate
    return {"consistent": found.consistent, "p": found.p,
            "covariate": None if hint is None else [hint.test.of, hint.test.column],
            "told": [[t.kind, t.of, t.column, t.where] for t in tests]}  # fmt: skip


def print_findings(console: Console, path: Path, replicates: int) -> None:
    """Judge the data sets that the file lacks, and print the shares of all."""
    keys = [(name, seed) for seed in range(replicates) for name in (*RIGHT, *CASES)]
    entries = kept(path, keys, judge)
    wrong = Table("what is wrong", "data sets", "found", "cause named first", "mended, found")
    for name, case in CASES.items():
        some = [entry for key, entry in entries.items() if key[0] == name]
        found = [e["wrong"]["told"] for e in some if e["wrong"]["consistent"] is False]
        named = sum((told[0][0], told[0][2]) in case.named for told in found)
        after = sum(e["mended"]["consistent"] is False for e in some)
        wrong.add_row(name, *map(str, (len(some), len(found), named, after)))
    console.print(wrong)
    right = Table("right model", "data sets", "called inconsistent", "covariate hinted", "by")
    for name in RIGHT:
        some = [entry["right"] for key, entry in entries.items() if key[0] == name]
        told = [e["told"][0] for e in some if e["consistent"] is False]
        kinds = Counter(f"{kind} of {of}" for kind, of, *_ in told)
        hinted = sum(e["covariate"] is not None for e in some)
        by = ", ".join(f"{k} {n}" for k, n in kinds.items())
        right.add_row(name, *map(str, (len(some), len(told), hinted)), by)
    console.print(right)
