"""The bootstrap: the scatter of the estimates over many drawn data sets."""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import ConfigDict, TypeAdapter
from scipy import special

from aleator.core.progress import Progress, Silent
from aleator.core.threads import single_threaded
from aleator.core.types import Array
from aleator.errors import AleatorError, InputsError, short
from aleator.inference.fit import Fit, refitted
from aleator.inference.information import INTERVALS
from aleator.laws.hyperparameter import limits_of
from aleator.results import printed
from aleator.simulators.pool import packed
from aleator.tasks.finished_work import FinishedWork, head_of
from aleator.tasks.identification import Identification
from aleator.tasks.runs import in_processes


def percentile(alpha: Array, level: float = INTERVALS.level) -> Array:
    """Percentile intervals (F, 2): quantiles of replicates (R, F); NaN without replicates."""
    return quantiles(alpha, np.full((alpha.shape[1], 2), _tails(level)))


def basic(estimate: Array, alpha: Array, level: float = INTERVALS.level) -> Array:
    """Basic intervals (F, 2): estimate - (quantile - estimate) for both tails (Efron, 1979)."""
    return np.asarray(2.0 * estimate[:, None] - percentile(alpha, level)[:, ::-1])


def bias_corrected(
    estimate: Array, alpha: Array, influence: Array, level: float = INTERVALS.level
) -> Array:
    """BCa intervals (F, 2) of replicates (R, F), second-order accurate (Efron, 1987).

    The ends are quantiles at the levels Phi(z0 + (z0 + z)/(1 - a (z0 + z))), where z = Phi^-1 of
    the tail probability. z0 is Phi^-1 of the share of replicates below the estimate, with half of
    the ties. The acceleration is a = sum U^3 / (6 (sum U^2)^1.5), where U (N, F) is the influence
    of each experiment. The interval is NaN if all replicates are on one side of the estimate.

    >>> rng = np.random.default_rng(0)
    >>> alpha = rng.normal(1.0, 2.0, (100_000, 1))
    >>> bias_corrected(np.array([1.0]), alpha, rng.normal(size=(50, 1)) * 0.0).round(1).tolist()
    [[-2.9, 4.9]]
    """
    if not len(alpha):
        return np.full((alpha.shape[1], 2), np.nan)
    below = np.mean(alpha < estimate, axis=0) + 0.5 * np.mean(alpha == estimate, axis=0)
    inside = (below > 0.0) & (below < 1.0)
    offset = special.ndtri(np.where(inside, below, 0.5))[:, None]
    moved = offset + special.ndtri(_tails(level))
    levels = special.ndtr(offset + moved / (1.0 - acceleration(influence)[:, None] * moved))
    return np.where(inside[:, None], quantiles(alpha, levels), np.nan)


def acceleration(influence: Array) -> Array:
    """The acceleration a (F,) of BCa intervals, from the influence (N, F) of each experiment.

    It is zero where no experiment has any influence.
    """
    square = np.sum(influence**2, axis=0)
    cube = np.sum(influence**3, axis=0)
    known = square > 0.0
    found = cube / (6.0 * np.where(known, square, 1.0) ** 1.5)
    return np.where(known & np.isfinite(found), found, 0.0)


def quantiles(alpha: Array, levels: Array) -> Array:
    """The quantiles (F, L) of replicates (R, F) at levels (F, L); NaN without replicates."""
    if not len(alpha):
        return np.full(levels.shape, np.nan)
    return np.array([np.quantile(alpha[:, k], own) for k, own in enumerate(levels)])


def _tails(level: float) -> Array:
    return np.array([0.5 - level / 2.0, 0.5 + level / 2.0])


