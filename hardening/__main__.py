"""`python -m hardening [PART...]`: what Aleator promises when something is wrong, tried.

Exit code 1 where a promise is broken. Needs a system with /proc.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable

from rich.console import Console
from rich.table import Table

from hardening.damaged import KINDS
from hardening.failing import failing
from hardening.formulas import READERS, formulas
from hardening.judging import DONE, REFUSED, Verdict, mutations
from hardening.kills import kills

CONSOLE = Console()


def tried_mutations(count: int, first: int, seed: int, workers: int) -> bool:
    """Damaged files: whether none of them ends in a traceback or takes too long."""

    def say(verdict: Verdict) -> None:
        if (verdict.number + 1) % 100 == 0:
            print(f"{verdict.number + 1:,} ...", file=sys.stderr)

    found = mutations(range(first, first + count), seed, workers, say)
    table = Table("damaged", "worked all the same", "told in a message", "broken")
    for kind in KINDS:
        done, told = found.counts[kind, DONE], found.counts[kind, REFUSED]
        whole = sum(number for (of, _), number in found.counts.items() if of == kind)
        table.add_row(kind, f"{done:,}", f"{told:,}", f"{whole - done - told:,}")
    CONSOLE.print(table)
    print(f"slowest: {found.slowest:.1f} s of a processor")
    for verdict in found.broken:
        print(f"\nnumber {verdict.number}: {verdict.outcome}: {' '.join(verdict.command)}")
        print(verdict.words)
    return not found.broken


def tried_kills(count: int, _first: int, seed: int, _workers: int) -> bool:
    """Kills: whether nothing was lost and nothing left."""
    found = kills(count, seed, lambda line: print(line, file=sys.stderr))
    table = Table("killed", "kills")
    for name, number in found.counts.items():
        table.add_row(name, str(number))
    CONSOLE.print(table)
    print(f"{found.studies} studies ended with the undisturbed answer, {found.runs:,} runs kept")
    print("\n".join(found.broken))
    return not found.broken


def tried_failures(count: int, first: int, seed: int, _workers: int) -> bool:
    """Failing simulators: whether alpha is what it is without failures."""
    table = Table("simulator", "runs", "failed", "alpha moved by")
    sound = True
    for number in range(first, first + count):
        one = failing(number, seed)
        table.add_row(one.name, f"{one.calls:,}", f"{one.failed:,}", f"{one.moved:.1g} sd")
        sound &= one.sound
        if one.error:
            print(f"{one.name}: {one.error}")
    CONSOLE.print(table)
    return sound


def tried_formulas(count: int, first: int, seed: int, _workers: int) -> bool:
    """Hostile formulas: whether none runs, ends in a traceback, or takes long."""
    found = formulas(range(first, first + count), seed)
    table = Table("hostile texts", "read all the same", "told in a message", "broken")
    for name in READERS:
        done, told = found.counts[name, DONE], found.counts[name, REFUSED]
        table.add_row(name, f"{done:,}", f"{told:,}", f"{count - done - told:,}")
    CONSOLE.print(table)
    print(f"slowest: {found.slowest:.2f} s of a processor")
    print("\n".join(found.broken))
    return not found.broken


PARTS: dict[str, tuple[Callable[[int, int, int, int], bool], int]] = {
    "mutations": (tried_mutations, 2_000 * len(KINDS)),
    "kills": (tried_kills, 200),
    "failures": (tried_failures, 20),
    "formulas": (tried_formulas, 5000),
}
"""Each with how many are tried unless a number is given."""


def main() -> None:
    """Try what was asked for, or everything."""
    parser = argparse.ArgumentParser(
        prog="python -m hardening", description=__doc__, usage="%(prog)s [options] [PART...]"
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--count", type=int, help="how many, of each part")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2, help="processes of damaged files")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; choose from {', '.join(PARTS)}")
    sound = True
    for name, (tried, usual) in PARTS.items():
        if name in (options.parts or PARTS):
            began = time.monotonic()
            count = usual if options.count is None else options.count
            sound &= tried(count, options.first, options.seed, options.workers)
            print(f"{name}: {count:,} in {(time.monotonic() - began) / 60:.1f} minutes\n")
    sys.exit(0 if sound else 1)


if __name__ == "__main__":
    main()
