"""A budget ends the runs, with the best answer so far, and what is bought next goes on from it."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import aleator
from aleator import Budget, Inputs, Noise, Normal, TruncatedNormal
from aleator.errors import InputsError, SimulatorError
from aleator.observations.experiments import Experiments
from aleator.simulators import Account, Runner, Store

N = 12
RUNS = 160
UNLIMITED = Budget()
LAW = Inputs({"a": TruncatedNormal(box=(0.2, 1.8))})


def front(load: float, a: float) -> float:
    """It rises fast in the middle of the law."""
    return float(a + np.tanh(8.0 * load * (a - 1.0)))


def table() -> pd.DataFrame:
    load, a = np.linspace(1.0, 3.0, N), np.random.default_rng(3).normal(1.0, 0.1, N)
    return pd.DataFrame({"load": load, "y": a + np.tanh(8.0 * load * (a - 1.0))})


def runner(store: Store | None = None) -> Runner:
    return Runner(front, Experiments.from_frame(table(), outcome="y"), LAW.names, store=store)


def identified(runs: Runner, budget: Budget = UNLIMITED) -> aleator.Identification:
    experiments = Experiments.from_frame(table(), outcome="y")
    return aleator.identify(
        runs, experiments, LAW, seed=0, budget=budget, consistency=False, best_law=False
    )


def test_it_ends_the_runs_with_an_answer_and_says_so() -> None:
    runs = runner()
    found = identified(runs, Budget(runs=RUNS))
    assert runs.fresh <= RUNS
    (told,) = [one for one in found.warnings if one.about == "budget"]
    assert told.concerns == ()
    assert all(np.isfinite(value.estimate) for value in found.alpha.values())


def test_a_budget_that_is_not_needed_changes_nothing() -> None:
    free, held = identified(runner()), identified(runner(), Budget(runs=10**6, hours=100.0))
    assert held.runs == free.runs
    assert [v.estimate for v in held.alpha.values()] == [v.estimate for v in free.alpha.values()]
    assert not [one for one in held.warnings if one.about == "budget"]


def test_the_same_command_again_gets_to_the_answer_without_a_budget(tmp_path: Path) -> None:
    free = identified(runner())
    made = []
    for _ in range(12):
        with Store(tmp_path / "runs.sqlite") as store:
            runs = runner(store)
            found = identified(runs, Budget(runs=RUNS))
            made.append(runs.fresh)
        if not [one for one in found.warnings if one.about == "budget"]:
            break
    assert len(made) > 1
    assert max(made) <= RUNS
    for name, value in free.alpha.items():
        assert value.standard_error
        apart = abs(found.alpha[name].estimate - value.estimate)
        assert apart < 0.1 * value.standard_error


def test_with_noise_and_several_observations_a_run_serves_a_whole_experiment() -> None:
    rng = np.random.default_rng(5)
    times = np.array([0.5, 1.0, 2.0, 4.0])
    rate = rng.normal(0.5, 0.1, 10)
    level = np.exp(-rate[:, None] * times) + rng.normal(0.0, 0.01, (10, 4))
    rows = pd.DataFrame(
        {"id": np.repeat(np.arange(10), 4), "time": np.tile(times, 10), "y": level.ravel()}
    )

    def draining(time: float, rate: float) -> float:
        return float(np.exp(-rate * time))

    experiments = Experiments.from_frame(rows, outcome="y")
    inputs = Inputs({"rate": Normal(mean=aleator.Free(0.2, 1.0), sd=aleator.Free(0.01, 0.4))})
    runs = Runner(draining, experiments, inputs.names)
    # rows of equal time are one run: four conditions
    found = aleator.identify(
        runs, experiments, inputs, noise=Noise(0.01), budget=Budget(runs=500), seed=0,
        consistency=False, best_law=False,
    )  # fmt: skip
    assert runs.fresh <= 500
    assert found.propagation == "response_surface"
    assert found.alpha["rate.mean"].estimate == pytest.approx(rate.mean(), abs=0.01)


def test_one_that_does_not_suffice_for_an_answer_is_refused_before_the_first_run() -> None:
    runs = runner()
    with pytest.raises(InputsError, match="allow at least"):
        identified(runs, Budget(runs=50))
    assert runs.runs == 0


def test_hours_are_runs_at_the_seconds_that_they_took() -> None:
    made = SimpleNamespace(tried=0, waited=0.0)
    account = Account(Budget(hours=1.0), made)
    assert account.granted(10**6) == 10**6  # nobody knows yet what a run takes
    made.tried, made.waited = 10, 36.0
    assert account.granted(10**6) == pytest.approx(1000, abs=1)
    assert account.granted(500, reserve=200) == 500
    assert account.granted(900, reserve=200) == pytest.approx(800, abs=1)
    assert account.refused


@pytest.mark.parametrize("wrong", [{"runs": 0}, {"runs": -5}, {"hours": 0.0}, {"hours": np.nan}])
def test_it_is_positive(wrong: dict[str, float]) -> None:
    with pytest.raises(SimulatorError):
        Budget(**wrong)  # type: ignore[arg-type]
