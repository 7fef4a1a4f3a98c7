"""What an identification was made with, held so that more can be asked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aleator.errors import AleatorError, InputsError
from aleator.likelihood.likelihood import Likelihood
from aleator.likelihood.model import Model
from aleator.observations.experiments import Conditions
from aleator.observations.transform import Transform
from aleator.progress import Progress
from aleator.simulators import Simulator, as_runner
from aleator.tasks.predict import predicted
from aleator.tasks.results.law import JointLaw
from aleator.tasks.results.values import Estimate, in_order
from aleator.types import Array


@dataclass(frozen=True, eq=False)
class Session:
    """Model, simulator, and the likelihood on the last surfaces; None for what is not at hand.

    `model` holds the inputs, the noise and the choices of surfaces and density.
    """

    model: Model | None
    simulator: Simulator | None
    likelihood: Likelihood | None

    def law(self, values: Mapping[str, Estimate]) -> JointLaw:
        """The joint law at these values of the hyperparameters."""
        if self.model is None:
            raise _missing("the law needs the inputs", "aleator.load(path, inputs=...)")
        alpha = in_order(values, self.model.hyperparameters)
        return JointLaw(self.model.inputs, alpha[: self.model.inputs.size])

    def predict(
        self,
        conditions: Conditions | pd.DataFrame,
        values: Mapping[str, Estimate],
        transform: Transform,
        quantiles: tuple[float, ...],
        progress: Progress | None,
    ) -> pd.DataFrame:
        """The table of `aleator.predict`."""
        if self.model is None or self.simulator is None:
            raise _missing(
                "a prediction needs the simulator and the inputs",
                "aleator.load(path, simulator=..., inputs=..., noise=...)",
            )
        if isinstance(conditions, pd.DataFrame):
            conditions = Conditions.from_frame(conditions, transform=transform)
        runner = as_runner(self.simulator, conditions, self.model.inputs.names)
        alpha = in_order(values, self.model.hyperparameters)
        return predicted(runner, self.model, alpha, quantiles, progress)

    def log_likelihood(
        self, alpha: Mapping[str, float] | ArrayLike, values: Mapping[str, Estimate]
    ) -> float:
        """The honest log-likelihood at alpha; what is not named has these values."""
        if self.likelihood is None:
            raise _missing(
                "the log-likelihood needs the surfaces, which are not saved",
                "identify again: with a Store no run is repeated",
            )
        hyperparameters = self.likelihood.hyperparameters
        if isinstance(alpha, Mapping | pd.Series):
            given = {str(name): value for name, value in alpha.items()}
        else:
            given = _named(np.asarray(alpha, dtype=np.float64), [h.name for h in hyperparameters])
        at = in_order({**values, **given}, hyperparameters)
        for value, h in zip(at, hyperparameters, strict=True):
            if not h.lower <= value <= h.upper:
                raise InputsError(
                    f"{h.name} = {value:g} is outside its limits [{h.lower:g}, {h.upper:g}]",
                    "choose a value between them",
                )
        return self.likelihood.evaluate(at).total


def _named(alpha: Array, names: Sequence[str]) -> dict[str, float]:
    if alpha.shape != (len(names),):
        raise InputsError(
            f"alpha has shape {alpha.shape}, and there are {len(names)} hyperparameters",
            f"give one number for each of {', '.join(names)}",
        )
    return dict(zip(names, alpha.tolist(), strict=True))


def _missing(what: str, remedy: str) -> AleatorError:
    return AleatorError(f"{what}; this identification was read from a file", remedy)
