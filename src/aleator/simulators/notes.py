"""Notes to the user about the store of runs: what it has at the start, what it keeps at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from aleator.errors import short
from aleator.simulators.run_cache import RunCache


@contextmanager
def notified(
    cache: RunCache | None, study: str, say: Callable[[str], None] | None = None
) -> Iterator[None]:
    """Tell what a store has for a runner, and what it holds of the runs when something stops them.

    `study` is the file that the commands `aleator runs ...` are given.
    """
    if cache is None or say is None:
        yield
        return
    _tell_at_start(cache, study, say)
    try:
        yield
    except BaseException:
        if cache.added:
            say(
                f"{cache.added:,} new runs are kept in {short(cache.store.path)}: the same command "
                "goes on from there"
            )
        raise


def _tell_at_start(cache: RunCache, study: str, say: Callable[[str], None]) -> None:
    path, identity = short(cache.store.path), cache.identity
    stored = cache.at_start
    if stored.runs:
        failed = f", {stored.failures:,} of them failures" if stored.failures else ""
        say(f"{path} has {stored.runs:,} runs of this simulator{failed}; none is repeated")
    if stored.other:
        say(
            f"{path} has {stored.other:,} runs of '{identity.name}' with other files or settings; "
            f"they are not used (aleator runs list {study})"
        )
    if not cache.store.writable:
        say(f"{path} is read-only: its runs are used, new ones are not kept")
