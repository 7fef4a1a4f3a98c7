"""Both shipped studies, through the Python API, against what is published and what was measured."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aleator import Identification, MonteCarlo, identify
from aleator.clutch import measure
from aleator.study import load_study

EXAMPLES = Path(__file__).parents[1] / "examples"
CONCRETE = EXAMPLES / "concrete_fatigue"
CLUTCH = EXAMPLES / "wet_clutch"

# Pascual and Meeker (1999), and standard errors of this size (those of the observed information).
PUBLISHED = {
    "v.mean": (-0.634, 0.078),
    "v.sd": (0.033, 0.0083),
    "b0.value": (-9.370, 0.50),
    "b1.value": (-8.346, 1.39),
    "noise.sd": (0.295, 0.154),
}
PUBLISHED_LOG_LIKELIHOOD = -72.883


def identified(path: Path, samples: int) -> Identification:
    study = load_study(path)
    return identify(
        study.runner(),
        study.experiments,
        study.inputs,
        noise=study.noise,
        propagation=study.propagation,
        density=study.density,
        search=study.search,
        verification=MonteCarlo(samples),
        seed=study.seed,
    )


@pytest.fixture(scope="module")
def concrete() -> Identification:
    return identified(CONCRETE / "study.toml", samples=2048)


@pytest.fixture(scope="module")
def clutch() -> Identification:
    return identified(CLUTCH / "study.toml", samples=128)


def test_concrete_fatigue_meets_the_published_answer(concrete: Identification) -> None:
    assert set(concrete.alpha) == set(PUBLISHED)
    for name, (value, standard_error) in PUBLISHED.items():
        found = concrete.alpha[name]
        assert abs(found.estimate - value) < 0.1 * standard_error, name
        assert found.standard_error == pytest.approx(standard_error, rel=0.05), name
    estimated = concrete.log_likelihood.estimated
    assert estimated == pytest.approx(PUBLISHED_LOG_LIKELIHOOD, abs=0.02)
    assert concrete.accepted


def test_concrete_fatigue_is_confirmed_by_the_simulator_itself(concrete: Identification) -> None:
    verified, error = (
        concrete.log_likelihood.verified,
        concrete.log_likelihood.verified_standard_error,
    )
    assert verified is not None
    assert error is not None
    assert error < 0.1
    assert abs(verified - PUBLISHED_LOG_LIKELIHOOD) < 4.0 * error


def test_concrete_fatigue_takes_few_runs(concrete: Identification) -> None:
    assert concrete.runs_by_stage["response surface"] < 1000
    assert concrete.surface is not None
    assert concrete.surface["worst_error"] < 0.001


def test_a_gaussian_density_misses_concrete_fatigue() -> None:
    result = identified(CONCRETE / "study_gaussian.toml", samples=0)
    missed = PUBLISHED_LOG_LIKELIHOOD - result.log_likelihood.estimated
    assert missed == pytest.approx(0.31, abs=0.03)
    assert missed > 0.2


def test_the_studies_of_concrete_fatigue_differ_in_the_density_alone() -> None:
    entropy, gaussian = (
        load_study(CONCRETE / f"{name}.toml") for name in ("study", "study_gaussian")
    )
    for name in ("noise", "propagation", "search", "verification", "seed", "table"):
        assert getattr(gaussian, name) == getattr(entropy, name), name
    assert gaussian.inputs.hyperparameters == entropy.inputs.hyperparameters
    assert np.array_equal(gaussian.inputs.box, entropy.inputs.box)
    assert gaussian.density != entropy.density


def test_concrete_fatigue_ships_all_specimens() -> None:
    table = pd.read_csv(CONCRETE / "experiments.csv")
    assert list(table.columns) == ["ratio", "kilocycles"]
    assert table.groupby("ratio").size().to_dict() == dict.fromkeys(
        (0.675, 0.75, 0.825, 0.9, 0.95), 15
    )
    assert np.log(table["kilocycles"]).sum() == pytest.approx(118.26395, abs=1e-6)


def test_every_run_of_concrete_fatigue_is_feasible() -> None:
    study = load_study(CONCRETE / "study.toml")
    ends = study.inputs.box
    corners = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(ends))
    for l in range(0, 75, 15):
        outcomes = study.runner()(np.full(len(corners), l), corners)
        assert np.all(np.isfinite(outcomes))


def test_the_bench_regenerates_the_clutch_measurements() -> None:
    shipped = pd.read_csv(CLUTCH / "experiments.csv")
    assert list(shipped.columns) == [
        "id", "pulse_duration", "hold_current", "pulse_current", "motor_speed", "brake_torque",
        "shifting_time",
    ]  # fmt: skip
    bench = measure(seed=1, kind="realistic")
    pd.testing.assert_frame_equal(shipped, bench[list(shipped.columns)], check_exact=True)


@pytest.mark.slow
def test_the_clutch_law_is_as_measured(clutch: Identification) -> None:
    """Along the ridge on which the two means trade, the log-likelihood falls by 0.1 in half a
    standard error, which is what these surfaces may err in total: so the means are
    held to half a standard error, and the log-likelihood to the 0.5 by which Monte Carlo with a
    thousand runs an experiment could tell.
    """
    alpha = clutch.alpha
    assert alpha["c2_scale.mean"].estimate == pytest.approx(0.914, abs=0.019)
    assert alpha["zp_scale.mean"].estimate == pytest.approx(0.736, abs=0.028)
    assert alpha["c2_scale.sd"].estimate == pytest.approx(0.0818, abs=0.0029)
    assert clutch.log_likelihood.estimated == pytest.approx(250.7, abs=0.5)
    assert {experiment.status for experiment in clutch.experiments} == {"solved"}
    assert clutch.accepted


@pytest.mark.slow
def test_the_clutch_measurements_hardly_determine_one_scatter(clutch: Identification) -> None:
    # Whether the maximum lies on the limit, 0.002, or at some 0.03 differs by less than 0.1 in
    # log-likelihood, which surfaces may err: what holds is that no scatter cannot be ruled out.
    weak = clutch.alpha["zp_scale.sd"]
    assert weak.interval is not None
    low, high = weak.interval
    assert low == pytest.approx(0.002)
    assert high == pytest.approx(0.097, abs=0.012)
    assert weak.estimate < 0.5 * high
    assert {"bounds", "identifiability"} & {warning.about for warning in clutch.warnings}


@pytest.mark.slow
def test_the_clutch_surfaces_keep_their_promise(clutch: Identification) -> None:
    assert clutch.surface is not None
    assert clutch.surface["experiments"] == 108
    assert clutch.surface["converged"] >= 106
    assert clutch.surface["worst_error"] < 0.1
    assert clutch.runs_by_stage["response surface"] <= 60 * 108
    # as the runs of the check tell, which no surface was fitted to
    errors = np.array([experiment.surface_error for experiment in clutch.experiments], dtype=float)
    assert np.median(errors) < 0.01
    assert np.max(errors) < 0.15


@pytest.mark.slow
def test_random_parameters_explain_more_than_the_best_point(clutch: Identification) -> None:
    least_squares = clutch.baselines["least_squares"]["log_likelihood"]
    assert clutch.log_likelihood.estimated > least_squares + 30.0
