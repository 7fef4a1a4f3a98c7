"""The record of completed runs, in memory and as a file that a later identification reuses.

The file is a CSV table (experiment id, parameters, outcome in its original unit) under one line
with the fingerprint of simulator, conditions and parameters: no runs of another model are reused.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aleator.errors import SimulatorError

_MARK = "# aleator runs, fingerprint "
_OUTCOME = "outcome"


@dataclass(frozen=True, eq=False)
class Runs:
    """R completed runs: `index` (R,) of the experiment, `x` (R, n), `outcome` (R,).

    The outcome is finite and in its original unit, before the transform of the experiments.

    >>> len(Runs.none(2))
    0
    """

    index: NDArray[np.intp]
    x: NDArray[np.float64]
    outcome: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.index)

    @classmethod
    def none(cls, parameters: int) -> Runs:
        """No runs of a simulator with so many parameters."""
        return cls.joined([], parameters)

    @classmethod
    def joined(cls, blocks: Sequence[Runs], parameters: int) -> Runs:
        """The runs of all blocks in their order."""
        return cls(
            np.concatenate([np.empty(0, np.intp), *(block.index for block in blocks)]),
            np.concatenate([np.empty((0, parameters)), *(block.x for block in blocks)]),
            np.concatenate([np.empty(0), *(block.outcome for block in blocks)]),
        )


def save(
    path: str | Path, runs: Runs, ids: Sequence[str], parameters: Sequence[str], fingerprint: str
) -> None:
    """Write runs, or leave the file that was there if that fails half-way.

    A file with runs of another fingerprint is kept beside it under a name with that fingerprint.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    other = _fingerprint_of(path)
    if other and other != fingerprint:
        path.replace(path.with_name(f"{path.stem}-{other[:8]}{path.suffix}"))
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    with draft.open("w", encoding="utf-8", newline="") as file:
        file.write(f"{_MARK}{fingerprint}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["experiment", *parameters, _OUTCOME])
        names = [ids[k] for k in runs.index.tolist()]
        columns = np.column_stack([runs.x, runs.outcome]).tolist()
        writer.writerows([name, *map(repr, row)] for name, row in zip(names, columns, strict=True))
    draft.replace(path)


def load(
    path: str | Path, ids: Sequence[str], parameters: Sequence[str], fingerprint: str
) -> Runs | None:
    """The runs in a file; None if there is none or its runs are of another model.

    Raises SimulatorError, with the row, if the file bears the fingerprint but was damaged.
    """
    path = Path(path)
    if _fingerprint_of(path) != fingerprint:
        return None
    position = {name: k for k, name in enumerate(ids)}
    index: list[int] = []
    values: list[list[float]] = []
    with path.open(encoding="utf-8", newline="") as file:
        for number, row in enumerate(csv.reader(file), start=1):
            if number <= 2:
                continue
            try:
                index.append(position[row[0]])
                values.append([float(text) for text in row[1:]])
                damaged = len(row) != len(parameters) + 2 or not np.all(np.isfinite(values[-1]))
            except (ValueError, KeyError, IndexError):
                damaged = True
            if damaged:
                raise SimulatorError(
                    f"{path}: row {number} is not a run: '{','.join(row):.60}'",
                    "delete the row, or the file if you can do without its runs",
                )
    table = np.array(values, dtype=np.float64).reshape(len(index), len(parameters) + 1)
    return Runs(np.array(index, dtype=np.intp), table[:, :-1], table[:, -1])


def _fingerprint_of(path: Path) -> str | None:
    if not path.is_file():
        return None
    with path.open(encoding="utf-8", errors="replace") as file:
        first = file.readline().strip()
    return first.removeprefix(_MARK) if first.startswith(_MARK) else None
