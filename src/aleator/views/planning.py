"""The reports of `aleator check`, `box`, `sensitivity` and `next`, made from their JSON files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import timedelta
from itertools import groupby
from typing import Any

from aleator.errors import count
from aleator.observations.gross_errors import Slip
from aleator.results.answer import without_arrays
from aleator.results.printed import (
    AMOUNTS,
    NONE,
    THRESHOLDS,
    WHOLE,
    Amounts,
    Chapter,
    Column,
    Content,
    Part,
    Sentence,
    TextTable,
    Thresholds,
    heads,
    listed,
    number,
    percent,
)
from aleator.results.units import label, transforms, unit_of, with_unit

Document = Mapping[str, Any]

# ------------------------------------------------------------------------------------ first runs


def first_look(document: Document) -> Content:
    """The report of check.json: effects of parameters, outcomes that no run gives, the cost."""
    seen, every = document["conditions"]["looked_at"], document["conditions"]["all"]
    under = f"{seen} of {every} different conditions"
    if seen == every:
        under = f"all {every} different conditions" if every > 1 else "the one condition"
    took = number(document["seconds_a_run"], 2)
    parts: list[Part] = [_parameters(document)]
    idle = [row["name"] for row in document["parameters"] if not row["influence"]]
    if idle:
        parts.append(
            Sentence(
                f"{', '.join(idle)}: the other parameters alone gave the same outcomes in all of "
                "these runs. As a known constant it costs nothing; if it should matter, see that "
                "the simulator uses it.",
                "warning", "No influence on any outcome",
            )
        )  # fmt: skip
    if document["failed"]:
        parts.append(
            Sentence(
                f"{document['failed']:,} of {document['runs']:,} runs failed{_failing(document)}. "
                f"Most often: {document['fault']}.",
                "warning", "Failures",
            )
        )  # fmt: skip
    for name, held in document["fixed_noise"].items():
        unit = "" if transforms(document).get(name) == "log" else unit_of(document, name) or ""
        said = [f"{key} = {number(each)} {unit if key == 'sd' else ''}".rstrip()
                for key, each in held.items()]  # fmt: skip
        text = (
            f"{name}: {' and '.join(said)} is taken as known. One value an experiment hardly tells "
            "the noise from the law: if this number is a guess, the scatter of the law rests on it."
        )
        parts.append(Sentence(text, "plain", "Noise"))
    for name, one in (document.get("understated_noise") or {}).items():
        of = f"log({name})" if transforms(document).get(name) == "log" else label(document, name)
        text = (
            f"{of}: repeats under the same conditions scatter with an sd of "
            f"{number(one['repeats'], 3)} ({one['df']:.0f} degrees of freedom), where the noise "
            f"has {number(one['noise'], 3)}. Correct it, or let it be identified."
        )
        parts.append(Sentence(text, "warning", "The noise is too small"))
    parts += [
        Sentence(
            str(Slip(row["row"], label(document, row["response"]), row["value"], row["fits"])),
            "warning", "Table",
        )
        for row in document.get("gross_errors") or ()
    ]  # fmt: skip
    parts += without_arrays(document)
    return Content(
        document.get("title") or "First look",
        [Sentence(f"{count(document['runs'], 'run')} under {under}; one takes {took} s.")],
        [
            Chapter("parameters", "Parameters", parts),
            Chapter("reach", "Out of reach", [*_without_runs(document), _out_of_reach(document)]),
        ],
        verdicts=[
            *_ranges(document),
            Sentence(_reach(document), "strong"),
            Sentence(_cost(document), "strong"),
        ],
    )


def to_mend(document: Document) -> bool:
    """Whether an experiment has no run that works, or a measured value that no run comes to."""
    return bool(document["lost"] or document["out_of_reach"])


def duration(hours: float) -> str:
    """The text of a duration in hours, as days, hours, minutes or seconds.

    >>> duration(0.0001), duration(0.2), duration(5.0), duration(100.0)
    ('less than a second', '12 minutes', '5 hours', '4.2 days')
    """
    seconds = timedelta(hours=1).total_seconds() * hours
    for unit in ("days", "hours", "minutes"):
        size = timedelta(**{unit: 1}).total_seconds()
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.0f} seconds" if seconds >= 1.0 else "less than a second"


def _parameters(document: Document) -> TextTable:
    responses = [*document["measured"]]
    several = len(responses) > 1
    outcome = "the outcome" if several else label(document, responses[0])
    columns = heads("parameter", ">from", ">to", f">moves {outcome} by", ">at most", "~note")
    rows = [
        (
            label(document, row["name"]) + (f", {label(document, response)}" if several else ""),
            number(row["lower"]), number(row["upper"]), number(moves),
            number(row["moves_at_most"][response]), "" if row["influence"] else "no influence",
        )
        for row in document["parameters"]
        for response, moves in row["moves"].items()
    ]  # fmt: skip
    return TextTable(columns, rows, "parameters", "Parameters")


def _out_of_reach(document: Document, amounts: Amounts = AMOUNTS) -> TextTable:
    known = {row["id"]: row for row in document["observations"]}
    responses = [*document["measured"]]
    one = f", {label(document, responses[0])}" if len(responses) == 1 else ""
    columns = heads(f"out of reach{one}", ">measured", ">reached from", ">to", ">beyond by")
    rows = []
    for name in document["out_of_reach"][: amounts.named]:
        row = known[name]
        measured = row["lower"] if row["beyond"] > 0.0 else row["upper"]
        shown = name if one else with_unit(name, unit_of(document, row["response"]))
        rows.append((shown, number(measured), *map(number, row["reached"]),
                     number(row["beyond"], 2)))  # fmt: skip
    return TextTable(columns, rows, "reach", "Out of reach")


def _without_runs(document: Document, amounts: Amounts = AMOUNTS) -> list[Part]:
    """A warning that names the experiments of which no run works, if there are some."""
    lost = [*document["lost"].items()]
    if not lost:
        return []
    named = [f"{name} ({why})" for name, why in lost[: amounts.named]]
    more = f", and {len(lost) - amounts.named} more" if len(lost) > amounts.named else ""
    mend = "Correct these rows: an identification leaves them out, or stops."
    text = f"{'; '.join(named)}{more}. {mend}"
    return [Sentence(text, "warning", f"No run works for {count(len(lost), 'experiment')}")]


def _ranges(document: Document) -> list[Sentence]:
    """The range of the simulated values of each response beside that of the measured ones.

    A simulator that stops somewhere, or jumps, shows itself here by a value far from all others.
    """
    said = []
    for response, measured in document["measured"].items():
        ends = [
            row["reached"] for row in document["observations"]
            if row["response"] == response and row["reached"][0] is not None
        ]  # fmt: skip
        if ends:
            low, high = min(low for low, _ in ends), max(high for _, high in ends)
            made, seen = (f"{number(a)} to {number(b)}" for a, b in ((low, high), measured))
            said.append(f"{label(document, response)} {made} (measured {seen})")
    return [Sentence("; ".join(said) + ".", "plain", "Simulated")] if said else []


def _reach(document: Document, amounts: Amounts = AMOUNTS) -> str:
    of, lost = len(document["observations"]), len(document["lost"])
    size, silent = len(document["out_of_reach"]), sum(
        row["reached"][0] is None for row in document["observations"]
    )  # fmt: skip
    none = f" Of {count(lost, 'experiment')} no run works." if lost else ""
    if not size and not lost:
        return f"All {of} measured values lie within what the simulator reaches in this region."
    if not size:
        return f"{of - silent} of {of} measured values lie within what the simulator reaches.{none}"
    more = f" ({size - amounts.named} more are in check.json)" if size > amounts.named else ""
    by = " within three standard deviations of the noise, known or in the middle of its limits"
    at = document["at_limit"]
    where = f" All runs that come closest have {at[0]} at its {at[1]} limit." if at else ""
    if (far := document.get("noises_beyond")) is not None:
        where = (
            f" In the median they lie {number(far, 2)} standard deviations of the noise beyond the "
            f"closest run.{where}"
        )
    return (
        f"{size} of {of} measured values are out of reach{more}: no run came to them"
        f"{by if document['noise'] else ''}, not even those that were made near the closest ones."
        f"{where}{none}"
    )


def _failing(document: Document) -> str:
    """The parameter that tells failed runs from others, with the values that failed."""
    for name, (side, value) in document["failing"].items():
        return f", all those with {name} {side} {number(value)} and no others"
    return ""


def _cost(document: Document) -> str:
    cost = document["cost"]
    if cost is None:
        return "Collocation runs the simulator for every alpha: its cost is not known beforehand."
    if cost["direct"]:
        return (
            "The simulator takes arrays: an identification runs it at every node, many in one "
            f"call: some {cost['least_runs']:,} to {cost['most_runs']:,} times, the more the "
            "finer nodes it needs. These runs are not kept. If it is slow, take [propagation] "
            'surfaces = "process".'
        )
    low, high = (duration(hours) for hours in cost["hours"])
    by = f"with {cost['workers']} workers" if cost["workers"] > 1 else "with one worker"
    return (
        f"An identification takes some {cost['least_runs']:,} to {cost['most_runs']:,} runs"
        f"{', and begins with the stored ones, these among them' if cost.get('reused') else ''}: "
        f"{low if low == high else f'{low} to {high}'} {by}. Computation comes on top: seconds to "
        "minutes, whatever the simulator takes."
    )


# ------------------------------------------------------------------------------------ the box


def box(document: Document, thresholds: Thresholds = THRESHOLDS) -> Content:
    """The report of box.json: the range of each parameter in which every experiment works.

    It has the keys for study.toml, too.
    """
    columns = heads("parameter", "side", ">value", "~limited by")
    rows = []
    for side in document["sides"]:
        limited = "the study's limits"
        if at := side["failed_at"]:
            where = ", ".join(f"{name}={value:.4g}" for name, value in at.items())
            limited = f"experiment {side['experiment']}, which fails at {where}"
        name = label(document, side["parameter"])
        rows.append((name, side["side"], f"{side['value']:.6g}", limited))
    sure = " The last rounds still met failures: shrink the box a little."
    parts: list[Part] = [
        TextTable(columns, rows, "sides", "Sides of the box"),
        Sentence(
            f"The box holds {document['share']:.1%} of the limits' volume. None of "
            f"{document['tested']:,} points inside fails under any experiment. This took "
            f"{document['runs']:,} runs.{'' if document['confirmed'] else sure}"
        ),
    ]
    name, share = max(document["without"].items(), key=lambda one: one[1], default=("", 0.0))
    if share >= thresholds.gain * document["share"]:
        parts.append(
            Sentence(
                f"Without experiment {name} the box would hold about {share:.0%} of the limits' "
                "volume: check its row, or leave it out and look again."
            )
        )
    moved = {side["parameter"] for side in document["sides"] if side["experiment"] is not None}
    lines = [
        f"{name}: box = [{low:.6g}, {high:.6g}]"
        for name, (low, high) in document["box"].items()
        if name in moved
    ]
    said = Sentence("; ".join(lines), "strong", "For the study")
    if not lines:
        said = Sentence("The study's limits are feasible as they are.", "strong")
    return Content("The feasible box", sections=[Chapter("box", "Box", parts)], verdicts=[said])


# ------------------------------------------------------------------------------------ sensitivity


def sensitivity(document: Document, amounts: Amounts = AMOUNTS) -> Content:
    """The report of sensitivity.json: Sobol' indices, and pairs of parameters with like effects."""
    expansion, outcome = document["expansion"], document["study"]["outcome"]
    missed = expansion["unexplained"]
    lead = (
        f"Shares of the variance of {outcome} over "
        f"{count(len(document['experiments']), 'experiment')}, from expansions of degree "
        f"{expansion['degree']} with {expansion['terms']} terms and "
        f"{expansion['runs']} runs an experiment. They miss {percent(missed['median'], 1)} of the "
        f"variance in the median, {percent(missed['largest'], 1)} at most (leave-one-out)."
    )
    columns = heads("parameter", ">alone", ">with others", ">at most", ">linear effect", "~varied")
    rows = [
        (row["parameter"], percent(row["mean_first"], 1), percent(row["mean_total"], 1),
         percent(row["max_total"], 1), number(row["effect"], 3),
         f"{row['spread']}; most in {row['experiment']}")
        for row in document["parameters"]
    ]  # fmt: skip
    parts: list[Part] = [TextTable(columns, rows, "parameters", "Parameters")]
    if document["pairs"]:
        pairing = heads("pair", ">explains", ">alignment", "~")
        pairs = [
            (f"{row['first']}, {row['second']}", percent(row["explained"], 1),
             NONE if row["alignment"] is None else f"{row['alignment']:+.3f}",
             "hard to tell apart" if row["confounded"] else "")
            for row in document["pairs"][:amounts.pairs]
        ]  # fmt: skip
        parts += [
            TextTable(pairing, pairs, "pairs", "Pairs"),
            Sentence(
                "Shares are means over the experiments: of a parameter alone (first-order Sobol' "
                "index) and with its interactions (total), at most in the experiment named. The "
                "linear effect is the straight part of what one standard deviation does, in the "
                "outcome's unit; what bends, as x^2 about zero, is seen in the shares only. "
                "Alignment is the cosine between the linear effects of two parameters over the "
                f"experiments: beyond {THRESHOLDS.confounded:g} these hardly tell them apart."
            ),
        ]
    rough = ""
    if not expansion["converged"]:
        rough = "; the expansions are rough"
        parts.append(
            Sentence(
                f"more than one in ten misses over {THRESHOLDS.missed:.0%} of the variance. Shares "
                f"smaller than that mean little; allow more runs (--runs {4 * expansion['runs']}).",
                "warning", "The expansions are rough",
            )
        )  # fmt: skip
    first = [f"{row['parameter']} {percent(row['mean_total'], 1)}"
             for row in document["parameters"][:3]]  # fmt: skip
    verdict = f"Shares of the variance of {outcome}: {', '.join(first)}{rough}."
    return Content.of(document.get("title") or "Sensitivity", lead, parts, verdict)


