"""Runs: a budget, runs that fail, and a study that was stopped and goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from identifications import unjudged

import aleator
from aleator import (
    Budget,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    Store,
    TruncatedNormal,
    cli,
    identify,
)
from aleator.core.progress import Silent
from aleator.core.types import Array
from aleator.errors import InputsError, SimulatorError
from aleator.fit.question import fails_here_and_there
from aleator.inference.check import Check
from aleator.observations.experiments import Conditions, Experiments
from aleator.search import GradientMultistart, SearchResult
from aleator.simulators import Account, Runner, as_runner
from aleator.simulators.function import FunctionSimulator
from aleator.simulators.store import keep, kept
from aleator.surrogates import ResponseSurface

N = 8
RUNS = 34
UNLIMITED = Budget()
FRONT_LAW = Inputs({"a": TruncatedNormal(box=(0.2, 1.8))})


def front(load: float, a: float) -> float:
    """It rises fast in the middle of the law."""
    return float(a + np.tanh(8.0 * load * (a - 1.0)))


def of_front() -> pd.DataFrame:
    load, a = np.linspace(1.0, 3.0, N), np.random.default_rng(3).normal(1.0, 0.1, N)
    return pd.DataFrame({"load": load, "y": a + np.tanh(8.0 * load * (a - 1.0))})


def runner(store: Store | None = None) -> Runner:
    return Runner(
        front, Experiments.from_frame(of_front(), outcome="y"), FRONT_LAW.names, store=store
    )


def within(runs: Runner, budget: Budget = UNLIMITED) -> aleator.Identification:
    experiments = Experiments.from_frame(of_front(), outcome="y")
    return aleator.identify(
        runs, experiments, FRONT_LAW, seed=0, budget=budget, consistency=False, best_law=False
    )


@pytest.fixture(scope="module")
def free() -> Identification:
    return within(runner())


def test_a_budget_that_is_not_needed_changes_nothing(free: Identification) -> None:
    held = within(runner(), Budget(runs=10**6, hours=100.0))
    assert held.runs == free.runs
    assert [v.estimate for v in held.alpha.values()] == [v.estimate for v in free.alpha.values()]
    assert not [one for one in held.warnings if one.about == "budget"]


def test_the_same_command_again_gets_to_the_answer_without_a_budget(
    free: Identification, tmp_path: Path
) -> None:
    """Each time the budget ends the runs with an answer, and says so."""
    made = []
    for _ in range(12):
        with Store(tmp_path / "runs.sqlite") as store:
            runs = runner(store)
            found = within(runs, Budget(runs=RUNS))
            made.append(runs.fresh)
        assert all(np.isfinite(value.estimate) for value in found.alpha.values())
        if not [one for one in found.warnings if one.about == "budget"]:
            break
    assert len(made) > 1
    assert max(made) <= RUNS
    for name, value in free.alpha.items():
        assert value.standard_error
        apart = abs(found.alpha[name].estimate - value.estimate)
        assert apart < 0.2 * value.standard_error


def test_one_that_does_not_suffice_for_an_answer_is_refused_before_the_first_run() -> None:
    runs = runner()
    with pytest.raises(InputsError, match="allow at least"):
        within(runs, Budget(runs=20))
    assert runs.runs == 0


@pytest.mark.parametrize("wrong", [{"runs": 0}, {"runs": -5}, {"hours": 0.0}, {"hours": np.nan}])
def test_a_budget_is_positive(wrong: dict[str, float]) -> None:
    with pytest.raises(SimulatorError):
        Budget(**wrong)  # type: ignore[arg-type]


def test_hours_are_runs_at_the_seconds_that_they_took() -> None:
    made = SimpleNamespace(tried=0, waited=0.0)
    account = Account(Budget(hours=1.0), made)
    assert account.granted(10**6) == 10**6  # nobody knows yet what a run takes
    made.tried, made.waited = 10, 36.0
    assert account.granted(10**6) == pytest.approx(1000, abs=1)
    assert account.granted(500, reserve=200) == 500
    assert account.granted(900, reserve=200) == pytest.approx(800, abs=1)
    assert account.refused


# ------------------------------------------------------------------------------ runs that fail


Z = np.linspace(1.0, 2.0, 40)
X = 1.5 + 0.2 * np.random.default_rng(3).standard_normal(40)


def model(z: Array, x: Array) -> Array:
    return z * np.sqrt(x)


TABLE = pd.DataFrame({"z": Z, "y": model(Z, X)})
MEAN, SD = X.mean(), X.std()  # the exact maximum: every x is told by its outcome
WIDE = Inputs({"x": Normal(mean=Free(0.5, 2.0), sd=Free(0.05, 1.0))})
BOXED = Inputs({"x": TruncatedNormal((0.3, 2.7), mean=Free(0.5, 2.5), sd=Free(0.05, 0.5))})


def test_runs_that_fail_here_and_there_leave_the_answer() -> None:
    def brittle(z: Array, x: Array) -> Array:
        hashed = np.modf(1e4 * np.abs(np.sin(1e4 * x + z)))[0]
        return np.where(hashed < 0.06, np.nan, model(z, x))

    check = Check(64)
    whole = unjudged(model, TABLE, BOXED, outcome="y", vectorized=True, verification=check)
    result = unjudged(brittle, TABLE, BOXED, outcome="y", vectorized=True, verification=check)
    error = {name: value.standard_error or 0.0 for name, value in whole.alpha.items()}
    for name, value in result.alpha.items():
        assert abs(value.estimate - whole.alpha[name].estimate) < 0.02 * error[name]
    assert result.sound
    share = result.failures.runs / result.failures.needed
    assert share == pytest.approx(0.06, abs=0.02)
    assert "nan" in result.failures.message
    low, high = result.failures.region["x"]
    assert low < MEAN < high
    assert result.failures.experiments in [
        warning.concerns for warning in result.warnings if warning.about == "simulator"
    ]
    assert json.dumps(result.to_dict()["failures"])
    assert whole.failures is None


def test_a_fast_simulator_with_holes_is_not_integrated_over_itself() -> None:
    """Every set of nodes meets other holes: the search took minutes, and surfaces go over them."""

    def brittle(z: Array, x: Array) -> Array:
        hashed = np.modf(1e4 * np.abs(np.sin(1e4 * x + z)))[0]
        return np.where(hashed < 0.02, np.nan, model(z, x))

    def ends(z: Array, x: Array) -> Array:
        return np.where(x > 2.4, np.nan, model(z, x))

    def answer(simulator: Callable[..., Array]) -> Identification:
        return identify(
            simulator, TABLE, BOXED, outcome="y", vectorized=True, noise=Noise(0.02),
            verification=Check(0), consistency=False, best_law=False,
        )  # fmt: skip

    whole, holes, cut = answer(model), answer(brittle), answer(ends)
    assert holes.propagation == "response_surface"
    for name, value in whole.alpha.items():
        for other in (holes, cut):
            near = 0.01 * (value.standard_error or 1.0)
            assert other.alpha[name].estimate == pytest.approx(value.estimate, abs=near)
    run = as_runner(ends, Conditions(("A",), pd.DataFrame({"z": [1.0]})), ["x"], vectorized=True)
    assert not fails_here_and_there(run, np.array([1.5]), np.array([[0.3, 2.7]]))


def test_a_failed_corner_is_told_and_costs_accuracy_only_there() -> None:
    def hot(z: Array, x: Array) -> Array:
        return np.where((x > 2.2) & (z > 1.7), np.nan, model(z, x))

    result = unjudged(hot, TABLE, BOXED, outcome="y", vectorized=True)
    assert result.alpha["x.mean"].estimate == pytest.approx(MEAN, abs=0.1 * SD / 40**0.5)
    low, high = result.failures.region["x"]
    assert 2.2 < low < high <= 2.7
    assert set(result.failures.experiments) <= {str(k + 1) for k in range(40) if Z[k] > 1.7}


def test_a_law_that_reaches_far_beyond_the_simulator_is_given_the_box_that_mends_it() -> None:
    everywhere = ResponseSurface(tolerance=0.005)
    beyond = Inputs({"x": Normal(mean=Free(-2.0, 2.0), sd=Free(0.05, 1.0))})
    with pytest.raises(SimulatorError) as caught:
        unjudged(model, TABLE, beyond, outcome="y", vectorized=True, propagation=everywhere)
    lines = [line.strip() for line in caught.value.remedy.splitlines()]
    assert 'law = "truncated_normal"' in lines
    (box,) = (line for line in lines if line.startswith("box = "))
    low, high = (float(end) for end in box.removeprefix("box = [").rstrip("]").split(","))
    assert 0.0 <= low < 0.5
    assert high > 2.0
    assert "aleator box" in caught.value.remedy


def test_surfaces_that_are_to_be_exact_where_runs_fail_are_refused() -> None:
    """Through the root a polynomial explodes where there is none: its own scatter says nothing."""
    everywhere = ResponseSurface(tolerance=0.005, max_runs=100)
    few = TABLE[::4]
    result = unjudged(model, few, WIDE, outcome="y", vectorized=True, propagation=everywhere)
    assert not result.sound
    assert any("aleator box" in warning.remedy for warning in result.warnings)


def test_surfaces_that_follow_the_law_leave_what_fails_behind() -> None:
    def rooted(z: Array, x: Array) -> Array:
        return np.where(x > 0.0, model(z, np.abs(x)), np.nan)

    result = unjudged(rooted, TABLE, WIDE, outcome="y", vectorized=True, verification=Check(0))
    assert result.alpha["x.mean"].estimate == pytest.approx(MEAN, abs=1e-3)
    assert result.alpha["x.sd"].estimate == pytest.approx(SD, abs=1e-3)
    assert result.failures.region["x"][1] <= 0.0


@pytest.mark.usefixtures("unreported", "unjudged_commands")
def test_the_study_says_how_many_failures_are_too_many(tmp_path: Path) -> None:
    (tmp_path / "model.py").write_text(
        "def model(z, x):\n    if 0.8 < x < 1.1: raise ValueError('stuck')\n    return z * x**0.5\n"
    )
    TABLE.to_csv(tmp_path / "table.csv", index=False)
    study = tmp_path / "study.toml"
    text = (
        '[experiments]\nfile = "table.csv"\noutcome = "y"\n[simulator]\n'
        'function = "model.py:model"\n{}\n[parameters.x]\nlaw = "truncated_normal"\n'
        "box = [0.3, 2.7]\n[verification]\nsamples = 50\n"
    )
    out = ["--output", str(tmp_path / "out"), "--no-figures"]
    study.write_text(text.format("max_failed = 0.01"))
    refused = CliRunner().invoke(cli.main, ["identify", str(study), *out])
    assert refused.exit_code == 2
    assert "stuck" in refused.stderr
    study.write_text(text.format("max_failed = 0.5\nretries = 1"))
    done = CliRunner().invoke(cli.main, ["identify", str(study), *out])
    assert done.exit_code == 0, done.stderr
    document = json.loads((tmp_path / "out" / "identification.json").read_text())
    low, high = document["failures"]["region"]["x"]
    assert 0.8 < low < high < 1.1
    assert "stuck" in document["failures"]["message"]
    assert "simulator" in [warning["about"] for warning in document["warnings"]]


# --------------------------------------------------------------------------- searches that are kept


LAW = Inputs({"a": Normal(Free(0.0, 2.0), Free(0.01, 1.0))})
SOME_NOISE = Noise(Free(0.01, 1.0))


def bent(c, a):
    return np.exp(0.4 * a) * c + a


def of_bent(seed: int = 1) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    c = rng.uniform(1.0, 2.0, 12)
    return pd.DataFrame({"c": c, "y": bent(c, rng.normal(1.0, 0.2, 12))})


MADE: list[int] = []
"""The seeds of the searches that were made, but for those of baselines."""


@dataclass(frozen=True)
class Counted:
    """A search that is noted."""

    own: GradientMultistart = field(default_factory=lambda: GradientMultistart(4))
    name: str = "counted"

    def maximize(self, *args: Any, seed: int, **choices: Any) -> SearchResult:
        if "progress" in choices:  # baselines have none
            MADE.append(seed)
        return self.own.maximize(*args, seed=seed, **choices)


@pytest.fixture
def kept_store(tmp_path: Path) -> Iterator[Store]:
    MADE.clear()
    with Store(tmp_path / "runs.sqlite") as one:
        yield one


def answer(kept_store: Store | None, noise: Noise | None, **choices: Any) -> Identification:
    experiments = Experiments.from_frame(choices.pop("rows", of_bent()), outcome="y")
    runner = Runner(
        FunctionSimulator(bent, vectorized=True), experiments, LAW.names, store=kept_store
    )
    # with a budget a fast simulator gets surfaces too
    given = {"search": Counted(), "consistency": False, "best_law": False}
    chosen = {**given, "budget": Budget(runs=10**9), **choices}
    return identify(runner, experiments, LAW, noise=noise, **chosen)


@pytest.mark.parametrize("noise", [None, SOME_NOISE])
def test_no_search_is_made_twice_and_every_digit_is_the_same(
    kept_store: Store, noise: Noise | None
) -> None:
    first = answer(kept_store, noise)
    searches = len(MADE)
    assert searches > 0
    again = answer(kept_store, noise)
    assert len(MADE) == searches
    alone = answer(None, noise)
    assert len(MADE) == 2 * searches
    for other in (again, alone):
        assert other.alpha == first.alpha
        assert other.log_likelihood == first.log_likelihood


class Killed(Silent):
    """A study that is killed when the baselines begin a second time, after all searches."""

    def __init__(self) -> None:
        self.inferring = False

    def stage(self, name: str) -> None:
        self.inferring |= name == "inference"
        if name == "baselines" and self.inferring:
            raise KeyboardInterrupt


def test_a_study_that_is_killed_after_its_searches_does_not_search_again(kept_store: Store) -> None:
    with pytest.raises(KeyboardInterrupt):
        answer(kept_store, None, progress=Killed())
    searches = len(MADE)
    answer(kept_store, None)
    assert len(MADE) == searches > 0


@pytest.mark.parametrize(
    "choices",
    [{"rows": of_bent(2)}, {"seed": 1}, {"search": Counted(GradientMultistart(5))}],
    ids=["outcomes", "seed", "search"],
)
def test_another_question_is_searched_for(kept_store: Store, choices: dict[str, Any]) -> None:
    answer(kept_store, None)
    searches = len(MADE)
    answer(kept_store, None, **choices)
    assert len(MADE) > searches


def test_a_damaged_result_is_no_result(kept_store: Store) -> None:
    keep(kept_store, "f", "one", "[1.0]")
    assert kept(kept_store, "f", "one") == "[1.0]"
    assert kept(kept_store, "f", "other") is None
    assert kept(kept_store, "g", "one") is None
    kept_store.connection.execute("UPDATE searches SET text = '[2.0]'")
    assert kept(kept_store, "f", "one") is None
