"""The feasible box: closed forms, and what limits it."""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from studies import shown_again

from aleator.cli import main
from aleator.errors import SimulatorError
from aleator.laws import TruncatedNormal
from aleator.laws.inputs import Inputs
from aleator.observations.experiments import Conditions
from aleator.tasks.box import FeasibleBox, feasible_box, largest_box
from examples.wet_clutch.bench import design
from examples.wet_clutch.model import shifting_time

TWO = Conditions(("mild", "hard"), pd.DataFrame({"load": [1.0, 2.0]}))


def found(model, seed: int = 0, vectorized: bool = False, **limits: tuple[float, float]):
    inputs = Inputs({name: TruncatedNormal(box=ends) for name, ends in limits.items()})
    return feasible_box(model, TWO, inputs, vectorized=vectorized, seed=seed)


def disc(load, x, y):
    return x + load if x * x + y * y < 1.0 else math.nan


def under_the_line(load, x, y, z=0.0):
    if x + y > 2.5 - 0.5 * load:  # the experiment of load 2 limits first, at 1.5
        raise ValueError("stalls")
    return x + load + z


@pytest.mark.parametrize("seed", [0, 1])
def test_the_largest_box_in_a_disc_is_the_inscribed_square(seed: int) -> None:
    box = found(disc, seed, x=(-1.0, 1.0), y=(-1.0, 1.0))
    # area 2 of the limits' 4; every side stays a hundredth of the limits away from a failure
    assert 0.46 < box.share <= 0.5
    assert box.confirmed
    assert np.all(np.hypot(box.box[0][:, None], box.box[1][None, :]) < 1.0)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_limiting_experiment_is_named_and_what_raises_is_a_failure(seed: int) -> None:
    box = found(under_the_line, seed, x=(0.0, 1.0), y=(0.0, 1.0), z=(0.0, 1.0))
    # max x y with x + y <= 1.5
    assert 0.51 < box.share <= 0.5625
    sides = {(side.parameter, side.upper): side.experiment for side in box.sides}
    assert sides[("x", True)] == sides[("y", True)] == "hard"
    assert sides[("x", False)] is None
    assert sides[("z", True)] is None
    for side in box.sides:
        if side.at is not None:
            with pytest.raises(ValueError, match="stalls"):
                under_the_line(2.0, *side.at)


def test_the_box_without_the_experiment_that_limits_it_is_offered() -> None:
    box = found(under_the_line, x=(0.0, 1.0), y=(0.0, 1.0), z=(0.0, 1.0))
    # without the load of 2 only x + y <= 2 is left, which holds the whole cube
    assert set(box.without) == {"hard"}
    assert box.without["hard"] == pytest.approx(1.0)


def test_a_vectorized_simulator_that_raises_for_the_whole_block_is_taken_apart() -> None:
    def block(load, x, y):
        if np.any(x + y > 2.5 - 0.5 * load):
            raise ValueError("one of them stalls")
        return x + load

    box = found(block, vectorized=True, x=(0.0, 1.0), y=(0.0, 1.0))
    assert 0.51 < box.share <= 0.5625


def test_limits_that_are_feasible_are_the_box() -> None:
    box = found(lambda load, x: load * x, x=(0.0, 3.0))
    assert box.box.tolist() == [[0.0, 3.0]]
    assert (box.share, box.confirmed) == (1.0, True)
    assert all(side.experiment is None for side in box.sides)


def test_no_valid_point_names_the_experiment_that_fails_most() -> None:
    def never(load, x):
        return math.nan if load > 1.5 else x

    with pytest.raises(SimulatorError, match="'hard'"):
        found(never, x=(0.0, 1.0))


def test_the_largest_box_without_given_failures_is_found_exactly() -> None:
    failed = np.array([[0.8, 0.5], [0.5, 0.9], [0.2, 0.45]])
    seed = np.array([0.5, 0.5])
    # all boxes that have their sides on failures or on the limits
    best = 0.0
    for a in (0.0, 0.2):
        for b in (1.0, 0.8):
            for c in (0.0, 0.45):
                for d in (1.0, 0.9, 0.5):
                    held = (failed > [a, c]) & (failed < [b, d])
                    if not held.all(axis=1).any() and c < seed[1] <= d:
                        best = max(best, (b - a) * (d - c))
    box = largest_box(failed, seed)
    assert float(np.prod(np.diff(box, axis=1))) == pytest.approx(best)


def test_the_command_prints_what_goes_into_the_study(tmp_path: Path) -> None:
    (tmp_path / "model.py").write_text(
        "def travel(force, stiffness):\n"
        "    if stiffness > 2.0:\n        raise ValueError('too stiff')\n"
        "    return force / stiffness\n"
    )
    (tmp_path / "springs.csv").write_text("force,travel\n1.0,0.5\n2.0,1.1\n3.0,1.4\n")
    study = tmp_path / "study.toml"
    study.write_text(
        '[experiments]\nfile = "springs.csv"\noutcome = "travel"\n'
        '[simulator]\nfunction = "model.py:travel"\n'
        '[parameters.stiffness]\nlaw = "truncated_normal"\nbox = [1.0, 3.0]\n'
    )
    arguments = ["box", str(study), "--output", str(tmp_path / "out")]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 0, done.output
    shown_again(done, tmp_path / "out" / "box.json")
    assert "stiffness: box = [1, 1.9" in done.output
    written = json.loads((tmp_path / "out" / "box.json").read_text())
    assert written["box"]["stiffness"][1] == pytest.approx(1.98, abs=0.02)
    assert written["sides"][1]["experiment"] is not None


def test_the_clutch_is_feasible_on_its_box_and_fails_beyond_the_plates() -> None:
    table = design().iloc[::12].reset_index(drop=True)
    conditions = Conditions(tuple(map(str, table.pop("id"))), table)
    inputs = Inputs(
        {"c2_scale": TruncatedNormal(box=(0.5, 2.0)), "zp_scale": TruncatedNormal(box=(0.3, 1.7))}
    )
    box: FeasibleBox = feasible_box(shifting_time, conditions, inputs, vectorized=True)
    # the plates would touch always beyond z_M/z_p = 2.0/1.32
    assert box.box[1, 1] == pytest.approx(2.0 / 1.32, abs=0.03)
    assert box.box[0].tolist() == [0.5, 2.0]
