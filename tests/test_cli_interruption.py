"""Ctrl-C while the program is still being imported: one line and exit code 130."""

import os
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
