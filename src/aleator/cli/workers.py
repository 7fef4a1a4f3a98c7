"""Who makes the simulator's runs: this process, others of this machine, or those of a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any, TypeVar

import click

from aleator.errors import AleatorError
from aleator.simulate.dask_cluster import dask_executor
from aleator.simulate.mpi_workers import mpi_executor
from aleator.simulate.pool import ProcessPool

Command = TypeVar("Command", bound=Callable[..., Any])

_CHOSEN = "aleator.workers"


def _choose(ctx: click.Context, option: click.Parameter, value: Any) -> None:
    if value:
        ctx.meta.setdefault(_CHOSEN, {})[option.name] = value


PROCESSES = click.option(
    "--workers",
    type=click.IntRange(min=1),
    metavar="N",
    expose_value=False,
    callback=_choose,
    help="Make the runs in N processes of this machine [default: in this one].",
)


def on_clusters(command: Command) -> Command:
    """Give a command the options that have its runs made by a cluster."""
    dask = click.option(
        "--dask",
        metavar="ADDRESS",
        expose_value=False,
        callback=_choose,
        help="Make the runs on a Dask cluster: its scheduler's address or file.",
    )
    mpi = click.option(
        "--mpi",
        is_flag=True,
        expose_value=False,
        callback=_choose,
        help="Make the runs in the processes of this MPI job (see docs/clusters.md).",
    )
    return dask(mpi(command))


@contextmanager
def chosen_executor(say: Callable[[str], None]) -> Iterator[Executor | None]:
    """What the options of the current command ask for; None is this process."""
    chosen: dict[str, Any] = click.get_current_context().meta.get(_CHOSEN, {})
    if len(chosen) > 1:
        names = " and ".join(f"--{name}" for name in chosen)
        raise AleatorError(f"{names} contradict each other", "choose one of them")
    if "dask" in chosen:
        with dask_executor(chosen["dask"], say) as executor:
            yield executor
    elif "mpi" in chosen:
        with mpi_executor() as executor:
            yield executor
    elif "workers" in chosen:
        with ProcessPool(chosen["workers"]) as executor:
            yield executor
    else:
        yield None
