"""`python -m benchmarks.judges RECORD.jsonl`: what `identify` answers by default, to be compared.

Every random study and every example is identified by default settings; of the random studies the
exact log-likelihood stands beside (`benchmarks.reference`), and how far its maximum is, by one
Newton step. What the file has already is not made again. `--before OLD.jsonl` prints the changes.
`--emulated` identifies the random studies as those of slow simulators, with an emulator.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console

from aleator import ResponseSurface, identify, load
from aleator.core.types import Array
from benchmarks.emulators import EMULATED
from benchmarks.kept import Entry, kept
from benchmarks.random_studies import RANDOM_STUDIES, RandomStudy
from benchmarks.reference import Reference, Resolution

ROOT = Path(__file__).parents[1]
EXAMPLES = tuple(
    str(path.relative_to(ROOT))
    for folder in ("examples", "src")
    for path in sorted((ROOT / folder).rglob("*.toml"))
    if "[experiments]" in path.read_text(encoding="utf-8")
)
DEFAULT = ResponseSurface()
STEP = 0.1
"""Step of the reference's slopes, in standard errors."""


def judged(name: str, propagation: ResponseSurface = DEFAULT) -> Entry:
    """The answer to one study: a number for a random one, else the path of its file.

    `propagation` is that of random studies.
    """
    before = _processor()
    document = _random(int(name), propagation) if name.isdigit() else _example(name)
    seconds = _processor() - before
    if "error" in document:
        return {"seconds": seconds, "error": document["error"]}
    entry = {
        "seconds": seconds,
        "runs": document["runs"],
        "sound": document["sound"],
        "consistent": document["consistent"],
        "likelihood": document["density"],
        "log_likelihood": document["log_likelihood"],
        "surface": document.get("surface"),
        "alpha": {
            key: [row["estimate"], row["standard_error"], row["interval"]]
            for key, row in document["alpha"].items()
            if not row["fixed"]
        },
    }
    if name.isdigit():
        entry |= _exactly(RANDOM_STUDIES[int(name)], document)
    return entry


def _processor() -> float:
    """Seconds of the processor, of this process and of those that it waited for."""
    return float(sum(os.times()[:4]))


def _random(number: int, propagation: ResponseSurface) -> Mapping[str, Any]:
    study = RANDOM_STUDIES[number]
    try:
        return identify(
            study.simulator, study.table(), study.inputs, outcome="y", noise=study.errors,
            propagation=propagation, vectorized=True, seed=0,
        ).to_dict()  # fmt: skip
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}


