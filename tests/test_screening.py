"""Screening against variances in closed form, for laws of every kind and many experiments."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from aleator.errors import InputsError, SimulatorError
from aleator.laws import Constant, Free, Normal, TruncatedNormal
from aleator.laws.inputs import Inputs
from aleator.observations.experiments import Conditions
from aleator.results.printed import THRESHOLDS
from aleator.simulators import FunctionSimulator, Runner
from aleator.tasks.screen import screen

Z = np.array([0.5, 1.0, 2.0, 4.0])
TABLE = pd.DataFrame({"z": Z})  # not looked at where there is a runner, which has its own


def runner_of(function, inputs: Inputs, z: np.ndarray = Z) -> Runner:
    table = Conditions(tuple("abcdefgh"[: len(z)]), pd.DataFrame({"z": z}))
    return Runner(FunctionSimulator(function, vectorized=True), table, inputs.names)


LINEAR = Inputs(
    {
        "known": Normal(3.0, 0.5),
        "boxed": TruncatedNormal((0.0, 2.0)),
        "fixed": Constant(7.0),
        "limited": Constant(Free(-1.0, 5.0)),
        "open": Normal(mean=Free(-1.0, 1.0, start=0.0), sd=Free(0.1, 1.0, start=0.4)),
    }
)


def test_every_kind_of_parameter_is_varied_as_promised() -> None:
    found = screen(
        runner_of(lambda z, known, boxed, fixed, limited, open: (
            z * known + 2.0 * boxed + fixed - limited + open
        ), LINEAR),
        TABLE,
        LINEAR,
    )  # fmt: skip
    assert found.names == ("known", "boxed", "limited", "open")
    assert found.spreads == (
        "Normal, as it is known",
        "uniform on [0, 2]",
        "uniform on [-1, 5]",
        "Normal at its start",
    )
    sd = np.stack([0.5 * Z, *[np.full(4, s) for s in (4 / 12**0.5, -6 / 12**0.5, 0.4)]], axis=1)
    variance = np.sum(sd**2, axis=1)
    np.testing.assert_allclose(found.sobol.first, sd**2 / variance[:, None], atol=1e-10)
    np.testing.assert_allclose(found.sobol.total, sd**2 / variance[:, None], atol=1e-10)
    np.testing.assert_allclose(found.effects, sd, atol=1e-10)
    np.testing.assert_allclose(found.expansion.mean, 3 * Z + 2 + 7 - 2, atol=1e-10)
    assert found.converged
    assert found.runs == 40


def test_alignment_is_one_for_parameters_that_no_experiment_tells_apart() -> None:
    inputs = Inputs({name: Constant(Free(0.0, 1.0)) for name in ("a", "b", "c", "d", "idle")})
    found = screen(
        runner_of(lambda z, a, b, c, d, idle: z * a - 3 * z * b + c + z**2 * d + 0 * idle, inputs),
        TABLE,
        inputs,
    )
    cosine = Z.sum() / np.sqrt(len(Z) * np.sum(Z**2))  # of the effects z and 1
    assert found.alignment[0, 1] == pytest.approx(-1.0)
    assert found.alignment[0, 2] == pytest.approx(cosine)
    assert np.isnan(found.alignment[0, 4])
    pairs = found.pairs()
    alike = pairs[pairs["confounded"]]
    assert (len(pairs), len(alike)) == (10, 1)
    assert {alike["first"].item(), alike["second"].item()} == {"a", "b"}
    assert cosine < THRESHOLDS.confounded
    assert found.parameters()["parameter"].tolist()[-1] == "idle"
    assert found.parameters()["mean_total"].iloc[-1] == pytest.approx(0.0, abs=1e-20)


def test_shares_are_means_and_maxima_over_the_experiments() -> None:
    inputs = Inputs({"a": Constant(Free(-1.0, 1.0)), "b": Constant(Free(-1.0, 1.0))})
    found = screen(runner_of(lambda z, a, b: z * a + b + z * a * b, inputs), TABLE, inputs)
    # variances z^2/3, 1/3, z^2/9
    parts = np.stack([Z**2 / 3, np.full(4, 1 / 3), Z**2 / 9], axis=1)
    share = parts / parts.sum(axis=1, keepdims=True)
    table = found.parameters().set_index("parameter")
    assert table.loc["a", "mean_first"] == pytest.approx(share[:, 0].mean())
    assert table.loc["a", "mean_total"] == pytest.approx((share[:, 0] + share[:, 2]).mean())
    assert table.loc["b", "max_total"] == pytest.approx(np.max(share[:, 1] + share[:, 2]))
    assert table.loc["a", "experiment"] == "d"
    pair = found.pairs().iloc[0]
    assert (pair["first"], pair["second"]) == ("a", "b")
    assert pair["explained"] == pytest.approx(1.0)
    assert pair["interaction"] == pytest.approx(share[:, 2].mean())


def test_an_experiment_that_does_not_react_does_not_count() -> None:
    inputs = Inputs({"a": Constant(Free(-1.0, 1.0)), "b": Constant(Free(-1.0, 1.0))})
    still = np.array([0.0, 1.0])
    found = screen(runner_of(lambda z, a, b: 5.0 + z * (a + b), inputs, still), TABLE, inputs)
    assert np.isnan(found.sobol.total[0]).all()
    np.testing.assert_allclose(found.parameters()["mean_total"], [0.5, 0.5])
    assert found.pairs()["explained"].iloc[0] == pytest.approx(1.0)


def test_runs_grow_until_the_expansions_are_good_and_no_run_is_wasted() -> None:
    inputs = Inputs({f"x{i}": Constant(Free(-1.0, 1.0)) for i in range(4)})

    def rough(z, x0, x1, x2, x3):
        return np.exp(z * x0 * x1) + x2 * x3**3

    runner = runner_of(rough, inputs, np.array([0.5, 1.0]))
    found = screen(runner, TABLE, inputs)
    assert found.runs > 40
    assert found.converged
    assert runner.runs == 2 * found.runs
    fixed = screen(runner_of(rough, inputs, np.array([0.5, 1.0])), TABLE, inputs, runs=50)
    assert fixed.runs == 50


def test_a_subset_of_the_experiments_and_a_seed() -> None:
    runner = runner_of(lambda z, known, boxed, fixed, limited, open: (
        z * known * boxed + limited**2 + fixed * open
    ), LINEAR)  # fmt: skip
    part = screen(runner, TABLE, LINEAR, only=["c", "a"], runs=80, seed=3)
    whole = screen(runner, TABLE, LINEAR, runs=80, seed=3)
    assert part.ids == ("c", "a")
    np.testing.assert_array_equal(part.sobol.first, whole.sobol.first[[2, 0]])
    assert len(part.table()) == 2 * 4
    other = screen(runner, TABLE, LINEAR, runs=80, seed=4)
    assert not np.array_equal(other.expansion.coefficients, whole.expansion.coefficients)


def test_misuse_is_told() -> None:
    known = Inputs({"a": Constant(1.0)})
    with pytest.raises(InputsError, match="known constant"):
        screen(runner_of(lambda z, a: z * a, known), TABLE, known)
    varied = Inputs({"a": Constant(Free(0.0, 1.0))})
    runner = runner_of(lambda z, a: z * np.log(a - 0.5), varied)
    with pytest.raises(InputsError, match="'q'"):
        screen(runner, TABLE, varied, only=["a", "q"])
    with pytest.raises(InputsError, match="2 runs"):
        screen(runner, TABLE, varied, runs=2)
    with pytest.raises(SimulatorError, match="narrow the box"), np.errstate(invalid="ignore"):
        screen(runner, TABLE, varied)
