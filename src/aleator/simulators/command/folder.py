"""The private folder of a run: what lies in it before, and what stays of it after."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from aleator.errors import SimulatorError, nearest
from aleator.simulators.command.janitor import watched
from aleator.simulators.command.placeholders import Columns
from aleator.simulators.failure import RunFailed

FAILED, COMPLETED, TOLD = "failed_runs", "completed_runs", "aleator.run.json"
# A box half of which fails must not fill the disk.
_MOST_FAILED = 100


class Keep(Enum):
    """Whose folders outlive the run: `failed_runs/` and `completed_runs/` beside the study."""

    FAILED = "failed"
    ALL = "all"
    NONE = "none"


@dataclass(frozen=True)
class Folder:
    """How a run's folder is made: `files` of the study copied (or linked), then thrown or kept.

    `base` is the study's folder. Of a folder among the files everything in it comes along, under
    its name. A link costs no time, but a program that writes to it writes to the original.

    Raises SimulatorError for a file that does not exist, and for two of one name.
    """

    base: Path = Path(".")
    files: tuple[str, ...] = ()
    link: bool = False
    keep: Keep = Keep.FAILED

    def __post_init__(self) -> None:
        names = [path.name for path in self.sources]
        for name, path in zip(self.files, self.sources, strict=True):
            if not path.exists():
                beside = [p.name for p in path.parent.glob("*")]
                raise SimulatorError(
                    f"the file {name!r} does not exist{nearest(path.name, beside)}",
                    "name it relative to the study",
                )
            if names.count(path.name) > 1:
                raise SimulatorError(
                    f"two of the files are named '{path.name}'", "a run's folder holds one"
                )

    @property
    def sources(self) -> tuple[Path, ...]:
        """The files and folders, where they lie."""
        return tuple(Path(os.path.abspath(self.base / name)) for name in self.files)

    @contextmanager
    def made(self, values: Columns, outputs: Sequence[str] = ()) -> Iterator[Path]:
        """A folder with the files, without the `outputs` that a copy may have brought.

        A RunFailed that leaves the block tells where the folder is kept.
        """
        folder = watched()
        try:
            self._fill(folder)
            for output in outputs:
                (folder / output).unlink(missing_ok=True)
            yield folder
            if self.keep is Keep.ALL:
                self._move(folder, COMPLETED, values, None)
        except RunFailed as failure:
            if self.keep is Keep.NONE:
                raise
            where = self._move(folder, FAILED, values, failure)
            raise RunFailed(f"{failure.message} ({where})", failure.log) from failure
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _fill(self, folder: Path) -> None:
        copy = os.symlink if self.link else shutil.copy2
        for source in self.sources:
            if source.is_dir():
                shutil.copytree(source, folder / source.name, copy_function=copy)
            else:
                copy(source, folder / source.name)

    def _move(self, folder: Path, kind: str, values: Columns, failure: RunFailed | None) -> str:
        """Keep the folder beside the study, with what it was run with: where, for a message."""
        home = self.base / kind
        if failure is not None and _crowded(home):
            return f"not kept: {home} holds {_MOST_FAILED} runs"
        told = {"values": dict(values), "failure": failure and failure.message}
        target = home / folder.name
        try:
            (folder / TOLD).write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
            home.mkdir(parents=True, exist_ok=True)
            shutil.move(folder, target)
        except OSError as error:
            return f"not kept in {home}: {error.strerror}"
        return f"kept in {target}"


def _crowded(home: Path) -> bool:
    return home.is_dir() and sum(1 for _ in home.iterdir()) >= _MOST_FAILED


def contents(paths: Sequence[Path]) -> Iterator[Path]:
    """Every file in or under `paths`, in an order that does not depend on the disk."""
    for path in paths:
        if path.is_dir():
            yield from sorted(inner for inner in path.rglob("*") if inner.is_file())
        elif path.is_file():
            yield path
