"""Ctrl-C while the program is still being imported: one line and exit code 130."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from aleator import cli

# a module that is interrupted while it is imported, and makes nothing of it
INTERRUPTED = """\
import os, signal, time
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(20)
except BaseException:
    pass
raise ImportError("half imported")
"""


@pytest.mark.parametrize(
    ("module", "arguments"), [("click", ["--help"]), ("numpy", ["identify", "study.toml"])]
)
def test_ctrl_c_ends_an_import_at_once(tmp_path: Path, module: str, arguments: list[str]) -> None:
    (tmp_path / f"{module}.py").write_text(INTERRUPTED)
    source = str(Path(cli.__file__).parents[2])
    done = subprocess.run(
        [sys.executable, "-m", "aleator", *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), source])},
        capture_output=True,
        check=False,
        text=True,
        # it may be ignored where the tests run in the background
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert (done.returncode, done.stderr) == (130, "aleator: stopped by Ctrl-C\n")


@pytest.mark.parametrize("ignored", [False, True])
def test_sigterm_ends_a_command_and_keeps_its_runs(tmp_path: Path, ignored: bool) -> None:
    """So a batch system ends it; in the background of a shell only Ctrl-C is ignored."""
    (tmp_path / "springs.csv").write_text("load,length\n1,1.1\n2,2.1\n3,2.8\n")
    (tmp_path / "model.py").write_text(
        "import os, signal\n"
        "def length(load, x):\n"
        "    length.runs += 1\n"
        "    if length.runs == 20: os.kill(os.getpid(), signal.SIGTERM)\n"
        "    return load * x\n"
        "length.runs = 0\n"
    )
    (tmp_path / "study.toml").write_text(
        '[experiments]\nfile = "springs.csv"\noutcome = "length"\n'
        '[simulator]\nfunction = "model.py:length"\n'
        '[parameters.x]\nlaw = "normal"\nmean = {lower = 0.5, upper = 1.5}\n'
        "sd = {lower = 0.01, upper = 0.5}\n"
    )
    answer = signal.SIG_IGN if ignored else signal.default_int_handler
    done = subprocess.run(
        [sys.executable, "-m", "aleator", "identify", "study.toml", "--output", "out"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[2])},
        capture_output=True,
        check=False,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, answer),
    )
    assert done.returncode == 143, done.stderr
    assert done.stderr.endswith("aleator: stopped by SIGTERM\n")
    kept = re.search(r"(\d+) new runs are kept", done.stderr)
    assert kept is not None
    assert int(kept[1]) >= 14
    assert "Traceback" not in done.stderr


def test_who_imports_the_command_line_keeps_its_own_answer_to_ctrl_c() -> None:
    told = subprocess.run(
        [
            sys.executable,
            "-c",
            "import signal\n"
            "before = signal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "import aleator.cli\n"
            "print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)",
        ],
        capture_output=True,
        check=True,
        text=True,
    )
    assert told.stdout == "True\n"
