"""progress.html: what it shows while a command works, and how it says that the command ended."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import pytest
from studies import LENGTHS, done, read, refused, run, springs

from aleator import cli
from aleator.core.progress import RunsAhead, Standing
from aleator.errors import AleatorError
from aleator.views.progress_page import ProgressPage, by_round, chart, rounds_of

AHEAD = (RunsAhead(0.2, 80.0, 10.0), RunsAhead(0.1, 90.0, 20.0))
ROUNDS = [
    Standing(20, -9.0, {"v.mean": 1.0}),
    Standing(20, -8.0, {"v.mean": 1.5}, math.inf, AHEAD),
    Standing(40, -7.5, {"v.mean": 1.6}, 1.0, AHEAD),
    Standing(60, -7.25, {"v.mean": 1.7}, 0.1, AHEAD),
    Standing(61, -7.25, {"v.mean": 1.7}),
]


def state(text: str) -> str:
    found = re.search(r'<p class="state (\w+)">', text)
    assert found is not None
    return found[1]


def refreshed(text: str) -> bool:
    return 'http-equiv="refresh"' in text


def test_rounds_are_the_last_ones_with_a_known_error_or_all_searches() -> None:
    assert [each.runs for each in rounds_of(ROUNDS)] == [20, 40, 60]
    assert rounds_of(ROUNDS[:1]) == ROUNDS[:1]
    rows = by_round(rounds_of(ROUNDS)).rows
    assert [row[0] for row in rows] == ["20", "40", "60"]
    assert [row[2] for row in rows] == ["", "1", "0.1"]
    assert [row[3] for row in rows] == ["1.5", "1.6", "1.7"]


def test_the_chart_has_the_errors_on_a_logarithmic_axis() -> None:
    picture = ElementTree.fromstring(chart(rounds_of(ROUNDS)))
    marks = [(float(m.get("cx", "nan")), float(m.get("cy", "nan"))) for m in picture.iter("circle")]
    levels = {
        text.text: float(line.get("y1", "nan"))
        for line, text in zip(picture.iter("line"), picture.iter("text"), strict=False)
    }
    assert [y for _, y in marks] == [levels["1"], levels["0.1"]]
    assert marks[0][0] < marks[1][0]
    assert levels["1"] < levels["0.2"] < levels["0.1"]  # downwards
    share = (levels["0.2"] - levels["1"]) / (levels["0.1"] - levels["1"])
    assert share == pytest.approx(-math.log10(0.2), abs=0.01)
    assert chart(ROUNDS[:3]) == ""


def test_a_page_shows_the_work_and_then_its_end(tmp_path: Path) -> None:
    page, file = ProgressPage(), tmp_path / "out" / "progress.html"
    with page:
        page.open(tmp_path / "out", "Springs <A>", "aleator identify")
        page.counts(lambda: 1234)
        assert (state(file.read_text()), refreshed(file.read_text())) == ("working", True)
        page.stage("search")
        page.update("start 1 of 4", 1, 4)
        page.update("start 2 of 4", 2, 4)
        for standing in ROUNDS:
            page.reached(standing)
        text = page.text()
        for word in ("Springs &lt;A&gt;", "1,234", "-7.25", "1.7", "80 runs", "90 runs", "<svg"):
            assert word in text
        assert "start 1 of 4" not in text
        assert "start 2 of 4" in text
        page.link([tmp_path / "out" / "report.html"])
        assert "report.html" not in text
    text = file.read_text()
    assert (state(text), refreshed(text)) == ("done", False)
    assert 'href="report.html"' in text
    assert "-7.25" not in text.partition("<h2>")[0]  # The answer has other numbers.
    assert [*file.parent.iterdir()] == [file]


@pytest.mark.parametrize(
    ("error", "how"),
    [(KeyboardInterrupt(), "stopped"), (AleatorError("no <x>", "mend it"), "failed")],
)
def test_a_page_tells_that_its_command_was_stopped_or_failed(
    tmp_path: Path, error: BaseException, how: str
) -> None:
    def work() -> None:
        with ProgressPage() as page:
            page.open(tmp_path, "Springs", "aleator check")
            raise error

    with pytest.raises(type(error)):
        work()
    text = (tmp_path / "progress.html").read_text()
    assert (state(text), refreshed(text)) == (how, False)
    assert ("no &lt;x&gt;" in text) == (how == "failed")


def test_a_page_that_cannot_be_written_is_misuse_at_first_and_nothing_later(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(AleatorError), ProgressPage() as page:
        page.open(tmp_path / "file", "Springs", "aleator check")
    with ProgressPage() as page:
        page.open(tmp_path / "out", "Springs", "aleator check")
        (tmp_path / "out" / "progress.html").unlink()
        (tmp_path / "out" / "progress.html").mkdir()


@pytest.mark.usefixtures("unjudged_commands")
def test_watching_changes_no_answer_and_a_page_needs_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    springs(tmp_path)
    monkeypatch.chdir(tmp_path)
    answers = []
    for folder, options in (("seen", ["--watch"]), ("unseen", [])):
        done("identify", "study.toml", "--no-store", "--no-figures", "--output", folder, *options)
        answers.append(read(f"{folder}/identification.json"))
        del answers[-1]["seconds"]
    assert answers[0] == answers[1]
    text = Path("seen/progress.html").read_text()
    assert state(text) == "done"
    assert f"{answers[0]['runs']:,}" in text
    assert f"{answers[0]['log_likelihood']['estimated']:.2f}" in text
    assert not Path("unseen/progress.html").exists()
    assert "--output" in refused("box", "study.toml", "--watch")
    Path("model.py").write_text("def length(load, softness):\n    raise ValueError('torn')\n")
    assert run("check", "study.toml", "--watch", "--output", "failed").exit_code == 2
    text = Path("failed/progress.html").read_text()
    assert state(text) == "failed"
    assert "torn" in text


SLOW = """\
import pathlib, time
def length(load, softness):
    if pathlib.Path("slow").exists():
        time.sleep(0.15)
    return load * softness
"""


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """The command in a process of its own, which hears Ctrl-C wherever these tests run."""
    heard = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.default_int_handler)}
    process = subprocess.Popen(
        [sys.executable, "-m", "aleator", *arguments], text=True, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[2])},
        **heard,  # type: ignore[call-overload]
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def text_with(file: Path, pattern: str, seconds: float = 60.0) -> str:
    """The text of a file as soon as it has a pattern."""
    give_up = time.monotonic() + seconds
    while time.monotonic() < give_up:
        if file.exists() and re.search(pattern, text := file.read_text()):
            return text
        time.sleep(0.05)
    raise AssertionError(f"{file} has no '{pattern}'")


@pytest.mark.slow
@pytest.mark.usefixtures("unjudged_commands")
def test_the_page_of_a_slow_study_during_work_after_ctrl_c_and_after_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    springs(tmp_path, model=SLOW, lengths=LENGTHS[:5])
    monkeypatch.chdir(tmp_path)
    file, slow = Path("out/progress.html"), Path("slow")
    slow.touch()
    asked = ("identify", "study.toml", "--no-verify", "--watch", "--output", "out")
    with started(*asked) as process:
        during = text_with(file, r"\d+ of \d+ runs")
        assert (state(during), refreshed(during)) == ("working", True)
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 130
    after = file.read_text()
    assert (state(after), refreshed(after)) == ("stopped", False)
    slow.unlink()
    done(*asked)
    end = file.read_text()
    assert (state(end), refreshed(end)) == ("done", False)
    assert 'href="report.html"' in end
    assert "<svg" in end
