"""Results as JSON files: keys have a fixed order, so equal numbers give files with equal bytes."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from aleator.errors import AleatorError, short

# The order of keys in a file: the most important first. Other keys follow in their own order.
_ORDER = (
    "title", "study", "sound", "undetermined", "consistent", "alpha", "correlation",
    "parameter_correlations", "factors", "log_likelihood", "criteria", "baselines", "warnings",
    "consistency", "simulator",
    "density", "propagation", "propagation_reason", "array_fault", "search", "surface", "runs",
    "runs_by_stage", "experiments", "seed", "versions", "seconds",
)  # fmt: skip


def plain(value: Any) -> Any:
    """A value converted to JSON types: NumPy numbers become Python's; NaN and infinity become None.

    >>> plain({"x": np.array([1.0, np.nan]), "n": np.int64(3)})
    {'x': [1.0, None], 'n': 3}
    """
    if value is None or isinstance(value, (str, bool)):
        return value
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, Sequence):
        return [plain(part) for part in value]
    raise TypeError(f"{type(value).__name__} has no place in a JSON document")


def to_json(result: Mapping[str, Any]) -> str:
    """A result as the text of a JSON file; floats are written so that they read back exactly.

    >>> to_json({"seed": 1, "title": "t"})
    '{\\n  "title": "t",\\n  "seed": 1\\n}\\n'
    """
    keys = [key for key in _ORDER if key in result]
    keys += [key for key in result if key not in _ORDER]
    ordered = plain({key: result[key] for key in keys})
    return json.dumps(ordered, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def study_entry(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """The entry `study` of a document, which names the study file; empty if missing or damaged."""
    entry = document.get("study")
    return entry if isinstance(entry, Mapping) else {}


def study_file(document: Mapping[str, Any], path: Path) -> Path:
    """The path of the study file named in a document that was read from `path`.

    Raises AleatorError if the document names no study file, or the file does not exist any more.
    """
    file = study_entry(document).get("file")
    found = path.parent / file if isinstance(file, str) else None
    if found is None or not _is_file(found):
        raise AleatorError(
            f"{path}: its study file {f'{found} ' if found else ''}is not there",
            "name the study file with --study",
        )
    return Path(os.path.relpath(found))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # The name of the file is too long or invalid.
        return False


def replaced(path: Path, study: Path | None = None) -> str | None:
    """A note that an older result file will be replaced; None if there is no such file.

    Raises AleatorError if the older file is the result of a study other than `study`.
    """
    try:
        older = study_entry(json.loads(path.read_text(encoding="utf-8"))).get("file")
    except FileNotFoundError:
        return None
    except (OSError, ValueError, AttributeError, RecursionError):
        older = None
    if study and isinstance(older, str) and (path.parent / older).resolve() != study.resolve():
        raise AleatorError(
            f"{short(path)} is the result of another study, {older}",
            "choose another folder with --output, or remove the file",
        )
    written = datetime.fromtimestamp(path.stat().st_mtime).isoformat(" ", "minutes")
    return f"{short(path)} of {written} will be replaced"


def make_folder(folder: Path) -> None:
    """Make the folder for results, if needed. Commands do so before they compute anything.

    Raises AleatorError if the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise AleatorError(
            f"{short(folder)}: the folder cannot be made: {error.strerror}",
            "choose another folder with --output",
        ) from None


def write_text(text: str, path: str | Path) -> None:
    """Write a text file completely or not at all, and make its folder if needed.

    Raises AleatorError if the file cannot be written.
    """
    path = Path(path)
    make_folder(path.parent)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    except OSError as error:
        with suppress(OSError):  # The file cannot be removed either if its name is too long.
            draft.unlink(missing_ok=True)
        raise AleatorError(
            f"{short(path)}: the file cannot be written: {error.strerror}",
            "choose another folder with --output",
        ) from None


def write_json(result: Mapping[str, Any], path: str | Path) -> None:
    """Write a result as a JSON file, completely or not at all.

    Raises AleatorError if the file cannot be written.
    """
    write_text(to_json(result), path)
