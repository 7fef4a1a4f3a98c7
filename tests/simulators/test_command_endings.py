"""A program that hangs, or whose caller is ended, leaves nothing behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from programs import failing, gone, script

from aleator.simulators import RunFailed
from aleator.simulators.command import CommandSimulator, Keep
from aleator.simulators.command.process import watched


def test_a_program_that_hangs_is_stopped_with_all_its_children(tmp_path: Path) -> None:
    failure = failing(tmp_path, "sleep 60 & echo $!; wait", timeout=0.2)
    assert failure.message.startswith("it was stopped after its 0.2 s")
    assert gone(int(failure.log))


def test_a_child_that_outlives_the_program_is_ended(tmp_path: Path) -> None:
    program = script(tmp_path, "sleep 60 & echo $!")
    assert gone(int(CommandSimulator([program], base=tmp_path).run_one({}, {})))


def test_a_program_that_does_not_listen_is_killed(tmp_path: Path) -> None:
    failure = failing(tmp_path, "trap '' TERM; sleep 60 & echo $!; wait", timeout=0.1)
    assert failure.message.startswith("it was stopped after its 0.1 s")
    assert gone(int(failure.log))


def test_nothing_is_left_of_a_run_whose_caller_is_killed(tmp_path: Path) -> None:
    program = script(tmp_path, f"sleep 60 & echo $$ $! > {tmp_path}/pids; wait")
    (tmp_path / "folders").mkdir()
    code = (
        "from pathlib import Path\n"
        "from aleator.simulators.command import CommandSimulator\n"
        f"CommandSimulator([{program!r}], base=Path({str(tmp_path)!r})).run_one({{}}, {{}})\n"
    )
    caller = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "TMPDIR": str(tmp_path / "folders")}
    )
    pids = tmp_path / "pids"
    while not (pids.exists() and pids.read_text().strip()):
        assert caller.poll() is None
        time.sleep(0.01)
    assert len([*(tmp_path / "folders").iterdir()]) == 1
    time.sleep(0.1)  # the caller takes note of what it started
    caller.kill()
    caller.wait()
    assert all(gone(int(pid)) for pid in pids.read_text().split())
    for _ in range(200):
        if not [*(tmp_path / "folders").iterdir()]:
            break
        time.sleep(0.01)
    assert [*(tmp_path / "folders").iterdir()] == []


@pytest.mark.slow
def test_ctrl_c_ends_the_program_and_passes_on(tmp_path: Path) -> None:
    program = script(tmp_path, f"echo $$ > {tmp_path}/pid; sleep 60")
    code = (
        "import signal\n"
        # it may be ignored where the tests run in the background
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from aleator.simulators.command import CommandSimulator\n"
        f"CommandSimulator([{program!r}], base=__import__('pathlib').Path({str(tmp_path)!r}))"
        ".run_one({}, {})\n"
    )
    caller = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE)
    pid = tmp_path / "pid"
    for _ in range(1000):
        if pid.exists() and pid.read_text().strip():
            break
        time.sleep(0.01)
    os.kill(caller.pid, signal.SIGINT)
    _, told = caller.communicate(timeout=20)
    assert told.endswith(b"KeyboardInterrupt\n")
    assert gone(int(pid.read_text()))


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_the_instant_of_a_start_ends_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, signum: signal.Signals
) -> None:
    simulator = CommandSimulator([script(tmp_path, "echo 1.0; exec sleep 60")], base=tmp_path)
    started: list[int] = []

    class Interrupted(subprocess.Popen[bytes]):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            started.append(self.pid)
            signal.raise_signal(signum)

    watched().rmdir()  # a janitor is there, whose start is not the one in question
    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    before = signal.signal(signum, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            simulator.run_one({}, {})
        assert signal.getsignal(signum) is signal.default_int_handler
    finally:
        signal.signal(signum, before)
    (pid,) = started
    assert gone(pid)


def test_a_program_hears_the_signals_that_its_caller_holds(tmp_path: Path) -> None:
    program = script(tmp_path, "kill -s TERM $$; sleep 60")
    with pytest.raises(RunFailed, match="ended by SIGTERM"):
        CommandSimulator([program], base=tmp_path, keep=Keep.NONE).run_one({}, {})


def test_a_passing_folder_is_gone_with_its_process(tmp_path: Path) -> None:
    code = (
        "import time\n"
        "from aleator.simulators.command.process import passing\n"
        "with passing() as folder:\n"
        "    (folder / 'large').write_text('1')\n"
        "    print(folder, flush=True)\n"
        "    time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    ) as caller:
        assert caller.stdout is not None
        folder = Path(caller.stdout.readline().decode().strip())
        assert (folder / "large").exists()
        caller.kill()
    for _ in range(200):
        if not [*tmp_path.iterdir()]:
            break
        time.sleep(0.01)
    assert [*tmp_path.iterdir()] == []
