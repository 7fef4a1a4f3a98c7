"""What a test that contradicts the model says, and what may mend the model."""

from __future__ import annotations

from collections.abc import Collection

from aleator.inference.consistency.battery import OUTCOMES, SAME, SCATTER
from aleator.inference.consistency.columns import ORDER, RESPONSE
from aleator.results.values import Discrepancy, Statistic

LIGHT = "fewer outcomes lie in the middle and far out than the law says: it may have two modes"
HEAVY = "more outcomes lie far out, and more in the middle, than the law says"


def told(
    test: Statistic, several: bool, within: Collection[str], measured: Collection[str] = ()
) -> Discrepancy:
    """A test as a sentence with a remedy.

    `several`: experiments have several observations; `within` are the columns that differ within
    an experiment, which no law can follow; `measured` those that may be results themselves.
    """
    if test.kind == "contrast":
        message, remedy = _contrast(test), (_curved if test.column in within else _mended)(test)
    else:
        message, remedy = _other(test, several)
    if test.column in measured and test.kind in ("contrast", "relation"):
        remedy += f"; or, if {test.column} is a result of the experiments, take it out of the table"
    return Discrepancy(test, message, remedy)


def _contrast(test: Statistic) -> str:
    if test.where is not None:
        place = f"at {test.where}"
    elif test.column == ORDER:
        place = "late in the table"
    else:
        place = f"under high `{test.column}`"
    up = test.z > 0.0
    if test.of == OUTCOMES:
        return f"outcomes {place} are {'larger' if up else 'smaller'} than the law says"
    if test.of == SCATTER:
        return f"outcomes {place} scatter {'more' if up else 'less'} than the law says"
    return f"experiments {place} ask for a {'larger' if up else 'smaller'} {test.of}"


def _mended(test: Statistic) -> str:
    if test.column == ORDER:
        return (
            "something changed while the experiments were made: look for it, and give it a column "
            "that the simulator or a law follows"
        )
    if test.column == RESPONSE:
        return "give each response a noise of its own, or mend what the simulator says of it"
    formula = test.column if test.where is None else f"C({test.column})"
    if test.of == SCATTER:
        return (
            f"let the noise differ with {test.column} (a column of standard deviations), or the sd "
            f'of a law follow it: sd = "1 + {formula}"'
        )
    of = "the mean of a parameter" if test.of == OUTCOMES else test.of
    return (
        f'let {of} follow {test.column}: "1 + {formula}"; or mend how the simulator depends on it'
    )


def _curved(test: Statistic) -> str:
    if test.of == SCATTER:
        return (
            f"let the noise differ with {test.column} (a column of standard deviations), or be "
            "relative: [noise] relative"
        )
    return (
        f"the simulator depends on {test.column} in another way than the experiments: mend it, or "
        "let a constant of it be identified"
    )


def _other(test: Statistic, several: bool) -> tuple[str, str]:
    """The message and the remedy of every kind of test but contrasts."""
    up, of, column = test.z > 0.0, test.of, test.column
    match test.kind:
        case "level":
            return (
                f"outcomes are {'larger' if up else 'smaller'} than the law says, by and large",
                "let a mean that is fixed be identified, or mend the simulator, which is biased",
            )
        case "scale":
            return (
                f"outcomes scatter {'more' if up else 'less'} than the law and the noise say",
                "let the noise, or a standard deviation of a law, be identified; where all are, "
                "let the noise differ by a column of standard deviations, or take noise of kind "
                '"student_t"',
            )
        case "heavy tails":
            pull = f"more experiments pull far, and more hardly, on {of} than the law says"
            return (
                HEAVY if of == OUTCOMES else pull,
                'noise of kind "student_t", a law with heavier tails, or a column that tells apart '
                "what scatters more",
            )
        case "light tails":
            return (
                LIGHT
                if of == OUTCOMES
                else f"experiments pull alike far on {of} than the law says",
                'a law = "mixture", or a column that tells two groups apart',
            )
        case "skewness":
            skewed = "choose a skewed law (lognormal, gamma, beta), or"
            if of == OUTCOMES:
                side = "above" if up else "below"
                message = f"outcomes lie farther {side} what is expected than the law says"
                return message, f"{skewed} the transform log"
            side = "up" if up else "down"
            message = f"single experiments pull {of} farther {side} than the law says"
            return message, f"{skewed} look at these experiments"
        case "outlier":
            return (
                "an outcome lies farther out than the law says",
                'look at the outliers named; noise of kind "student_t", or a skewed law, makes '
                "them likely",
            )
        case "unequal":
            whose = "experiments" if column == ORDER else f"outcomes of different `{column}`"
            whose = "outcomes under different conditions" if column == SAME else whose
            heavy = ', or take noise of kind "student_t"' if column == ORDER else ""
            return (
                f"{whose} scatter unequally, more than the law says",
                f"let the noise differ between them by a column of standard deviations{heavy}",
            )
        case "neighbours" if several:
            return (
                f"observations that follow each other in an experiment err {_alike(up)}",
                "the errors are not independent, or the simulator's curve has another shape: mend "
                "the simulator, or leave out observations that are too close",
            )
        case "neighbours":
            return (
                f"outcomes next to each other in the table are {_alike(up)}",
                "if they are of one subject, name the column that says which: [experiments] "
                'id = "..."; else something changed while the experiments were made',
            )
        case "groups":
            where = "under the same conditions" if column == SAME else f"with the same `{column}`"
            whose = (
                "observations of the same experiment" if column == ORDER else f"outcomes {where}"
            )
            mended = "mend the simulator, whose curve has another shape than what was measured"
            named = "..." if column == SAME else column
            subject = (
                "if their rows are of one subject, name the column that says which: [experiments] "
                f'id = "{named}"; else mend the simulator, which is biased there'
            )
            return f"{whose} err alike, more than the law says", mended if several else subject
        case "pair":
            return (
                f"{of} and {column} of single experiments differ "
                f"{'together' if up else 'in opposite directions'}, more than a law says that "
                "takes them as independent",
                f"let them be correlated: [correlation] {of}.{column}",
            )
        case _:
            late, size = column == ORDER, "larger" if up else "smaller"
            place = "late in the table" if late else f"under high `{column}`"
            return (
                f"{of} of single experiments is {size} {place} than the law says",
                "look for what changed while the experiments were made"
                if late
                else f'let the mean of {of} follow {column}: "1 + {column}"',
            )


def _alike(up: bool) -> str:
    return "alike" if up else "opposite"
