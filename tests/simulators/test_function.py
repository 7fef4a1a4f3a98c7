# Arguments that a test's simulator does not use still say what it is given.
# ruff: noqa: ARG005
import sys
from pathlib import Path

import numpy as np
import pytest

from aleator.errors import SimulatorError
from aleator.simulators import FunctionSimulator, load_function
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


def test_a_parameter_that_the_function_does_not_take_is_told() -> None:
    with pytest.raises(SimulatorError, match=r"parameter 'stifness' \(did you mean 'stiffness'"):
        FunctionSimulator(model).asks(["load"], ["stifness"])


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


def test_extra_positional_arguments_are_ignored() -> None:
    def loose(load: float, *rest: float) -> float:
        return load + len(rest)

    assert FunctionSimulator(loose).asks(["load"], []) == ("load",)


def test_what_completed_before_an_exception_is_handed_over() -> None:
    def brittle(x: float) -> float:
        if x > 1.5:
            raise ValueError("broken")
        return x

    with pytest.raises(RunStopped) as caught:
        FunctionSimulator(brittle)({}, {"x": np.array([0.0, 1.0, 2.0, 1.0])})
    assert caught.value.completed.tolist() == [0.0, 1.0]
    assert isinstance(caught.value.__cause__, ValueError)


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        (None, "is a return statement missing"),
        (np.zeros(1), r"an array of shape \(1,\) instead of one number"),
        ("0.5", "'0.5' instead of a number"),
        (1j, "instead of a number"),
    ],
)
def test_an_outcome_is_one_real_number(returned: object, words: str) -> None:
    with pytest.raises(RunStopped) as caught:
        FunctionSimulator(lambda x: returned)({}, {"x": np.zeros(1)})
    with pytest.raises(TypeError, match=words):
        raise caught.value.__cause__  # type: ignore[misc]


def test_integers_are_numbers() -> None:
    outcomes = FunctionSimulator(lambda x: int(x))({}, {"x": np.array([1.0, 2.0])})
    assert outcomes.dtype == np.float64


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


def test_a_file_that_cannot_be_imported_leaves_no_module(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("1 / 0\n")
    before = set(sys.modules)
    with pytest.raises(SimulatorError):
        load_function("broken.py:run", tmp_path)
    assert set(sys.modules) == before


def test_the_fingerprint_changes_with_the_source(tmp_path: Path) -> None:
    path = tmp_path / "model.py"
    path.write_text("def run(x): return x\n")
    first = FunctionSimulator(load_function("model.py:run", tmp_path)).fingerprint()
    assert FunctionSimulator(load_function("model.py:run", tmp_path)).fingerprint() == first
    path.write_text("def run(x): return 2 * x\n")
    assert FunctionSimulator(load_function("model.py:run", tmp_path)).fingerprint() != first
