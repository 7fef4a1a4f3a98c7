"""Intervals of few experiments: how often they hold the truth, plain and adjusted.

`python -m benchmarks small-samples --replicates 400` draws data sets of twelve small studies with
12, 20 and 40 experiments under a right model. Exact likelihoods take the place of nodes and level
sets, so that thousands of data sets take an hour; maximum, profile and adjusted ends are those of
the package. It prints how often the 95 % intervals hold the truth, with the drop 1.92 and with the
drops of Skovgaard's modified signed root. Then it prints by how much the ends of `identify` differ
from these, of one data set of each study. All data are synthetic.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from rich.console import Console

from aleator import Check, GradientMultistart, identify
from aleator.inference.information import Inference, infer
from aleator.inference.likelihood_at import LikelihoodAt
from aleator.inference.profile import TARGET, Profile, profile_intervals
from aleator.inference.small_sample import modified_targets
from aleator.observations.responses import Observations
from aleator.search.newton import ascended, outer
from benchmarks.exact_densities import STUDIES, ExactLikelihood
from benchmarks.kept import Entry, Key, kept

COUNTS = (12, 20, 40)
"""The numbers of experiments."""
STUDY = {study.name: study for study in STUDIES}


def intervals(name: str, count: int, seed: int) -> Entry:
    """The plain and the adjusted intervals of one data set, by hyperparameter."""
    likelihood = STUDY[name].likelihood(count, seed)
    at, inference, plain = _profiled(likelihood)
    own = inference.identified.tolist()
    targets = modified_targets(
        cast(LikelihoodAt, at), cast(Observations, None), inference, plain, seed
    )
    known = np.where(np.isnan(targets), TARGET, targets)
    adjusted = profile_intervals(
        at, at.alpha, at.hyperparameters, inference, about=plain.points, targets=known
    )
    names = [at.hyperparameters[k].name for k in own]
    return {
        "alpha": {
            name: [
                at.alpha[k], plain.intervals[k].tolist(), adjusted.intervals[k].tolist(),
                targets[k].tolist(), inference.at_bound[k],
            ]
            for name, k in zip(names, own, strict=True)
        }
    }  # fmt: skip


def _profiled(likelihood: ExactLikelihood) -> tuple[ExactLikelihood, Inference, Profile]:
    """The likelihood at its maximum, with the information matrix and the plain profile."""
    own = np.flatnonzero([h.free for h in likelihood.hyperparameters])
    while True:
        # The second ascent begins with the outer products of the scores where the first one ended.
        for _ in range(2):
            scores = likelihood.scored().scores
            assert scores is not None
            end = ascended(
                likelihood, likelihood.alpha, likelihood.hyperparameters, own,
                outer(scores[:, own]), 1e-8, bent=True,
            )  # fmt: skip
            likelihood = replace(likelihood, alpha=end.alpha)
        at = likelihood.alpha, likelihood.hyperparameters
        inference = infer(likelihood, *at)
        profile = profile_intervals(likelihood, *at, inference)
        if profile.better is None:
            return likelihood, inference, profile
        likelihood = replace(likelihood, alpha=profile.better)


def print_small_samples(console: Console, path: Path, replicates: int) -> None:
    """Coverage by study, hyperparameter and number of experiments; makes what the file lacks."""
    rows = pd.DataFrame(coverages(kept(path, _keys(replicates), intervals)))
    console.print(rows.to_string(index=False))
    console.print("\nall intervals, and the shares of rows within 93.5 to 96.5 %")
    for count, some in rows.groupby("experiments"):
        sets = some["data sets"]
        shares = [np.average(some[kind], weights=sets) for kind in ("plain", "adjusted")]
        within = [some[kind].between(93.5, 96.5).mean() for kind in ("plain", "adjusted")]
        console.print(
            f"{count} experiments: plain {shares[0]:.1f} %, adjusted {shares[1]:.1f} % of "
            f"{sets.sum()}; rows {within[0]:.0%} and {within[1]:.0%}"
        )
    console.print("\nends by identify beside these, in widths of the interval")
    for study in STUDIES:
        console.print(f"{study.name}: at most {apart(study.name):.4f}")


def apart(name: str, count: int = 12, seed: int = 0) -> float:
    """The largest difference of interval ends, plain and adjusted, of `identify` from the exact.

    It is in widths of the plain interval, over all hyperparameters of one data set.
    """
    study, exactly = STUDY[name], intervals(name, count, seed)["alpha"]
    drawn = study.likelihood(count, seed)
    found = identify(
        study.simulator, study.table(drawn.y, drawn.c), study.inputs, noise=study.noise,
        vectorized=True, search=GradientMultistart(starts=2), verification=Check(0), seed=seed,
        consistency=False, best_law=False, small_sample=True,
    ).alpha  # fmt: skip
    off = [
        np.abs(np.array([found[one].unadjusted, found[one].interval]) - known[1:3]).max()
        / np.ptp(known[1])
        for one, known in exactly.items()
    ]
    return float(np.max(off))


def _keys(replicates: int) -> Iterator[Key]:
    return (
        (study.name, count, seed)
        for seed, count, study in product(range(replicates), COUNTS, STUDIES)
    )


def coverages(entries: Mapping[Key, Entry]) -> Iterator[dict[str, Any]]:
    """The per cent of intervals that hold the truth, and of those wholly above and below it.

    `error` is the standard error of a coverage of 95 %. `wider` is the median ratio of the widths.
    An end that cannot be adjusted is `kept`.
    """
    for study, count in product(STUDIES, COUNTS):
        some = [entry for key, entry in entries.items() if key[:2] == (study.name, count)]
        for alpha, truth in study.truth.items():
            rows = [entry["alpha"][alpha] for entry in some]
            ends = np.array([row[1:3] for row in rows], dtype=float)
            ends, targets = ends.reshape(-1, 2, 2), np.array([row[3] for row in rows], dtype=float)
            known = np.isfinite(ends).all(axis=(1, 2))
            if not np.any(known):
                continue
            ends, targets = ends[known], targets[known]
            above, below = (
                np.mean(ends[..., 0] > truth, axis=0),
                np.mean(ends[..., 1] < truth, axis=0),
            )
            plain, adjusted = 100.0 * (1.0 - above - below)
            width = np.ptp(ends, axis=2)
            yield {
                "study": study.name,
                "alpha": alpha,
                "experiments": count,
                "data sets": len(ends),
                "plain": round(plain, 1),
                "adjusted": round(adjusted, 1),
                "error": round(100.0 * float(np.sqrt(0.95 * 0.05 / len(ends))), 1),
                "above": round(100.0 * above[1], 1),
                "below": round(100.0 * below[1], 1),
                "wider": f"{100.0 * np.median(width[:, 1] / width[:, 0]) - 100.0:.0f} %",
                "kept": f"{100.0 * np.mean(np.isnan(targets).any(axis=1)):.0f} %",
                "no interval": int(np.sum(~known)),
            }
