"""`aleator runs`: list, export, import and forget the stored runs of a simulator."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import click
from rich.console import Console

from aleator.cli.running import FILE
from aleator.errors import AleatorError, StoreError, count, short
from aleator.simulators import Simulator, Store, records
from aleator.study import load_study
from aleator.views import runs as report

TARGET = click.argument("target", type=FILE, metavar="STUDY.toml|STORE")


@dataclass(frozen=True)
class Target:
    """The store of runs that a command works on, with the simulator of the study.

    `simulator` is None if the user named the file of the store, and no study.
    """

    store: Store
    simulator: Simulator | None

    @cached_property
    def fingerprint(self) -> str | None:
        """The hash of the source of the study's simulator; None without a study."""
        return None if self.simulator is None else self.simulator.fingerprint()


@contextmanager
def opened(target: Path, new: bool = False) -> Iterator[Target]:
    """A context with the store of runs that `target`, a study or the file of a store, names.

    Raises StoreError if the file does not exist, unless `new`.
    """
    path, simulator = target, None
    if target.suffix == ".toml" or target.is_dir():
        study = load_study(target)
        path, simulator = study.store, study.simulator
    if not os.path.exists(path) and not new:
        raise StoreError(
            f"{short(path)}: there is no store of runs",
            "`aleator identify` makes it with the first run; name the file if it lies elsewhere",
        )
    with Store(path) as store:
        yield Target(store, simulator)


@click.group()
def runs() -> None:
    """See, export, import or forget the runs that are kept.

    Every command of a study keeps the simulator's runs in runs.sqlite beside the study file (or
    where `[simulator] store` or --store says), and repeats none of them. A run is reused if the
    simulator, the parameters, and the conditions that the simulator takes are the same. Whether the
    simulator is the same is judged by its fingerprint, a hash of its source. If you know better,
    write `[simulator] version = "..."` for a function: its runs are then valid until you change
    that version.

    With STUDY.toml the commands are about the runs of its simulator as it is now; with the file
    of a store they are about all runs in it.
    """


@runs.command("list")
@TARGET
def list_(target: Path) -> None:
    """Tell for every simulator how many runs there are, failures, seconds and the last date."""
    with opened(target) as at:
        found = records.runs_by_simulator(at.store)
        Console().print(report.holdings(found, at.fingerprint, short(at.store.path)))


@runs.command()
@TARGET
@click.argument("number", type=click.IntRange(1, 2**63 - 1), required=False, metavar="[RUN]")
@click.option("--failures", is_flag=True, help="Only runs that failed.")
def show(target: Path, number: int | None, failures: bool) -> None:
    """Show one RUN with its log, or the last runs, or the last failures."""
    with opened(target) as at:
        if number is not None:
            found = [*records.stored_runs(at.store, number=number)]
            if not found:
                raise StoreError(
                    f"{short(at.store.path)} has no run {number}",
                    "`aleator runs show` lists the last ones",
                )
            Console().print(report.one(found[0]))
            return
        every = [
            held
            for held in records.runs_by_simulator(at.store)
            if at.fingerprint in (None, held.simulator.fingerprint)
        ]
        total = sum(held.failures if failures else held.runs for held in every)
        last = records.stored_runs(at.store, at.fingerprint, failures=failures, last=20)
        found = [*last]
        Console().print(report.runs(found, total - len(found)))


@runs.command()
@TARGET
@click.argument("file", type=FILE, metavar="FILE")
def export(target: Path, file: Path) -> None:
    """Write the runs to FILE, a row a run: .csv, or .parquet (which needs pyarrow)."""
    with opened(target) as at:
        written = records.write(records.stored_runs(at.store, at.fingerprint), file)
    click.echo(f"Written: {file}, {count(written, 'run')}")


@runs.command("import")
@TARGET
@click.argument("file", type=FILE, metavar="FILE.csv")
def import_(target: Path, file: Path) -> None:
    """Add the runs of a CSV file that `aleator runs export` wrote, here or on another machine.

    With STUDY.toml the file may lack the column fingerprint. Leave it out to bring in runs that
    were computed elsewhere, or to go on with runs of a simulator whose source has changed although
    its outcomes have not. A run that is in the store already stays as it is.
    """
    with opened(target, new=True) as at:
        if not at.store.writable:
            raise StoreError(f"{short(at.store.path)} is read-only", "name another store")
        found = records.read(at.store, file, at.simulator)
    click.echo(f"{count(found.added, 'run')} added, {found.present:,} were there already")
    if found.different:
        click.echo(f"{found.different:,} of these have another outcome there, which stays")


@runs.command()
@TARGET
def retry(target: Path) -> None:
    """Forget the failures, so that they are run again when they are needed.

    If a failed run stopped a study, the next command repeats the run anyway. Use this command for
    failed runs that did not stop a study, such as those of `aleator box`.
    """
    with opened(target) as at:
        forgotten = records.retry(at.store, at.fingerprint)
    click.echo(f"Forgotten: {count(forgotten, 'failure')}")


@runs.command()
@TARGET
@click.option("--old", is_flag=True, help="All but the study's simulator as it is now.")
@click.option("--all", "everything", is_flag=True, help="All runs in the store.")
@click.option("--fingerprint", metavar="TEXT", help="One simulator, by how its fingerprint begins.")
@click.option("--yes", is_flag=True, help="Do it.")
def forget(target: Path, old: bool, everything: bool, fingerprint: str | None, yes: bool) -> None:
    """Forget simulators with all their runs, for good; without --yes only say which."""
    if old + everything + (fingerprint is not None) != 1:
        raise AleatorError("what is to be forgotten?", "give one of --old, --all, --fingerprint")
    with opened(target) as at:
        if old and at.simulator is None:
            raise AleatorError(
                "--old: a store does not tell which simulator is the present one",
                "name the study, or give --fingerprint",
            )
        chosen = [
            held
            for held in records.runs_by_simulator(at.store)
            if everything
            or (old and held.simulator.fingerprint != at.fingerprint)
            or (fingerprint and held.simulator.fingerprint.startswith(fingerprint))
        ]
        size = sum(held.runs for held in chosen)
        if not chosen:
            click.echo("There is nothing to forget")
        elif yes:
            records.forget(at.store, [held.simulator.fingerprint for held in chosen])
            click.echo(f"Forgotten: {count(size, 'run')}")
        else:
            Console().print(report.holdings(chosen, at.fingerprint, short(at.store.path)))
            raise AleatorError(f"this forgets {count(size, 'run')} for good", "say --yes to do it")
