"""A Python function as a simulator: its arguments, its file, and what it returns."""

import pickle
import sys
from collections.abc import Callable, Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import pandas as pd
import pytest

from aleator.errors import ExperimentsError, SimulatorError
from aleator.observations.experiments import Conditions, Experiments
from aleator.simulators import FunctionSimulator, Runner, function, load_function
from aleator.simulators.protocol import RunStopped


def model(load: float, stiffness: float, gravity: float = 9.81) -> float:
    return load * gravity / stiffness


def test_only_what_is_asked_for_is_passed() -> None:
    simulator = FunctionSimulator(model)
    assert simulator.asks(["bench", "load"], ["stiffness"]) == ("load",)
    assert simulator.asks(["gravity", "load"], ["stiffness"]) == ("gravity", "load")


def test_keyword_arguments_take_everything() -> None:
    simulator = FunctionSimulator(lambda **values: sum(values.values()))
    assert simulator.asks(["a", "b"], ["c"]) == ("a", "b")
    assert simulator({"a": np.ones(2)}, {"c": np.arange(2.0)}).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("vectorized", [False, True])
def test_both_ways_of_calling_agree(vectorized: bool) -> None:
    simulator = FunctionSimulator(model, vectorized)
    outcomes = simulator({"load": np.array([1.0, 2.0])}, {"stiffness": np.array([9.81, 1.0])})
    np.testing.assert_allclose(outcomes, [1.0, 19.62])


def test_an_argument_that_is_nothing_known_is_told_with_the_nearest_name() -> None:
    with pytest.raises(SimulatorError, match=r"argument 'load' is neither.*did you mean 'loads'"):
        FunctionSimulator(model).asks(["loads"], ["stiffness"])


def test_a_name_cannot_be_condition_and_parameter() -> None:
    with pytest.raises(SimulatorError, match="'stiffness' is both a condition and a parameter"):
        FunctionSimulator(model).asks(["load", "stiffness"], ["stiffness"])


def test_arguments_need_names() -> None:
    def positional(load: float, /) -> float:
        return load

    with pytest.raises(SimulatorError, match="'load' cannot be given by name"):
        FunctionSimulator(positional)
    with pytest.raises(SimulatorError, match="does not say what its arguments are called"):
        FunctionSimulator(dict)
    with pytest.raises(SimulatorError, match="is not callable"):
        FunctionSimulator(3)  # type: ignore[arg-type]


def test_what_completed_before_an_exception_is_handed_over() -> None:
    def brittle(x: float) -> float:
        if x > 1.5:
            raise ValueError("broken")
        return x

    with pytest.raises(RunStopped) as caught:
        FunctionSimulator(brittle)({}, {"x": np.array([0.0, 1.0, 2.0, 1.0])})
    assert caught.value.completed.tolist() == [0.0, 1.0]
    assert isinstance(caught.value.__cause__, ValueError)


def test_functions_are_found_in_files_and_modules(tmp_path: Path) -> None:
    (tmp_path / "aleator_test_part.py").write_text("factor = 2.0\n")
    (tmp_path / "model.py").write_text(
        "from aleator_test_part import factor\n"
        "class Models:\n"
        "    @staticmethod\n"
        "    def double(x): return factor * x\n"
        "def single(x): return x\n"
    )
    assert load_function("model.py:single", tmp_path)(3.0) == 3.0
    assert load_function("model.py:Models.double", tmp_path)(3.0) == 6.0
    assert load_function("math:hypot", tmp_path)(3.0, 4.0) == 5.0


