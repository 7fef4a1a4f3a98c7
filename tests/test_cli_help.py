"""The first help fits a screen, and the shell completes commands, options, choices and files."""

import os
import subprocess
import sys
from pathlib import Path

from click.shell_completion import BashComplete
from click.testing import CliRunner

from aleator import cli
from aleator.cli.program import COMMANDS


def test_the_first_help_fits_a_screen() -> None:
    shown = CliRunner().invoke(cli.main, ["--help"]).output.splitlines()
    assert len(shown) <= 24
    assert max(map(len, shown)) <= 80
    assert all(any(name in line.split() for line in shown) for name in COMMANDS)


def completed(*words: str) -> list[tuple[str, str]]:
    *before, last = words
    found = BashComplete(cli.main, {}, "aleator", "_ALEATOR_COMPLETE").get_completions(before, last)
    return [(item.type, item.value) for item in found]


def test_words_are_completed(tmp_path: Path) -> None:
    assert completed("ident") == [("plain", "identify")]
    assert completed("new", "--par") == [("plain", "--parameter")]
    assert completed("runs", "ex") == [("plain", "export")]
    assert completed("clutch", "bench", "--kind", "re") == [("plain", "realistic")]
    assert completed("identify", str(tmp_path)) == [("file", str(tmp_path))]
    assert completed("report", str(tmp_path)) == [("dir", str(tmp_path))]


def test_the_shell_is_given_its_lines_and_asks_with_them() -> None:
    def asked(**more: str) -> str:
        program = "from aleator.cli import main; main(prog_name='aleator')"
        return subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, **more}, text=True, capture_output=True, check=True,
        ).stdout  # fmt: skip

    assert "_ALEATOR_COMPLETE=bash_complete" in asked(_ALEATOR_COMPLETE="bash_source")
    answer = asked(_ALEATOR_COMPLETE="bash_complete", COMP_WORDS="aleator sch", COMP_CWORD="1")
    assert answer == "plain,schema\n"
