"""The claims of a reproduction as text: the index page of its folder, and a page of the docs.

`python -m reproduction.document out/paper/claims.csv docs/paper.md` writes everything that
stands below the mark in the page anew; what stands above it is written by hand.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from aleator.errors import AleatorError
from aleator.results import documents
from reproduction.figure import Claim, Made, Verdict

COLUMNS = ("figure", "place", "statement", "paper", "ours", "verdict", "note")
"""The columns of `claims.csv`."""
MARK = "<!-- Everything below is written by `python -m reproduction.document`. -->\n"


def counts(claims: Sequence[Claim]) -> str:
    """How many claims hold, as a sentence.

    >>> counts([])
    '0 claims: 0 hold, 0 do not hold, 0 not comparable.'
    """
    verdicts = [claim.verdict for claim in claims]
    hold, fail = verdicts.count(Verdict.HOLDS), verdicts.count(Verdict.FAILS)
    return (
        f"{len(verdicts)} claims: {hold} hold, {fail} do not hold, "
        f"{len(verdicts) - hold - fail} not comparable."
    )


def page(made: Sequence[Made]) -> str:
    """The index page: every figure with what the paper says and what was measured here."""
    parts = [
        "# The paper, reproduced\n",
        "Every statement of the paper that a figure supports, beside what was measured here. "
        "The measurements of the wet clutch are synthetic, because the authors' are not public: "
        "numbers differ, and each line says whether the claim holds here all the same.\n",
        f"{counts([claim for m in made for claim in m.claims])}\n",
    ]
    for m in made:
        parts.append(f"## {m.figure.name} ({m.figure.place})\n")
        parts.append(f"{m.figure.title}.\n")
        pictures = [name for name in m.files if name.endswith(".png")]
        parts += [f"![{m.figure.title}]({name})\n" for name in pictures]
        parts.append(claims_table(m.claims))
        listed = ", ".join(f"[{name}]({name})" for name in m.files)
        parts.append(f"Files: {listed}\n")
    return "\n".join(parts)


def claims_table(claims: Sequence[Claim]) -> str:
    """Claims as a Markdown table."""
    lines = ["| the paper | its value | here | verdict |", "|---|---|---|---|"]
    for claim in claims:
        ours = f"{claim.ours}<br>*{claim.note}*" if claim.note else claim.ours
        cells = (claim.statement, claim.paper, ours, f"**{claim.verdict.value}**")
        lines.append("| " + " | ".join(cell.replace("|", "&#124;") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def updated(text: str, claims: pd.DataFrame) -> str:
    """The page with the claims of a `claims.csv` below its mark.

    They are named by verdict; their numbers and notes are in the file.
    Raises AleatorError where the page has no mark.

    >>> row = ["sets", "Fig. 2", "Two is one and one.", "2", "2", "holds", ""]
    >>> page = updated("# By hand\\n" + MARK + "stale", pd.DataFrame([row], columns=COLUMNS))
    >>> page.splitlines()[0], page.splitlines()[3], "stale" in page
    ('# By hand', '1 claims: 1 hold, 0 do not hold, 0 not comparable.', False)
    """
    head, mark, _ = text.partition(MARK)
    if not mark:
        raise AleatorError("the page has no mark", f"put this line where claims go: {MARK.strip()}")
    every = [_claim(row) for _, row in claims.iterrows()]
    parts = [head + mark, counts(every) + "\n"]
    for (name, place), rows in claims.groupby(["figure", "place"], sort=False):
        of_figure = [_claim(row) for _, row in rows.iterrows()]
        parts.append(f"## {name} ({place})\n")
        for verdict in Verdict:
            named = [claim.statement for claim in of_figure if claim.verdict is verdict]
            if named:
                parts.append(f"{verdict.value.capitalize()}: {' '.join(named)}\n")
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
