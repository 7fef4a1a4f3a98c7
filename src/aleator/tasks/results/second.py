"""The second verdict in the document of an identification, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from aleator.inference.consistency import Consistency, Discrepancy, Outlier, Relation, Statistic

Entry = Mapping[str, Any]


def entry_of(consistency: Consistency) -> dict[str, Any]:
    """What the document says of the consistency; whether it is one stands beside it.

    >>> entry_of(Consistency.untested("it was not asked for"))["reason"]
    'it was not asked for'
    """
    entry = asdict(consistency)
    return {key: entry[key] for key in entry if key != "consistent"}


def consistency_in(document: Entry) -> Consistency:
    """The consistency of a document; not asked for where it has none.

    Raises KeyError, TypeError or ValueError where it is not as it was written.
    """
    if "consistency" not in document:
        return Consistency.untested("it was not asked for")
    entry = document["consistency"]
    return Consistency(
        document["consistent"],
        entry["p"],
        entry["replicates"],
        tuple(
            Discrepancy(_test(row["test"]), row["message"], row["remedy"])
            for row in entry["discrepancies"]
        ),
        tuple(Outlier(**row) for row in entry["outliers"]),
        tuple(map(_test, entry["tests"])),
        entry["reason"],
        tuple(Relation(**row) for row in entry.get("relations", ())),
        tuple(entry.get("copies", ())),
    )


def _test(row: Entry) -> Statistic:
    known = {key: math.nan if row[key] is None else row[key] for key in ("z", "p", "corrected")}
    return Statistic(**{**row, **known})
