"""Real processes: killed at any moment, or two at once on one store."""

import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner

from aleator import cli
from aleator.simulators.runs import REPEATABILITY

STUDY = """\
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
sd = {lower = 0.01, upper = 0.4}
[search]
starts = 1
[verification]
samples = 50
"""
MODEL = """\
import os, time
log = os.open({log!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
def length(load, softness):
    time.sleep(0.002)
    os.write(log, f"{{load!r}} {{softness!r}}\\n".encode())
    return load * softness ** 1.1
"""
PART = 16  # cheap runs are committed by as many
COMMAND = [sys.executable, "-c", "from aleator.cli import main; main()"]


def made(folder: Path, log: Path) -> Path:
    folder.mkdir()
    lengths = [0.93, 2.1, 3.2, 3.7, 5.4, 5.8, 7.9, 7.6]
    rows = [f"{chr(65 + k)},{k + 1},{length}" for k, length in enumerate(lengths)]
    (folder / "springs.csv").write_text("\n".join(["id,load,length", *rows]) + "\n")
    (folder / "model.py").write_text(MODEL.format(log=str(log)))
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


def document(folder: Path) -> dict[str, object]:
    found = json.loads((folder / "identification.json").read_text())
    del found["seconds"]
    return found


def stored(path: Path) -> int:
    with closing(sqlite3.connect(path)) as connection:
        return int(connection.execute("SELECT count(*) FROM runs").fetchone()[0])


def count(log: Path) -> int:
    return log.read_bytes().count(b"\n") if log.exists() else 0


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no kill -9")
def test_a_study_killed_again_and_again_ends_with_the_same_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    study, log = made(tmp_path / "springs", tmp_path / "calls.txt"), tmp_path / "calls.txt"
    arguments = ["identify", "springs/study.toml", "--quiet", "--no-figures", "--output"]
    whole = CliRunner().invoke(cli.main, [*arguments, "whole", "--no-store"])
    assert whole.exit_code == 0, whole.output
    needed = count(log)
    distinct = len(set(log.read_text().splitlines()))
    log.unlink()

    store, chance, kills = study.with_name("runs.sqlite"), random.Random(7), 2
    for number in range(kills):
        before = stored(store) if store.exists() else 0
        goal = count(log) + chance.randrange(1, needed // (kills + 1))
        process = subprocess.Popen([*COMMAND, *arguments, "result"])
        while count(log) < goal:
            assert process.poll() is None
            time.sleep(0.001)
        time.sleep(chance.uniform(0.0, 0.01))
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        # All is there but what was being computed; the repeated runs of each start add none.
        kept = stored(store)
        assert kept >= before
        assert kept >= count(log) - (number + 1) * (PART + 1 + REPEATABILITY.most)
    done = subprocess.run([*COMMAND, *arguments, "result"], check=False)
    assert done.returncode == 0
    assert document(tmp_path / "result") == document(tmp_path / "whole")
    assert stored(store) == distinct
    assert count(log) <= distinct + kills * PART + (kills + 1) * (1 + REPEATABILITY.most)


WRITER = """\
import struct, sys
from aleator.simulators.store import Case, Identity
from aleator.simulators.store import Store
path, name, start = sys.argv[1], sys.argv[2], int(sys.argv[3])
case = Case.of({"load": 1.0}, ["x"])
print("ready", flush=True)
sys.stdin.readline()
with Store(path) as store:
    for block in range(100):
        xs = [float(start + 10 * block + k) for k in range(20)]
        rows = [(0, struct.pack("<d", x), 2 * x, None, None, 0.0, name, 0.0, 1) for x in xs]
        store.add(Identity("f", "model"), [case], rows)
        found = store.find("f", [case], [row[:2] for row in rows])
        assert [outcome for _, outcome, *_ in found] == [2 * x for x in xs]
"""


def test_two_processes_may_fill_one_store_at_once(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    writers = [
        subprocess.Popen(
            [sys.executable, "-c", WRITER, path, name, start],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for name, start in (("one", "0"), ("two", "500"))
    ]
    for writer in writers:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        assert writer.stdin is not None
        writer.stdin.write("go\n")
        writer.stdin.flush()
    for writer in writers:
        writer.communicate()
    assert [writer.returncode for writer in writers] == [0, 0]
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        runs = connection.execute("SELECT x, outcome FROM runs").fetchall()
        assert connection.execute("SELECT count(*) FROM simulators").fetchone() == (1,)
    # 0 to 1009 and 500 to 1509, each once
    assert len(runs) == 1510
    assert len({x for x, _ in runs}) == 1510
