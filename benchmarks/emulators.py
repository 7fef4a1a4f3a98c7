"""`python -m benchmarks.emulators RECORD.jsonl`: what an emulator in place of the simulator costs.

Eleven unlike simulators with six data sets each, all synthetic (`benchmarks.simulators`), are
identified by default settings as ones that are not vectorized. Each answer is compared with that of
the same study where the simulator itself is integrated over. The error of alpha in the worst
direction is sqrt(2 (L(exact) - L(found))) in standard errors, where L is the exact log-likelihood.
The exact answers are kept in a file beside, RECORD-exact.jsonl, so that they are computed once;
what RECORD.jsonl has already is not made again. With `--jac` runs give derivatives, too.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console

from aleator import (
    Experiments,
    GradientMultistart,
    Identification,
    Inputs,
    ResponseSurface,
    identify,
)
from aleator.core.progress import Silent
from aleator.fit.ledger import Ledger
from aleator.fit.quadrature import Maximum
from aleator.fit.question import Choices
from aleator.fit.refine import refined
from aleator.inference.information import infer
from aleator.simulators import as_runner
from benchmarks.kept import Entry, Key, kept
from benchmarks.simulators import SIMULATORS, Errors, Studied

BY_NAME = {study.name: study for study in SIMULATORS}
EMULATED = ResponseSurface(surfaces="process")
"""What a simulator that is not vectorized gets by default; for a fast one it must be said."""
DIRECT = ResponseSurface(surfaces="none")
SEARCH = GradientMultistart(starts=3, most=6)
"""Of the exact answer, which starts from the law of the data."""
SETS, FIRST_SEED = 6, 3100
FACTOR = 2.0
"""A true error up to so many times the stated one counts as stated truly."""


def stated_error(found: Identification) -> float | None:
    """The error of alpha by the emulator that the result states, in standard errors, or None."""
    return getattr(found, "emulator_error", None)


def exactly(study: Studied, table: Experiments, inputs: Inputs, noise: Errors) -> Maximum:
    """The maximum of the likelihood where the simulator itself is integrated over."""
    runner = as_runner(study.exact, table, inputs.names, True, None)
    choices = Choices.of(table, inputs, noise, DIRECT, search=SEARCH)
    question = choices.question(runner, table.observations, 0)
    return refined(question, Ledger(runner, Silent())).maximum


def exact_value(study: Studied, table: Experiments, alpha: Mapping[str, float]) -> float:
    """The exact log-likelihood at alpha: that of the study with nothing left to identify."""
    end = exactly(study, table, *study.at(alpha))
    return float(end.likelihood.continued(end.alpha).likelihood)


def exact_answer(name: str, seed: int) -> Entry:
    """The exact answer to one study, searched from the law of the data."""
    began, study = time.process_time(), BY_NAME[name]
    table = study.table(seed)
    end = exactly(study, table, *study.from_truth())
    told = infer(end.likelihood.followed, end.alpha, end.likelihood.hyperparameters)
    names = [h.name for h in end.likelihood.hyperparameters]
    alpha = dict(zip(names, end.alpha.tolist(), strict=True))
    errors = [None if np.isnan(one) else float(one) for one in told.standard_error]
    entry = {
        "alpha": alpha,
        "standard_errors": dict(zip(names, errors, strict=True)),
        "log_likelihood": exact_value(study, table, alpha),
        "at_bound": [n for n, side in zip(names, told.at_bound, strict=True) if side],
        "seconds": time.process_time() - began,
    }
    print(f"{name} {seed}: exact answer in {entry['seconds']:.1f} s", flush=True)
    return entry


def judged(exact: Mapping[Key, Entry], name: str, seed: int, jac: bool = False) -> Entry:
    """One study by default settings, held against its exact answer; `jac`: with derivatives."""
    study, best = BY_NAME[name], exact[name, seed]
    table = study.table(seed)
    began = time.process_time()
    try:
        found = identify(
            study.sloped if jac else study.slow,
            table,
            study.inputs,
            noise=study.noise,
            propagation=EMULATED,
            best_law=False,
        )
    except Exception as error:  # an answer that is refused is one row of the table
        return {"error": f"{type(error).__name__}: {error}"[:300]}
    seconds = time.process_time() - began
    alpha = {key: one.estimate for key, one in found.alpha.items()}
    value = exact_value(study, table, alpha)
    loss = best["log_likelihood"] - value
    off = {
        key: abs(alpha[key] - best["alpha"][key]) / error
        for key, error in best["standard_errors"].items()
        if error is not None
    }
    entry = {
        "experiments": len(table.ids),
        "runs": found.runs,
        "runs_by_stage": dict(found.runs_by_stage),
        "seconds": seconds,
        "seconds_by_stage": dict(found.seconds),
        "alpha": alpha,
        "log_likelihood": found.log_likelihood.estimated,
        "exact_log_likelihood": value,
        "loss": loss,
        "error": None,
        "worst": float(np.sqrt(2.0 * max(loss, 0.0))),
        "single": max(off.values(), default=0.0),
        "single_name": max(off, key=lambda key: off[key], default=""),
        "sound": found.sound,
        "consistent": found.consistent,
        "stated": stated_error(found),
    }
    print(
        f"{name} {seed}: {found.runs / len(table.ids):.1f} runs an experiment, error "
        f"{entry['worst']:.3f}, stated {entry['stated']}, loss {loss:+.4f}, log L off by "
        f"{entry['log_likelihood'] - value:+.3f}, {'sound' if found.sound else 'NOT SOUND'}, "
        f"{seconds:.1f} s",
        flush=True,
    )
    return entry


def summary(entries: Mapping[Key, Entry], exact: Mapping[Key, Entry]) -> pd.DataFrame:
    """A row for each simulator, and one for all."""
    rows = pd.DataFrame([
        {"simulator": key[0], "exact_seconds": exact[key]["seconds"],
         "bound": bool(exact[key]["at_bound"]), **entry}
        for key, entry in entries.items()
    ])  # fmt: skip
    if "worst" not in rows:
        return rows
    parts = [(name, rows[rows["simulator"] == name]) for name in rows["simulator"].unique()]
    return pd.DataFrame([_row(name, part) for name, part in [*parts, ("all", rows)]])


def _row(name: str, part: pd.DataFrame) -> dict[str, Any]:
    answered = part[part["error"].isna()]
    stated = answered["stated"].astype(float)
    worst = answered["worst"].astype(float)
    known = stated.notna()
    return {
        "simulator": name, "studies": len(part), "answered": len(answered),
        "runs/experiment": (answered["runs"] / answered["experiments"]).median(),
        "largest": (answered["runs"] / answered["experiments"]).max(),
        "true": worst.median(), "largest true": worst.max(),
        "within 0.2": f"{(worst <= 0.2).sum()}/{len(part)}",
        "single": answered["single"].astype(float).median(),
        "log L off": (answered["log_likelihood"] - answered["exact_log_likelihood"]).abs().max(),
        "stated": stated.median(),
        f"true<={FACTOR:g}x": f"{(worst <= FACTOR * stated)[known].sum()}/{known.sum()}",
        "stated/true": (stated / worst.clip(lower=1e-3)).median(),
        "sound": f"{answered['sound'].sum():.0f}/{len(part)}",
        "CPU s": answered["seconds"].astype(float).median(),
        "exact CPU s": part["exact_seconds"].median(),
        "on a limit": f"{part['bound'].sum():.0f}/{len(part)}",
    }  # fmt: skip


def main() -> None:
    """Identify what the record lacks, and print a row for each simulator."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.emulators", description=__doc__)
    parser.add_argument("record", type=Path)
    parser.add_argument("--only", help=f"names, with commas between them: {', '.join(BY_NAME)}")
    parser.add_argument("--sets", type=int, default=SETS, help="data sets of each simulator")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="seed of the first data set")
    parser.add_argument("--jac", action="store_true", help="runs give derivatives, too")
    options = parser.parse_args()
    names = options.only.split(",") if options.only else [*BY_NAME]
    if unknown := set(names) - {*BY_NAME}:
        parser.error(f"no simulator {', '.join(sorted(unknown))}")
    keys: list[Key] = [(n, options.seed + k) for n in names for k in range(options.sets)]
    warnings.simplefilter("ignore")
    beside = options.record.with_name(f"{options.record.stem}-exact.jsonl")
    exact = kept(beside, keys, exact_answer)
    known = kept(options.record, keys, partial(judged, exact, jac=options.jac))
    entries = {key: known[key] for key in keys}
    with pd.option_context("display.width", 260, "display.max_columns", 30):
        table = summary(entries, exact).to_string(index=False, float_format="%.3f")
    Console(width=260).print(table, highlight=False, markup=False)
    for key, entry in entries.items():
        if entry["error"]:
            print(*key, entry["error"])


if __name__ == "__main__":
    main()