# ------------------------------------------------------------------------------------ next

BESIDE = ("id", "standard_error", "chosen", "ties", "beyond")
"""The keys of a candidate experiment in next.json that are not conditions."""


def next_experiments(document: Document) -> Content:
    """The report of next.json: the best single experiments, the best set, its standard errors."""
    laws = "" if document["laws"] == 1 else f", in the mean over {document['laws']} possible laws"
    aim = "" if document.get("probability") is None else " and the probability"
    lead = (
        f"About {_about(document)}{laws}: {_error(document)} now {_value(document['now'])}."
        f"{_default(document)}{_probability(document)}"
    )
    made = (
        f"{count(document['runs'], 'different run')} of the simulator for "
        f"{count(len(document['candidates']), 'candidate')}{aim}."
    )
    columns = heads("hyperparameter", ">std. error now", ">after")
    rows = [
        (label(document, row["id"]), _value(row["now"]), _value(row["after"]))
        for row in document["hyperparameters"]
    ]
    sections = {
        "After one such experiment:": _candidates(document),
        "The best set, the most useful first:": _chosen(document),
        "What the set does to each:": TextTable(columns, rows, "after", "Standard errors"),
    }
    notes = [Sentence(note, "warning", head) for head, note in _notes(document)]
    return Content(
        document.get("title") or "The next experiment",
        [Sentence(lead), Sentence(made, depth=WHOLE), *notes],
        [Chapter(part.name, head, [Sentence(head, "strong", depth=part.depth), part])
         for head, part in sections.items()],
        verdicts=[Sentence(_gain(document), "strong")],
    )  # fmt: skip


