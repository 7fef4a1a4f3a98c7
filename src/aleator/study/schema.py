"""The JSON schema of study.toml for editors, made from the sections that check the file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from aleator.study.kinds import LAWS, Kinds
from aleator.study.sections import StudyFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_KINDS = "x-kinds"
_TEMPLATE = "#/$defs/{model}"


def study_schema() -> dict[str, Any]:
    """The JSON schema of study.toml, with the built-in laws and other kinds, and those of plug-ins.

    The schema accepts every file that `load_study` reads. Only `load_study` notices mistakes that
    depend on the table, on the simulator or on arithmetic, such as a range whose ends are swapped.

    >>> found = study_schema()
    >>> found["required"]
    ['experiments', 'simulator', 'parameters']
    """
    open_: dict[str, Kinds[Any]] = {}
    whole = StudyFile.model_json_schema(ref_template=_TEMPLATE, schema_generator=_noting(open_))
    defined: dict[str, Any] = whole.pop("$defs", {})
    done: set[str] = set()
    while left := [group for group in open_ if group not in done]:
        for group in left:
            done.add(group)
            kinds = open_[group]
            sections = [_kind(kinds, name, defined, open_) for name in kinds.names]
            defined[group] = {"anyOf": [section for section in sections if section]}
    found = {"$schema": DIALECT, "title": "study.toml of Aleator", **whole, "$defs": defined}
    return _resolved(found)  # type: ignore[no-any-return]


def _kind(
    kinds: Kinds[Any], name: str, defined: dict[str, Any], open_: dict[str, Kinds[Any]]
) -> dict[str, Any] | None:
    """The JSON schema of the keys of one kind; None for a plug-in that cannot be imported."""
    try:
        section = kinds.section(name)
    except Exception:
        return None
    found = section.model_json_schema(ref_template=_TEMPLATE, schema_generator=_noting(open_))
    defined.update(found.pop("$defs", {}))
    found["title"] = f"{kinds.key} = {name}" if kinds.key else name
    found.pop("description", None)
    if kinds.key:
        found["properties"][kinds.key] = {"const": name}
        if name != kinds.default:
            found["required"] = [kinds.key, *found.get("required", [])]
    return found


def _noting(open_: dict[str, Kinds[Any]]) -> type[GenerateJsonSchema]:
    """A generator of JSON schemas for sections that choose a kind, such as a law.

    It writes a placeholder for the kinds, which `_resolved` replaces, and collects the kinds in
    `open_`.
    """

    class Generator(GenerateJsonSchema):
        def function_plain_schema(
            self, schema: core_schema.PlainValidatorFunctionSchema
        ) -> JsonSchemaValue:
            read = schema["function"]["function"]
            # The function `_law` stands for LAWS, which is defined after the sections that use it.
            kinds = getattr(read, "__self__", LAWS)
            open_[kinds.group] = kinds
            return {_KINDS: kinds.group}

        def emit_warning(self, kind: Any, detail: str) -> None:
            """Print no warning about a default that is no JSON value; the schema leaves it out."""

    return Generator


def _resolved(value: Any) -> Any:
    """A part of the JSON schema with references to kinds for placeholders, and finite defaults."""
    if isinstance(value, dict):
        if _KINDS in value:
            return {"$ref": _TEMPLATE.format(model=value[_KINDS])}
        return dict(_kept(value))
    if isinstance(value, list):
        return [_resolved(part) for part in value]
    return value


def _kept(value: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, part in value.items():
        endless = isinstance(part, float) and not math.isfinite(part)
        if not (key == "default" and endless):
            # A value such as {variable = "x"} may fit two alternatives; oneOf would refuse it.
            yield "anyOf" if key == "oneOf" else key, _resolved(part)
