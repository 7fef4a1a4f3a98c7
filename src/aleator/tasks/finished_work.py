"""Files of finished work: a head that identifies the fit, then a JSON object on each line.

What a line has is never lost when a command is interrupted: the same command goes on from there.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from aleator.errors import AleatorError, short
from aleator.inference.fit import Fit
from aleator.results.documents import make_folder


@dataclass(frozen=True)
class FinishedWork:
    """A JSON lines file with a head that identifies the fit, then a line for each part of work."""

    path: Path
    head: Mapping[str, Any]

    def begun(self) -> list[dict[str, Any]]:
        """The lines behind the head; an incomplete last line is removed.

        Creates the file if it does not exist. Raises AleatorError if its head belongs to another
        fit, seed or kind.
        """
        make_folder(self.path.parent)
        lines, kept = self._lines()
        if not lines:
            self._write(json.dumps(self.head).encode() + b"\n", 0)
            return []
        if not _alike(lines[0], self.head):
            raise AleatorError(
                f"{short(self.path)}: its lines are those of another study, seed or kind",
                "remove the file, or choose another folder with --output (folder=...)",
            )
        self._write(b"", kept)
        return lines[1:]

    def add(self, part: Mapping[str, Any]) -> None:
        """Append a line, and flush it to the disk."""
        self._write(json.dumps(part).encode() + b"\n", None)

    def _lines(self) -> tuple[list[dict[str, Any]], int]:
        """The complete lines of the file, and their total number of bytes."""
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
        """Append a line; with a `size` the file is first cut to this number of bytes."""
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
    """The head of a file of replicates: names, limits, estimates and a hash of the data.

    A file with an equal head is continued; alpha and log-likelihood need to be equal only nearly.
    """
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


def _near(found: Any, wanted: Any, relative: float = 1e-5, absolute: float = 1e-12) -> bool:
    """Whether numbers read from a file equal the expected ones up to a relative difference."""
    try:
        numbers = np.array(found, dtype=float)
    except (OverflowError, TypeError, ValueError):  # damaged
        return False
    same = numbers.shape == np.shape(wanted)
    return same and bool(np.allclose(numbers, wanted, rtol=relative, atol=absolute))
