"""Right models, identified again and again: how often intervals hold the truth, and what is told.

`python -m benchmarks right --replicates 200` prints the coverage of the intervals of each study by
hyperparameter, and the share of the replicates in which each warning was told. `verdicts` counts
those that are called inconsistent: false alarms all. `resampled` adds the coverage of bootstrap and
posterior. Each keeps its replicates in a file of its own, and goes on where it ended.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from scipy import stats

from aleator import (
    Check,
    GradientMultistart,
    Identification,
    bootstrap,
    identify,
    posterior,
)
from aleator.inference.information import INTERVALS
from benchmarks.kept import Entry, Key, kept
from benchmarks.shapes import SHAPES, Shape

HALF = float(stats.norm.ppf(0.5 + INTERVALS.level / 2.0))
SHAPE = {shape.name: shape for shape in SHAPES}
SEARCH = GradientMultistart(starts=2)
"""In place of ten: half of the time, and on these studies the same maximum."""
RESAMPLES, DRAWS = 200, 250
"""Replicates of a bootstrap, and draws of each of the four chains of a posterior."""


def identified(shape: Shape, seed: int, consistency: bool = False) -> Identification:
    """One virtual data set of a study, by default settings but for the search."""
    return identify(
        shape.simulator, shape.table(seed), shape.inputs, noise=shape.noise, vectorized=True,
        search=SEARCH, verification=Check(0), seed=seed, consistency=consistency,
        best_law=False,
    )  # fmt: skip


def intervals(name: str, seed: int) -> Entry:
    """Estimates, errors, profile intervals and warnings of one replicate."""
    found = identified(SHAPE[name], seed)
    return {
        "sound": found.sound,
        "warnings": [[w.about, w.message] for w in found.warnings],
        "alpha": {
            name: [e.estimate, e.standard_error, e.sandwich_error, e.interval]
            for name, e in found.alpha.items()
            if not e.fixed
        },
    }


def verdict(name: str, seed: int) -> Entry:
    """The second verdict of one replicate, with the smallest p of each group of tests."""
    second = identified(SHAPE[name], seed, consistency=True).consistency
    tests = pd.DataFrame([(t.kind, t.of, t.p) for t in second.tests], columns=["kind", "of", "p"])
    return {
        "consistent": second.consistent,
        "p": second.p,
        "told": [d.message for d in second.discrepancies],
        "least": tests.groupby("kind")["p"].min().to_dict(),
    }


def resampled(name: str, seed: int) -> Entry:
    """Intervals by bootstrap and by posterior, of one replicate."""
    found = identified(SHAPE[name], seed)
    again = bootstrap(found, replicates=RESAMPLES, seed=seed)
    drawn = posterior(found, draws=DRAWS, seed=seed)
    ends = {kind: again.intervals(kind) for kind in ("percentile", "basic", "bca")}
    ends["posterior"] = drawn.table()[["lower", "upper"]]
    return {
        "converged": drawn.converged,
        "alpha": {kind: {k: [*map(float, e)] for k, e in t.T.items()} for kind, t in ends.items()},
    }


def print_right(console: Console, path: Path, replicates: int) -> None:
    """Coverage and warnings, of what the file has and what it lacks."""
    entries = _of_each(kept(path, _keys(replicates), intervals))
    console.print(pd.DataFrame(_coverages(entries)).to_string(index=False))
    every = [entry for some in entries.values() for entry in some]
    console.print(f"\nwarnings, in per cent of {len(every)} right studies")
    console.print(_alarms(entries).T.to_string())
    console.print(f"not computed soundly: {sum(not entry['sound'] for entry in every)}")


def print_verdicts(console: Console, path: Path, replicates: int) -> None:
    """How many replicates of each study are called inconsistent, and by which tests."""
    entries = _of_each(kept(path, _keys(replicates), verdict))
    rows = [
        {
            "study": name,
            "replicates": len(some),
            "inconsistent": sum(entry["consistent"] is False for entry in some),
            "untested": sum(entry["consistent"] is None for entry in some),
        }
        for name, some in entries.items()
    ]
    console.print(pd.DataFrame(rows).to_string(index=False))


def print_resampled(console: Console, path: Path, replicates: int) -> None:
    """Coverage of the intervals by bootstrap and by posterior."""
    entries = _of_each(kept(path, _keys(replicates), resampled))
    rows = []
    for name, some in entries.items():
        for alpha, truth in SHAPE[name].truth.items():
            row: dict[str, Any] = {"study": name, "alpha": alpha, "replicates": len(some)}
            for kind in some[0]["alpha"]:
                ends = [entry["alpha"][kind][alpha] for entry in some]
                row[kind] = _percent([low <= truth <= high for low, high in ends])
            rows.append(row)
    console.print(pd.DataFrame(rows).to_string(index=False))


def _keys(replicates: int) -> Iterator[Key]:
    """The replicates of all studies, in turns."""
    return ((shape.name, seed) for seed, shape in product(range(replicates), SHAPES))


def _of_each(entries: dict[Key, Entry]) -> dict[str, list[Entry]]:
    """The entries of each study."""
    names = [name for name in SHAPE if any(key[0] == name for key in entries)]
    return {name: [e for key, e in entries.items() if key[0] == name] for name in names}


def _coverages(entries: dict[str, list[Entry]]) -> Iterator[dict[str, Any]]:
    """The share of 95 % intervals that hold the truth, by study and hyperparameter."""
    for name, some in entries.items():
        for alpha, truth in SHAPE[name].truth.items():
            rows = [entry["alpha"][alpha] for entry in some]
            profile = [low <= truth <= high for *_, ends in rows if ends for low, high in [ends]]
            row: dict[str, Any] = {"study": name, "alpha": alpha, "replicates": len(rows)}
            row["profile"] = _percent(profile)
            for k, kind in ((1, "standard error"), (2, "sandwich")):
                held = [abs(r[0] - truth) <= HALF * r[k] for r in rows if r[k] is not None]
                row[kind] = f"{_percent(held)} of {len(held)}"
            row["no interval"] = sum(ends is None for *_, ends in rows)
            yield row


def _percent(held: list[bool]) -> str:
    return f"{100 * sum(held) / len(held):.0f} %" if held else "-"


def _alarms(entries: dict[str, list[Entry]]) -> pd.DataFrame:
    """The share of replicates with each kind of warning, by study; nothing is wrong in any."""
    every = [(name, entry) for name, some in entries.items() for entry in some]
    rows = [
        {"warning": kind, "study": name}
        for name, entry in every
        for kind in sorted({_kind(*warning) for warning in entry["warnings"]})
    ]
    if not rows:
        return pd.DataFrame()
    each = pd.DataFrame(rows)
    counts = pd.crosstab(each["warning"], each["study"])
    of = pd.Series({name: len(some) for name, some in entries.items()})
    shares = (100 * counts / of[counts.columns]).round(1)
    shares.insert(0, "all", (100 * counts.sum(axis=1) / len(every)).round(1))
    return shares


def _kind(about: str, message: str) -> str:
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
