"""What an identification was made with, held so that more can be asked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aleator.errors import AleatorError, InputsError
from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.inference.fit import AnyFit, Fit
from aleator.laws import Hyperparameter
from aleator.likelihood.model import Model
from aleator.observations.experiments import Conditions, Experiments, unmeasured
from aleator.observations.responses import Transform
from aleator.progress import Progress
from aleator.results.law import JointLaw
from aleator.results.values import Estimate, in_order
from aleator.simulators import Runner, Simulator, as_runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.decide.ground import Ground
from aleator.tasks.decide.table import tabled, tails
from aleator.tasks.outcome import predicted
from aleator.tasks.outcome_fit import OutcomeFit
from aleator.tasks.refinement.choice import under_law
from aleator.types import Array


class Session(Protocol):
    """What can be asked of an identification beside its values.

    Raises AleatorError for what was not kept: an identification that was read from a file.
    """

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha."""

    @property
    def fit(self) -> Fit | None:
        """The likelihood with its data at the answer; None where it was read from a file."""

    def law(
        self,
        values: Mapping[str, float | Estimate],
        at: Mapping[str, object] | pd.Series | None = None,
    ) -> JointLaw:
        """The joint law at these values of the hyperparameters, and `at` these covariates."""

    def log_likelihood(
        self, alpha: Mapping[str, float] | ArrayLike, values: Mapping[str, float | Estimate]
    ) -> float:
        """The log-likelihood at alpha; what is not named has these values."""

    def predict(
        self,
        conditions: Conditions | pd.DataFrame,
        plausible: AlphaDraws,
        transform: Transform,
        quantiles: tuple[float, ...],
        progress: Progress | None,
        of: str | None = None,
        noise: bool = True,
    ) -> pd.DataFrame:
        """The table of `Identification.predict` under plausible alphas, or the estimate alone."""

    def ground(
        self,
        conditions: Conditions | pd.DataFrame,
        alpha: Array,
        transform: Transform,
        of: str | None = None,
        noise: bool = True,
    ) -> Ground:
        """New experiments, or those `of` measured ones, and what makes their outcomes."""

    def exact_fit(self) -> Fit | None:
        """The fit by the simulator itself, which makes runs; None where it has no surfaces."""

    def runner_on(self, conditions: Conditions) -> Runner:
        """What makes the runs of other experiments, as that of the identification did."""

    def fit_on(
        self, candidates: Conditions, alpha: Array, runner: Runner, progress: Progress
    ) -> Fit:
        """The fit of experiments that were not made, at alpha: their outcomes are unknown.

        `drawn` and `seeing` give it some. Runs are made for surfaces where those are needed.
        """


