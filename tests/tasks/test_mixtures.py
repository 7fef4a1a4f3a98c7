"""Laws of several components, against densities that are known in closed form."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from identifications import unjudged
from reports import printed
from scipy import integrate, optimize, stats

from aleator import Experiments, Free, GradientMultistart, Identification, Inputs, Mixture, Noise

from aleator import Normal, ResponseSurface, cli  # isort: skip
from aleator.errors import InputsError
from aleator.surrogates.choice import Surfaces

pytestmark = pytest.mark.usefixtures("unreported")

COMPONENT = Normal(Free(0.3, 3.0), Free(0.005, 0.8))
LAW = Inputs({"k": Mixture((COMPONENT, COMPONENT))})
NAMES = ["k.1.mean", "k.1.sd", "k.2.mean", "k.2.sd", "k.1.share"]
TRUTH = np.array([1.0, 0.1, 1.8, 0.15, 0.35, 0.05])


def drawn(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    first = rng.random(count) < TRUTH[4]
    return np.where(first, rng.normal(*TRUTH[:2], count), rng.normal(*TRUTH[2:4], count))


def springs(count: int = 60, seed: int = 1) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    load = rng.uniform(0.5, 2.0, count)
    return pd.DataFrame(
        {"load": load, "y": load * drawn(count, seed) + TRUTH[5] * rng.standard_normal(count)}
    )


def decays(count: int = 40, seed: int = 2) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    k, time = np.repeat(drawn(count, seed), 5), np.tile([0.2, 0.5, 1.0, 1.5, 2.0], count)
    y = np.exp(-k * time) + 0.05 * rng.standard_normal(k.size)
    return pd.DataFrame({"id": np.repeat(np.arange(count), 5), "time": time, "y": y})


def elongation(load: np.ndarray, k: np.ndarray) -> np.ndarray:
    return load * k


def decay(time: np.ndarray, k: np.ndarray) -> np.ndarray:
    return np.exp(-k * time)


def components(alpha: np.ndarray) -> list[tuple[float, float, float]]:
    return [(alpha[4], alpha[0], alpha[1]), (1.0 - alpha[4], alpha[2], alpha[3])]


def of_springs(frame: pd.DataFrame, alpha: np.ndarray) -> float:
    """Sums of two normal densities."""
    load, y = frame["load"].to_numpy(), frame["y"].to_numpy()
    parts = [
        w * stats.norm.pdf(y, load * mean, np.hypot(load * sd, alpha[5]))
        for w, mean, sd in components(alpha)
    ]
    return float(np.log(sum(parts)).sum())


def of_decays(frame: pd.DataFrame, alpha: np.ndarray) -> float:
    """The integral over k by the trapezoidal rule."""
    k = np.linspace(0.0, 3.5, 7001)
    law = sum(w * stats.norm.pdf(k, mean, sd) for w, mean, sd in components(alpha))
    total = 0.0
    for _, own in frame.groupby("id"):
        terms = stats.norm.logpdf(
            own["y"].to_numpy()[:, None], decay(own["time"].to_numpy()[:, None], k), alpha[5]
        )
        total += np.log(integrate.trapezoid(law * np.exp(terms.sum(axis=0)), k))
    return float(total)


def values(found: Identification) -> np.ndarray:
    return found.values[[*NAMES, "noise.sd"]].to_numpy()


@pytest.fixture(scope="module")
def of_one() -> Identification:
    return unjudged(
        elongation, springs(), LAW, outcome="y", vectorized=True, noise=Noise(Free(0.005, 0.5))
    )


def test_one_outcome_an_experiment_is_a_sum_of_normal_densities(of_one: Identification) -> None:
    alpha = values(of_one)
    assert of_one.log_likelihood.estimated == pytest.approx(of_springs(springs(), alpha), abs=1e-3)
    best = optimize.minimize(
        lambda at: -of_springs(springs(), at), alpha, method="Nelder-Mead",
        options={"fatol": 1e-9, "xatol": 1e-8, "maxiter": 5000},
    )  # fmt: skip
    assert -best.fun == pytest.approx(of_one.log_likelihood.estimated, abs=0.01)
    assert of_one.sound


def test_equal_components_are_told_in_order_and_not_as_two_optima(of_one: Identification) -> None:
    alpha = values(of_one)
    assert alpha[0] < alpha[2]
    assert "maxima" not in printed(of_one)


@pytest.mark.parametrize("surfaces", ["none", "own"])
def test_series_are_integrated_over_both_components(surfaces: Surfaces) -> None:
    frame = decays()
    found = unjudged(
        decay, Experiments.from_frame(frame, outcome="y", id="id"), LAW, vectorized=True,
        noise=Noise(Free(0.005, 0.5)), search=GradientMultistart(starts=4),
        propagation=ResponseSurface(surfaces=surfaces),
    )  # fmt: skip
    assert found.log_likelihood.estimated == pytest.approx(
        of_decays(frame, values(found)), abs=0.02
    )
    assert found.sound


def test_a_prediction_is_that_of_the_mixture(of_one: Identification) -> None:
    alpha = values(of_one)
    found = of_one.predict(
        pd.DataFrame({"load": [1.5]}), quantiles=(0.1, 0.5, 0.9), uncertainty=False
    )

    def reached(y: float) -> float:
        return sum(
            w * stats.norm.cdf(y, 1.5 * mean, np.hypot(1.5 * sd, alpha[5]))
            for w, mean, sd in components(alpha)
        )

    told = found[["q0.1", "q0.5", "q0.9"]].to_numpy()[0]
    assert [reached(y) for y in told] == pytest.approx([0.1, 0.5, 0.9], abs=2e-3)


def test_the_probabilities_of_the_outcomes_are_uniform(of_one: Identification) -> None:
    pit = np.array([o.pit for o in of_one.observations])
    assert stats.kstest(pit, "uniform").pvalue > 0.05


STUDY = """\
[experiments]
file = "springs.csv"
outcome = "y"
[simulator]
function = "model.py:elongation"
[parameters.k]
law = "mixture"
components = [
    {law = "normal", mean = {lower = 0.3, upper = 3}, sd = {lower = 0.005, upper = 0.8}},
    {law = "normal", mean = {lower = 0.3, upper = 3}, sd = {lower = 0.005, upper = 0.8}},
]
[noise]
sd = {lower = 0.005, upper = 0.5}
[search]
starts = 2
"""


def folder(tmp_path: Path, study: str) -> Path:
    springs().to_csv(tmp_path / "springs.csv", index=False)
    (tmp_path / "model.py").write_text("def elongation(load, k):\n    return load * k\n")
    (tmp_path / "study.toml").write_text(study)
    return tmp_path / "study.toml"


def read(file: Path) -> Mapping[str, float]:
    alpha = json.loads(file.read_text())["alpha"]
    return {name: alpha[name]["estimate"] for name in alpha}


def test_a_study_says_components(tmp_path: Path, of_one: Identification) -> None:
    study = folder(tmp_path, STUDY)
    ran = CliRunner().invoke(cli.main, ["identify", str(study), "--output", str(tmp_path / "out")])
    assert ran.exit_code == 0, ran.output
    told = read(tmp_path / "out" / "identification.json")
    assert [told[name] for name in NAMES] == pytest.approx(values(of_one)[:5], abs=0.02)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('{law = "normal", mean = {lower = 0.3', '{law = "normel", mean = {lower = 0.3', "normel"),
        ("components = [", "shares = [0.2, 0.3]\ncomponents = [", "shares"),
        ("sd = {lower = 0.005, upper = 0.8}},", "sdd = 1}},", "sdd"),
    ],
)
def test_what_is_wrong_in_a_component_is_told(
    tmp_path: Path, old: str, new: str, named: str
) -> None:
    study = folder(tmp_path, STUDY.replace(old, new, 1))
    ran = CliRunner().invoke(cli.main, ["identify", str(study), "--output", str(tmp_path / "out")])
    assert ran.exit_code == 2
    assert named in ran.output
    assert "Traceback" not in ran.output


def test_without_noise_it_is_refused() -> None:
    with pytest.raises(InputsError, match="noise"):
        unjudged(elongation, springs(), LAW, outcome="y", vectorized=True)
