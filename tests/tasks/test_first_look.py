"""The first runs of a study: what they reach, what has no influence, and what the rest costs."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aleator import By, Constant, Free, Inputs, Noise, Normal, TruncatedNormal, identify
from aleator.errors import SimulatorError
from aleator.inference.check import Check
from aleator.observations.experiments import Experiments
from aleator.observations.model import NormalError, StudentError
from aleator.simulators import FunctionSimulator, Runner, Store
from aleator.surrogates import ResponseSurface
from aleator.tasks.first_look import (
    LOOK,
    Look,
    expected_cost,
    first_look,
    planned_look,
    understated_noise,
)

FORCE = np.array([10.0, 20.0, 30.0, 40.0, 50.0])
TRAVEL = np.array([4.9, 10.2, 15.4, 12.0, 8.0])  # stiffness 2.04, 1.96, 1.95, 3.33, 6.25
TABLE = pd.DataFrame({"id": [*"ABCDE"], "force": FORCE, "travel": TRAVEL})


def spring(force: float, stiffness: float, idle: float = 0.0) -> float:
    return force / stiffness + 0.0 * idle


def looked(
    inputs: Inputs, table: pd.DataFrame = TABLE, function: object = spring, **by: object
) -> Look:
    experiments = Experiments.from_frame(table, outcome="travel", **by)  # type: ignore[arg-type]
    runner = Runner(function, experiments, inputs.names)  # type: ignore[arg-type]
    return first_look(runner, experiments, planned_look(runner, experiments, inputs))


def test_an_experiment_is_out_of_reach_where_no_stiffness_of_the_box_gives_its_travel() -> None:
    look = looked(Inputs({"stiffness": TruncatedNormal(box=(2.0, 6.0))}))
    assert look.plan.runs == 5 * 3
    assert look.reached == pytest.approx(np.stack([FORCE / 6.0, FORCE / 2.0], axis=1))
    expected = {
        name: y - f / 2 if y > f / 2 else y - f / 6
        for name, f, y in zip("ABCDE", FORCE, TRAVEL, strict=True)
        if not f / 6 <= y <= f / 2
    }
    found = {look.ids[k]: float(look.beyond[k]) for k in look.out_of_reach}
    assert found == pytest.approx(expected)
    assert [*found] == sorted(found, key=lambda name: -abs(found[name]))


def test_what_noise_explains_is_not_out_of_reach() -> None:
    inputs = Inputs({"stiffness": TruncatedNormal(box=(2.0, 6.0))})
    experiments = Experiments.from_frame(TABLE, outcome="travel")
    runner = Runner(spring, experiments, inputs.names)
    plan = planned_look(runner, experiments, inputs)

    def beyond(noise: Noise) -> set[str]:
        look = first_look(runner, experiments, plan, noise)
        return {look.ids[k] for k in look.out_of_reach}

    gaps = {"B": 0.2, "C": 0.4, "E": 50.0 / 6.0 - 8.0}
    for sd in (0.05, 0.1, 0.12, 0.2):
        expected = {name for name, gap in gaps.items() if gap > 3.0 * sd}
        median = first_look(runner, experiments, plan, Noise(sd)).noises_beyond
        far = [gaps[name] / sd for name in expected]
        assert median == (pytest.approx(np.median(far)) if far else None)
        assert beyond(Noise(sd)) == beyond(Noise(Free(sd / 4.0, 4.0 * sd))) == expected
    assert beyond(Noise(relative=0.04)) == set()

    # A share of the outcome is small where the outcome is: a wrong sign is none of it.
    wrong = Experiments.from_frame(TABLE.assign(travel=[-4.9, *TRAVEL[1:]]), outcome="travel")
    look = first_look(runner, wrong, plan, Noise(relative=0.04))
    assert [look.ids[k] for k in look.out_of_reach] == ["A"]
    assert look.margin[0] == pytest.approx(3.0 * 0.04 * 10.0 / 6.0)
    assert not first_look(runner, wrong, plan, Noise(relative=3.0)).out_of_reach.size


def test_noise_that_repeats_contradict_is_told_and_the_scatter_of_a_law_is_not() -> None:
    rng = np.random.default_rng(1)
    ids, stiffness = np.repeat(np.arange(8), 3), np.repeat(rng.uniform(2.5, 5.0, 8), 3)
    y = 30.0 / stiffness + 0.5 * rng.standard_normal(24)
    frame = pd.DataFrame({"id": ids, "force": 30.0, "travel": y})
    table = Experiments.from_frame(frame, outcome="travel", id="id")
    inputs = Inputs({"stiffness": TruncatedNormal(box=(2.0, 6.0))})
    runner = Runner(spring, table, inputs.names)
    told = understated_noise(runner, table, inputs, Noise(0.01))["travel"]
    within = frame.groupby("id")["travel"].var().mean() ** 0.5
    assert told == pytest.approx({"repeats": within, "noise": 0.01, "df": 16})
    for noise in (Noise(0.5), Noise(Free(0.01, 1.0)), Noise(relative=0.1), None):
        assert not understated_noise(runner, table, inputs, noise)
    # Of one value an experiment the repeats scatter by the law too, unless nothing scatters.
    alone = Experiments.from_frame(frame.drop(columns="id"), outcome="travel")
    constant, both = Inputs({"stiffness": Constant(3.0)}), []
    for law in (inputs, constant):
        other = Runner(spring, alone, law.names)
        both.append(understated_noise(other, alone, law, Noise(0.01)))
    assert [*map(bool, both)] == [False, True]


def test_constants_by_covariates_and_errors_with_long_tails_are_no_understated_noise() -> None:
    """Two oils with constants of their own, 5 apart, and repeats with an sd of 0.1."""
    rng = np.random.default_rng(1)
    oil = np.repeat(["a", "b"], 12)
    y = np.where(oil == "a", 10.0, 15.0) + 0.1 * rng.standard_normal(24)
    table = Experiments.from_frame(pd.DataFrame({"oil": oil, "travel": y}), outcome="travel")
    found = {}
    for formula in ("1", "1 + oil"):
        inputs = Inputs({"shift": Constant(By(formula, 0.0, 20.0))})
        runner = Runner(lambda shift: shift, table, inputs.names)
        found[formula] = understated_noise(runner, table, inputs, Noise(0.1))
    assert found["1"]["travel"]["df"] == 23
    assert not found["1 + oil"]
    same = Inputs({"shift": Constant(3.0)})
    tails, normal = (Noise(0.5, kind=kind) for kind in (StudentError(2.0), NormalError()))
    assert understated_noise(runner, table, same, normal)
    assert not understated_noise(runner, table, same, tails)


def test_a_law_with_a_known_mean_is_looked_at_as_far_as_its_sd_may_reach() -> None:
    """An sd of 0.1 at most: 3.1 of it are 0.31, on either side of the known mean."""
    table = pd.DataFrame({"force": [1.0, 1.0, 1.0], "travel": [0.0, 0.25, 0.5]})
    inputs = Inputs({"shift": Normal(mean=0.0, sd=Free(0.001, 0.1))})
    look = looked(inputs, table, lambda force, shift: force * shift)
    assert look.plan.region[0].tolist() == pytest.approx([-0.31, 0.31])
    assert [look.ids[k] for k in look.out_of_reach] == ["3"]


def test_a_corner_of_two_parameters_is_reached() -> None:
    """No single parameter comes to 1.9 from the middle; both together do."""
    table = pd.DataFrame({"force": [1.0, 1.0], "travel": [1.9, 2.1]})
    inputs = Inputs({name: TruncatedNormal(box=(0.0, 1.0)) for name in ("stiffness", "idle")})
    look = looked(inputs, table, lambda force, stiffness, idle: force * (stiffness + idle))
    assert look.plan.runs == 5 + 4
    assert [look.ids[k] for k in look.out_of_reach] == ["2"]


def test_a_maximum_between_two_values_of_a_parameter_is_no_false_alarm() -> None:
    """The outcome has its maximum, 1, at 0.37; of three values the nearest gives 0.83."""
    table = pd.DataFrame({"force": [1.0, 1.0, 1.0], "travel": [0.5, 0.995, 1.2]})
    inputs = Inputs({"stiffness": TruncatedNormal(box=(0.0, 1.0))})
    look = looked(inputs, table, lambda force, stiffness: force - 10.0 * (stiffness - 0.37) ** 2)
    assert [look.ids[k] for k in look.out_of_reach] == ["3"]
    assert look.beyond[2] == pytest.approx(0.2, abs=0.005)
    assert look.at_limit is None
    assert look.runs <= look.plan.runs + look.plan.more()
    narrow = Inputs({"stiffness": TruncatedNormal(box=(2.0, 6.0))})
    assert looked(narrow).at_limit is None  # B and C lie beyond one limit, E beyond the other
    assert looked(narrow, TABLE[:3]).at_limit == ("stiffness", "lower", 2.0)


def test_a_parameter_that_acts_only_beside_another_has_influence() -> None:
    inputs = Inputs({name: TruncatedNormal(box=(0.0, 1.0)) for name in ("stiffness", "idle")})
    table = pd.DataFrame({"force": [1.0, 2.0], "travel": [0.4, 0.6]})

    def stronger(force: float, stiffness: float, idle: float) -> float:
        return force * max(stiffness, 0.5 * idle)

    assert looked(inputs, table, stronger).without_influence.tolist() == [False, False]


def test_a_parameter_that_moves_nothing_is_told() -> None:
    inputs = Inputs(
        {"stiffness": TruncatedNormal(box=(1.0, 7.0)), "idle": Constant(Free(0.0, 1.0))}
    )
    look = looked(inputs)
    assert look.without_influence.tolist() == [False, True]
    assert look.swing[:, 0] == pytest.approx(FORCE * 6.0 / 7.0)


def test_bounds_are_out_of_reach_only_if_no_value_beyond_them_is_reached() -> None:
    from aleator import Censoring

    table = TABLE.assign(ended=["", "longer", "longer", "", ""])
    inputs = Inputs({"stiffness": TruncatedNormal(box=(2.0, 6.5))})
    censored = Censoring("ended", right=["longer"])
    look = looked(inputs, table, censored=censored, conditions=["force"])
    assert {look.ids[k] for k in look.out_of_reach} == {"B", "C"}  # above 10.2 and 15.4
    wide = looked(
        Inputs({"stiffness": TruncatedNormal(box=(0.5, 6.5))}),
        table, censored=censored, conditions=["force"],
    )  # fmt: skip
    assert wide.out_of_reach.size == 0


def test_runs_that_fail_are_counted_and_stop_nothing() -> None:
    def breaks(force: float, stiffness: float) -> float:
        return force / stiffness if stiffness > 2.5 else float("nan")

    look = looked(Inputs({"stiffness": TruncatedNormal(box=(2.0, 6.0))}), function=breaks)
    assert look.failed >= 5
    side, end = look.failing["stiffness"]
    assert side == "<="
    assert 2.0 <= end <= 2.5
    assert np.all(look.reached[:, 1] >= FORCE / 4.0)
    assert np.all(look.reached[:, 1] < FORCE / 2.5)


def test_a_simulator_that_never_works_is_an_error() -> None:
    table = pd.DataFrame({"force": np.arange(1.0, 13.0), "travel": 1.0})
    with pytest.raises(SimulatorError, match="failed"):
        looked(
            Inputs({"stiffness": TruncatedNormal(box=(2.0, 6.0))}),
            table,
            lambda force, stiffness: force / 0.0 / stiffness,
        )


def test_where_all_runs_fail_that_is_an_error_with_their_message_even_if_they_are_few() -> None:
    def breaks(force: float, stiffness: float) -> float:
        if stiffness > least:
            raise ValueError("the mesh folds")
        return force / stiffness

    inputs, least = Inputs({"stiffness": TruncatedNormal(box=(2.0, 6.0))}), 0.0
    with pytest.raises(SimulatorError, match="the mesh folds") as told:
        looked(inputs, TABLE[:2], breaks)
    assert "6 of 6 runs failed" in told.value.problem
    assert "no run of it worked" in told.value.remedy
    least = 2.0  # The two runs with the stiffness 2 work.
    assert looked(inputs, TABLE[:2], breaks).failed == 4


def test_of_many_conditions_some_are_looked_at_with_both_ends() -> None:
    force = np.linspace(1.0, 50.0, 400)
    table = pd.DataFrame({"force": force, "travel": force / 2.0})
    inputs = Inputs({"stiffness": TruncatedNormal(box=(1.0, 6.0))})
    look = looked(inputs, table)
    assert look.looked_at == LOOK.runs // 3
    assert look.runs == 3 * look.looked_at
    assert {look.ids[0], look.ids[-1]} == {"1", "400"}


def test_an_identification_takes_no_more_runs_than_were_expected() -> None:
    rng = np.random.default_rng(0)
    force = np.repeat(FORCE, 4)
    table = pd.DataFrame({"force": force, "travel": force / rng.normal(2.0, 0.1, force.size)})
    inputs = Inputs({"stiffness": TruncatedNormal(box=(1.0, 3.0))})
    experiments = Experiments.from_frame(table, outcome="travel")
    slow = FunctionSimulator(spring, vectorized=False)
    runner = Runner(slow, experiments, inputs.names)
    plan = planned_look(runner, experiments, inputs)
    cost = expected_cost(runner, experiments, inputs, None, ResponseSurface(), None, Check(), plan)
    found = identify(slow, table, inputs, outcome="travel", consistency=False, best_law=False)
    assert cost.least <= found.runs <= cost.most


def test_an_identification_begins_with_stored_runs_where_there_is_a_store(tmp_path: Path) -> None:
    inputs, noise = Inputs({"stiffness": TruncatedNormal(box=(1.0, 3.0))}), Noise(0.02)
    experiments = Experiments.from_frame(TABLE, outcome="travel")
    slow = FunctionSimulator(spring, vectorized=False)
    with Store(tmp_path / "runs.sqlite") as store:
        for kept in (None, store):
            runner = Runner(slow, experiments, inputs.names, store=kept)
            plan = planned_look(runner, experiments, inputs)
            cost = expected_cost(runner, experiments, inputs, noise, ResponseSurface(),
                                 None, Check(), plan)  # fmt: skip
            assert cost.reused is (kept is not None)


def test_the_simulator_itself_is_run_as_often_as_was_expected() -> None:
    rng = np.random.default_rng(0)
    travel = FORCE / rng.normal(2.0, 0.1, FORCE.size) + 0.02 * rng.standard_normal(FORCE.size)
    table = pd.DataFrame({"force": FORCE, "travel": travel})
    inputs, noise = Inputs({"stiffness": TruncatedNormal(box=(1.0, 3.0))}), Noise(0.02)
    experiments = Experiments.from_frame(table, outcome="travel")
    runner = Runner(FunctionSimulator(spring, vectorized=True), experiments, inputs.names)
    plan = planned_look(runner, experiments, inputs)
    cost = expected_cost(runner, experiments, inputs, noise, ResponseSurface(), None, Check(), plan)
    found = identify(
        spring, table, inputs, outcome="travel", noise=noise, vectorized=True, best_law=False
    )
    assert cost.direct
    assert cost.least <= found.runs <= cost.most
