"""The claims of a reproduction as a page of the documents.

`python -m reproduction.document out/paper/claims.csv docs/paper.md` writes everything that
stands below the mark in the page anew; what stands above it is written by hand.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from aleator.errors import AleatorError
from aleator.tasks import documents
from reproduction.figure import Claim, Verdict
from reproduction.output import claims_table, count_sentence

MARK = "<!-- Everything below is written by `python -m reproduction.document`. -->\n"


def updated(text: str, claims: pd.DataFrame) -> str:
    """The page with the claims of a `claims.csv` below its mark.

    Raises AleatorError where the page has no mark.

    >>> columns = ["figure", "place", "statement", "paper", "ours", "verdict", "note"]
    >>> row = ["sets", "Fig. 2", "Two is one and one.", "2", "2", "holds", ""]
    >>> page = updated("# By hand\\n" + MARK + "stale", pd.DataFrame([row], columns=columns))
    >>> page.splitlines()[0], page.splitlines()[3], "stale" in page
    ('# By hand', '1 claims: 1 hold, 0 do not hold, 0 not comparable.', False)
    """
    head, mark, _ = text.partition(MARK)
    if not mark:
        raise AleatorError("the page has no mark", f"put this line where claims go: {MARK.strip()}")
    every = [_claim(row) for _, row in claims.iterrows()]
    parts = [head + mark, count_sentence(every) + "\n"]
    for (name, place), rows in claims.groupby(["figure", "place"], sort=False):
        parts.append(f"## {name} ({place})\n")
        parts.append(claims_table([_claim(row) for _, row in rows.iterrows()]))
    return "\n".join(parts)


def _claim(row: pd.Series[str]) -> Claim:
    texts = (row["statement"], row["paper"], row["ours"])
    return Claim(*texts, Verdict(row["verdict"]), row["note"])


def main(claims: Path, page: Path) -> None:
    """Write the claims into the page."""
    table = pd.read_csv(claims, keep_default_na=False, dtype=str)
    documents.write_text(updated(page.read_text(encoding="utf-8"), table), page)


if __name__ == "__main__":
    main(*(Path(name) for name in sys.argv[1:]))