def _gain(document: Document) -> str:
    """A sentence on the standard error after the chosen set, and on repetitions for the same."""
    chosen = document["chosen"]
    begin = (
        f"{count(len(chosen), 'experiment')}: {_error(document)} {_value(document['now'])} -> "
        f"{_value(chosen[-1]['standard_error'])}."
    )
    made, halving = document["made"], document.get("halving")
    if document["repetitions"] is None:
        again = f"More experiments like the {made} that were made do not reach that."
    else:
        again = (
            f"It would also take {count(round(document['repetitions'] * made), 'more experiment')} "
            f"like the {made} that were made."
        )
    half = (
        ""
        if halving is None
        else (
            f" About {count(max(math.ceil(halving), 1), 'experiment')} like those of the set would "
            "halve the standard error, and so the width of a 95 % interval (extrapolated: "
            "information grows with their number)."
        )
    )
    assumed = [f"{name} = {number(value)}" for name, value in document["planned_for"].items()]
    law = f" This assumes {listed(assumed)}, off the limit." if assumed else ""
    return f"{begin} {again}{half}{law}"


def _about(document: Document) -> str:
    return label(document, document["about"])


def _default(document: Document) -> str:
    """A sentence that the aim was not asked for, and how another is."""
    if not document.get("aim_by_default"):
        return ""
    other = "`--for NAME`, `--for-prediction FILE`, about= in Python"
    return (
        " That is the default aim, the standard deviation that is least known for its size; ask "
        f"for another by {other}."
    )


