"""A result is plain data: every kind of it is written to a file, read back, and the same again."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

import aleator
from aleator import (
    Budget,
    By,
    Censoring,
    Check,
    Experiments,
    Free,
    Identification,
    Inputs,
    MaximumEntropy,
    Mixture,
    Noise,
    Normal,
    ResponseSurface,
    identify,
)
from aleator.results.result import Result
from aleator.results.schema import read_answer
from aleator.results.values import (
    Estimate,
    ExperimentReport,
    LogLikelihoodReport,
    ObservationReport,
)
from aleator.tasks.identification import pictured

RNG = np.random.default_rng(71)
LOAD = np.linspace(0.6, 2.4, 14)
SLOPE = 1.1 + 0.15 * RNG.standard_normal(LOAD.size)
TABLE = pd.DataFrame({"load": LOAD, "y": LOAD * SLOPE + 0.05 * RNG.standard_normal(LOAD.size)})
SCATTER = Normal(Free(0.5, 2.0), Free(0.01, 0.8))
LAW = Inputs({"k": SCATTER})
UNCHECKED = Check(0)


def product(load: Any, k: Any) -> Any:
    return load * k


def brittle(load: float, k: float) -> float:
    return math.nan if 1e4 * k % 1.0 < 0.06 else load * k


def vectorized() -> Identification:
    return identify(product, TABLE, LAW, outcome="y", vectorized=True, units={"y": "mm"})


def by_moments() -> Identification:
    return identify(
        product,
        TABLE,
        LAW,
        outcome="y",
        density=MaximumEntropy(4),
        verification=UNCHECKED,
        best_law=False,
    )


def noisy() -> Identification:
    prior = Inputs({"k": Normal(Free(0.5, 2.0, prior=Normal(1.1, 0.2)), Free(0.01, 0.8))})
    return unjudged(product, TABLE, prior, outcome="y", noise=Noise(0.05), vectorized=False)


def with_pictures() -> Identification:
    return pictured(identify(product, TABLE, LAW, outcome="y", vectorized=True, noise=Noise(0.05)))


def of_a_mixture() -> Identification:
    k = np.concatenate([RNG.normal(1.0, 0.05, 12), RNG.normal(1.8, 0.05, 18)])
    frame = pd.DataFrame({"load": np.ones(30), "y": k + 0.02 * RNG.standard_normal(30)})
    part = Normal(Free(0.5, 2.5), Free(0.01, 0.6))
    return identify(
        product, frame, Inputs({"k": Mixture((part, part))}), outcome="y", vectorized=True,
        noise=Noise(0.02), best_law=False, consistency=False,
    )  # fmt: skip


def of_lines() -> Identification:
    """Two correlated parameters, several observations an experiment, some only bounded."""
    time, a = np.tile([0.0, 1.0, 2.0, 4.0], 9), RNG.normal(2.0, 0.5, 9)
    y = np.repeat(a, 4) + np.repeat(0.3 * a, 4) * time + 0.1 * RNG.standard_normal(36)
    frame = pd.DataFrame({"id": np.repeat(np.arange(9), 4), "time": time, "y": np.minimum(y, 4.0)})
    frame["cut"] = np.where(y > 4.0, "above", "")
    law = Inputs(
        {"a": Normal(Free(-5.0, 5.0), Free(0.01, 2.0)), "b": Normal(Free(-2.0, 2.0), 0.2)},
        {("a", "b"): Free(-0.95, 0.95)},
    )
    table = Experiments.from_frame(
        frame, outcome="y", id="id", censored=Censoring(column="cut", right="above")
    )
    return identify(
        lambda time, a, b: a + b * time,
        table,
        law,
        vectorized=True,
        noise=Noise(Free(0.01, 1.0)),
        best_law=False,
        consistency=False,
    )


def of_a_column() -> Identification:
    law = Inputs({"k": Normal(By("1 + load", -5.0, 5.0), Free(0.01, 0.8))})
    return unjudged(product, TABLE, law, outcome="y", vectorized=True, noise=Noise(0.05))


def of_logarithms() -> Identification:
    table = Experiments.from_frame(TABLE, outcome="y", transform="log")
    return identify(product, table, LAW, vectorized=True, verification=UNCHECKED, best_law=False)


def with_failures() -> Identification:
    return unjudged(brittle, TABLE, LAW, outcome="y", noise=Noise(0.05))


def out_of_runs() -> Identification:
    return identify(
        product, TABLE, LAW, outcome="y", noise=Noise(0.05), budget=Budget(220),
        propagation=ResponseSurface(), best_law=False,
    )  # fmt: skip


KINDS: list[Callable[[], Identification]] = [
    vectorized, by_moments, noisy, with_pictures, of_a_mixture, of_lines,
    of_a_column, of_logarithms, with_failures, out_of_runs,
]  # fmt: skip


def strange(value: Any, place: str = "") -> list[str]:
    """The places of values that are none of Python's numbers, texts, tuples, lists and dicts."""
    if is_dataclass(value):
        return [
            s
            for f in fields(value)
            if f.name != "session"
            for s in strange(getattr(value, f.name), f"{place}.{f.name}")
        ]
    if isinstance(value, Mapping):
        own = [] if type(value) is dict else [place]
        return own + [s for key, part in value.items() for s in strange(part, f"{place}.{key}")]
    if type(value) in (tuple, list):
        return [s for k, part in enumerate(value) for s in strange(part, f"{place}[{k}]")]
    known = value is None or type(value) in (str, bool, int, float) or isinstance(value, StrEnum)
    return [] if known else [f"{place}: {type(value).__name__}"]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_read_back_is_the_same(kind: Callable[[], Identification], tmp_path: Path) -> None:
    found, path = kind(), tmp_path / "found.json"
    assert strange(found) == []
    found.save(path)
    again, alone = aleator.load(path), Result.from_document(read_answer(path))
    assert again == found == alone == Result.from_document(found.to_dict())
    assert type(alone) is Result
    assert strange(alone) == []
    assert alone.to_dict().keys() == found.to_dict().keys()
    alone.save(tmp_path / "again.json")
    assert path.read_bytes() == (tmp_path / "again.json").read_bytes()
    assert repr(alone) == repr(found)
    name = next(iter(found.alpha))
    other = replace(found.alpha[name], estimate=np.nextafter(found.alpha[name].estimate, 99.0))
    assert replace(found, alpha={**found.alpha, name: other}) != found


