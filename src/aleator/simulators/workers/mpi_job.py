"""The processes of an MPI job as an executor."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.util import find_spec

from aleator.errors import ClusterError

_START = "mpiexec -n N python -m mpi4py.futures -m aleator ... --mpi (or a script for -m aleator)"


@contextmanager
def mpi_executor() -> Iterator[Executor]:
    """The processes of this MPI job but the first, which runs the study, as an executor.

    The job is to be started by `mpiexec -n N python -m mpi4py.futures SCRIPT`. Where one of its
    processes dies MPI ends all of them: the runs that a store holds are kept.

    Raises ClusterError if the job was not started so, or if there is no mpi4py or no MPI library.

    >>> with mpi_executor() as executor:
    ...     runner = Runner(simulator, experiments, ["stiffness"], executor=executor)
    Traceback (most recent call last):
        ...
    aleator.errors.ClusterError: this process is not the first of an MPI job with workers ...
    """
    if find_spec("mpi4py") is None:
        raise ClusterError("MPI needs the package mpi4py", "pip install mpi4py")
    if "mpi4py.futures" not in sys.orig_argv:
        raise ClusterError(
            "this process is not the first of an MPI job with workers", f"start it so: {_START}"
        )
    # Workers get what they need with each call, not by importing this program.
    from mpi4py.futures import MPIPoolExecutor

    executor: Executor = MPIPoolExecutor(main=False)
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        raise
    executor.shutdown()
