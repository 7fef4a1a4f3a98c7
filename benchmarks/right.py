"""Right models, identified again and again: how often intervals hold the truth, and what is warned.

`python -m benchmarks right --replicates 60` keeps each replicate as a line of a file, begins where
it ended, and prints the coverage of the intervals by hyperparameter, and the share of the
replicates in which each warning was told or the model was called inconsistent: false alarms all.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from scipy import stats

from aleator import ResponseSurface
from aleator.inference.information import LEVEL
from aleator.progress import Silent
from aleator.tasks import individual
from aleator.tasks.asked import DEFAULT_SEARCH, runner_on
from aleator.tasks.consistency import consistency_of
from aleator.tasks.ledger import Ledger
from benchmarks.shapes import SHAPES, Shape

Entry = Mapping[str, Any]
HALF = float(stats.norm.ppf(0.5 + LEVEL / 2.0))


def replicate(shape: Shape, seed: int) -> dict[str, Any]:
    """One virtual data set identified: estimates, warnings and the second verdict."""
    table = shape.table(seed)
    runner = runner_on(shape.simulator, table, shape.inputs.names, vectorized=True)
    found = individual.identified(
        runner, table, shape.inputs, shape.noise, ResponseSurface(), DEFAULT_SEARCH,
        verified=True, seed=seed, ledger=Ledger(runner, Silent()),
    )  # fmt: skip
    return {
        "shape": shape.name,
        "seed": seed,
        "sound": found.sound,
        "consistent": consistency_of(found.fit, found.sound, seed, Silent()).consistent,
        "warnings": [[w.about, w.message] for w in found.warnings],
        "alpha": {
            name: [e.estimate, e.standard_error, e.sandwich_error, e.interval]
            for name, e in found.alpha.items()
            if not e.fixed
        },
    }


def measured(path: Path, replicates: int, names: tuple[str, ...] = ()) -> list[Entry]:
    """All replicates of the shapes, those of the file and those that it lacks, in turns."""
    known = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(entry["shape"], entry["seed"]) for entry in known}
    with path.open("a") as file:
        for seed in range(replicates):
            for shape in SHAPES:
                if (names and shape.name not in names) or (shape.name, seed) in done:
                    continue
                known.append(replicate(shape, seed))
                file.write(json.dumps(known[-1]) + "\n")
                file.flush()
    return known


def coverage(entries: list[Entry]) -> pd.DataFrame:
    """The share of 95 % intervals that hold the truth, by shape and hyperparameter."""
    return pd.DataFrame(_coverages(entries))


def _coverages(entries: list[Entry]) -> Iterator[dict[str, Any]]:
    for shape in SHAPES:
        some = [entry for entry in entries if entry["shape"] == shape.name]
        for name, truth in shape.truth.items():
            rows = [entry["alpha"][name] for entry in some if name in entry["alpha"]]
            profile = [low <= truth <= high for *_, ends in rows if ends for low, high in [ends]]
            row: dict[str, Any] = {"shape": shape.name, "alpha": name, "replicates": len(rows)}
            row["profile"] = _percent(profile)
            for k, kind in ((1, "standard error"), (2, "sandwich")):
                held = [abs(r[0] - truth) <= HALF * r[k] for r in rows if r[k] is not None]
                row[kind] = f"{_percent(held)} of {len(held)}"
            row["no interval"] = sum(ends is None for *_, ends in rows)
            if rows:
                yield row


def inconsistent(entries: list[Entry]) -> pd.DataFrame:
    """How many of the replicates of each shape were called inconsistent."""
    judged = [e for e in entries if e.get("consistent") is not None]
    rows = pd.DataFrame([{"shape": e["shape"], "flagged": not e["consistent"]} for e in judged])
    return rows.groupby("shape", sort=False)["flagged"].agg(["sum", "count"]).reset_index()


def _percent(held: list[bool]) -> str:
    return f"{100 * sum(held) / len(held):.0f} %" if held else "-"


def alarms(entries: list[Entry]) -> pd.DataFrame:
    """The share of replicates with each kind of warning, by shape; nothing is wrong in any."""
    rows = [
        {"warning": kind(*warning), "shape": entry["shape"], "seed": entry["seed"]}
        for entry in entries
        for warning in entry["warnings"]
    ]
    if not rows:
        return pd.DataFrame()
    each = pd.DataFrame(rows).drop_duplicates()
    counts = pd.crosstab(each["warning"], each["shape"])
    of = pd.Series([entry["shape"] for entry in entries]).value_counts()
    shares = (100 * counts / of[counts.columns]).round(0)
    shares.insert(0, "all", (100 * counts.sum(axis=1) / len(entries)).round(1))
    return shares


def kind(about: str, message: str) -> str:
    """A warning without its names and numbers, as one of its kinds."""
    kinds = {
        "hardly determine": "one hardly determined",
        "hardly be told apart": "hardly told apart",
        "without effect": "no effect",
        "two maxima": "two maxima",
        "ends at zero": "ends at zero",
        "ends on its": "ends on its limit",
        "no interval": "no interval",
        "experiments for": "few experiments",
    }
    return next((f"{about}: {told}" for words, told in kinds.items() if words in message), about)


def print_right(console: Console, path: Path, replicates: int) -> None:
    """Measure what the file lacks, and print both tables."""
    entries = measured(path, replicates)
    console.print(coverage(entries).to_string(index=False))
    console.print(f"\nwarnings, in per cent of {len(entries)} right studies")
    console.print(alarms(entries).T.to_string())
    console.print("\ncalled inconsistent with the experiments")
    console.print(inconsistent(entries).to_string(index=False))
    console.print(f"not computed soundly: {sum(not entry['sound'] for entry in entries)}")
