"""Finished replicates in a file, so that a bootstrap that was stopped goes on where it was."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from aleator.errors import AleatorError, short
from aleator.inference.fit import Fit
from aleator.results.documents import make_folder

SAME = 1e-5
"""Relative difference up to which two estimates are those of one identification."""


@dataclass(frozen=True)
class Replicate:
    """One replicate: its `number`, the free hyperparameters (F,), log L there, and a `status`.

    The status is "arrived", or says that the climb did not end at a maximum.
    """

    number: int
    alpha: tuple[float, ...]
    log_likelihood: float
    status: str


@dataclass(frozen=True)
class ReplicateFile:
    """A file of lines: a head that says what is replicated, then a line for each replicate."""

    path: Path
    head: Mapping[str, Any]

    def begun(self) -> dict[int, Replicate]:
        """The replicates that are finished, by number; a torn last line is cut off.

        Makes the file where there is none. Raises AleatorError where its head is another one.
        """
        make_folder(self.path.parent)
        lines, kept = self._lines()
        if not lines:
            self._write(json.dumps(self.head).encode() + b"\n", 0)
            return {}
        if not _alike(lines[0], self.head):
            raise AleatorError(
                f"{short(self.path)}: its replicates are those of another study, seed or kind",
                "remove the file, or choose another folder with --output (folder=...)",
            )
        self._write(b"", kept)
        found = [self._replicate(number, line) for number, line in enumerate(lines[1:], start=2)]
        return {replicate.number: replicate for replicate in found}

    def _replicate(self, number: int, line: Mapping[str, Any]) -> Replicate:
        """What a line of the file says; raises AleatorError where it is no replicate."""
        alpha = line.get("alpha")
        sound = (
            line.keys() == {field.name for field in fields(Replicate)}
            and isinstance(alpha, list)
            and len(alpha) == len(self.head["hyperparameters"])
            and all(type(value) in (int, float) for value in (*alpha, line["log_likelihood"]))
            and type(line["number"]) is int
            and isinstance(line["status"], str)
        )
        if not sound:
            raise AleatorError(
                f"{short(self.path)}: line {number} is no replicate",
                "delete the line, and its replicate is made again",
            )
        return Replicate(**{**line, "alpha": tuple(map(float, alpha or ()))})

    def add(self, replicate: Replicate) -> None:
        """Append a line, and have it on the disk before anything else is done."""
        self._write(json.dumps(asdict(replicate)).encode() + b"\n", None)

    def _lines(self) -> tuple[list[dict[str, Any]], int]:
        """The whole lines that can be read, and how many bytes they are."""
        try:
            text = self.path.read_bytes()
        except FileNotFoundError:
            return [], 0
        except OSError as error:
            raise self._refused("read", error) from None
        found, size = list[dict[str, Any]](), 0
        for line in text.splitlines(keepends=True):
            try:
                read = json.loads(line)
            except (ValueError, RecursionError):
                break
            if not line.endswith(b"\n") or not isinstance(read, dict):
                break
            found.append(read)
            size += len(line)
        return found, size

    def _write(self, line: bytes, size: int | None) -> None:
        """Append a line, after cutting the file to a size where there is one."""
        try:
            with self.path.open("ab") as file:
                if size is not None:
                    file.truncate(size)
                file.write(line)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise self._refused("written", error) from None

    def _refused(self, what: str, error: OSError) -> AleatorError:
        return AleatorError(
            f"{short(self.path)}: the file cannot be {what}: {error.strerror}",
            "choose another folder with --output (folder=...)",
        )


def head_of(fit: Fit, kind: str, seed: int) -> dict[str, Any]:
    """What says of which fit replicates are: names, limits and data exactly, the rest nearly."""
    own = [fit.hyperparameters[k] for k in fit.inference.identified]
    seen, digest = fit.table.observations, sha256()
    for part in (seen.experiment, seen.response, seen.lower, seen.upper):
        digest.update(np.ascontiguousarray(part).tobytes())
    digest.update("\n".join(fit.table.ids).encode())
    return {
        "kind": kind,
        "seed": seed,
        "experiments": digest.hexdigest(),
        "hyperparameters": [h.name for h in own],
        "limits": [[h.lower, h.upper] for h in own],
        "alpha": fit.alpha[fit.inference.identified].tolist(),
        "log_likelihood": fit.scored().total,
    }


def _alike(found: Mapping[str, Any], head: Mapping[str, Any]) -> bool:
    numbers = ("alpha", "log_likelihood")
    exact = all(found.get(key) == value for key, value in head.items() if key not in numbers)
    return exact and all(_near(found.get(key), head[key]) for key in numbers)


def _near(found: Any, wanted: Any) -> bool:
    """Whether these are the numbers that are wanted, but for rounding."""
    try:
        numbers = np.array(found, dtype=float)
    except (OverflowError, TypeError, ValueError):  # damaged
        return False
    same = numbers.shape == np.shape(wanted)
    return same and bool(np.allclose(numbers, wanted, rtol=SAME, atol=1e-12))
