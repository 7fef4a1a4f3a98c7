"""What is wrong with the keys of a study file, in one message: key, value, cause and remedy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from aleator.errors import StudyError, key_path, nearest
from aleator.study.kinds import TOLD, in_toml


def study_error(error: ValidationError, document: Mapping[str, Any], path: Path) -> StudyError:
    """One message for everything that is wrong with the keys."""
    faults = [_fault(details, document) for details in error.errors(include_url=False)]
    lines = [f"{path}: {problem}" for problem, _ in faults]
    if len(faults) == 1:
        return StudyError(lines[0], faults[0][1])
    numbered = [f"{line}: {remedy}" for line, (_, remedy) in zip(lines, faults, strict=True)]
    return StudyError(
        f"{path}: {len(faults)} keys are wrong\n  " + "\n  ".join(numbered), "correct these keys"
    )


def _fault(details: ErrorDetails, document: Mapping[str, Any]) -> tuple[str, str]:
    """What is wrong with one key, and what to do about it."""
    context: dict[str, Any] = dict(details.get("ctx", {}))
    kind = details["type"]
    location = key_path(details["loc"], document, missing=kind == "missing")
    if context.get("key"):
        location = f"{location}.{context['key']}" if location else str(context["key"])
    key = f"key '{location}'"
    if kind == TOLD:
        return f"{key}{context['problem']}", str(context["remedy"])
    if kind == "missing":
        name = location.rpartition(".")[2]
        return f"{key} is missing", f"add {_FORMS.get(location, _FORMS.get(name, 'it'))}"
    if kind == "literal_error":
        return _unknown(location, str(context["expected"]), details.get("input"))
    shown = f"{key} = {in_toml(details.get('input'))}"
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        return f"{shown} is not a table", f"write [{location}] and its keys under it"
    message = details["msg"]
    message = message.removeprefix("Input ").removeprefix("Value ").removeprefix("List ")
    return f"{shown}: it {message}", _WANTED.get(kind, "correct the value")


def _unknown(location: str, expected: str, value: object) -> tuple[str, str]:
    """A value that is none of those that there are; pydantic tells them as one text."""
    known = [word.strip(" '") for word in expected.replace(" or ", ", ").split(",")]
    return (
        f"key '{location}' = {in_toml(value)} is not known{nearest(str(value), known)}",
        f"choose one of {', '.join(known)}",
    )


_FORMS = {
    "experiments.file": 'file = "experiments.csv"',
    "experiments.outcome": 'outcome = "COLUMN"',
    "experiments": "[experiments] and its keys under it",
    "simulator": "[simulator] and its keys under it",
    "parameters": "[parameters.NAME] and its keys under it, for each parameter",
    "box": "box = [LOWER, UPPER]",
    "mean": "mean = NUMBER, or mean = {lower = NUMBER, upper = NUMBER} to identify it",
    "sd": "sd = NUMBER, or sd = {lower = NUMBER, upper = NUMBER} to identify it",
    "value": "value = NUMBER, or value = {lower = NUMBER, upper = NUMBER} to identify it",
}
"""How a key that a table needs is written."""

_WANTED = {
    "float_type": "write a number without quotes, such as 0.5",
    "int_type": "write a whole number without quotes, such as 10",
    "bool_type": "write true or false, without quotes",
    "string_type": 'write a text in quotes: "..."',
    "list_type": "write a list in brackets: [..., ...]",
    "too_short": "write as many values as it says",
    "too_long": "write as many values as it says",
    "finite_number": "write a finite number",
}