@dataclass(frozen=True)
class Refitted:
    """One replicate: its `number`, estimates (F,), log-likelihood, and a `status`.

    The status is "arrived", or "not at a maximum" if the maximization did not converge.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    number: int
    alpha: tuple[float, ...]
    log_likelihood: float
    status: str


REPLICATE = TypeAdapter(Refitted)
"""A reader of a replicate that refuses missing fields and numbers written as text."""


@dataclass(frozen=True)
class ReplicateFile(FinishedWork):
    """The file of the finished replicates of a bootstrap."""

    def replicates(self) -> dict[int, Refitted]:
        """The finished replicates of the file, by number (see `begun`)."""
        found = [self._replicate(number, line) for number, line in enumerate(self.begun(), start=2)]
        return {replicate.number: replicate for replicate in found}

    def _replicate(self, number: int, line: Mapping[str, Any]) -> Refitted:
        """The replicate in a line of the file; raises AleatorError if the line is not valid."""
        try:
            found = REPLICATE.validate_json(json.dumps(line), strict=True)
        except ValueError:
            found = None
        if found is None or len(found.alpha) != len(self.head["hyperparameters"]):
            raise AleatorError(
                f"{short(self.path)}: line {number} is no replicate",
                "delete the line, and its replicate is made again",
            )
        return found


FILE = "bootstrap.jsonl"
PARAMETRIC, NONPARAMETRIC = "parametric", "nonparametric"
ARRIVED, LEFT = "arrived", "not at a maximum"
KINDS = ("percentile", "basic", "bca")


@dataclass(frozen=True, eq=False, repr=False)
class Bootstrap:
    """R bootstrap replicates of the estimates of the F free hyperparameters `names`.

    `estimate` (F,) are the estimates of the identification, `limits` (F, 2) the limits of the
    hyperparameters, `influence` (N, F) the influence of each experiment on the estimates. `here` is
    true if the simulator could not be sent to other processes, so that this process did the work.
    """

    kind: str
    seed: int
    names: tuple[str, ...]
    estimate: Array
    limits: Array
    influence: Array
    runs: tuple[Refitted, ...]
    here: bool

    def __repr__(self) -> str:
        return f"{len(self.runs)} replicates, {self.kind}\n{self.table().to_string()}"

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        return printed.shown(f"{len(self.runs)} replicates, {self.kind}", self.table())

    def replicates(self) -> pd.DataFrame:
        """A table with a row for each replicate: its estimates, `log_likelihood`, `status`."""
        frame = pd.DataFrame([run.alpha for run in self.runs], columns=[*self.names])
        frame["log_likelihood"] = [run.log_likelihood for run in self.runs]
        frame["status"] = [run.status for run in self.runs]
        return frame.rename_axis("replicate")

    @property
    def alpha(self) -> Array:
        """The estimates (R, F) of the replicates whose maximization converged."""
        found = [run.alpha for run in self.runs if run.status == ARRIVED]
        return np.array(found, dtype=float).reshape(len(found), len(self.names))

    def table(self) -> pd.DataFrame:
        """A table with a row for each hyperparameter.

        The columns are `estimate`, `bias` (mean of the replicates minus estimate) with its Monte
        Carlo error `bias_error`, `standard_error`, the share `at_limit` of replicates on a limit,
        and the ends of 95 % intervals: `percentile_lower`, `percentile_upper`, `basic_...`,
        `bca_...`. Only converged replicates count. Values are NaN if there are fewer than two.
        """
        alpha = self.alpha
        enough = len(alpha) > 1
        nothing = np.full(len(self.names), np.nan)
        scatter = alpha.std(axis=0, ddof=1) if enough else nothing
        width = np.diff(self.limits, axis=1)[:, 0]
        low, high = (np.abs(alpha - end) <= INTERVALS.limit * width for end in self.limits.T)
        columns = {
            "estimate": self.estimate,
            "bias": alpha.mean(axis=0) - self.estimate if enough else nothing,
            "bias_error": scatter / np.sqrt(max(len(alpha), 1)),
            "standard_error": scatter,
            "at_limit": np.mean(low | high, axis=0) if enough else nothing,
        }
        for kind in KINDS:
            ends = self.intervals(kind).to_numpy()
            columns |= {f"{kind}_lower": ends[:, 0], f"{kind}_upper": ends[:, 1]}
        return pd.DataFrame(columns, index=[*self.names])

    def intervals(self, kind: str = "bca") -> pd.DataFrame:
        """The 95 % intervals of a kind, "percentile", "basic" or "bca"; columns lower, upper.

        They are cut at the limits of the hyperparameters. Raises InputsError for another kind.
        """
        alpha = self.alpha
        if kind not in KINDS:
            raise InputsError(f"intervals '{kind}'", f"choose {', '.join(KINDS)}")
        if kind == "percentile":
            ends = percentile(alpha)
        elif kind == "basic":
            ends = basic(self.estimate, alpha)
        else:
            ends = bias_corrected(self.estimate, alpha, self.influence)
        ends = np.clip(ends, self.limits[:, :1], self.limits[:, 1:])
        return pd.DataFrame(ends, index=[*self.names], columns=["lower", "upper"])

    def to_dict(self) -> dict[str, Any]:
        """The content of bootstrap.json as plain dictionaries, lists, numbers and texts."""
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
    """Estimate the hyperparameters again from each of `replicates` other data sets.

    "parametric" data are drawn for the same experiments under the identified law and noise (Efron,
    1979). "nonparametric" data are the same number of experiments, drawn with replacement; they
    stay valid where the law or the noise is wrong. For each data set the likelihood is maximized
    from the estimate. Response surfaces stay the same, and with them no runs are made.

    Each replicate has its own seed. So the result does not depend on the number of `workers`
    (processes of this machine), and more replicates begin with the same ones. With a `folder` each
    finished replicate is stored there in bootstrap.jsonl, and a call with the same fit, kind and
    seed continues it.

    Raises InputsError for fewer than two replicates or another kind. Raises AleatorError for an
    identification that was read from a file, and for a bootstrap.jsonl of another study. Cost: one
    maximization for each replicate, some ten evaluations of the likelihood.

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
    return bootstrapped(found.fit, replicates, kind, seed, workers, folder, progress or Silent())


