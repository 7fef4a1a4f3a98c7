"""`make kernels`: the numerical tests under other kernels of the BLAS, and with two threads.

A BLAS sums in another order on another processor, and no answer may depend on it. OpenBLAS takes
the kernel that OPENBLAS_CORETYPE names; one that the processor lacks is left out.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
NUMERICAL = (
    "core", "laws", "moments", "likelihood", "search", "surrogates", "inference", "tasks",
    "test_exact_answers.py",
)  # fmt: skip
KERNELS = {"Haswell": "Haswell", "SkylakeX": "SkylakeX", "Prescott": "Katmai"}
"""Kernels to ask for, and what OpenBLAS calls those that it then has: the wide ones of AVX2 and
AVX-512, and one without either."""
PROBE = """
import numpy, scipy.linalg, threadpoolctl
numpy.ones((64, 64)) @ numpy.ones((64, 64))
print(*{i.get("architecture") for i in threadpoolctl.threadpool_info() if i["user_api"] == "blas"})
"""


def main() -> int:
    """One run of the tests for each kernel, and one with two threads; 1 where a test failed."""
    cases = [({"OPENBLAS_CORETYPE": asked}, known, 1) for asked, known in KERNELS.items()]
    cases.append(({}, taken({}), 2))
    lines, failed = [], 0
    for choice, known, threads in cases:
        name = choice.get("OPENBLAS_CORETYPE", known)
        case = f"{name}, {threads} thread{'s' if threads > 1 else ''}"
        here = taken(choice)
        if here != known:
            lines.append(f"{case}: left out, the processor or the BLAS has {here or 'none'}")
            continue
        count, code = tested(choice, threads)
        lines.append(f"{case}: {count}")
        failed |= code
    print("\n".join(lines))
    return failed


def taken(choice: dict[str, str]) -> str:
    """The kernel that the BLAS takes in a process of its own; nothing where that one dies."""
    found = subprocess.run(
        [sys.executable, "-c", PROBE], env={**os.environ, **choice}, capture_output=True, text=True
    )
    return found.stdout.strip()


def tested(choice: dict[str, str], threads: int) -> tuple[str, int]:
    """The line of counts of the tests, whose output is shown, and 1 where one failed."""
    workers = max((os.cpu_count() or 1) // threads, 1)
    command = [
        sys.executable, "-m", "pytest", "-m", "not long", "--numprocesses", str(workers),
        "--dist", "loadfile", *(str(ROOT / "tests" / folder) for folder in NUMERICAL),
    ]  # fmt: skip
    known = {**os.environ, **choice, "OPENBLAS_NUM_THREADS": str(threads)}
    last = ""
    with subprocess.Popen(command, cwd=ROOT, env=known, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        for line in run.stdout:
            print(line, end="", flush=True)
            last = line.strip() or last
    return last, int(run.returncode != 0)


if __name__ == "__main__":
    sys.exit(main())
