"""Parameters that follow from others: the same as a simulator that computes them itself."""

from __future__ import annotations

import pickle
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aleator import Experiments, Runner, derived
from aleator.core.types import Array
from aleator.errors import AleatorError, SimulatorError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Simulator
from aleator.simulators.protocol import Columns

TABLE = Conditions(("1", "2"), pd.DataFrame({"load": [6.0, 8.0], "h": [3.0, 2.0]}))
E = {"e": "a + b*(h - 1)"}
X = np.array([[1.0, 0.5], [2.0, 0.25]])
TRUTH = np.array([6.0 / 2.0, 8.0 / 2.25])


def stretch(load: float, e: float) -> float:
    return load / e


@pytest.mark.parametrize("vectorized", [None, True])
def test_a_function_gets_what_the_expressions_make(vectorized: bool | None) -> None:
    simulator = derived(FunctionSimulator(stretch, vectorized=vectorized), E)
    run = Runner(simulator, TABLE, ["a", "b"])
    np.testing.assert_allclose(run([0, 1], X), TRUTH, rtol=1e-15)
    assert run.takes_arrays(np.array([[1.0, 2.0], [0.1, 1.0]]))
    np.testing.assert_allclose(run.straight([0, 1], X)[:, 0], TRUTH, rtol=1e-15)


def test_an_expression_may_name_one_before_it_and_functions() -> None:
    simulator = derived(stretch, {"c": "exp(a) + min(b, h)", "e": "2*sqrt(c)"})
    found = Runner(simulator, TABLE, ["a", "b"])([0], X[:1])
    np.testing.assert_allclose(found, 6.0 / (2.0 * np.sqrt(np.exp(1.0) + 0.5)), rtol=1e-14)


class Lever:
    """A simulator of its own kind."""

    name, block = "lever", 8

    def asks(self, conditions: list[str], parameters: list[str]) -> tuple[str, ...]:
        assert "load" in conditions
        if set(parameters) != {"e", "b"}:
            raise SimulatorError(f"lever takes e and b, not {parameters}", "give both")
        return ("load",)

    def __call__(self, conditions: Columns, parameters: Mapping[str, Array]) -> Array:
        assert set(conditions) == {"load"}
        return np.asarray(conditions["load"] / parameters["e"] + parameters["b"])

    def fingerprint(self) -> str:
        return "lever 1"


def test_any_simulator_gets_them_and_goes_to_another_process() -> None:
    there: Simulator = pickle.loads(pickle.dumps(derived(Lever(), E)))
    assert there.name == "lever"
    found = Runner(there, TABLE, ["a", "b"])([0, 1], X)
    np.testing.assert_allclose(found, TRUTH + X[:, 1])


def test_other_expressions_are_another_simulator() -> None:
    prints = {
        derived(stretch, {"e": text}).fingerprint() for text in ("a", "a + b", "a + b*(h - 1)")
    }
    assert len(prints | {FunctionSimulator(stretch).fingerprint()}) == 4


def test_a_series_may_have_a_parameter_that_varies_with_its_condition() -> None:
    frame = pd.DataFrame({"id": [1, 1, 2, 2], "t": [0.0, 1.0, 0.0, 2.0], "y": [1.0, 1.0, 1.0, 1.0]})
    experiments = Experiments.from_frame(frame, outcome="y")

    def length(e: Array) -> Array:
        return 2.0 * e

    simulator = derived(FunctionSimulator(length, series=True), {"e": "a + b*t"})
    found = Runner(simulator, experiments, ["a", "b"]).values([0, 1], X)
    np.testing.assert_allclose(found, [[2.0, 3.0], [4.0, 5.0]])


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        ({"e": "a + hh"}, ["derived.e", "'hh'", "did you mean 'h'"]),
        ({"e": "a +"}, ["derived.e", "'a +'"]),
        ({"e": "a if b else h"}, ["derived.e", "not arithmetic"]),
        ({"e": "a + open(h)"}, ["derived.e", "open(h)"]),
        ({"load": "a"}, ["derived.load", "already"]),
        ({"e": "f", "f": "a"}, ["derived.e", "'f'"]),
        ({"2e": "a"}, ["2e"]),
        ({"ee": "a + b"}, ["'ee'", "stretch"]),
    ],
)
def test_misuse_is_told_with_the_key(texts: dict[str, str], told: list[str]) -> None:
    with pytest.raises(AleatorError) as caught:
        Runner(derived(stretch, texts), TABLE, ["a", "b"])
    assert all(part in str(caught.value) for part in told)


def test_a_text_is_no_number() -> None:
    table = Conditions(("1",), pd.DataFrame({"load": [6.0], "h": ["wet"]}))
    with pytest.raises(SimulatorError, match="'h' is a text"):
        Runner(derived(Lever(), E), table, ["a", "b"])([0], X[:1])


@pytest.mark.parametrize(
    "text",
    [
        "9**9**9",
        "2**2**2**2**2**2",
        "a*9**9**9",
        "1/0",
        "(-8)**0.5",
        "-" * 3000 + "a",
        "1" + " + a" * 3000,
        "a" + "**2" * 3000,
        "abs(" * 3000 + "a" + ")" * 3000,
        "not " * 3000 + "a",
        "1" * 5000 + "*a",
        "__import__('os').system('touch X')",
        "a.__class__",
        "(lambda: a)()",
        "min(*a, 2)",
    ],
)
def test_an_expression_that_computes_without_end_or_no_number_is_refused_at_once(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    began = time.process_time()
    with pytest.raises(SimulatorError, match=r"derived\.e") as caught:
        Runner(derived(stretch, {"e": text}), TABLE, ["a", "b"])
    assert time.process_time() - began < 5.0
    assert caught.value.remedy
    assert not list(tmp_path.iterdir())


def test_numbers_of_an_expression_are_floats_and_long_sums_are_computed() -> None:
    run = Runner(derived(stretch, {"e": "10**20 + a" + " + b" * 200}), TABLE, ["a", "b"])
    expected = TABLE.table["load"].to_numpy() / (1e20 + X[:, 0] + 200.0 * X[:, 1])
    np.testing.assert_allclose(run([0, 1], X), expected, rtol=1e-12)