def _probability(document: Document) -> str:
    """A sentence on the probability aimed at, with its range now and after the set."""
    found = document.get("probability_range")
    if found is None:
        return ""
    now, after = (f"{number(low, 2)} to {number(high, 2)}" for low, high in found.values())
    at = "under the law of this plan" if document["planned_for"] else "at the estimate"
    return (
        f" The probability is {number(document['probability'][0], 3)} {at} (aleator "
        "predict has the mean over the plausible laws, too). Its 95 % range, by the reliability "
        f"index, is {now} now and {after} after the set."
    )


def _error(document: Document) -> str:
    relative = document["relative"]
    return "standard errors over those now, in the mean," if relative else "standard error"


def _notes(document: Document, amounts: Amounts = AMOUNTS) -> list[tuple[str, str]]:
    """Warnings about planned experiments, each as a head and a sentence."""
    notes = [] if not document.get("rows_alone") else [
        ("Rows", "each row of the candidates is taken as an experiment of its own, and experiments "
         "of the study have several. Give rows of one experiment the same id, in the column of ids "
         "of the study.")
    ]  # fmt: skip
    notes += [
        (f"{name} ended on its limit", "where no experiment tells anything of it. The plan and its "
         f"errors are those at {number(value)}, one standard deviation off the limit, with the "
         "others as likely as can be beside it.")
        for name, value in document["planned_for"].items()
    ]  # fmt: skip
    # No quantity between zero and one has a larger standard deviation than a half.
    one = document.get("probability") is not None and not document["relative"]
    if one and document["now"] is not None and document["now"] > 0.5:
        notes.append(
            (
                "The standard error of the probability is larger than any can be",
                "the experiments leave a combination of the hyperparameters open, and the normal "
                "approximation of this plan does not serve. Fix one of them, or give it limits "
                "that are known.",
            )
        )
    if not document["sound"]:
        notes.append(("The identification is not sound", "mend that first, the plan rests on it."))
    if document.get("settled") is False:
        notes.append(
            (
                "The response surface does not determine the event",
                "the standard errors rest on it: allow more runs.",
            )
        )
    if document["consistent"] is False:
        notes.append(
            ("The model is not consistent with the experiments", "the plan is one for this model.")
        )
    lost = [row["id"] for row in document["candidates"] if row["standard_error"] is None]
    if document["now"] is None:
        so = f" So would {count(len(lost), 'candidate')}, each by itself." if lost else ""
        notes.append(("Open", f"the experiments that were made leave it open.{so}"))
    elif lost:
        notes.append(("Cannot be simulated", f"{', '.join(lost[: amounts.candidates])}."))
    if beyond := document.get("beyond"):
        chosen = dict.fromkeys(row["id"] for row in document["chosen"])
        far = [f"{name} ({beyond[name]})" for name in chosen if name in beyond]
        more = f", and {len(far) - amounts.named} more" if len(far) > amounts.named else ""
        if far:
            notes.append((
                "Beyond the tested conditions",
                f"{', '.join(far[: amounts.named])}{more}. There the plan trusts the simulator and "
                "the law, which no experiment has tested.",
            ))  # fmt: skip
    largest = max(document["uncertain"].values(), default=0.0) or 0.0
    if largest > 0.0:
        known = f"errors of candidates are known to {number(largest, 2)}."
        notes.append(("By virtual data sets", known))
    return notes


