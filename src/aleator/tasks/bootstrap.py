"""How far the estimates scatter: the same identification of other data, many times."""

from __future__ import annotations

import pickle
from collections.abc import Generator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aleator.errors import InputsError, SurroundingsError
from aleator.inference import resampling
from aleator.inference.fit import Fit, refitted
from aleator.laws.hyperparameter import limits_of
from aleator.progress import Progress, Silent
from aleator.results import printed
from aleator.simulators import ProcessPool
from aleator.simulators.command.janitor import passing
from aleator.simulators.workers.parcel import packed
from aleator.tasks.identification import Identification
from aleator.tasks.replicate_file import Replicate, ReplicateFile, head_of
from aleator.threads import single_threaded
from aleator.types import Array

FILE = "bootstrap.jsonl"
PARAMETRIC, NONPARAMETRIC = "parametric", "nonparametric"
ARRIVED, LEFT = "arrived", "not at a maximum"
INTERVALS = ("percentile", "basic", "bca")


@dataclass(frozen=True, eq=False, repr=False)
class Bootstrap:
    """R replicates of the F free hyperparameters `names`.

    `estimate` (F,) are those of the identification, `limits` (F, 2) theirs, `influence` (N, F)
    what each experiment adds to them. `here` tells that the work was done in this process because
    the simulator cannot travel to others.
    """

    kind: str
    seed: int
    names: tuple[str, ...]
    estimate: Array
    limits: Array
    influence: Array
    runs: tuple[Replicate, ...]
    here: bool

    def __repr__(self) -> str:
        return f"{len(self.runs)} replicates, {self.kind}\n{self.table().to_string()}"

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        return printed.shown(f"{len(self.runs)} replicates, {self.kind}", self.table())

    def replicates(self) -> pd.DataFrame:
        """A row for each replicate: the hyperparameters, `log_likelihood`, `status`."""
        frame = pd.DataFrame([run.alpha for run in self.runs], columns=[*self.names])
        frame["log_likelihood"] = [run.log_likelihood for run in self.runs]
        frame["status"] = [run.status for run in self.runs]
        return frame.rename_axis("replicate")

    @property
    def alpha(self) -> Array:
        """Those replicates (R, F) that arrived at a maximum."""
        found = [run.alpha for run in self.runs if run.status == ARRIVED]
        return np.array(found, dtype=float).reshape(len(found), len(self.names))

    def table(self) -> pd.DataFrame:
        """A row for each hyperparameter.

        `estimate`, `bias` (mean of the replicates minus estimate) with its Monte Carlo
        `bias_error`, `standard_error`, the share `at_limit` of replicates on a limit, and 95 %
        intervals: `percentile_lower`, `percentile_upper`, `basic_...`, `bca_...`. All of the
        replicates that arrived; NaN where fewer than two did.
        """
        alpha = self.alpha
        enough = len(alpha) > 1
        nothing = np.full(len(self.names), np.nan)
        scatter = alpha.std(axis=0, ddof=1) if enough else nothing
        width = np.diff(self.limits, axis=1)[:, 0]
        low, high = (np.abs(alpha - end) <= 1e-6 * width for end in self.limits.T)
        columns = {
            "estimate": self.estimate,
            "bias": alpha.mean(axis=0) - self.estimate if enough else nothing,
            "bias_error": scatter / np.sqrt(max(len(alpha), 1)),
            "standard_error": scatter,
            "at_limit": np.mean(low | high, axis=0) if enough else nothing,
        }
        for kind in INTERVALS:
            ends = self.intervals(kind).to_numpy()
            columns |= {f"{kind}_lower": ends[:, 0], f"{kind}_upper": ends[:, 1]}
        return pd.DataFrame(columns, index=[*self.names])

    def intervals(self, kind: str = "bca") -> pd.DataFrame:
        """95 % intervals by name: "percentile", "basic" or "bca"; columns lower, upper.

        Cut at the limits. Raises InputsError for another kind.
        """
        alpha = self.alpha
        if kind not in INTERVALS:
            raise InputsError(f"intervals '{kind}'", f"choose {', '.join(INTERVALS)}")
        if kind == "percentile":
            ends = resampling.percentile(alpha)
        elif kind == "basic":
            ends = resampling.basic(self.estimate, alpha)
        else:
            ends = resampling.bias_corrected(self.estimate, alpha, self.influence)
        ends = np.clip(ends, self.limits[:, :1], self.limits[:, 1:])
        return pd.DataFrame(ends, index=[*self.names], columns=["lower", "upper"])

    def to_dict(self) -> dict[str, Any]:
        """The document bootstrap.json as plain dictionaries, lists, numbers and texts."""
        status = [run.status for run in self.runs]
        return {
            "kind": self.kind,
            "seed": self.seed,
            "replicates": len(self.runs),
            "experiments": len(self.influence),
            "statuses": {name: status.count(name) for name in dict.fromkeys(status)},
            "hyperparameters": self.table().to_dict("index"),
            "in_this_process": self.here,
        }


