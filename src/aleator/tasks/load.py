"""Reading an identification from its document."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aleator.errors import AleatorError, InputsError
from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.observations.errors import Noise
from aleator.observations.experiments import Experiments
from aleator.observations.responses import Response, Transform
from aleator.results.schema import read_answer
from aleator.results.values import in_order
from aleator.simulators import Runner, Simulator, as_simulator
from aleator.surrogates import ResponseSurface
from aleator.tasks.asked import DEFAULT_PROPAGATION
from aleator.tasks.identification import Identification
from aleator.tasks.individual.session import IndividualSession, Runners, runners, session_of
from aleator.tasks.session import OutcomeSession, Session

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


def load(
    path: str | Path,
    *,
    simulator: Callable[..., Any] | Simulator | None = None,
    inputs: Inputs | None = None,
    vectorized: bool = False,
    noise: Noise | Mapping[str, Noise] | None = None,
    experiments: Experiments | None = None,
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
    density: Density | None = None,
) -> Identification:
    """Read an identification that `found.save` or the command `aleator identify` wrote.

    All values come back as they were. What is no value is given again, as `identify` takes it:
    `inputs` and `noise` for `found.law`, `simulator` as well for `found.predict`; the `experiments`
    too for predictions of one that was measured, and where a law follows covariates. Raises
    AleatorError that names the file and the key where it is no identification, InputsError where
    the inputs and the noise have other hyperparameters than those that were identified.

    >>> from tempfile import TemporaryDirectory
    >>> import pandas as pd
    >>> from aleator import Free, Check, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y",
    ...                  verification=Check(0))
    >>> with TemporaryDirectory() as folder:
    ...     found.save(f"{folder}/found.json")
    ...     again = load(f"{folder}/found.json", inputs=law)
    >>> again == found, again.law.marginals["x"].mean
    (True, 1.031)
    """
    found = Identification.from_document(read_answer(path))
    if inputs is None:
        return found
    made = None if simulator is None else as_simulator(simulator, vectorized)
    session: Session
    if found.observations:
        session = _individual_session(found, path, made, inputs, noise, experiments, propagation)
    else:
        if noise is not None:
            raise InputsError(
                f"{path} was identified from exact outcomes, without noise", "leave the noise out"
            )
        session = OutcomeSession(Model.of(inputs, propagation, density), made, None, experiments)
    try:
        in_order(found.alpha, session.hyperparameters)
    except InputsError as error:
        raise InputsError(
            f"{path} was identified with other inputs or another noise: {error.problem}",
            "give those of the identification",
        ) from None
    return replace(found, session=session)


def _individual_session(
    found: Identification,
    path: str | Path,
    simulator: Simulator | None,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise] | None,
    experiments: Experiments | None,
    propagation: ResponseSurface | Collocation,
) -> IndividualSession:
    regressed = inputs.regressed and inputs.covariate_model is None
    if noise is None or (experiments is None and regressed):
        lacking = "noise" if noise is None else "experiments, whose covariates make the law,"
        raise AleatorError(
            f"what can be asked of {path} needs the {lacking} too",
            f"aleator.load(path, ..., {'noise' if noise is None else 'experiments'}=...)",
        )
    surfaces = propagation if isinstance(propagation, ResponseSurface) else ResponseSurface()
    seen = tuple(Response(name, Transform(each)) for name, each in found.responses.items())
    return session_of(
        found.propagation, inputs, noise, seen, experiments, surfaces,
        _runners(found, simulator, inputs, experiments),
    )  # fmt: skip


def _runners(
    found: Identification,
    simulator: Simulator | None,
    inputs: Inputs,
    experiments: Experiments | None,
) -> Runners | None:
    """What makes runs with the simulator, which gets arrays of what varied within experiments."""
    if simulator is None:
        return None
    if experiments is not None:
        return runners(Runner(simulator, experiments, inputs.names), experiments)
    varying = {name for entry in found.observations for name in entry.conditions}
    return lambda asked: Runner(simulator, asked, inputs.names, varying=varying)
