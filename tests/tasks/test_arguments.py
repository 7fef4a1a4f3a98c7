"""What a user may write in place of the library's types, and what wrong arguments are told."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import stats

import aleator
from aleator import (
    CMAES,
    Check,
    Experiments,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    LogNormal,
    Mixture,
    Noise,
    Normal,
    Runner,
    Store,
    Uniform,
)
from aleator.errors import AleatorError

RNG = np.random.default_rng(7)
SLOPES = np.repeat(RNG.normal(2.0, 0.3, 8), 2)
TABLE = pd.DataFrame({"unit": np.repeat([*"abcdefgh"], 2), "load": np.tile([1.0, 3.0], 8)})
TABLE["travel"] = SLOPES * TABLE["load"] + RNG.normal(0.0, 0.2, 16)
LAW = {"slope": Normal(mean=Free(1.0, 3.0), sd=Free(0.01, 1.0))}


def spring(load: float, slope: float) -> float:
    return load * slope


def asked(
    simulator: Any = spring, table: Any = TABLE, law: Any = LAW, **more: Any
) -> Identification:
    given = {
        "outcome": "travel", "noise": 0.2, "vectorized": True, "search": GradientMultistart(1),
        "verification": Check(0),
    }  # fmt: skip
    return unjudged(simulator, table, law, **given | more)


def test_rows_of_one_id_share_one_draw() -> None:
    """Two values of a unit are a pair of correlated normal variates: a closed form."""
    found = asked(id="unit")
    mean, sd = found.values["slope.mean"], found.values["slope.sd"]
    load = np.array([1.0, 3.0])
    pair = stats.multivariate_normal(load * mean, sd**2 * np.outer(load, load) + 0.04 * np.eye(2))
    exact = pair.logpdf(TABLE["travel"].to_numpy().reshape(8, 2)).sum()
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=1e-6)
    assert (
        found.log_likelihood.estimated
        == asked(
            table=Experiments.from_frame(TABLE, outcome="travel", id="unit"), outcome=None
        ).log_likelihood.estimated
    )
    told = found.predict({"load": 3.0}, of="c", noise=False, uncertainty=False)
    own = found.individuals.loc["c", "slope.mean"]
    assert told["mean"][0] == pytest.approx(3.0 * own, abs=0.02)
    assert "unit" not in told
    assert found.predict(of="c")["unit"].tolist() == ["c", "c"]
    assert found.predict(of="unit")["unit"].tolist() == TABLE["unit"].tolist()


@pytest.mark.parametrize(
    "written",
    [
        {"noise": Noise(0.2)},
        {"noise": {"travel": 0.2}},
        {"law": Inputs(LAW)},
        {"table": TABLE.to_dict("list")},
        {"outcome": ["travel"]},
    ],
)
def test_short_forms_mean_the_same(written: dict[str, Any]) -> None:
    assert asked(**written).values.to_numpy() == pytest.approx(asked().values.to_numpy())


class Frame:
    """Like the data frame of another library."""

    def to_pandas(self) -> pd.DataFrame:
        return TABLE


@pytest.mark.parametrize(
    ("call", "right"),
    [
        (lambda: asked(noise="0.2"), "noise=0.1"),
        (lambda: asked(noise=True), "noise=0.1"),
        (lambda: asked(noise=Noise), "Noise(...)"),
        (lambda: asked(noise=Normal(0.0, 0.1)), "noise=Free("),
        (lambda: asked(law=Normal(2.0, 0.1)), '{"stiffness": Normal('),
        (lambda: asked(law=TABLE), '{"stiffness": Normal('),
        (lambda: asked(law={"slope": Normal}), "Normal(...)"),
        (lambda: asked(law={"slope": (1.0, 3.0)}), "TruncatedNormal(box=(1.0, 3.0))"),
        (lambda: asked(law={"slope": 2.0}), "Constant(2.0)"),
        (lambda: Mixture(Normal(1.0, 0.1), Normal(2.0, 0.1)), "Mixture([Normal("),  # type: ignore[arg-type]
        (lambda: Mixture([2.0, Normal(2.0, 0.1)]), "Constant(2.0)"),  # type: ignore[arg-type, list-item]
        (lambda: Normal(Free(math.nan, 1.0), 0.1), "a lower and an upper limit"),
        (lambda: asked(law={"slope": Free(1.0, 3.0)}), "Constant(Free("),
        (lambda: asked(law={"slope": stats.norm(2.0, 0.1)}), "ScipyLaw("),
        (lambda: asked(table=TABLE.to_dict("records")), "pandas.DataFrame(rows)"),
        (lambda: asked(table=TABLE[["load", "travel"]].to_numpy()), "name the columns"),
        (lambda: asked(table="springs.csv"), "pandas.read_csv('springs.csv')"),
        (lambda: asked(table=Frame()), "to_pandas()"),
        (lambda: asked(table=TABLE["travel"]), "to_frame()"),
        (lambda: asked(table={"load": [1.0, 2.0], "travel": [1.0]}), "one length"),
        (lambda: asked(outcome=None), 'outcome="travel"'),
        (lambda: asked(outcome=TABLE["travel"]), 'outcome="travel"'),
        (lambda: asked(table=Experiments.from_frame(TABLE, outcome="travel")), "leave it out"),
        (lambda: asked(id="uni"), "'unit'"),
        (lambda: asked("model.py:spring"), "the function itself"),
        (lambda: asked(lambda load: load), "it has load"),
        (lambda: asked(search="cmaes"), "search=CMAES()"),
        (lambda: asked(search=CMAES), "search=CMAES()"),
        (lambda: asked(verification=False), "Check(0)"),
        (lambda: asked(budget=100), "Budget(runs=100)"),
        (lambda: asked(seed="a"), "seed=0"),
        (lambda: asked(propagation="process"), "ResponseSurface()"),
        (lambda: asked(progress=True), "ProgressLine()"),
        (lambda: asked(units="mm"), '{"travel": "mm"}'),
        (lambda: aleator.screen(spring, [1.0], {"slope": Uniform(2.0, 0.1)}), "name the columns"),
        (lambda: aleator.feasible_box(spring, TABLE, [Normal(1.0, 0.1)]), '{"stiffness"'),
    ],
)  # fmt: skip
def test_a_wrong_argument_is_told_the_right_call(call: Callable[[], Any], right: str) -> None:
    with pytest.raises(AleatorError) as caught:
        call()
    assert right in caught.value.remedy


def test_wrong_questions_are_told_the_right_call() -> None:
    found = asked()
    for call, right in (
        (lambda: found.predict(50.0), "{'force'"),
        (lambda: found.predict({"lod": 50.0}), "load"),
        (lambda: found.predict({}), "give load"),
        (lambda: found.predict({"load": 1.0}, uncertainty="no"), "found.draws("),
        (lambda: found.probability(26.0), "'travel > 26'"),
        (lambda: found.tolerance(95, 90), "0.95 and 0.90"),
        (lambda: found.tolerance(TABLE), "0.95 and 0.90"),
        (lambda: found.tolerance(outcome="slope"), "travel"),
        (lambda: found.draws(0), "one or more"),
        (lambda: aleator.next_experiments(found, TABLE, 1, about=["slope.sd"]), "Predicted(...)"),
        (lambda: aleator.next_experiments({}, TABLE, 1), "identify(...)"),
        (lambda: found.tolerance(outcome="heat", side="upp"), '"upper"'),
    ):
        with pytest.raises(AleatorError) as caught:
            call()
        assert right in caught.value.remedy
    alone = replace(found, session=replace(found.session, experiments=None))
    with pytest.raises(AleatorError, match="'load'"):
        alone.predict({})


def test_a_simulator_without_conditions_is_asked_without_any() -> None:
    table = pd.DataFrame({"y": np.exp(0.1 * stats.norm.ppf((np.arange(12) + 0.5) / 12))})
    found = aleator.identify(
        lambda k: 2.0 * k, table, {"k": LogNormal(Free(0.2, 2.0), Free(0.01, 1.0))}, outcome="y",
        noise=0.01, consistency=False, best_law=False,
    )  # fmt: skip
    alone = replace(found, session=replace(found.session, experiments=None))
    with pytest.raises(AleatorError) as caught:
        found.predict({"load": 1.0})
    assert "leave it out" in caught.value.remedy
    for one in (found, alone):
        assert one.predict({}, uncertainty=False)["q0.5"][0] == pytest.approx(1.0, abs=0.01)


def test_every_public_name_tells_of_an_argument_that_it_has_not() -> None:
    for name in {*aleator.__all__} - {"AleatorError", "compare"}:
        with pytest.raises(AleatorError, match="argument"):
            getattr(aleator, name)(no_such_argument=1)
    with pytest.raises(AleatorError, match=r"'meanlog'.*\n.*mean, sd, lower"):
        LogNormal(meanlog=1.0)  # type: ignore[call-arg]
    with pytest.raises(AleatorError, match=r"Inputs\(\.\.\., correlation="):
        asked(correlation={})
    with pytest.raises(AleatorError, match=r"Uniform\.between"):
        Uniform(lower=0.0, upper=1.0)  # type: ignore[call-arg]
    assert pickle.loads(pickle.dumps(aleator.identify)) is aleator.identify


def test_a_stopped_identification_keeps_its_runs_and_tells_where(tmp_path: Path) -> None:
    table, calls = Experiments.from_frame(TABLE, outcome="travel", id="unit"), list[float]()

    def stopping(load: float, slope: float) -> float:
        calls.append(slope)
        if len(calls) == 7:
            raise KeyboardInterrupt
        return math.sqrt(load) * slope

    def runner() -> Runner:
        return Runner(stopping, table, ("slope",), store=Store(tmp_path / "runs.sqlite"))

    with pytest.raises(KeyboardInterrupt) as stopped:
        unjudged(runner(), table, LAW, noise=0.2, verification=Check(0))
    assert "runs.sqlite" in stopped.value.__notes__[0]
    cache = runner().cache
    assert cache is not None
    assert 0 < cache.at_start.runs < len(calls)


def test_median_and_sdlog_have_the_intervals_of_a_normal_law_of_the_logarithm() -> None:
    """The median is exp of the logarithm's mean, and sdlog its sd: profiles are invariant."""
    law = {"slope": LogNormal(Free(0.5, 5.0), Free(0.01, 3.0))}
    found = asked(law=law, id="unit")
    logarithm = {"log_slope": Normal(Free(-1.0, 2.0), Free(0.005, 1.0))}
    other = asked(lambda load, log_slope: load * np.exp(log_slope), law=logarithm, id="unit")
    exact = other.intervals.assign(estimate=other.values)
    told = found.quantities[["lower", "upper", "estimate"]]
    median, sdlog = np.exp(exact.loc["log_slope.mean"]), exact.loc["log_slope.sd"]
    assert told.loc["slope.median"].tolist() == pytest.approx(median.tolist(), rel=0.02)
    assert told.loc["slope.sdlog"].tolist() == pytest.approx(sdlog.tolist(), rel=0.06)
    errors = found.quantities["standard_error"]
    exact_error = median["estimate"] * other.errors["log_slope.mean"]
    assert errors["slope.median"] == pytest.approx(exact_error, rel=1e-3)
    assert errors["slope.sdlog"] == pytest.approx(other.errors["log_slope.sd"], rel=1e-3)
    assert "slope.sdlog" in repr(found)
    assert found.aic == pytest.approx(-2.0 * found.log_likelihood.estimated + 4.0, abs=1e-6)
    assert len(repr(found.draws()).splitlines()) == 5
