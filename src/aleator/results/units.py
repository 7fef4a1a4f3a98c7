"""Names with their units, such as `stiffness [N/mm]`, for tables and the axes of charts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from aleator.errors import InputsError, nearest

Document = Mapping[str, Any]
Units = Mapping[str, str]
"""Units of outcomes, conditions and parameters by name; names without a unit are left out."""

# What has the unit of its parameter: `k.mean`, `k.2.sd`, `k.mean[supplier=B]`, `k.median`, and of
# the parameter of one experiment `k.mode`, `k.lower`, `k.upper`.
_OF_LAW = re.compile(
    r"^(?P<of>.+?)(\.\d+)?\.(mean|sd|value|median|mode|lower|upper|loc|scale)"
    r"(\[(?P<term>.*)\])?$"
)
_NOISE = re.compile(r"^noise\.(?:(?P<of>.+)\.)?(?:process_)?sd$")


def with_unit(name: str, unit: str | None) -> str:
    """A name followed by its unit in brackets, if it has a unit.

    >>> with_unit("stiffness", "N/mm"), with_unit("ratio", None)
    ('stiffness [N/mm]', 'ratio')
    """
    return f"{name} [{unit}]" if unit else name


def label(document: Document, name: str) -> str:
    """The name of an outcome, condition, parameter or hyperparameter, with its unit if known.

    >>> document = {"units": {"travel": "mm", "k": "N/mm"}, "outcome": "travel"}
    >>> [label(document, name) for name in ("travel", "k.sd", "noise.sd", "k.mean[t]", "force")]
    ['travel [mm]', 'k.sd [N/mm]', 'noise.sd [mm]', 'k.mean[t]', 'force']
    """
    return with_unit(name, unit_of(document, name))


def seen_label(document: Document, name: str) -> str:
    """The name of an outcome on the scale of the likelihood, for example `log(cycles / kcycles)`.

    >>> document = {"units": {"cycles": "kcycles"}, "outcome": "cycles", "transform": "log"}
    >>> seen_label(document, "cycles"), seen_label({**document, "transform": "none"}, "cycles")
    ('log(cycles / kcycles)', 'cycles [kcycles]')
    """
    if transforms(document).get(name) != "log":
        return label(document, name)
    unit = units(document).get(name)
    return f"log({name} / {unit})" if unit else f"log({name})"


def unit_of(document: Document, name: str) -> str | None:
    """The unit of the quantity with this name; None if it has none."""
    known = units(document)
    if not known or name in known:
        return known.get(name)
    if noise := _NOISE.match(name):
        responses = transforms(document)
        of = noise["of"] or next(iter(responses), "")
        return None if responses.get(of) == "log" else known.get(of)
    law = _OF_LAW.match(name)
    if law is None or law["of"] not in known:
        return None
    # A slope has another unit: the parameter's over the covariate's. It is not shown.
    term = law["term"]
    return known[law["of"]] if term in (None, "Intercept") or "=" in term else None


def units(document: Document) -> Units:
    """The units by name that a document has; empty for a document of an earlier version."""
    found = document.get("units")
    return found if isinstance(found, Mapping) else {}


def transforms(document: Document) -> Mapping[str, str]:
    """The transform of each response by name."""
    if responses := document.get("responses"):
        return {str(name): str(each) for name, each in responses.items()}
    return {str(document.get("outcome") or ""): str(document.get("transform") or "none")}


def checked_units(units: Units | None, names: Iterable[str]) -> dict[str, str]:
    """Units that the user states by name, checked; empty ones are left out.

    Raises InputsError for a unit that is no text, and for a name that is not among `names`.

    >>> checked_units({"travel": "mm", "ratio": ""}, ["travel", "ratio"])
    {'travel': 'mm'}
    """
    if not isinstance(units, Mapping | None):
        raise InputsError(f"units: {units!r:.40} is no mapping", 'write {"travel": "mm"}')
    known, stated = [*names], dict(units or {})
    for name, unit in stated.items():
        if name not in known:
            raise InputsError(
                f"units: nothing is called '{name}'{nearest(name, known)}",
                f"there are {', '.join(known)}",
            )
        if not isinstance(unit, str):
            raise InputsError(
                f"units: the unit of '{name}' is {unit!r}", f'write a text: {{"{name}": "mm"}}'
            )
    return {name: unit.strip() for name, unit in stated.items() if unit.strip()}
