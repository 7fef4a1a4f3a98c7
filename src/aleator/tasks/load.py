"""Reading an identification from its document."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aleator.errors import InputsError
from aleator.laws.inputs import Inputs
from aleator.observations.experiments import Experiments
from aleator.observations.noise import Noise
from aleator.results.schema import read_answer
from aleator.results.values import in_order
from aleator.simulators import Runner, Simulator, as_simulator
from aleator.surrogates import ResponseSurface
from aleator.tasks.asked import DEFAULT_PROPAGATION
from aleator.tasks.identification import Identification
from aleator.tasks.session import Runners, Session, runners, runners_like

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
    runner = None
    if simulator is not None:
        runner = _runners(found, as_simulator(simulator, vectorized), inputs, experiments)
    session = Session.again(found, path, inputs, noise, experiments, propagation, density, runner)
    try:
        in_order(found.alpha, session.hyperparameters)
    except InputsError as error:
        raise InputsError(
            f"{path} was identified with other inputs or another noise: {error.problem}",
            "give those of the identification",
        ) from None
    return replace(found, session=session)


def _runners(
    found: Identification, simulator: Simulator, inputs: Inputs, experiments: Experiments | None
) -> Runners:
    """What makes runs with the simulator, which gets arrays of what varied within experiments."""
    if not found.observations:
        return runners(simulator, inputs.names)
    if experiments is not None:
        return runners_like(Runner(simulator, experiments, inputs.names), experiments)
    varying = {name for entry in found.observations for name in entry.conditions}
    return lambda asked: Runner(simulator, asked, inputs.names, varying=varying)