def bootstrap(
    found: Identification,
    *,
    replicates: int = 200,
    kind: str = PARAMETRIC,
    seed: int = 0,
    workers: int = 1,
    folder: str | Path | None = None,
    progress: Progress | None = None,
) -> Bootstrap:
    """Estimate again from other data, `replicates` times; no run of the simulator on surfaces.

    "parametric" data are drawn for the same experiments under the identified law and noise (Efron
    1979); "nonparametric" are as many of the experiments, drawn with replacement, which stays right
    where the law or the noise is wrong. Each replicate climbs to the maximum of its own data from
    the estimate; surfaces and the choices made for them stay what they are. Each has a seed of its
    own, so that the answer does not depend on the number of `workers`, processes of this machine,
    and more replicates begin with the same ones. With a `folder` each finished replicate is kept
    there in bootstrap.jsonl, and a call for the same fit, kind and seed goes on from it.

    Raises InputsError for fewer than two replicates or another kind, AleatorError for an
    identification that was read from a file, and where the file is that of another study. Cost: a
    climb a replicate, some ten evaluations of the likelihood.

    >>> from aleator import Free, Inputs, Noise, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> answer = identify(lambda load, x: load * x, table, law, outcome="y", noise=Noise(0.05))
    >>> resampled = bootstrap(answer, replicates=40)
    >>> resampled.table().loc["x.mean", ["estimate", "standard_error"]].round(2).tolist()
    [1.03, 0.06]
    """
    if replicates < 2:
        raise InputsError(f"bootstrap: {replicates} replicates", "use at least 2; 200 tell a lot")
    if kind not in (PARAMETRIC, NONPARAMETRIC):
        raise InputsError(f"bootstrap: kind '{kind}'", f"choose {PARAMETRIC} or {NONPARAMETRIC}")
    fit, told = found.fit, progress or Silent()
    told.stage("bootstrap")
    file = None
    if folder is not None:
        file = ReplicateFile(Path(folder) / FILE, head_of(fit, kind, seed))
    done = file.begun() if file is not None else {}
    left = [number for number in range(replicates) if number not in done]
    parcel = packed(fit) if workers > 1 and left else None
    with closing(_made(fit, parcel, kind, seed, left, workers)) as made:
        for replicate in made:
            done[replicate.number] = replicate
            if file is not None:
                file.add(replicate)
            told.update(f"{len(done)} of {replicates} replicates", len(done), replicates)
    own = fit.inference.identified
    limits = np.column_stack(limits_of(fit.hyperparameters, own))
    return Bootstrap(
        kind, seed, tuple(fit.hyperparameters[k].name for k in own), fit.alpha[own],
        limits, influence(fit), tuple(done[r] for r in range(replicates)),
        workers > 1 and bool(left) and parcel is None,
    )  # fmt: skip


def influence(fit: Fit) -> Array:
    """H^-1 s_l (N, F): what experiment l adds to the estimates, zero for one on a limit."""
    inference, scores = fit.inference, fit.scored().scores
    found = np.zeros((fit.count, inference.identified.size))
    if inference.positive and scores is not None:
        inside = np.isin(inference.identified, inference.free)
        found[:, inside] = scores[:, inference.free] @ inference.covariance
    return found


@single_threaded
def replicated(fit: Fit, kind: str, seed: int, number: int) -> Replicate:
    """Replicate `number`, which depends on these four alone."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    if kind == PARAMETRIC:
        end = refitted(fit.drawn(rng))
    else:
        share = np.full(fit.count, 1.0 / fit.count)
        end = refitted(fit, rng.multinomial(fit.count, share).astype(float))
    alpha = end.fit.alpha[fit.inference.identified]
    return Replicate(number, tuple(alpha.tolist()), end.value, ARRIVED if end.arrived else LEFT)


def _made(
    fit: Fit, parcel: bytes | None, kind: str, seed: int, numbers: Sequence[int], workers: int
) -> Generator[Replicate, None, None]:
    """The replicates of these numbers as they are finished; here, or where the parcel goes."""
    if parcel is None:
        for number in numbers:
            yield replicated(fit, kind, seed, number)
        return
    with passing() as folder:
        path = folder / "fit.pickle"
        path.write_bytes(parcel)
        pool = ProcessPool(min(workers, len(numbers)))
        try:
            jobs = [pool.submit(_elsewhere, str(path), kind, seed, number) for number in numbers]
            for job in as_completed(jobs):
                yield job.result()
        except BrokenProcessPool:
            raise SurroundingsError(
                "bootstrap: a worker process ended before its replicate was finished",
                "ask for fewer workers, there may be no memory left; with a folder, what is "
                "finished is kept: ask again",
            ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _elsewhere(path: str, kind: str, seed: int, number: int) -> Replicate:
    return replicated(_unpacked(path), kind, seed, number)


@lru_cache(maxsize=1)
def _unpacked(path: str) -> Fit:
    fit: Fit = pickle.loads(Path(path).read_bytes())
    return fit
