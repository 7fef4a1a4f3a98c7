"""Non-zero sets on disk: found once, checked whenever they are read."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.expansion.moments.basis import Basis
from aleator.expansion.moments.nonzero import NonzeroSet, Origin

FORMAT = 1
"""Raised whenever the meaning of a file changes, so that older ones are not read."""


def kept(folder: Path, basis: Basis, m: int, compute: Callable[[], NonzeroSet]) -> NonzeroSet:
    """The non-zero set of order m from its file in `folder`, or computed and written there.

    The name of the file holds a hash of the recurrences, the multi-indices, m and the format; the
    file holds the hash in full and one of its own content. A file that is damaged, or is of
    something else, is not trusted: the set is computed anew, the file replaced, and a
    RuntimeWarning names it. Written at once or not at all, so that processes may share a folder.
    Raises InputsError where the folder cannot be written.
    """
    name = hashlib.sha256(f"{FORMAT} {m} {basis.fingerprint(m)}".encode()).hexdigest()
    path = folder / f"push_fork-{name[:16]}.npz"
    if path.exists():
        stored = _read(path, name, m, basis.size)
        if stored is not None:
            return stored
        warnings.warn(
            f"{path} is damaged or of something else: computed anew and replaced",
            RuntimeWarning,
            stacklevel=3,
        )
        found = replace(compute(), origin=Origin.REPLACED)
    else:
        found = compute()
    _write(path, name, found)
    return found


def _read(path: Path, name: str, m: int, size: int) -> NonzeroSet | None:
    try:
        with np.load(path, allow_pickle=False) as file:
            factors, coefficients = file["factors"], file["coefficients"]
            mark, content = str(file["name"]), str(file["content"])
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile):
        return None
    # the content's hash vouches for shapes and types too: they are part of it
    if mark != name or content != _hash(factors, coefficients):
        return None
    return NonzeroSet(m, size, factors, coefficients, Origin.STORED)


def _write(path: Path, name: str, found: NonzeroSet) -> None:
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
        with os.fdopen(handle, "wb") as file:
            np.savez(
                file,
                name=np.array(name),
                content=np.array(_hash(found.factors, found.coefficients)),
                factors=found.factors,
                coefficients=found.coefficients,
            )
        os.replace(temporary, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise InputsError(
            f"{path.parent}: cannot keep a non-zero set there ({error})",
            "name a folder that can be written, or none",
        ) from error


def _hash(factors: NDArray[np.int32], coefficients: NDArray[np.float64]) -> str:
    digest = hashlib.sha256()
    for array in (factors, coefficients):
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