def _candidates(document: Document, amounts: Amounts = AMOUNTS) -> TextTable:
    rows = document["candidates"][: amounts.candidates]
    names = [name for name in rows[0] if name not in BESIDE]
    columns: list[Column] = [
        ("id", "left"), *((label(document, name), "right") for name in names),
        ("std. error", "right"), ("in the set", "right"),
    ]  # fmt: skip
    cells = [
        (
            row["id"], *(_cell(row[name]) for name in names), _value(row["standard_error"]),
            f"{row['chosen']} times" if row["chosen"] > 1 else "yes" if row["chosen"] else "",
        )
        for row in rows
    ]  # fmt: skip
    return TextTable(columns, cells, "candidates", "Candidates", depth=WHOLE)


def _chosen(document: Document, amounts: Amounts = AMOUNTS) -> TextTable:
    groups = [[*rows] for _, rows in groupby(document["chosen"], key=lambda row: row["id"])]
    shown = groups[: amounts.chosen]
    names = [name for name in shown[0][0] if name not in BESIDE]
    columns: list[Column] = [
        ("", "right"), ("id", "left"), *((label(document, name), "right") for name in names),
        ("std. error", "right"), ("", "fold"),
    ]  # fmt: skip
    cells, before = [], 0
    for rows in shown:
        first, before, last = before + 1, before + len(rows), rows[-1]
        cells.append((
            f"{first}" if len(rows) == 1 else f"{first} to {before}",
            last["id"], *(_cell(last[name]) for name in names), _value(last["standard_error"]),
            f"{count(last['ties'], 'other')} as good" if last["ties"] else "",
        ))  # fmt: skip
    left = len(document["chosen"]) - before
    if left:
        cells.append(("", f"... {left} more", *("" for _ in names), "", ""))
    return TextTable(columns, cells, "chosen", "The best set")


def _cell(value: Any) -> str:
    return number(value) if isinstance(value, int | float) else str(value)


def _value(value: float | None) -> str:
    return "open" if value is None else number(value, 3)