def _example(file: str) -> Mapping[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.run(
            [sys.executable, "-m", "aleator", "identify", file, "--output", folder, "--no-figures"],
            cwd=ROOT, capture_output=True, text=True, check=False,
        )  # fmt: skip
        written = Path(folder) / "identification.json"
        if not written.exists():
            return {"error": run.stderr[-500:]}
        return load(written).to_dict()


def _exactly(study: RandomStudy, document: Mapping[str, Any]) -> Entry:
    """The exact log-likelihood at the answer, its own error, and a Newton step to its maximum.

    `off` is the longest step of one estimate in standard errors; `deficit` what the step gains.
    """
    table = study.table()
    alpha = {key: row["estimate"] for key, row in document["alpha"].items()}
    exact = Reference(study, table)
    value = exact(alpha)
    error = Reference(study, table, Resolution().coarser)(alpha) - value
    correlation = document["correlation"]
    names = correlation["names"]
    errors = np.array([document["alpha"][name]["standard_error"] for name in names], dtype=float)
    if not np.all(np.isfinite(errors)):
        # where the information has no inverse there is no Newton step
        return {"exact": value, "exact_error": error}
    slopes = np.array(
        [
            exact({**alpha, name: alpha[name] + STEP * se})
            - exact({**alpha, name: alpha[name] - STEP * se})
            for name, se in zip(names, errors, strict=True)
        ]
    ) / (2.0 * STEP)
    steps: Array = np.reshape(correlation["matrix"], (len(names), len(names))) @ slopes
    return {
        "exact": value,
        "exact_error": error,
        "off": float(np.max(np.abs(steps), initial=0.0)),
        "deficit": float(0.5 * slopes @ steps),
    }


def print_record(console: Console, entries: Mapping[tuple[str | int, ...], Entry]) -> None:
    """A row for each study of one record."""
    rows = []
    for (name,), entry in entries.items():
        told = entry.get("log_likelihood", {})
        value = told.get("estimated", np.nan)
        rows.append({
            "study": _title(str(name)), "sound": entry.get("sound"),
            "consistent": entry.get("consistent"), "log L": value,
            "exact - log L": entry.get("exact", np.nan) - value,
            "deficit": entry.get("deficit", np.nan), "off": entry.get("off", np.nan),
            "told": (entry.get("surface") or {}).get("estimates_error", np.nan),
            "runs": entry.get("runs"), "CPU s": entry["seconds"],
            "error": entry.get("error", "")[:60],
        })  # fmt: skip
    console.print(pd.DataFrame(rows).to_string(index=False, float_format="%.3f"))


def print_changes(
    console: Console, before: Mapping[Any, Entry], after: Mapping[Any, Entry]
) -> None:
    """What differs between two records of the same studies, and the sums of runs and seconds."""
    both = [key for key in before if key in after]
    rows = [{"study": _title(str(key[0])), **_change(before[key], after[key])} for key in both]
    console.print(pd.DataFrame(rows).to_string(index=False, float_format="%.4f"))
    for what in ("runs", "seconds"):
        old, new = (sum(r[key].get(what, 0) for key in both) for r in (before, after))
        console.print(f"{what}: {old:.0f} before, {new:.0f} after, {new / old:.3f} times")


def _change(before: Entry, after: Entry) -> dict[str, Any]:
    if "error" in before or "error" in after:
        return {"verdicts": f"{before.get('error', 'answer')} -> {after.get('error', 'answer')}"}
    shifts = [0.0]
    for name, (estimate, se, interval) in before["alpha"].items():
        if se is None or name not in after["alpha"]:
            continue
        new = after["alpha"][name]
        shifts.append(abs(new[0] - estimate) / se)
        if interval and new[2]:
            shifts += [abs(a - b) / se for a, b in zip(interval, new[2], strict=True)
                       if a is not None and b is not None]  # fmt: skip
    old, new = (entry["log_likelihood"]["estimated"] for entry in (before, after))
    verdicts = [f"{entry['sound']}/{entry['consistent']}" for entry in (before, after)]
    return {
        "log L": old, "change": new - old, "largest shift, se": max(shifts),
        "off before": before.get("off", np.nan), "off after": after.get("off", np.nan),
        "log L error before": old - before.get("exact", np.nan),
        "log L error after": new - after.get("exact", np.nan),
        "verdicts": verdicts[0] if verdicts[0] == verdicts[1] else " -> ".join(verdicts),
        "runs": f"{before['runs']} -> {after['runs']}",
        "CPU s": f"{before['seconds']:.1f} -> {after['seconds']:.1f}",
    }  # fmt: skip


def _title(name: str) -> str:
    return f"{name} {RANDOM_STUDIES[int(name)].name}" if name.isdigit() else name


def main() -> None:
    """Identify what the record lacks, print it, and compare it where another one is given."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.judges", description=__doc__)
    parser.add_argument("record", type=Path)
    parser.add_argument("--before", type=Path, help="the record to compare with")
    parser.add_argument("--only", help="names of studies, with commas between them")
    parser.add_argument(
        "--emulated", action="store_true", help="the random studies alone, with an emulator"
    )
    options = parser.parse_args()
    random = [*map(str, range(len(RANDOM_STUDIES)))]
    every = random if options.emulated else [*random, *EXAMPLES]
    names = options.only.split(",") if options.only else every
    propagation = EMULATED if options.emulated else DEFAULT
    entries = kept(
        options.record, [(name,) for name in names], partial(judged, propagation=propagation)
    )
    console = Console(width=240)
    print_record(console, entries)
    if options.before:
        lines = map(json.loads, options.before.read_text().splitlines())
        print_changes(console, {tuple(line["key"]): line for line in lines}, entries)


if __name__ == "__main__":
    main()
