"""The posterior distribution of alpha from experiments and priors: draws, without new runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array
from aleator.errors import AleatorError, InputsError, short
from aleator.inference.fit import Fit
from aleator.inference.information import INTERVALS
from aleator.inference.posterior import (
    POSTERIOR,
    SAMPLER,
    ChainPiece,
    Chains,
    Convergence,
    RealLine,
    convergence,
    installed,
    sampled,
    scaled,
)
from aleator.laws import classes
from aleator.laws.inputs import drawn
from aleator.results import printed
from aleator.tasks.finished_work import FinishedWork, head_of
from aleator.tasks.identification import Identification

if TYPE_CHECKING:
    from xarray import DataTree


FILE = "posterior.jsonl"
"""The file of finished draws in the folder of the results."""


@dataclass(frozen=True)
class DrawnReportSettings:
    """Settings of the report on the draws of a posterior; the values are chosen by judgement."""

    looked_at: int = 16
    """The number of draws at which the errors of quadrature and of the surfaces' region are
    checked."""
    fewest: int = 10
    """The least number of draws of a chain."""
    longer: float = 1.3
    """The safety factor of the recommended number of draws."""
    shown: float = 0.2
    """The seconds between two messages of the progress display."""
    most_kept: int = 20_000_000
    """The largest number of log-densities (draws times experiments) that are exported."""
    broken: float = 0.01
    """The share of divergent trajectories above which there is a warning."""
    uneven: float = 0.1
    """The standard deviation of the quadrature error of the log-likelihood over the draws above
    which there is a warning."""
    outside: float = 0.01
    """The share of the drawn laws outside the surfaces' region above which there is a warning."""


REPORTED = DrawnReportSettings()


