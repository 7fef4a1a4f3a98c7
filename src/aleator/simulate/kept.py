"""Completed runs outlive what stops the computation that asked for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from aleator.simulate.runner import Runner


@contextmanager
def keeping(runner: Runner, path: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Take up the runs in the file `path`; if the block is left by any exception, write all to it.

    `say` is told what was taken up and what was written. Raises SimulatorError if the file is
    damaged.
    """
    known = runner.load(path)
    if known:
        say(f"{known:,} runs are taken from {path} (delete it to run them anew)")
    elif known is None and path.exists():
        say(f"{path} is left alone: its runs are of another simulator or other conditions")
    try:
        yield
    except BaseException:
        if runner.fresh:
            _save(runner, path, say)
        raise


def _save(runner: Runner, path: Path, say: Callable[[str], None]) -> None:
    try:
        runner.save(path)
        say(f"the {len(runner.completed):,} runs that completed are kept in {path}")
    except OSError as error:
        # What stopped the runs is the error to be told, not this one.
        say(f"the runs that completed could not be written to {path}: {error.strerror}")