def bootstrapped(
    fit: Fit,
    replicates: int,
    kind: str,
    seed: int,
    workers: int,
    folder: str | Path | None,
    progress: Progress,
) -> Bootstrap:
    """The bootstrap of a fit, continued from the replicates stored in the folder, if any."""
    progress.stage("bootstrap")
    if kind != PARAMETRIC and fit.inputs.grouping is not None and not np.any(fit.cluster):
        raise InputsError(
            "all experiments share parameters, directly or through others, and none can be drawn "
            "by itself",
            f'take kind = "{PARAMETRIC}"',
        )
    file = None
    if folder is not None:
        file = ReplicateFile(Path(folder) / FILE, head_of(fit, kind, seed))
    done = file.replicates() if file is not None else {}
    left = [number for number in range(replicates) if number not in done]
    parcel = packed(fit) if workers > 1 and left else None
    with closing(_made(fit, parcel, kind, seed, left, workers)) as made:
        for replicate in made:
            done[replicate.number] = replicate
            if file is not None:
                file.add(asdict(replicate))
            progress.update(f"{len(done)} of {replicates} replicates", len(done), replicates)
    own = fit.inference.identified
    limits = np.column_stack(limits_of(fit.hyperparameters, own))
    return Bootstrap(
        kind, seed, tuple(fit.hyperparameters[k].name for k in own), fit.alpha[own],
        limits, influence(fit), tuple(done[r] for r in range(replicates)),
        workers > 1 and bool(left) and parcel is None,
    )  # fmt: skip


def influence(fit: Fit) -> Array:
    """The influence H^-1 s_l (N, F) of experiment l on the estimates, with its score s_l.

    H is the information matrix. The influence on an estimate at a limit is zero. Experiments that
    share parameters count together; if all do, none has an influence.
    """
    inference, scores = fit.inference, fit.scored().independent
    found = np.zeros((len(scores), inference.identified.size))
    if inference.positive and len(scores) > 1:
        inside = np.isin(inference.identified, inference.free)
        found[:, inside] = scores[:, inference.free] @ inference.covariance
    return found


@single_threaded
def replicated(fit: Fit, kind: str, seed: int, number: int) -> Refitted:
    """Compute replicate `number`, which depends only on fit, kind, seed and number."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    if kind == PARAMETRIC:
        end = refitted(fit.drawn(rng))
    else:
        cluster = fit.cluster
        count = int(cluster.max()) + 1
        drawn = rng.multinomial(count, np.full(count, 1.0 / count)).astype(float)
        end = refitted(fit, drawn[cluster])
    alpha = end.fit.alpha[fit.inference.identified]
    return Refitted(number, tuple(alpha.tolist()), end.value, ARRIVED if end.arrived else LEFT)


def _made(
    fit: Fit, parcel: bytes | None, kind: str, seed: int, numbers: Sequence[int], workers: int
) -> Generator[Refitted, None, None]:
    """The replicates with these numbers, computed in this process or in several.

    `parcel` is the serialized fit for other processes; with None all work is done in this one.
    """
    if parcel is None:
        for number in numbers:
            yield replicated(fit, kind, seed, number)
        return
    pieces = {number: (kind, seed, number) for number in numbers}
    with closing(in_processes(parcel, replicated, pieces, workers)) as made:
        for _, replicate in made:
            yield replicate
