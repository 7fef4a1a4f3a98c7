"""How an answer was computed: optima, runs and seconds, versions, and what repeats it."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from aleator.errors import count
from aleator.results.answer import words
from aleator.results.documents import study_entry
from aleator.results.printed import (
    DETAILS,
    NONE,
    PAGE,
    WHOLE,
    Part,
    Sentence,
    TextTable,
    heads,
    number,
    to_three,
)

Document = Mapping[str, Any]


def missing(what: str, remedy: str) -> Sentence:
    """A sentence that says what report.html lacks and why, and how to obtain it."""
    return Sentence(f"{what} {remedy}", "missing", depth=PAGE)


def named_values(values: Mapping[str, float | None]) -> str:
    """Names with their values, as text.

    >>> named_values({"a": 1.0, "b": None})
    'a 1, b -'
    """
    return ", ".join(f"{name} {number(value)}" for name, value in values.items())


def effort(document: Document) -> Iterator[Part]:
    """The section on cost: the optima of the search, and runs and seconds of each stage."""
    search = document.get("search") or {}
    optima = search.get("optima") or ()
    if search:
        method = f"{words(search['method'])}, " if search.get("method") else ""
        values, stopped = (
            [f"{to_three(one.get('log_likelihood'))} ({count(one.get('starts', 0), 'start')})"
             for one in some[:4]]
            for some in (optima, search.get("stopped") or ())
        )  # fmt: skip
        distinct = search.get("distinct_optima", len(optima))
        shown = f": {', '.join(values)}" if values else ""
        shown += f"; out of evaluations before an optimum: {', '.join(stopped)}" if stopped else ""
        evaluations = search.get("evaluations", NONE)
        yield Sentence(
            f"{method}{evaluations} evaluations, {distinct} distinct "
            f"optim{'um' if distinct == 1 else 'a'}{shown}",
            head="search", depth=WHOLE,
        )  # fmt: skip
    stages, seconds = document.get("runs_by_stage") or {}, document.get("seconds") or {}
    if "runs" in document:
        made = ", ".join(f"{stage} {runs:,}" for stage, runs in stages.items() if runs)
        what = " different ones"
        twice = (
            ". The first one, and about as many as the square root of their number (at most 24), "
            "are made twice, to check that outcomes repeat."
        )
        if direct := document.get("propagation") == "direct":
            what, twice = " points at which the simulator was evaluated, many in one call", ""
        told = f"{document['runs']:,}{what}{made and f': {made}'}{twice}"
        yield Sentence(told, head="evaluations" if direct else "runs", depth=WHOLE)
    if seconds:
        total = seconds.get("total", sum(seconds.values()))
        yield Sentence(f"{total:.1f}", head="seconds", depth=WHOLE)
    rows = [
        (name, f"{stages.get(name, 0):,}", f"{seconds.get(name, 0.0):.1f}")
        for name in dict.fromkeys([*stages, *seconds])
        if name != "total"
    ]
    columns = heads("stage", ">runs", ">seconds")
    yield TextTable(columns, rows, "runs", "Runs and seconds by stage", DETAILS, folded=True)
    columns = heads("log-likelihood", ">starts", "~alpha")
    cells = [(number(one.get("log_likelihood"), 7), str(one.get("starts", 0)),
              named_values(one.get("alpha") or {})) for one in optima]  # fmt: skip
    yield TextTable(columns, cells, "optima", "Optima that the search met", DETAILS, folded=True)


WORDS: Mapping[str, tuple[Callable[[Document], bool], str]] = {
    "sandwich error": (
        lambda document: bool(document.get("alpha")),
        "a standard error that stays valid if the model is wrong; it is told in a note where it "
        "differs much from the standard error",
    ),
    "shrinkage": (
        lambda document: bool(document.get("shrinkage")),
        "0 % where the observations of an experiment alone say what its parameter is, 100 % where "
        "only the law does",
    ),
    "emulator": (
        lambda document: bool((document.get("surface") or {}).get("rounds")),
        "a function that is fitted to the runs made, and used in place of further runs",
    ),
    "panels": (
        lambda document: "panels" in str(document.get("density")),
        "the integral over the parameters of an experiment is the sum over intervals, the panels, "
        "which are halved until that does not change it",
    ),
    "best possible law": (
        lambda document: bool(document.get("best_possible")),
        "of all laws, of any shape, the one under which the outcomes are most likely; what it "
        "gains is the most that another family could gain",
    ),
}
"""Words of a report by the documents that use them, with their meaning."""


def origin(document: Document, study: str | None) -> Iterator[Part]:
    """The section with all that is needed to repeat the computation: versions, seed, study file.

    `study` is the text of the study file; None if it does not exist, or was changed since.
    """
    columns = heads("what", "~value")
    rows = [(name, str(value)) for name, value in _facts(document) if value not in (None, "")]
    yield TextTable(columns, rows, "origin", "What was computed with what", PAGE)
    said = [(word, text) for word, (used, text) in WORDS.items() if used(document)]
    yield TextTable(heads("word", "~meaning"), said, "words", "Words of this page", PAGE)
    yield Sentence("The same again", "heading", depth=PAGE)
    yield Sentence(_commands(document), "code", depth=PAGE)
    yield Sentence("The study file", "heading", depth=PAGE)
    file = study_entry(document).get("file")
    if study is not None:
        yield Sentence(study, "code", depth=PAGE)
    elif file is None:
        yield missing("There is none.", "The identification was made from Python.")
    else:
        yield missing(
            f"{file} is not shown: it is not there, or it was changed since.",
            "Its SHA-256 in the table above says which one it was.",
        )


def _facts(document: Document) -> Iterator[tuple[str, Any]]:
    entry, simulator = study_entry(document), document.get("simulator") or {}
    yield "study", entry.get("file")
    yield "SHA-256 of the study file", entry.get("sha256")
    yield "simulator", simulator.get("name")
    yield "fingerprint of the simulator", simulator.get("fingerprint")
    yield "outcome", document.get("outcome")
    yield "transform", document.get("transform")
    yield "likelihood", document.get("density")
    yield "propagation", words(document.get("propagation"))
    yield "why this propagation", document.get("propagation_reason")
    yield "search", (document.get("search") or {}).get("method")
    if nodes := document.get("quadrature"):
        yield (
            "nodes",
            f"{nodes['nodes']:,.0f} of each experiment; more change the log-likelihood by "
            f"{number(nodes['gap'], 2)}",
        )
    yield "seed", document.get("seed")
    for name, version in (document.get("versions") or {}).items():
        yield f"version of {name}", version


def _commands(document: Document) -> str:
    entry = study_entry(document)
    version, seed = (document.get("versions") or {}).get("aleator"), document.get("seed", 0)
    source = f"# by Aleator {version}; in the folder of its source: pip install '.[report]'\n"
    install = source if version else ""
    if "file" not in entry:
        return f"{install}# from Python: aleator.identify(..., seed={seed})"
    file = shlex.quote(str(entry["file"]))
    again = f"aleator identify {file} --seed {seed} --output again"
    return f"# in the folder of this report\n{install}{again}"