def test_files_of_one_name_in_two_folders_are_two_modules(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "model.py").write_text(f"def where(): return '{name}'\n")
    found = [load_function("model.py:where", tmp_path / name)() for name in ("a", "b")]
    assert found == ["a", "b"]


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ("model.py", "does not name a function"),
        (":run", "does not name a function"),
        ("modell.py:run", r"modell\.py does not exist.*'model\.py'"),
        ("model.py:rum", r"has no 'rum'.*'run'"),
        ("model.py:constant", "is float 3.0, not a function"),
        ("broken.py:run", r"ZeroDivisionError: division by zero \(broken\.py, line 2\)"),
        ("syntax.py:run", r"SyntaxError: .*\(syntax\.py, line 1\)"),
        ("aleator_no_such_module:run", "ModuleNotFoundError: No module named 'aleator_no"),
    ],
)
def test_what_cannot_be_loaded_is_told(tmp_path: Path, reference: str, words: str) -> None:
    (tmp_path / "model.py").write_text("constant = 3.0\ndef run(x): return x\n")
    (tmp_path / "broken.py").write_text("\n1 / 0\n")
    (tmp_path / "syntax.py").write_text("def run(x) return x\n")
    with pytest.raises(SimulatorError, match=words):
        load_function(reference, tmp_path)


def test_the_fingerprint_changes_with_the_source(tmp_path: Path) -> None:
    path = tmp_path / "model.py"
    path.write_text("def run(x): return x\n")
    first = FunctionSimulator(load_function("model.py:run", tmp_path)).fingerprint()
    assert FunctionSimulator(load_function("model.py:run", tmp_path)).fingerprint() == first
    path.write_text("def run(x): return 2 * x\n")
    assert FunctionSimulator(load_function("model.py:run", tmp_path)).fingerprint() != first


