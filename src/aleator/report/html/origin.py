"""How it was made: data, settings, versions, seed, simulator, and commands that make it again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from aleator.report.html.markup import Section, code, heading, missing, table
from aleator.results.documents import study_entry
from aleator.results.printed import number

Document = Mapping[str, Any]


def origin(document: Document, study: str | None) -> Section:
    """What another would need to compute the same; `study` is the text of the study file."""
    rows = [list(row) for row in _facts(document).items()]
    parts = [
        table("origin", "What was computed with what", ["", ""], rows, text=2),
        heading("The same again"),
        code(_commands(document)),
        heading("The study file"),
    ]
    parts.append(code(study) if study is not None else _without(study_entry(document).get("file")))
    return Section.of("origin", "How this was computed", *parts)


def _without(file: str | None) -> str:
    if file is None:
        return missing("There is none.", "The identification was made from Python.")
    return missing(
        f"{file} is not shown: it is not there, or it was changed since.",
        "Its SHA-256 in the table above says which one it was.",
    )


def _facts(document: Document) -> dict[str, str]:
    entry, simulator = study_entry(document), document.get("simulator") or {}
    found = {
        "study": entry.get("file"),
        "SHA-256 of the study file": entry.get("sha256"),
        "simulator": simulator.get("name"),
        "fingerprint of the simulator": simulator.get("fingerprint"),
        "outcome": document.get("outcome"),
        "transform": document.get("transform"),
        "likelihood": document.get("density"),
        "propagation": document.get("propagation"),
        "why this propagation": document.get("propagation_reason") or None,
        "search": (document.get("search") or {}).get("method"),
        "nodes": _nodes(document),
        "seed": document.get("seed"),
        **{f"version of {name}": text for name, text in (document.get("versions") or {}).items()},
    }
    return {
        name: str(value).replace("_", " ") if name == "propagation" else str(value)
        for name, value in found.items()
        if value is not None
    }


def _nodes(document: Document) -> str | None:
    quadrature = document.get("quadrature")
    if not quadrature:
        return None
    return (
        f"{quadrature['nodes']:,.0f} of each experiment; more change the log-likelihood by "
        f"{number(quadrature['gap'], 2)}"
    )


def _commands(document: Document) -> str:
    entry = study_entry(document)
    version = (document.get("versions") or {}).get("aleator")
    source = f"# by Aleator {version}; in the folder of its source: pip install '.[report]'"
    install = source if version else ""
    if "file" not in entry:
        return f"{install}\n# from Python: aleator.identify(..., seed={document.get('seed', 0)})"
    file = shlex.quote(str(entry["file"]))
    seed = document.get("seed", 0)
    return (
        f"# in the folder of this report\n{install}\n"
        f"aleator identify {file} --seed {seed} --output again"
    )