@dataclass(frozen=True, eq=False, repr=False)
class Posterior:
    """The posterior draws (C, D, G) of the G free hyperparameters `names`, in C chains of D draws.

    `fixed` has the values of all other hyperparameters, `estimates` (G,) the maximum likelihood
    estimates. `chains` has the log-likelihood and sampler statistics of each draw. `ids` are the N
    experiments. `nodes_error` is the standard deviation over the draws of the log-likelihood's
    quadrature error. `outside` is the share of the drawn laws outside the region of the response
    surfaces. `sound` and `consistent` are the verdicts of the identification.

    >>> from aleator import Free, Inputs, Check, Noise, Normal, identify, posterior
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.0, 2.0, prior=Normal(1.2, 0.1)), sd=0.1)})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y", noise=Noise(0.1),
    ...                  vectorized=True, verification=Check(0))
    >>> drawn = posterior(found, draws=100, chains=2)
    >>> drawn.draws.shape, list(drawn.frame().columns)
    ((2, 100, 1), ['chain', 'draw', 'x.mean', 'log_likelihood', 'log_prior'])
    >>> bool(abs(drawn.table().loc["x.mean", "mean"] - found.values["x.mean"]) < 0.05)
    True
    """

    names: tuple[str, ...]
    draws: Array
    chains: Chains
    convergence: Convergence
    estimates: Array
    fixed: dict[str, float]
    priors: tuple[str, ...]
    ids: tuple[str, ...]
    outcome: str
    seed: int
    seconds: float
    nodes_error: float
    outside: float
    sound: bool = True
    consistent: bool | None = None

    def __repr__(self) -> str:
        chains, draws, _ = self.draws.shape
        return f"{chains} chains of {draws} draws\n{self.table().round(4)}\n{self.verdict}"

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        chains, draws, _ = self.draws.shape
        return printed.shown(f"{chains} chains of {draws} draws", self.table(), self.verdict)

    @property
    def converged(self) -> bool:
        """Whether every R-hat is below 1.01 and every effective sample size above 400."""
        return self.convergence.converged

    @property
    def verdict(self) -> str:
        """A sentence that says whether the chains converged, and what to do if not."""
        found = self.convergence
        worst = self.names[int(np.argmax(found.r_hat))]
        diagnosis = (
            f"largest R-hat {np.max(found.r_hat):.4f} ({worst}), smallest effective sample size "
            f"{found.least:.0f}"
        )
        if self.converged:
            return f"Converged: {diagnosis}."
        wanted = []
        if not found.mixed:
            wanted.append(f"R-hat is not below {POSTERIOR.largest_r_hat}")
        if not found.enough:
            wanted.append(f"the effective sample size is not above {POSTERIOR.least_ess:.0f}")
        return (
            f"NOT converged: {' and '.join(wanted)} ({diagnosis}). "
            f"Take more draws: --draws {self._enough}."
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Further warnings about the draws, a sentence or two each."""
        broken = float(np.mean(self.chains.divergent))
        found = []
        if not self.sound:
            found.append(
                "The identification that they begin from was not computed soundly: deal with its "
                "warnings first (aleator identify)."
            )
        if self.consistent is False:
            found.append(
                "The model is not consistent with the experiments, and a posterior of a wrong "
                "model is as narrow as one of a right one: aleator identify says what is wrong."
            )
        if broken > REPORTED.broken:
            found.append(
                f"{100 * broken:.1f} % of the trajectories broke off, at an end of the posterior "
                "or where it is very curved: what lies there may be drawn too rarely. Compare with "
                "the intervals of aleator identify."
            )
        if self.nodes_error > REPORTED.uneven:
            found.append(
                f"More nodes change the log-likelihood by {self.nodes_error:.2g} more at some "
                "draws than at others: the posterior is that of these nodes, and off by as much."
            )
        if self.outside > REPORTED.outside:
            found.append(
                f"{100 * self.outside:.1f} % of the laws that were drawn lies beyond the region of "
                "the surfaces, where these are held on. Narrow the limits, or give a prior."
            )
        return tuple(found)

    def table(self) -> pd.DataFrame:
        """A table with a row for each hyperparameter: mean, sd, median, 95 % interval, diagnostics.

        The columns are ``mean``, ``sd``, ``median``, ``lower`` and ``upper`` (the quantiles of 2.5
        and 97.5 %), ``r_hat``, ``ess_bulk``, ``ess_tail``.
        """
        flat = self.draws.reshape(-1, len(self.names))
        low, high = INTERVALS.ends
        lower, median, upper = np.quantile(flat, [low, 0.5, high], axis=0)
        columns = {
            "mean": flat.mean(axis=0), "sd": flat.std(axis=0, ddof=1), "median": median,
            "lower": lower, "upper": upper, "r_hat": self.convergence.r_hat,
            "ess_bulk": self.convergence.bulk, "ess_tail": self.convergence.tail,
        }  # fmt: skip
        return pd.DataFrame(columns, index=list(self.names))

    def frame(self) -> pd.DataFrame:
        """A table with a row for each draw: its chain and number, alpha, log L and log prior."""
        chains, draws, size = self.draws.shape
        flat = self.draws.reshape(-1, size)
        return pd.DataFrame(
            {
                "chain": np.repeat(np.arange(chains), draws),
                "draw": np.tile(np.arange(draws), chains),
                **dict(zip(self.names, flat.T, strict=True)),
                "log_likelihood": self.chains.likelihood.ravel(),
                "log_prior": self.chains.prior.ravel(),
            }
        )

    def data(self) -> DataTree:
        """The draws as an xarray.DataTree, the format of ArviZ since version 1.

        The groups are ``posterior`` with a variable for each hyperparameter, ``sample_stats``
        (``lp``, ``diverging``, ``n_steps``, ``acceptance_rate``), ``log_likelihood`` of each
        experiment (left out above 20 million numbers), and ``constant_data`` with the fixed
        hyperparameters. Raises AleatorError if ArviZ is not installed.
        """
        groups: dict[str, dict[str, Any]] = {
            "posterior": {_key(name): self.draws[:, :, g] for g, name in enumerate(self.names)},
            "sample_stats": {
                "lp": self.chains.likelihood + self.chains.prior,
                "diverging": self.chains.divergent,
                "n_steps": self.chains.steps,
                "acceptance_rate": self.chains.accepted,
            },
        }
        outcome = _key(self.outcome)
        if self.chains.each.size <= REPORTED.most_kept:
            groups["log_likelihood"] = {outcome: self.chains.each}
        if self.fixed:
            groups["constant_data"] = {_key(n): np.array(v) for n, v in self.fixed.items()}
        made: DataTree = installed("arviz_base").from_dict(
            groups,
            dims={outcome: ["experiment"]},
            coords={"experiment": list(self.ids)},
            attrs={"posterior": {"inference_library": "mici", "seed": self.seed}},
        )
        return made

    def save(self, path: str | Path) -> None:
        """Write `data` to a netCDF file, which ``xarray.open_datatree`` and ArviZ can read.

        Raises AleatorError if the file cannot be written, or h5netcdf is not installed.
        """
        installed("h5netcdf")
        try:
            self.data().to_netcdf(path, engine="h5netcdf")
        except OSError as error:
            raise AleatorError(
                f"{path} cannot be written: {error.strerror or error}", "choose another place"
            ) from None

    def to_dict(self) -> dict[str, Any]:
        """The content of posterior.json: the table and all other results, without the draws."""
        chains, draws, _ = self.draws.shape
        table = self.table()
        table.insert(0, "estimate", self.estimates)
        return {
            "hyperparameters": {
                str(name): {str(key): float(value) for key, value in row.items()}
                for name, row in table.iterrows()
            },
            "fixed": dict(self.fixed),
            "priors": list(self.priors),
            "experiments": len(self.ids),
            "chains": chains,
            "draws": draws,
            "warm_up": POSTERIOR.warm_up,
            "evaluations": self.chains.evaluations,
            "divergent": int(np.sum(self.chains.divergent)),
            "nodes_error": self.nodes_error,
            "outside": self.outside,
            "converged": self.converged,
            "verdict": self.verdict,
            "warnings": list(self.warnings),
            "seed": self.seed,
            "seconds": self.seconds,
        }

    @property
    def _enough(self) -> int:
        """The recommended number of draws of each chain, from the present effective sample size."""
        draws = self.draws.shape[1]
        factor = max(2.0, REPORTED.longer * POSTERIOR.least_ess / max(self.convergence.least, 1.0))
        return int(np.ceil(draws * min(factor, 100.0) / 100.0) * 100)


def _key(name: str) -> str:
    """A name that netCDF accepts: a slash, which would start a group there, is replaced."""
    return name.replace("/", " over ")


def posterior(
    found: Identification,
    draws: int = 1000,
    chains: int = 4,
    seed: int = 0,
    progress: Progress | None = None,
    settings: DrawnReportSettings = REPORTED,
    folder: str | Path | None = None,
) -> Posterior:
    """Draw from the posterior p(alpha | y) ~ L(alpha) p(alpha) of an identification.

    L is the likelihood, zero where an outcome is impossible. p(alpha) is the product of the priors;
    a hyperparameter without a prior has a flat one between its limits. At least two `chains` of
    `draws` each are made by the No-U-Turn sampler with the exact score, starting near the mode. The
    same seed gives the same draws. With a `folder` every 50 draws of a chain are kept there in
    posterior.jsonl, up to 20 million numbers: after an interruption, and for more draws or chains,
    a call with the same identification and seed goes on from there, to the same draws.

    Raises AleatorError if the extra `bayes` is not installed, or if the identification was read
    from a file and has no fit (see `Identification.with_fit`), and InputsError if nothing is
    identified. Cost: some three to seven evaluations of the likelihood for each draw; with response
    surfaces no simulator runs.

    >>> import pandas as pd
    >>> from aleator import Free, Inputs, Check, Noise, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.0, 2.0, prior=Normal(1.2, 0.1)), sd=0.1)})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y", noise=Noise(0.1),
    ...                  vectorized=True, verification=Check(0))
    >>> drawn = posterior(found, draws=50, chains=2)
    >>> bool(abs(drawn.table().loc["x.mean", "mean"] - found.values["x.mean"]) < 0.05)
    True
    """
    for package in (SAMPLER, "arviz_stats"):
        installed(package)
    _require(draws, chains, settings)
    found = found.with_fit(progress)
    made = sampled_posterior(
        found.fit, draws, chains, seed, progress or Silent(), settings=settings, folder=folder
    )
    return replace(made, outcome=found.outcome, sound=found.sound, consistent=found.consistent)


def sampled_posterior(
    fit: Fit,
    draws: int,
    chains: int,
    seed: int,
    progress: Progress,
    settings: DrawnReportSettings = REPORTED,
    folder: str | Path | None = None,
) -> Posterior:
    """The posterior draws of a fit, without the verdicts of its identification."""
    began, moving = time.perf_counter(), fit.inference.identified
    if not moving.size:
        raise InputsError(
            "nothing is identified: every hyperparameter is a number",
            "give one limits: Free(lower, upper), {lower = ..., upper = ...}",
        )
    progress.stage("posterior")
    density = RealLine(fit.likelihood.honest(), fit.hyperparameters, fit.alpha, moving)
    scale = scaled(density, density.u_of(fit.alpha))
    tell = _listener(progress, settings)
    if folder is None or draws * chains * fit.count > settings.most_kept:
        made = sampled(density, scale, draws, chains, seed, tell)
    else:
        file = FinishedWork(Path(folder) / FILE, head_of(fit, "posterior", seed))
        known = _pieces(file)
        made = sampled(
            density, scale, draws, chains, seed, tell, known, lambda piece: file.add(piece.line())
        )
    alphas = np.array([[_in_order(density.alpha_of(u), fit) for u in chain] for chain in made.u])
    own = alphas[:, :, moving]
    few = alphas.reshape(-1, alphas.shape[2])
    few = few[np.linspace(0, len(few) - 1, settings.looked_at).astype(np.intp)]
    names = [h.name for h in fit.hyperparameters]
    return Posterior(
        names=tuple(names[k] for k in moving),
        draws=own,
        chains=made,
        convergence=convergence(own),
        estimates=fit.alpha[moving],
        fixed={n: float(fit.alpha[k]) for k, n in enumerate(names) if k not in moving},
        priors=tuple(h.name for h in fit.hyperparameters if h.prior is not None),
        ids=fit.cluster_names,
        outcome=fit.table.outcome_name,
        seed=seed,
        seconds=time.perf_counter() - began,
        nodes_error=_nodes_error(fit, few),
        outside=_outside(fit, few, seed),
    )


def _pieces(file: FinishedWork) -> list[ChainPiece]:
    """The pieces of chains in a file; raises AleatorError for a line that has none."""
    found = []
    for number, line in enumerate(file.begun(), start=2):
        try:
            found.append(ChainPiece.read(line))
        except (AttributeError, KeyError, TypeError, ValueError):
            raise AleatorError(
                f"{short(file.path)}: line {number} has no draws of a chain",
                "delete the line, and its draws are made again",
            ) from None
    return found


def _require(draws: int, chains: int, settings: DrawnReportSettings) -> None:
    if draws < settings.fewest:
        raise InputsError(
            f"draws = {draws} are too few", f"take {settings.fewest} at least, better 1000"
        )
    if chains < 2:
        raise InputsError(f"chains = {chains}: R-hat compares chains", "take 2 at least, better 4")


def _listener(progress: Progress, settings: DrawnReportSettings) -> Callable[[int, int], None]:
    last = [0.0]

    def tell(done: int, total: int) -> None:
        now = time.perf_counter()
        if now - last[0] > settings.shown or done == total:
            last[0] = now
            progress.update(f"step {done} of {total}", done, total)

    return tell


def _in_order(alpha: Array, fit: Fit) -> Array:
    """alpha (K,) with the equal components of a mixture sorted."""
    size = fit.inputs.size
    return np.concatenate([classes.ordered(fit.inputs, alpha[:size]), alpha[size:]])


def _nodes_error(fit: Fit, alphas: Array) -> float:
    """The standard deviation over alphas (A, K) of the change of log L by more quadrature nodes."""
    changes = np.array([fit.likelihood.more_nodes(alpha) for alpha in alphas])
    return float(np.std(changes[np.isfinite(changes)])) if np.any(np.isfinite(changes)) else 0.0


def _outside(fit: Fit, alphas: Array, seed: int) -> float:
    """The share of parameters, drawn under alphas (A, K), outside the response surfaces' region."""
    rng = np.random.default_rng(seed)
    size, low, high = fit.inputs.size, *fit.likelihood.region.T
    beyond = [
        np.any((x < low) | (x > high), axis=1)
        for x in (drawn(fit.inputs, alpha[:size], fit.count, rng) for alpha in alphas)
    ]
    return float(np.mean(beyond))
