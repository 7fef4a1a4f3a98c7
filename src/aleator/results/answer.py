"""The short report of an identification, from its document: estimates, warnings, verdicts.

`print` and notebooks show the report that `answer` makes. The long report
(`aleator.views.identification`) begins with the same sentences and tables.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from aleator.errors import count
from aleator.observations.gross_errors import gross_errors
from aleator.results.findings import answers_to_questions, findings
from aleator.results.printed import (
    NONE,
    THRESHOLDS,
    WHOLE,
    Chapter,
    Content,
    Sentence,
    TextTable,
    Thresholds,
    between,
    heads,
    listed,
    number,
    to_three,
    with_error,
)
from aleator.results.units import label, transforms
from aleator.results.values import REPORTED

Document = Mapping[str, Any]
COLUMNS = heads("hyperparameter", ">estimate", ">std. error", ">95 % interval", "~note")


def answer(document: Document) -> Content:
    """The short report of an identification: findings, estimates, warnings and verdicts."""
    return Content(
        str(document.get("title") or ""),
        lead(document),
        [
            Chapter(
                "estimates",
                "Estimates",
                [estimates(document), quantities(document), log_likelihood(document)],
            )
        ],
        warnings(document),
        verdicts(document),
        findings(document),
    )


def brief(document: Document) -> Content:
    """The answers to questions, the estimates, how many experiments were left out, the verdicts.

    The verdicts stand without their reasons.
    """
    said = [replace(each, text=f"{each.text.split(':')[0].rstrip('.')}.", remedy="")
            for each in verdicts(document)]  # fmt: skip
    silent = sum(each.get("observations") == 0 for each in document["experiments"])
    of = f"{silent} of {count(len(document['experiments']), 'experiment')}"
    left = [Sentence(f"Left out: {of}, without a measured value or without any run that works.")]
    chapter = Chapter("estimates", "Estimates", [estimates(document)])
    asked = [*answers_to_questions(document)]
    return Content("", asked, [chapter], (), [*(left if silent else []), *said])


def is_individual(document: Document) -> bool:
    """Whether experiments have several observations each, and thus individual parameters."""
    return bool(document.get("observations"))


def has_one_law(document: Document) -> bool:
    """Whether experiments have noise and all one law that scatters: `aleator ceiling` can answer.

    The means of laws that follow columns are coefficients, named as in `k.mean[temperature]`.
    """
    follows = any("[" in name for name in document["alpha"])
    scatters = document.get("ranges") or document.get("law_curves")
    noise = document.get("quadrature")
    return bool(noise and scatters) and not follows and not document.get("levels")


def conditional_rows(document: Document) -> str:
    """What the log-densities of experiments are given where some share parameters of levels."""
    shared = ", ".join(dict.fromkeys((document.get("levels") or {}).values()))
    if not shared:
        return ""
    return (
        f" The log-density of an experiment is given all others that share {shared} with it, so "
        "that the rows do not add up to log L."
    )


def words(name: object) -> str:
    """The name of a method or a status with blanks for its underscores; "-" where there is none."""
    return str(name or NONE).replace("_", " ")


# ------------------------------------------------------------------------------------ what was done


def lead(document: Document) -> tuple[Sentence, ...]:
    """Two sentences: what was identified from which data, and by which method.

    Runs are told where a surface stands for the simulator, because they are what it costs. A
    simulator that takes arrays is evaluated at millions of points; the section on cost tells them.
    """
    free = sum(not entry.get("fixed") for entry in document["alpha"].values())
    seen = document.get("observations") or ()
    bounds = sum(entry["lower"] is None or entry["lower"] != entry["upper"] for entry in seen)
    values = f" with {count(len(seen), 'observation')}" if seen else ""
    values += f" ({bounds:,} of them bounds only)" if bounds else ""
    counted = "runs" in document and document.get("propagation") != "direct"
    runs = f", {count(document['runs'], 'different run')} of the simulator" if counted else ""
    experiments = count(len(document["experiments"]), "experiment")
    return (
        Sentence(f"{count(free, 'hyperparameter')} identified from {experiments}{values}{runs}"),
        Sentence(_method(document), depth=WHOLE),
        *without_arrays(document),
    )


def without_arrays(document: Document) -> tuple[Sentence, ...]:
    """Why a function that was tried with arrays is called once for each run, if it was.

    >>> print(*without_arrays({"array_fault": "it returned no finite number"}))
    Arrays: the function was tried with arrays: it returned no finite number. So each run is a...
    """
    if not (fault := document.get("array_fault")):
        return ()
    return (
        Sentence(
            f"the function was tried with arrays: {fault}. So each run is a call, and an emulator "
            "takes its place.",
            "plain", "Arrays",
            "a formula in NumPy takes arrays and needs none: np.exp for math.exp, np.where for if",
        ),
    )  # fmt: skip


def _method(document: Document) -> str:
    prior = (document.get("log_likelihood") or {}).get("log_prior")
    restricted = (document.get("log_likelihood") or {}).get("restricted") is not None
    principle = "restricted maximum likelihood" if restricted else "maximum likelihood"
    principle = principle if prior is None else "maximum a posteriori"
    reason = document.get("propagation_reason")
    because = f" ({reason})" if reason else ""
    search = document.get("search") or {}
    starts, warm = search.get("starts", 0), str(search.get("method")).startswith("warm_start")
    best = f", best of {starts} starts" if starts > 1 else ""
    best += ", one of them the maximum before the last runs" if best and warm else ""
    if not is_individual(document):
        what = f"{document.get('density') or NONE}, propagation by "
        what += f"{words(document.get('propagation'))}{because}"
    else:
        what = f"integral over individual parameters by {document.get('density') or NONE}, "
        direct = document["propagation"] == "direct"
        what += ("on the simulator itself" if direct else "on surfaces of it") + because
    log = ""
    if document.get("transform") == "log" and not is_individual(document):
        name = document["outcome"]
        log = (
            f" The likelihood is that of log({name}); outcomes and ranges below are {name} itself."
        )
    return f"By {principle}: {what}{best}, seed {document.get('seed', NONE)}.{log}"


# ------------------------------------------------------------------------------------ estimates


def estimates(document: Document) -> TextTable:
    """The table of estimates: a row for each hyperparameter.

    Its columns are the name with its unit, the estimate, the standard error, the 95 % interval, and
    a note, such as "fixed".
    """
    rows: list[Sequence[str]] = []
    for name, entry in document["alpha"].items():
        error = entry.get("standard_error")
        shown = with_error(entry["estimate"], error, estimate=True)
        interval = between(entry.get("interval"), error)
        rows.append((label(document, name), *shown, interval, _note(entry)))
    return TextTable(COLUMNS, rows, "estimates", "Estimates")


def quantities(document: Document) -> TextTable:
    """The table of the quantities by which the laws are usually told; without rows if none are.

    >>> median = {"estimate": 1.0, "interval": [0.8, 1.3], "standard_error": 0.13}
    >>> quantities({"ranges": {"k": {"quantities": {"median": median}}}}).rows
    [('k.median', '1.00', '0.13', '0.80 .. 1.30')]
    """
    rows = []
    for name, entry in (document.get("ranges") or {}).items():
        levels = (entry.get("by_level") or {}).items()
        laws = [("", entry), *((f"[{entry.get('factor')}={each}]", own) for each, own in levels)]
        for at, law in laws:
            for what, one in (law.get("quantities") or {}).items():
                error = one.get("standard_error")
                shown = with_error(one["estimate"], error, estimate=True)
                head = label(document, f"{name}.{what}{at}")
                rows.append((head, *shown, between(one.get("interval"), error)))
    columns = heads("of the laws", ">estimate", ">std. error", ">95 % interval")
    return TextTable(columns, rows, "quantities", "Quantities of the laws")


def _note(entry: Document, thresholds: Thresholds = THRESHOLDS) -> str:
    if entry.get("fixed"):
        return "only bounded" if entry.get("interval") else "fixed"
    if entry.get("at_bound"):
        return f"at its {entry['at_bound']} bound"
    notes = []
    error, sandwich = entry.get("standard_error"), entry.get("sandwich_error")
    if (
        error
        and sandwich
        and not thresholds.sandwich[0] < sandwich / error < thresholds.sandwich[1]
    ):
        notes.append(f"sandwich error {number(sandwich, 2)}")
    if entry.get("cut"):
        notes.append(_to_limit(entry["cut"], entry.get("drops")))
    return ", ".join(notes)


def _to_limit(cut: str, drops: Sequence[float] | None) -> str:
    """A note on an interval that ends at a limit of the hyperparameter.

    It says by how much the profile log-likelihood falls to the limit, which is 1.92 at an inner
    end.

    >>> _to_limit("lower", (1.263, 1.92)), _to_limit("both", (0.5, 0.004))
    ('to its lower limit: log L falls by 1.26', 'from limit to limit: log L falls by 0.50, 0.00')
    """
    which = {"both": slice(0, 2), "lower": slice(0, 1), "upper": slice(1, 2)}[cut]
    limit = "from limit to limit" if cut == "both" else f"to its {cut} limit"
    falls = ", ".join(f"{max(drop, 0.0):.2f}" for drop in (drops or ())[which])
    return f"{limit}: log L falls by {falls}" if falls else limit


def log_likelihood(document: Document) -> Sentence:
    """A sentence with the log-likelihood, its numerical error, the log prior, and its verification.

    The verification is the log-likelihood from runs of the simulator itself, where these were made.
    It ends with how the intervals were adjusted, if they were.
    """
    value, density = document["log_likelihood"], document.get("density")
    line = f"log-likelihood {to_three(value.get('estimated'))}"
    line += "" if value.get("error") is None else f" +- {number(value['error'], 2)}"
    line += f" by {density}" if density else ""
    if (prior := value.get("log_prior")) is not None:
        line += f", log prior {to_three(prior)} (maximum a posteriori)"
    if (whole := value.get("restricted")) is not None:
        line += f", restricted log-likelihood {to_three(whole)}"
    if value.get("verified") is not None:
        error = number(value.get("verified_standard_error"), 2)
        line += f"; on the simulator itself {to_three(value['verified'])} +- {error}"
    if any(entry.get("unadjusted") for entry in document["alpha"].values()):
        line += "; 95 % intervals adjusted for few experiments (Skovgaard's r*)"
    return Sentence(line)


# ------------------------------------------------------------------------------------ verdicts


def verdicts(document: Document) -> tuple[Sentence, ...]:
    """The two verdicts: is the computation sound, and is the model consistent with the experiments?

    The first also says which laws the experiments leave open although the computation is sound. A
    third sentence names a column that may be a missing covariate.

    >>> [str(v) for v in verdicts({"sound": False, "warnings": [{"about": "search"}]})]
    ['NOT computed soundly: do not use the estimates before the warnings are dealt with (search).']
    >>> [v.kind for v in verdicts({"consistent": None, "consistency": {"reason": "only 4"}})]
    ['open']
    """
    found = [_soundness(document)] if "sound" in document else []
    if second := document.get("consistency"):
        found.append(_agreement(document))
        found += [_covariate(document, one)] if (one := second.get("covariate")) else []
    return tuple(found)


def _soundness(document: Document) -> Sentence:
    if not document["sound"]:
        about = dict.fromkeys(str(entry["about"]) for entry in document.get("warnings") or [])
        named = f" ({', '.join(about)})" if about else ""
        return Sentence(
            "NOT computed soundly: do not use the estimates before the warnings are dealt with"
            f"{named}.",
            "bad",
        )
    if is_individual(document):
        what = "the search converged, and more nodes do not change the answer"
    else:
        what = "the search converged, every density was solved"
    if document["propagation"] == "direct":
        checked = "; the simulator itself was integrated over"
    elif document["log_likelihood"].get("verified") is not None:
        checked = ", and the simulator itself agrees"
    elif (off := (document.get("surface") or {}).get("estimates_error")) is not None:
        checked = (
            f", and the emulator of the simulator moves the estimates by {to_three(off)} standard "
            "errors"
        )
    else:
        checked = "; not verified on the simulator"
    if doubts := [*_doubts(document)]:
        said, why, remedies = ([*dict.fromkeys(part)] for part in zip(*doubts, strict=True))
        meant = "; ".join(filter(None, why))
        return Sentence(
            f"Computed soundly, but {', and '.join(said)}{f': {meant}' if meant else ''}.",
            "open",
            remedy="; ".join(remedies),
        )
    return Sentence(f"Computed soundly: {what}{checked}.", "good")


def _doubts(document: Document) -> Iterator[tuple[str, str, str]]:
    """What the experiments leave open: in the words of a verdict, what it means, and its remedy.

    What an sd at its lower limit means is told beside the range of its parameter, among the
    findings.

    >>> one = {"alpha": {"k.sd": {"at_bound": "lower"}, "k.mean": {"cut": "upper"}}}
    >>> for what, *_ in _doubts(one):
    ...     print(what)
    k.sd ends on its lower limit
    a limit cuts the 95 % interval of k.mean
    """
    alpha, left = document["alpha"], list(document.get("undetermined") or ())
    if left:
        yield (
            f"the experiments do not determine {_left_open(document, left)}",
            f"other values of {listed(left)} are not ruled out, and the answer is sure of the "
            "outcome under the tested conditions only",
            "measure under more varied conditions, or several values an experiment, or give a "
            "hyperparameter a known value",
        )
    ends = {name: side for name, entry in alpha.items()
            if (side := entry.get("at_bound")) and name not in left}  # fmt: skip
    for name, side in ends.items():
        of, _, what = name.rpartition(".")
        flat = side == "lower" and what == "sd" and of != "noise" and not of.startswith("noise.")
        yield (
            f"{name} ends on its {side} limit",
            "" if flat else f"the most likely {name} may lie beyond",
            'take law = "constant" for a parameter that need not scatter' if flat else WIDEN,
        )
    if cut := [name for name in cut_by_limits(document) if name not in {*left, *ends}]:
        several = len(cut) > 1
        yield (
            f"{'limits cut' if several else 'a limit cuts'} the 95 % "
            f"interval{'s' if several else ''} of {listed(cut)}",
            f"nothing is ruled out beyond {'these limits' if several else 'that limit'}",
            WIDEN,
        )


WIDEN = "where a limit is not physical, widen it (box, or lower and upper) and identify again"


def cut_by_limits(document: Document) -> list[str]:
    """The hyperparameters whose 95 % intervals would go on beyond a limit.

    A scale that may be next to nothing, at its lower limit, is not among them.

    >>> cut_by_limits({"alpha": {"a.mean": {"cut": "lower"}, "a.sd": {"cut": "lower"}}})
    ['a.mean']
    """
    return [
        name
        for name, entry in document["alpha"].items()
        if (cut := entry.get("cut"))
        and (cut != "lower" or name.partition("[")[0].endswith((".mean", ".value")))
    ]


def _left_open(document: Document, names: Sequence[str]) -> str:
    """The laws of the parameters with these hyperparameters; others by their own names.

    >>> _left_open({"ranges": {"E": {}, "k": {}}}, ["E.mean", "E.sd", "k.mean", "noise.sd"])
    'the laws of E and k, and noise.sd'
    >>> _left_open({"ranges": {"E": {}}}, ["c.value"])
    'c.value'
    """
    ranges = document.get("ranges") or {}
    laws = [*dict.fromkeys(of for name in names if (of := name.partition(".")[0]) in ranges)]
    others = [name for name in names if name.partition(".")[0] not in ranges]
    of_laws = f"the law{'s' if len(laws) > 1 else ''} of {listed(laws)}" if laws else ""
    return ", and ".join(part for part in (of_laws, listed(others) if others else "") if part)


def _agreement(document: Document) -> Sentence:
    """The verdict on consistency, with the probability of all tests together."""
    second, verdict = document["consistency"], document["consistent"]
    if verdict is None:
        reason = second["reason"]
        return Sentence(f"Not tested whether consistent with the experiments: {reason}.", "open")
    if verdict:
        return Sentence(
            f"Consistent with the experiments: none of {len(second['tests'])} tests contradicts "
            f"the model (p = {number(second['p'], 2)}){_neighbours(document)}.",
            "good",
        )
    against = [*_numbered(second["discrepancies"])]
    said = "; ".join(f"{place}{_contradiction(row)}" for place, row in against)
    mended = " ".join(f"{place}{row['remedy']}." for place, row in against)
    if _mistyped(document):
        mended = f"first {MISTYPED}; else {mended}"
    if not {row["test"].get("kind") for row in second["discrepancies"]} & {"neighbours", "groups"}:
        said += _neighbours(document)
    return Sentence(f"NOT consistent with the experiments: {said}.", "bad", remedy=mended)


def _covariate(document: Document, row: Document, level: float = REPORTED.level) -> Sentence:
    """A hint at a covariate, with its probability alone, among such relations, and among all.

    Other parameters are named that seem to depend on the same column, by themselves.
    """
    test, tests = row["test"], document["consistency"]["tests"]
    whole = next(one for one in tests if one | {"corrected": test["corrected"]} == test)
    of = "the outcome" if test["of"] == "outcomes" else test["of"]
    least = dict[str, float]()
    for one in tests:
        if (one["kind"], one["column"]) == (test["kind"], test["column"]) and one["p"] < level:
            least[one["of"]] = min(one["p"], least.get(one["of"], 1.0))
    others = [f"{name} (p = {number(p, 2)})" for name, p in least.items() if name != test["of"]]
    also = f" By itself the same can be said of {listed(others)}." if others else ""
    remedy = "; then compare both models"
    if others:
        remedy = "; do so with each of these parameters in turn, and compare the models"
    return Sentence(
        f"Perhaps {of} depends on {test['column']}: {row['message']} (p = {number(test['p'], 2)} "
        f"by itself, {number(test['corrected'], 2)} among the relations to columns, "
        f"{number(whole['corrected'], 2)} among all {len(tests)} tests).{also}",
        "open",
        remedy=f"{row['remedy']}{remedy}",
    )


def _neighbours(document: Document, level: float = REPORTED.level) -> str:
    """What the test of serial correlation says of experiments with several observations."""
    tests = document["consistency"].get("tests") or ()
    test = next((test for test in tests if test["kind"] == "neighbours"), None)
    if test is None or len(document.get("observations") or ()) <= len(document["experiments"]):
        return ""
    p = f"p = {number(test['p'], 2)}"
    what = "; residuals that follow each other in an experiment are"
    if test["p"] >= level:
        return f"{what} not correlated beyond chance ({p})"
    sign = "positively" if test["z"] > 0.0 else "negatively"
    return f"{what} {sign} correlated ({p} alone, not beyond chance among {len(tests)} tests)"


def warnings(document: Document) -> tuple[Sentence, ...]:
    """All warnings and outliers, with remedies; a verdict has the contradictions of the model."""
    warned: list[Sentence] = []
    for entry in document.get("warnings") or ():
        head = f"Warning, {entry.get('about', '')}"
        said, remedy = str(entry.get("message", "")), entry.get("remedy") or ""
        warned.append(Sentence(said, "warning", head, remedy))
    second = document.get("consistency") or {}
    if outliers := second.get("outliers"):
        slips = _slips(document)
        rows = [
            f"{row['id']}{_row(document, row)} (p = {number(row['p'], 1)}"
            f"{slips.get((row['id'], row['row']), '')})"
            for row in outliers
        ]
        ids = tuple(str(row["id"]) for row in outliers)
        mended = MISTYPED if _mistyped(document) else ""
        warned.append(Sentence(f"{', '.join(rows)}.", "warning", "Outliers", mended, ids=ids))
    if copies := second.get("copies"):
        named = ", ".join(f"`{name}`" for name in copies)
        warned.append(
            Sentence(
                f"{named}, which the outcome determines, as in another unit, a rank, a class (pass "
                "or fail) or a ratio. If it is a condition of the tests, let the simulator or a "
                "law take it.",
                head="Left out of the tests",
            )
        )
    return tuple(warned)


MISTYPED = "see whether an outlier was mistyped, and identify again"


def _mistyped(document: Document) -> bool:
    """Whether one of the outliers looks like a slip of the pen."""
    outliers = document["consistency"].get("outliers") or ()
    return bool({(row["id"], row["row"]) for row in outliers} & {*_slips(document)})


def _slips(document: Document) -> dict[tuple[str, int], str]:
    """Why measured values look like slips of the pen, by id and row.

    >>> seen = [{"id": str(k), "row": k, "response": "y", "lower": y, "upper": y}
    ...         for k, y in enumerate([3.2, 4.4, 4.5, 5.1, 8.0, 7.9, 3.1, 3.6, 4.1, 4.2, -4.4])]
    >>> _slips({"observations": seen})
    {('10', 10): '; measured is -4.4, where 4.4 would lie among the others'}
    >>> seen = [{"id": str(k), "row": k, "response": "y", "lower": y, "upper": y, "predicted": 1.0}
    ...         for k, y in enumerate([0.1, 1.0, 10.0, 100.0, -4.0])]
    >>> _slips({"observations": seen})
    {('4', 4): '; measured is -4, where every prediction is positive'}
    """
    seen = [row for row in document.get("observations") or () if row["lower"] == row["upper"]]
    found, changed = {}, transforms(document)
    for response in dict.fromkeys(row["response"] for row in seen):
        if changed.get(response, "none") != "none":
            continue
        own = [row for row in seen if row["response"] == response]
        if all((row.get("predicted") or 0.0) > 0.0 for row in own):
            for row in own:
                if row["lower"] < 0.0:
                    found[row["id"], row["row"]] = (
                        f"; measured is {number(row['lower'])}, where every prediction is positive"
                    )
        for k, right in gross_errors(np.array([row["lower"] for row in own], float)).items():
            found[own[k]["id"], own[k]["row"]] = (
                f"; measured is {number(own[k]['lower'])}, where {number(right)} would lie among "
                "the others"
            )
    return found


def _contradiction(row: Document) -> str:
    return f"{row['message']} (p = {number(row['test']['corrected'], 1)})"


def _numbered(rows: Sequence[Document]) -> Iterator[tuple[str, Document]]:
    """Discrepancies, each with its number such as "(1) "; a single one has no number."""
    for place, row in enumerate(rows, start=1):
        yield f"({place}) " if len(rows) > 1 else "", row


def _row(document: Document, outlier: Document) -> str:
    """Which of the rows of its experiment an outlier is, if the experiment has several.

    >>> seen = [{"id": "B", "row": 2}, {"id": "B", "row": 5}, {"id": "C", "row": 3}]
    >>> [_row({"observations": seen}, each) for each in seen]
    [', row 1 of 2', ', row 2 of 2', '']
    """
    seen = document.get("observations", ())
    rows = sorted({each["row"] for each in seen if each["id"] == outlier["id"]})
    if len(rows) < 2 or outlier["row"] not in rows:
        return ""
    return f", row {rows.index(outlier['row']) + 1} of {len(rows)}"
