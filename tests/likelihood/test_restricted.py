"""The restricted likelihood: published maxima of REML, and its equation for independent values."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from aleator import (
    Constant,
    Experiments,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    compare,
    identify,
)
from aleator.errors import InputsError
from aleator.fit.question import Choices
from aleator.laws.law import Law
from aleator.likelihood.individual import Direct
from aleator.simulators import as_runner
from aleator.simulators.function import FunctionSimulator

DATA = Path(__file__).parents[1] / "data"


def level(**parameters: np.ndarray) -> np.ndarray:
    return np.asarray(sum(parameters.values()))


def found(
    frame: pd.DataFrame,
    outcome: str,
    laws: dict[str, Law],
    noise: Noise,
    restricted: bool = True,
    levels: dict[str, str] | None = None,
) -> Identification:
    unit = "id" if "id" in frame else None
    table = Experiments.from_frame(frame, outcome=outcome, id=unit, conditions=[])
    return identify(
        level, table, Inputs(laws, levels=levels or {}), noise=noise, vectorized=True,
        restricted=restricted, consistency=False, best_law=False,
    )  # fmt: skip


def dyestuff(restricted: bool = True) -> Identification:
    frame = pd.read_csv(DATA / "dyestuff.csv").rename(columns={"unit": "id"})
    laws: dict[str, Law] = {"m": Normal(Free(1000.0, 2000.0), Free(0.0, 500.0))}
    return found(frame, "yield", laws, Noise(Free(1.0, 500.0)), restricted)


def test_dyestuff_has_the_published_maximum_of_reml() -> None:
    """lme4 and MixedModels.jl: 319.6542768422576, sds 42.001 and 49.510."""
    answer = dyestuff()
    assert answer.sound
    assert answer.log_likelihood.restricted is not None
    assert -2.0 * answer.log_likelihood.restricted == pytest.approx(319.6542768422576, abs=1e-6)
    assert answer.alpha["m.sd"].estimate == pytest.approx(42.001, abs=2e-3)
    assert answer.alpha["noise.sd"].estimate == pytest.approx(49.510, abs=1e-3)
    # The intervals are those of the restricted likelihood: wider than those of the likelihood.
    plain = dyestuff(restricted=False)
    wide, narrow = answer.alpha["m.sd"].interval, plain.alpha["m.sd"].interval
    assert wide is not None
    assert narrow is not None
    assert wide[1] - wide[0] > narrow[1] - narrow[0]


BATCHES: dict[str, Law] = {
    "m": Constant(Free(40.0, 80.0)),
    "batch": Normal(0.0, Free(0.0, 20.0)),
    "cask": Normal(0.0, Free(0.0, 20.0)),
}
CROSSED: dict[str, Law] = {
    "m": Constant(Free(10.0, 40.0)),
    "a": Normal(0.0, Free(0.0, 10.0)),
    "b": Normal(0.0, Free(0.0, 10.0)),
}
LEVELS = {
    # The maxima of REML and the sds that lme4 prints.
    "pastes": ("strength", BATCHES, {"batch": "batch"}, 246.9907,
               [60.05333, 0.0, 1.28736, 0.0, 2.90407, 0.82341]),
    "penicillin": ("diameter", CROSSED, {"a": "plate", "b": "sample"}, 330.8606,
                   [22.97222, 0.0, 0.84671, 0.0, 1.93157, 0.54992]),
}  # fmt: skip


@pytest.mark.parametrize("name", LEVELS)
def test_levels_have_the_published_maxima_of_reml(name: str) -> None:
    outcome, laws, levels, published, alpha = LEVELS[name]
    frame = pd.read_csv(DATA / f"{name}.csv")
    table = Experiments.from_frame(
        frame, outcome=outcome, id="id" if "id" in frame else None, conditions=[]
    )
    choices = Choices.of(
        table, Inputs(laws, levels=levels), Noise(Free(0.05, 20.0)), restricted=True
    )
    runner = as_runner(FunctionSimulator(level, vectorized=True), table, (*laws,), True, None)
    question = choices.question(runner, table.observations, 0)
    here = np.array(alpha)
    likelihood = question.integral(Direct(runner, np.arange(len(laws)), question.inputs.box))
    found = likelihood.adapted(here)(here)
    assert -2.0 * found.total == pytest.approx(published, abs=1e-4)
    # At the maximum the score is zero, to the digits of the sds.
    assert np.abs(found.score * here * 1e-4).max() < 1e-3


def test_lines_have_the_value_and_the_derivative_of_the_closed_form() -> None:
    """-1/2 log det sum_l X' V^-1 X beside the log-likelihood; its slope by differences of it."""
    time = np.tile(np.arange(6.0), 8)
    subject, rng = np.repeat(np.arange(8), 6), np.random.default_rng(5)
    y = 3.0 + 0.5 * time + rng.standard_normal(8)[subject] * (1.0 + 0.3 * time)
    frame = pd.DataFrame({"id": subject, "t": time, "y": y + 0.1 * rng.standard_normal(48)})
    table = Experiments.from_frame(frame, outcome="y", id="id")
    law = Inputs({"a": Normal(Free(0, 9), Free(0.1, 9)), "b": Normal(Free(-2, 2), Free(0.1, 9))})
    choices = Choices.of(table, law, Noise(Free(0.01, 9.0)), restricted=True)
    line = FunctionSimulator(lambda t, a, b: a + b * t, vectorized=True)
    runner = as_runner(line, table, ("a", "b"), True, None)
    question = choices.question(runner, table.observations, 0)
    likelihood = question.integral(Direct(runner, np.arange(2), question.inputs.box))
    design = np.stack([np.ones(6), time[:6]], axis=1)

    def exact(alpha: np.ndarray) -> float:
        spread = np.diag(alpha[[1, 3]] ** 2)
        covariance = design @ spread @ design.T + alpha[4] ** 2 * np.eye(6)
        away = frame["y"].to_numpy().reshape(8, 6) - design @ alpha[[0, 2]]
        value = stats.multivariate_normal.logpdf(away, cov=covariance).sum()
        information = 8.0 * design.T @ np.linalg.inv(covariance) @ design
        return float(value - 0.5 * np.linalg.slogdet(information)[1] + np.log(2.0 * np.pi))

    here = np.array([3.2, 1.1, 0.45, 0.35, 0.12])
    found = likelihood.adapted(here)(here)
    assert found.total == pytest.approx(exact(here), abs=1e-5)
    slopes = [(exact(here + h) - exact(here - h)) / 2e-5 for h in 1e-5 * np.eye(5)]
    np.testing.assert_allclose(found.score, slopes, rtol=1e-5, atol=1e-3)


def test_the_sd_of_independent_values_has_n_minus_one() -> None:
    y = np.array([1.1, 0.7, 2.3, 1.9, 0.4, 1.6])
    answer = found(
        pd.DataFrame({"y": y}), "y", {"m": Constant(Free(-5.0, 5.0))}, Noise(Free(0.01, 5.0))
    )
    assert answer.alpha["noise.sd"].estimate == pytest.approx(y.std(ddof=1), rel=1e-5)
    assert answer.alpha["m.value"].estimate == pytest.approx(y.mean(), abs=1e-5)
    assert answer.alpha["m.value"].standard_error == pytest.approx(
        y.std(ddof=1) / np.sqrt(6.0), rel=1e-3
    )


def test_without_noise_and_in_comparisons_it_is_refused() -> None:
    with pytest.raises(InputsError, match="noise"):
        identify(
            lambda x: x, pd.DataFrame({"y": [1.0, 2.0, 3.0]}),
            Inputs({"x": Normal(Free(0.0, 5.0), Free(0.1, 2.0))}), outcome="y", restricted=True,
        )  # fmt: skip
    with pytest.raises(InputsError, match="restricted"):
        compare(dyestuff(), dyestuff())