TWO = {"x": np.array([2.0])}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A simulator of two files, in a process that has loaded neither."""
    (tmp_path / "model.py").write_text("import rates_of_this_test as r\n\ndef f(x): return r.k * x")
    (tmp_path / "rates_of_this_test.py").write_text("k = 3")
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(function, "_loaded", {})
    yield tmp_path
    sys.modules.pop("rates_of_this_test", None)


def parcel(folder: Path) -> bytes:
    return bytes(cloudpickle.dumps(FunctionSimulator.named("model.py:f", folder)))


def test_the_same_files_give_the_same_simulator(folder: Path) -> None:
    sent = FunctionSimulator.named("model.py:f", folder)
    arrived = pickle.loads(cloudpickle.dumps(sent))
    assert arrived({}, TWO).tolist() == [6.0]
    assert arrived.fingerprint() == sent.fingerprint()
    assert cloudpickle.dumps(arrived) == cloudpickle.dumps(sent)


@pytest.mark.parametrize("name", ["model.py", "rates_of_this_test.py"])
def test_a_file_that_is_another_one_there_is_refused(folder: Path, name: str) -> None:
    sent = parcel(folder)
    (folder / name).write_text((folder / name).read_text() + "\n# another copy")
    with pytest.raises(SimulatorError, match=rf"{name} is not the same for this worker"):
        pickle.loads(sent)


def test_a_worker_that_lives_on_reads_the_changed_file_again(folder: Path) -> None:
    pickle.loads(parcel(folder))
    (folder / "model.py").write_text("def f(x): return 7 * x")
    assert pickle.loads(parcel(folder))({}, TWO).tolist() == [14.0]


def test_a_worker_that_holds_an_older_module_beside_it_says_so(folder: Path) -> None:
    pickle.loads(parcel(folder))
    (folder / "rates_of_this_test.py").write_text("k = 4")
    with pytest.raises(SimulatorError, match="has changed since this worker loaded it") as caught:
        pickle.loads(parcel(folder))
    assert "start the workers again" in str(caught.value)


ROWS = Conditions(("A", "B", "C"), pd.DataFrame({"load": [1.0, 2.0, 3.0]}))
SERIES = Conditions(("A",), pd.DataFrame({"load": [1.0, 2.0, 3.0]}), experiment=np.zeros(3))
NAN = float("nan")
GIVEN: dict[str, tuple[Callable[[Any], Any], list[float]]] = {
    "masked": (lambda v: np.ma.masked_greater(v, 2.5), [1.0, 2.0, NAN]),
    "masked whole numbers": (lambda v: np.ma.masked_equal(v.astype(int), 2), [1.0, NAN, 3.0]),
    "objects": (lambda v: v.astype(object), [1.0, 2.0, 3.0]),
    "decimals": (lambda v: np.array([Decimal(str(a)) for a in v]), [1.0, 2.0, 3.0]),
    "missing": (lambda v: np.array([v[0], None, v[2]], dtype=object), [1.0, NAN, 3.0]),
    "missing in a frame": (
        lambda v: pd.array([v[0], pd.NA, v[2]], dtype="Float64"),
        [1.0, NAN, 3.0],
    ),
}
REFUSED: dict[str, Callable[[Any], Any]] = {
    "texts": lambda v: v.astype(str),
    "a list of texts": lambda v: [str(a) for a in v],
    "texts as objects": lambda v: v.astype(str).astype(object),
    "truth values": lambda v: v > 0,
    "complex": lambda v: v + 0j,
    "dates": lambda v: v.astype(int).astype("M8[s]"),
}


def values(make: Callable[[Any], Any], table: Conditions, **kind: bool) -> Runner:
    simulator = FunctionSimulator(lambda load, x: make(np.asarray(load * x)), **kind)
    return Runner(simulator, table, ["x"], max_failed=1.0)


@pytest.mark.parametrize(("make", "expected"), GIVEN.values(), ids=GIVEN)
def test_values_are_those_that_were_returned(
    make: Callable[[Any], Any], expected: list[float]
) -> None:
    vectorized = values(make, ROWS, vectorized=True)
    found = vectorized.attempt([0, 1, 2], np.ones((3, 1)))
    np.testing.assert_array_equal(found, expected)
    assert len(vectorized.failures) == np.isnan(expected).sum()
    straight = vectorized.straight([0, 1, 2], np.ones((3, 1)))
    np.testing.assert_array_equal(straight[:, 0], expected)
    series = values(make, SERIES, series=True).values([0], [[1.0]])
    lost = [NAN] * 3 if np.isnan(expected).any() else expected  # of a series all rows are needed
    np.testing.assert_array_equal(series[0], lost)


@pytest.mark.parametrize("make", REFUSED.values(), ids=REFUSED)
def test_what_is_no_number_is_none(make: Callable[[Any], Any]) -> None:
    with pytest.raises(SimulatorError, match="returned values of type"):
        values(make, ROWS, vectorized=True)([0, 1, 2], np.ones((3, 1)))
    run = values(make, SERIES, series=True)
    assert np.isnan(run.values([0], [[1.0]])).all()
    assert "values of type" in next(iter(run.failures.failures.values())).message
    with pytest.raises(ExperimentsError, match="values of type"):
        Experiments(ROWS.ids, ROWS.conditions, make(np.array([1.0, 2.0, 3.0])))


@pytest.mark.parametrize("returned", ["2.0", b"2.0", True, 1j, [2.0], None])
def test_one_run_gives_one_number(returned: object) -> None:
    run = Runner(lambda load, x: returned if load > 1 else load * x, ROWS, ["x"])  # type: ignore[arg-type]
    assert run([0], [[1.0]]).tolist() == [1.0]
    with pytest.raises(SimulatorError, match="experiment 'B'"):
        run([1], [[1.0]])


def test_a_function_that_masks_is_not_called_with_arrays_unseen() -> None:
    """Where a call with many numbers masks some of them, these runs have no outcome."""
    run = Runner(lambda load, x: np.ma.masked_less(load * x, 1.5), ROWS, ["x"])
    assert run.takes_arrays(np.array([[2.0, 3.0]]))
    found = run.straight([0, 1, 2], np.ones((3, 1)))
    np.testing.assert_array_equal(found[:, 0], [NAN, 2.0, 3.0])


def test_a_masked_measurement_is_no_outcome() -> None:
    with pytest.raises(ExperimentsError, match="1 of them not finite"):
        Experiments(ROWS.ids, ROWS.conditions, np.ma.masked_equal([1.0, 2.0, 3.0], 2.0))
    exact = Experiments(ROWS.ids, ROWS.conditions, np.array([1, Decimal(2), 3.0], dtype=object))
    assert exact.outcomes.tolist() == [1.0, 2.0, 3.0]
