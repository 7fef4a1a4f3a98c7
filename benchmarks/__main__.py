"""`python -m benchmarks [PART...]`: what Aleator must reach, measured in one run, as ratios.

Every row is one number of Aleator over one number of its peer or its target, both measured here and
now, so that the machine's speed cancels where there is a peer. Nothing is asserted. All parts take
about half an hour; each can be asked for by its name.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from benchmarks.coverage import print_coverage
from benchmarks.densities import density_rows, failure_table
from benchmarks.economy import print_economy
from benchmarks.expansions import expansion_rows
from benchmarks.few_runs import print_few_runs
from benchmarks.findings import print_findings
from benchmarks.folds import print_folds
from benchmarks.growth import print_cost, print_growth
from benchmarks.identifications import identification_rows
from benchmarks.individual import individual_rows
from benchmarks.likelihood import likelihood_rows
from benchmarks.limit_states import print_limit_states
from benchmarks.linear import print_linear, print_linear_verdicts
from benchmarks.moments import moment_rows
from benchmarks.next_experiment import print_next
from benchmarks.peers import print_peers
from benchmarks.power import print_power
from benchmarks.right import print_resampled, print_right, print_verdicts
from benchmarks.row import Row, table_of
from benchmarks.runs import print_runs
from benchmarks.searches import print_searches
from benchmarks.simulator import simulator_rows
from benchmarks.small import small_rows
from benchmarks.small_samples import print_small_samples

ROWS: dict[str, Callable[[], list[Row]]] = {
    "identify": identification_rows,
    "likelihood": likelihood_rows,
    "individual": individual_rows,
    "small": small_rows,
    "simulator": simulator_rows,
    "moments": moment_rows,
    "densities": density_rows,
    "expansions": expansion_rows,
}
TABLES: dict[str, Callable[[Console], None]] = {
    "failures": failure_table,
    "searches": print_searches,
    "few-runs": print_few_runs,
    "economy": print_economy,
    "runs": lambda _: print_runs(),
    "next": print_next,
    "growth": print_growth,
    "peers": print_peers,
}
COVERAGE = "coverage"
PARTS = (*ROWS, *TABLES, COVERAGE)
"""All parts that are measured unless some are named."""
LONG: dict[str, Callable[[Console, Path, int], None]] = {
    "findings": print_findings,
    "folds": print_folds,
    "cost": print_cost,
    "power": print_power,
    "right": print_right,
    "verdicts": print_verdicts,
    "resampled": print_resampled,
    "small-samples": print_small_samples,
    "linear": print_linear,
    "linear-verdicts": print_linear_verdicts,
    "limit_states": lambda console, _, __: print_limit_states(console),
}
"""Parts that take an hour and more; most keep what they have measured in a file of their name."""


def main() -> None:
    """Measure what was asked for, or everything, and print it."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, usage="%(prog)s [options] [PART...]"
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--replicates", type=int, default=40, help="data sets of the coverage")
    parser.add_argument("--workers", type=int, default=2, help="processes of the coverage")
    options = parser.parse_args()
    if unknown := set(options.parts) - {*PARTS, *LONG}:
        named = ", ".join((*PARTS, *LONG))
        parser.error(f"no part {', '.join(sorted(unknown))}; choose from {named}")
    chosen, console = options.parts or PARTS, Console()
    for name, measured in ROWS.items():
        if name in chosen and (rows := measured()):
            console.print(table_of(name, rows))
    for name, printed in TABLES.items():
        if name in chosen:
            printed(console)
    if COVERAGE in chosen:
        print_coverage(console, options.replicates, options.workers)
    for name, long in LONG.items():
        if name in chosen:
            long(console, Path(f"{name}.jsonl"), options.replicates)


if __name__ == "__main__":
    main()