@dataclass(frozen=True, eq=False)
class OutcomeSession:
    """Model, simulator, and the fit on the last surfaces; None for what is not at hand.

    `model` holds the inputs and the choices of surfaces and density; `tested` are the
    experiments where there is no fit that has them.
    """

    model: Model | None
    simulator: Runner | Simulator | None
    fit: OutcomeFit | None
    tested: Experiments | None = None

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of the model; none without one."""
        return () if self.model is None else self.model.hyperparameters

    def law(
        self,
        values: Mapping[str, float | Estimate],
        at: Mapping[str, object] | pd.Series | None = None,  # noqa: ARG002  it is the same
    ) -> JointLaw:
        """The joint law at these values of the hyperparameters."""
        if self.model is None:
            raise missing("the law needs the inputs", "aleator.load(path, inputs=...)")
        alpha = in_order(values, self.model.hyperparameters)
        return JointLaw(self.model.inputs, alpha[: self.model.inputs.size])

    def predict(
        self,
        conditions: Conditions | pd.DataFrame,
        plausible: AlphaDraws,
        transform: Transform,
        quantiles: tuple[float, ...],
        progress: Progress | None,
        of: str | None = None,
        noise: bool = True,
    ) -> pd.DataFrame:
        """The table of `Identification.predict`; at the estimate alone by the study's density."""
        ground = self.ground(conditions, plausible.estimate, transform, of, noise)
        if progress is not None:
            progress.stage("prediction")
        if not plausible.certain:
            return tabled(ground, plausible, quantiles, progress)
        assert self.model is not None
        found = predicted(ground.runner, self.model, plausible.estimate, quantiles, progress)
        status = found.pop("status")
        for name, column in tails(ground).items():
            found[name] = column
        return found.assign(status=status)

    def ground(
        self,
        conditions: Conditions | pd.DataFrame,
        alpha: Array,  # noqa: ARG002  one interface for all sessions
        transform: Transform,
        of: str | None = None,
        noise: bool = True,  # noqa: ARG002  there is none
    ) -> Ground:
        """New experiments, on surfaces."""
        if of is not None:
            raise InputsError(
                f"of '{of}': one outcome says too little of the parameters of its experiment",
                "predict new experiments: leave `of` out",
            )
        model = self.model
        if model is None or self.simulator is None:
            raise missing(
                "a prediction needs the simulator and the inputs",
                "aleator.load(path, simulator=..., inputs=..., noise=...)",
            )
        if isinstance(conditions, pd.DataFrame):
            conditions = Conditions.from_frame(conditions, transform=transform)
        return Ground(
            conditions,
            model.inputs,
            None,
            as_runner(self.simulator, conditions, model.inputs.names),
            False,
            model.surfaces or ResponseSurface(),
            tested=self.tested if self.fit is None else self.fit.table,
        )

    def exact_fit(self) -> None:
        """None: its density is that of all nodes, which no runs replace."""

    def runner_on(self, conditions: Conditions) -> Runner:
        """Runs of the simulator, made here and kept in no store."""
        if self.model is None or self.simulator is None:
            raise missing("this needs the simulator", "aleator.load(path, simulator=..., ...)")
        return as_runner(self.simulator, conditions, self.model.inputs.names)

    def fit_on(
        self, candidates: Conditions, alpha: Array, runner: Runner, progress: Progress
    ) -> OutcomeFit:
        """On surfaces of the candidates' own, as exact as a prediction's."""
        fit = kept(self.fit)
        ready = under_law(runner, fit.problem.model, alpha, progress)
        problem = ready.given(np.full(len(candidates.ids), np.nan))
        return OutcomeFit(problem, alpha, fit.inference, unmeasured(candidates))

    def log_likelihood(
        self, alpha: Mapping[str, float] | ArrayLike, values: Mapping[str, float | Estimate]
    ) -> float:
        """The honest log-likelihood at alpha; what is not named has these values."""
        fit = kept(self.fit)
        at = given_values(alpha, values, fit.hyperparameters)
        return fit.problem.likelihood.evaluate(at).likelihood


def given_values(
    alpha: Mapping[str, float] | ArrayLike,
    values: Mapping[str, float | Estimate],
    hyperparameters: Sequence[Hyperparameter],
) -> Array:
    """The alpha (K,) of names or of an array; what is not named has these values.

    Raises InputsError for a name that is unknown and a value beyond its limits.
    """
    if isinstance(alpha, Mapping | pd.Series):
        given = {str(name): value for name, value in alpha.items()}
    else:
        given = _named(np.asarray(alpha, dtype=np.float64), [h.name for h in hyperparameters])
    return in_order({**values, **given}, hyperparameters)


def _named(alpha: Array, names: Sequence[str]) -> dict[str, float]:
    if alpha.shape != (len(names),):
        raise InputsError(
            f"alpha has shape {alpha.shape}, and there are {len(names)} hyperparameters",
            f"give one number for each of {', '.join(names)}",
        )
    return dict(zip(names, alpha.tolist(), strict=True))


def kept(fit: AnyFit | None) -> AnyFit:
    """The fit. Raises AleatorError where the identification was read from a file."""
    if fit is None:
        raise missing(
            "this needs the surfaces, which are not saved",
            "identify again: with a Store no run is repeated",
        )
    return fit


def missing(what: str, remedy: str) -> AleatorError:
    """The error of an identification that was read from a file."""
    return AleatorError(f"{what}; this identification was read from a file", remedy)
