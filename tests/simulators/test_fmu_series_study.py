"""Series of an FMU in study.toml, and the law that is identified from them."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fmus.truths import cooled
from identifications import unjudged
from scipy.special import logsumexp
from scipy.stats import norm

from aleator import Free, Inputs, Noise, Normal
from aleator.errors import SimulatorError, StudyError
from aleator.observations.experiments import Experiments
from aleator.simulators.fmu import Final, FMUSimulator, Operation
from aleator.study import load_study

HERE = Operation(isolated=False)
K = {"k": "surface.k"}


STUDY = """
[experiments]
file = "table.csv"
outcome = "cooled"
[simulator]
fmu = "cooling2.fmu"
variables = {{k = "surface.k"}}
{keys}
[parameters.k]
law = "truncated_normal"
box = [0.5, 2.0]
"""


def study(fmu: Path, keys: str) -> Path:
    table = {"time": [0.5, 1.25], "cooled": [350.0, 330.0]}
    pd.DataFrame(table).to_csv(fmu.parent / "table.csv", index=False)
    path = fmu.parent / "study.toml"
    path.write_text(STUDY.format(keys=keys), encoding="utf-8")
    return path


def test_a_study_takes_times_from_its_table(fmus: dict[int, Path]) -> None:
    loaded = load_study(study(fmus[2], 'outcome = "T"\nstop_time = "time"\nisolated = false'))
    found = loaded.runner()([0, 1], [[1.0], [2.0]])
    assert found == pytest.approx([cooled(1.0, np.array(0.5)), cooled(2.0, np.array(1.25))])


def test_a_study_names_a_series_and_its_responses(fmus: dict[int, Path]) -> None:
    """A response may be called as a key is, if its outcome is a table."""
    outcome = 'outcome = {warmth = "T - ambient", value = {variable = "T", reduce = "maximum"}}'
    for text, responses in ((outcome, ("warmth", "value")), ('outcome = "T"', ())):
        if responses:
            text = text.replace('"T - ambient"', '{variable = "T - ambient"}')
        simulator = load_study(study(fmus[2], f'{text}\nseries = true\ntime = "time"')).simulator
        assert isinstance(simulator, FMUSimulator)
        assert simulator.series
        assert simulator.responses == responses
        assert simulator.course.conditions == ("time",)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ('outcome = "T"\ntime = "time"', "(?s)without series.*stop_time"),
        ('outcome = "T"\nseries = true\nstop_time = 2.0', "delete stop_time"),
        ('outcome = "T"\nseries = true\ntime = "tim"', "'tim'.*'time'"),
        ('outcome = {warmth = "T", late = "Tt"}', r"'Tt'.*'T'"),
        ('outcome = {warmth = {variable = "T", reduce = "last"}}', '"last"'),
    ],
)
def test_a_study_with_a_mistake_is_refused(fmus: dict[int, Path], keys: str, message: str) -> None:
    with pytest.raises((StudyError, SimulatorError), match=message):
        load_study(study(fmus[2], keys))


def test_a_law_is_identified_from_series(fmus: dict[int, Path]) -> None:
    """Against an integral over k on a fine grid, of the closed form."""
    rng = np.random.default_rng(3)
    times = rng.uniform(0.2, 2.0, (6, 4)).round(3)
    drawn = 1.0 + 0.2 * rng.standard_normal((6, 1))
    measured = 300.0 + 100.0 * np.exp(-drawn * times) + rng.standard_normal((6, 4))
    ids = np.repeat([f"body {k}" for k in range(6)], 4)
    table = pd.DataFrame({"id": ids, "time": times.ravel(), "T": measured.ravel()})
    simulator = FMUSimulator(fmus[2], Final("T"), variables=K, operation=HERE, series=True)
    found = unjudged(
        simulator,
        Experiments.from_frame(table, outcome="T", id="id"),
        Inputs({"k": Normal(Free(0.5, 2.0), Free(0.01, 1.0))}),
        noise=Noise(1.0),
    )
    simulator.close()
    mean, sd = (found.alpha[name].estimate for name in ("k.mean", "k.sd"))
    k = np.linspace(mean - 8.0 * sd, mean + 8.0 * sd, 4001)
    errors = measured[..., None] - 300.0 - 100.0 * np.exp(-times[..., None] * k)
    log_density = np.sum(norm.logpdf(errors), axis=1) + norm.logpdf(k, mean, sd)
    exact = np.sum(logsumexp(log_density, axis=1) + np.log(k[1] - k[0]))
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=0.01)
