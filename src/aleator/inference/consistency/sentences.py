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
        message, remedy = _OTHERS[test.kind](test, several)
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


def _level(test: Statistic, several: bool) -> tuple[str, str]:  # noqa: ARG001
    return (
        f"outcomes are {'larger' if test.z > 0.0 else 'smaller'} than the law says, by and large",
        "let a mean that is fixed be identified, or mend the simulator, which is biased",
    )


def _scale(test: Statistic, several: bool) -> tuple[str, str]:  # noqa: ARG001
    return (
        f"outcomes scatter {'more' if test.z > 0.0 else 'less'} than the law and the noise say",
        "let the noise, or a standard deviation of a law, be identified; where all are, let the "
        'noise differ by a column of standard deviations, or take noise of kind "student_t"',
    )


def _heavy(test: Statistic, several: bool) -> tuple[str, str]:  # noqa: ARG001
    remedy = (
        'noise of kind "student_t", a law with heavier tails, or a column that tells apart what '
        "scatters more"
    )
    if test.of == OUTCOMES:
        return HEAVY, remedy
    return f"more experiments pull far, and more hardly, on {test.of} than the law says", remedy


def _light(test: Statistic, several: bool) -> tuple[str, str]:  # noqa: ARG001
    remedy = 'a law = "mixture", or a column that tells two groups apart'
    if test.of == OUTCOMES:
        return LIGHT, remedy
    return f"experiments pull alike far on {test.of} than the law says", remedy


def _unequal(test: Statistic, several: bool) -> tuple[str, str]:  # noqa: ARG001
    of = "experiments" if test.column == ORDER else f"outcomes of different `{test.column}`"
    if test.column == SAME:
        of = "outcomes under different conditions"
    heavy = ', or take noise of kind "student_t"' if test.column == ORDER else ""
    return (
        f"{of} scatter unequally, more than the law says",
        f"let the noise differ between them by a column of standard deviations{heavy}",
    )


def _skewness(test: Statistic, several: bool) -> tuple[str, str]:  # noqa: ARG001
    side = "above" if test.z > 0.0 else "below"
    if test.of == OUTCOMES:
        return (
            f"outcomes lie farther {side} what is expected than the law says",
            "choose a skewed law (lognormal, gamma, beta), or the transform log",
        )
    return (
        f"single experiments pull {test.of} farther {'up' if test.z > 0.0 else 'down'} than the "
        "law says",
        "choose a skewed law (lognormal, gamma, beta), or look at these experiments",
    )


def _outlier(test: Statistic, several: bool) -> tuple[str, str]:  # noqa: ARG001
    return (
        "an outcome lies farther out than the law says",
        'look at the outliers named; noise of kind "student_t", or a skewed law, makes them likely',
    )


def _neighbours(test: Statistic, several: bool) -> tuple[str, str]:
    alike = "alike" if test.z > 0.0 else "opposite"
    if several:
        return (
            f"observations that follow each other in an experiment err {alike}",
            "the errors are not independent, or the simulator's curve has another shape: mend the "
            "simulator, or leave out observations that are too close",
        )
    return (
        f"outcomes next to each other in the table are {alike}",
        'if they are of one subject, name the column that says which: [experiments] id = "..."; '
        "else something changed while the experiments were made",
    )


def _groups(test: Statistic, several: bool) -> tuple[str, str]:
    where = "under the same conditions" if test.column == SAME else f"with the same `{test.column}`"
    message = f"outcomes {where} err alike, more than the law says"
    if test.column == ORDER:
        message = "observations of the same experiment err alike, more than the law says"
    if several:
        return message, "mend the simulator, whose curve has another shape than what was measured"
    named = "..." if test.column == SAME else test.column
    return message, (
        "if their rows are of one subject, name the column that says which: [experiments] id = "
        f'"{named}"; else mend the simulator, which is biased there'
    )


def _pair(test: Statistic, several: bool) -> tuple[str, str]:  # noqa: ARG001
    sign = "together" if test.z > 0.0 else "in opposite directions"
    return (
        f"{test.of} and {test.column} of single experiments differ {sign}, more than a law says "
        "that takes them as independent",
        f"let them be correlated: [correlation] {test.of}.{test.column}",
    )


def _relation(test: Statistic, several: bool) -> tuple[str, str]:  # noqa: ARG001
    late = test.column == ORDER
    place = "late in the table" if late else f"under high `{test.column}`"
    size = "larger" if test.z > 0.0 else "smaller"
    return (
        f"{test.of} of single experiments is {size} {place} than the law says",
        "look for what changed while the experiments were made"
        if late
        else f'let the mean of {test.of} follow {test.column}: "1 + {test.column}"',
    )


_OTHERS = {
    "pair": _pair,
    "relation": _relation,
    "level": _level,
    "scale": _scale,
    "heavy tails": _heavy,
    "light tails": _light,
    "skewness": _skewness,
    "outlier": _outlier,
    "unequal": _unequal,
    "neighbours": _neighbours,
    "groups": _groups,
}
