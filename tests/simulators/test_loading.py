"""A worker runs the code that the study was started with, or says that it does not."""

import pickle
import sys
from collections.abc import Iterator
from pathlib import Path

import cloudpickle
import numpy as np
import pytest

from aleator.errors import SimulatorError
from aleator.simulators import FunctionSimulator, function

X = {"x": np.array([2.0])}


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
    assert arrived({}, X).tolist() == [6.0]
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
    assert pickle.loads(parcel(folder))({}, X).tolist() == [14.0]


def test_a_worker_that_holds_an_older_module_beside_it_says_so(folder: Path) -> None:
    pickle.loads(parcel(folder))
    (folder / "rates_of_this_test.py").write_text("k = 4")
    with pytest.raises(SimulatorError, match="has changed since this worker loaded it") as caught:
        pickle.loads(parcel(folder))
    assert "start the workers again" in str(caught.value)


def test_modules_that_a_worker_has_not_loaded_yet_are_no_matter(folder: Path) -> None:
    sent = parcel(folder)
    (folder / "model.py").with_name("other.py").write_text("")
    sys.modules.pop("rates_of_this_test")
    assert pickle.loads(sent)({}, X).tolist() == [6.0]


def test_functions_of_a_script_travel_as_they_are() -> None:
    made: dict[str, object] = {"__name__": "__main__"}
    exec("def f(x): return 5 * x", made)
    sent = cloudpickle.dumps(FunctionSimulator(made["f"]))  # type: ignore[arg-type]
    assert pickle.loads(sent)({}, X).tolist() == [10.0]
