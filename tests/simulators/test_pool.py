"""Worker processes: they end with their parent, and it ends nobody else's."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aleator.simulators.pool import ProcessPool

PARENT = """\
import sys, time
from pathlib import Path
from aleator.simulators import ProcessPool
from aleator.simulators.command import CommandSimulator
if __name__ == "__main__":
    here = Path(sys.argv[1])
    program = CommandSimulator("echo $$ > {study}/program; sleep 60", base=here, shell=True)
    pool = ProcessPool(2)
    pool.submit(program.run_one, {}, {})
    if sys.argv[2] == "stubborn":
        (here / "stubborn.py").write_text(
            "import os, time\\n"
            "def stays():\\n"
            "    while True:\\n"
            "        try:\\n"
            "            time.sleep(60)\\n"
            "        except BaseException:\\n"
            "            pass\\n"
        )
        sys.path.insert(0, str(here))
        import stubborn
        pool.submit(stubborn.stays)
    else:
        pool.submit(len, "idle")
    while not (here / "program").exists():
        time.sleep(0.01)
    time.sleep(0.2)
    print(*[worker.pid for worker in pool._inner._processes.values()], flush=True)
    time.sleep(60)
"""


def gone(pid: int, seconds: float) -> bool:
    """Whether a process has ended within so many seconds."""
    give_up = time.monotonic() + seconds
    while time.monotonic() < give_up:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":  # whoever adopted it has not asked after it
            return True
        time.sleep(0.01)
    return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="there is no /proc")
@pytest.mark.parametrize("other", ["idle", "stubborn"])
def test_workers_and_their_programs_end_with_a_parent_that_is_killed(
    tmp_path: Path, other: str
) -> None:
    (tmp_path / "folders").mkdir()
    (tmp_path / "parent.py").write_text(PARENT)
    parent = subprocess.Popen(
        [sys.executable, "parent.py", str(tmp_path), other],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(tmp_path / "folders")},
    )
    with parent:
        assert parent.stdout is not None
        workers = [int(word) for word in parent.stdout.readline().split()]
        assert len(workers) == 2
        os.kill(parent.pid, signal.SIGKILL)
    assert all(gone(worker, 10.0) for worker in workers)
    assert gone(int((tmp_path / "program").read_text()), 1.0)
    give_up = time.monotonic() + 5.0
    while [*(tmp_path / "folders").iterdir()]:  # somebody else removes them
        assert time.monotonic() < give_up
        time.sleep(0.01)


def test_a_pool_that_gives_up_ends_its_own_workers_only() -> None:
    mine = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))
    mine.start()
    try:
        pool = ProcessPool(1)
        asked = pool.submit(time.sleep, 60)
        while not asked.running():
            time.sleep(0.01)
        (worker,) = [p for p in multiprocessing.active_children() if p.pid != mine.pid]
        began = time.monotonic()
        pool.shutdown(wait=False, cancel_futures=True)
        worker.join(10.0)
        assert time.monotonic() - began < 10.0
        # the pool may have reaped it first: then it is gone, and no child to ask about
        with pytest.raises(ProcessLookupError):
            os.kill(worker.pid, 0)
        assert mine.is_alive()
    finally:
        mine.kill()
        mine.join()