def test_numbers_that_no_file_holds_are_the_same_before_and_after(tmp_path: Path) -> None:
    """Infinities, NaN and NumPy's numbers in every place where a numerical failure puts them."""
    nan, inf = np.float64(np.nan), np.float64(np.inf)
    row = ExperimentReport(
        id="1", outcome=np.float64(1.5), log_density=-inf, mean=nan, standard_deviation=inf,
        skewness=nan, kurtosis=inf, quantiles={"0.5": -inf}, pit=nan, status="outside_support",
        surface_error=inf,
    )  # fmt: skip
    failed = replace(row, id="2", log_density=nan, status="no_convergence")
    found = Result(
        alpha={"x.mean": Estimate(np.float64(2.0), inf, nan, (1.0, 3.0), None, np.bool_(False))},
        log_likelihood=LogLikelihoodReport(nan, inf, nan, error=inf),
        density="level sets", propagation="response_surface", sound=np.bool_(False), warnings=[],
        experiments=[row, failed], correlation_names=["x.mean"], correlation=np.eye(1),
        search={"edm": inf, "optima": ({"log_likelihood": inf, "starts": np.int64(1)},)},
        surface={"worst_error": inf}, baselines={}, runs=np.int64(7),
        runs_by_stage={"surfaces": np.int64(7)}, seconds={"total": np.float64(0.1)}, seed=0,
        quadrature={"nodes": 9, "gap": nan},
        best_possible={"log_likelihood": -inf, "gap": inf, "p_value": nan, "replicates": 40.0},
    )  # fmt: skip
    assert strange(found) == []
    assert found.experiments[0].log_density == -math.inf
    found.save(tmp_path / "found.json")
    assert aleator.load(tmp_path / "found.json") == found
    certain = replace(found, experiments=(row,))
    assert certain.log_likelihood.estimated == -math.inf
    certain.save(tmp_path / "certain.json")
    assert aleator.load(tmp_path / "certain.json") == certain != found


@pytest.mark.parametrize(
    ("lower", "upper", "end"), [(None, 4.0, -math.inf), (4.0, None, math.inf), (4.0, 4.0, None)]
)
def test_a_prediction_without_end_is_on_the_open_side(
    lower: float | None, upper: float | None, end: float | None
) -> None:
    told = ObservationReport("1", 1, "y", lower, upper, np.inf, 0.1, 0.0, {"time": 3, "at": "lab"})
    assert math.isnan(told.predicted) if end is None else told.predicted == end


def test_a_result_is_read_without_what_made_it() -> None:
    """Neither simulators nor likelihoods nor tasks are imported to read, print and write one."""
    program = (
        "import sys, aleator.results.result, aleator.results.schema; "
        "print(*sorted({m.split('.')[1] for m in sys.modules if m.startswith('aleator.')}))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    rooms = set(done.stdout.decode().split())
    above = {"simulators", "surrogates", "likelihood", "search", "inference", "tasks", "study"}
    assert "results" in rooms
    assert rooms & above == set()
