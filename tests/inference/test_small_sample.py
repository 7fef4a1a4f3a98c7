"""Intervals for few experiments: exact laws of Student and Helmert, and what cannot be adjusted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from aleator import (
    Check,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    ResponseSurface,
    identify,
    load,
    recover,
)
from aleator.core.types import Array
from aleator.errors import InputsError, StudyError
from aleator.inference.information import infer
from aleator.inference.likelihood_at import LikelihoodAt
from aleator.inference.profile import TARGET, profile_intervals
from aleator.inference.small_sample import modified_targets, unadjusted_warnings
from aleator.laws import Hyperparameter
from aleator.observations.responses import Observations
from aleator.search.interface import LogLikelihood
from aleator.study import load_study
from tests.studies import SPRINGS, done, springs

SLEEP = Path(__file__).parents[2] / "examples" / "sleep_study" / "correlated.toml"
NORMAL = Inputs({"x": Normal(mean=Free(-1.0, 3.0), sd=Free(0.01, 2.0))})
TABLE = pd.DataFrame({"load": np.ones(12), "y": np.random.default_rng(1).normal(1.0, 0.2, 12)})


def identified(table: pd.DataFrame, inputs: Inputs = NORMAL, **choices: Any) -> Identification:
    """One outcome for each load, of a spring whose length is load times x."""
    return identify(
        lambda load, x: load * x, table, inputs, outcome="y",
        **{"vectorized": True, "verification": Check(0), "consistency": False, "best_law": False}
        | choices,
    )  # fmt: skip


@pytest.fixture(scope="module")
def adjusted() -> Identification:
    return identified(TABLE, small_sample=True)


def test_ends_of_a_normal_law_are_those_of_student_and_helmert(adjusted: Identification) -> None:
    y, n = TABLE["y"].to_numpy(), len(TABLE)
    half = stats.t.ppf(0.975, n - 1) * y.std(ddof=1) / np.sqrt(n)
    exact = {
        "x.mean": (y.mean() - half, y.mean() + half),
        "x.sd": np.sqrt(n * y.var() / stats.chi2.ppf([0.975, 0.025], n - 1)),
    }
    for name, ends in exact.items():
        found, width = adjusted.alpha[name], np.ptp(ends)
        assert found.interval == pytest.approx(ends, abs=0.02 * width)
        assert found.unadjusted != pytest.approx(ends, abs=0.02 * width)


def test_means_of_a_balanced_mixed_model_have_the_ends_of_student() -> None:
    study = load_study(SLEEP)
    found = identify(
        study.runner(), study.experiments, study.inputs, noise=study.noise, small_sample=True,
        search=GradientMultistart(starts=2), consistency=False, best_law=False,
    )  # fmt: skip
    table = pd.read_csv(SLEEP.with_name("reactions.csv"))
    # Every person was tested on the same days, so that the lines of single persons tell the means.
    lines = [np.polyfit(own["days"], own["reaction"], 1) for _, own in table.groupby("unit")]
    for name, of in zip(("slope.mean", "start.mean"), np.transpose(lines), strict=True):
        half = stats.t.ppf(0.975, len(of) - 1) * stats.sem(of)
        assert found.alpha[name].interval == pytest.approx(
            (of.mean() - half, of.mean() + half), abs=0.02 * half
        )


def test_only_the_intervals_change_and_the_file_keeps_both(
    adjusted: Identification, tmp_path: Path
) -> None:
    plain = identified(TABLE)
    for name, found in adjusted.alpha.items():
        before = plain.alpha[name]
        assert found.unadjusted == before.interval
        assert before.unadjusted is None
        assert (found.estimate, found.standard_error) == (before.estimate, before.standard_error)
        assert found.drops != pytest.approx(before.drops, abs=0.1)
    adjusted.save(tmp_path / "identification.json")
    again = load(tmp_path / "identification.json")
    assert again == adjusted
    assert again.alpha["x.sd"].unadjusted == adjusted.alpha["x.sd"].unadjusted
    assert "r*" in repr(again)
    assert "r*" not in repr(plain)


def test_the_seed_decides_and_hardly_matters() -> None:
    law, noise = Inputs({"x": LogNormal(Free(0.2, 4.0), Free(0.01, 2.0))}), Noise(0.05)
    first, same, other = (
        identified(TABLE, law, noise=noise, small_sample=True, seed=seed) for seed in (3, 3, 4)
    )
    pd.testing.assert_frame_equal(first.intervals, same.intervals)
    for name in ("x.mean", "x.sd"):
        width = np.ptp(first.alpha[name].interval)
        assert other.alpha[name].interval == pytest.approx(
            first.alpha[name].interval, abs=0.02 * width
        )


# ------------------------------------------------------------------------- the targets alone


@dataclass(frozen=True)
class Exponential:
    """The likelihood of exponential outcomes (N,) with mean alpha, with the methods of a fit's.

    A share `lost` of the drawn data sets has outcomes that are no numbers.
    """

    y: Array
    lost: float = 0.0
    limits: tuple[float, float] = (0.01, 100.0)

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        return (Hyperparameter("mean", *self.limits, start=1.0, free=True),)

    @property
    def alpha(self) -> Array:
        return np.clip(self.y.mean(keepdims=True), *self.limits)

    def __call__(self, alpha: Array) -> LogLikelihood:
        each = -np.log(alpha) - self.y / alpha
        scores = (self.y / alpha - 1.0) / alpha
        return LogLikelihood(each, scores[:, None], np.zeros(each.size, dtype=np.int64))

    def objective(self) -> Exponential:
        return self

    def rough(self) -> Exponential:
        return self

    def scored(self) -> LogLikelihood:
        return self(self.alpha)

    def drawn(self, _: object, rng: np.random.Generator) -> Array:
        y = rng.exponential(self.alpha, self.y.size)
        return y * np.nan if rng.random() < self.lost else y

    def seeing(self, y: Array) -> Exponential:
        return replace(self, y=y)


def targets(likelihood: Exponential) -> Array:
    alpha, own = likelihood.alpha, likelihood.hyperparameters
    inference = infer(likelihood, alpha, own)
    plain = profile_intervals(likelihood, alpha, own, inference)
    fit, seen = cast(LikelihoodAt, likelihood), cast(Observations, None)
    found = modified_targets(fit, seen, inference, plain, seed=0)
    named = unadjusted_warnings(own, replace(plain, targets=found))
    assert [one.concerns for one in named] == [("mean",)] * bool(np.isnan(found).any())
    return found[0]


@pytest.mark.parametrize("count", [5, 12, 100])
def test_targets_of_an_exponential_mean_are_exact(count: int) -> None:
    y = np.random.default_rng(count).exponential(2.0, count)
    # 2 sum(y)/mean has a chi-square law with 2 N degrees of freedom.
    ratio = 2.0 * count / stats.chi2.ppf([0.975, 0.025], 2 * count)
    roots = np.sqrt(2.0 * count * (np.log(ratio) + 1.0 / ratio - 1.0))
    assert targets(Exponential(y)) == pytest.approx(roots, abs=0.01)
    assert np.abs(roots - TARGET) == pytest.approx(0.33 / np.sqrt(count), rel=0.1)


def test_a_limit_and_an_estimate_on_it_are_not_adjusted() -> None:
    y = np.random.default_rng(0).exponential(2.0, 10)
    narrow = Exponential(y, limits=(y.mean() - 0.1, 100.0))
    assert targets(narrow)[0] == TARGET
    assert targets(narrow)[1] != pytest.approx(TARGET, abs=0.02)
    assert targets(Exponential(y, limits=(2.0 * y.mean(), 100.0))).tolist() == [TARGET, TARGET]


def test_too_few_data_sets_with_a_likelihood_adjust_nothing() -> None:
    y = np.random.default_rng(0).exponential(2.0, 10)
    assert np.isnan(targets(Exponential(y, lost=0.8))).all()
    assert targets(Exponential(y, lost=0.2)) == pytest.approx(targets(Exponential(y)), abs=0.02)


def test_each_end_has_the_drop_that_its_target_asks_for() -> None:
    y = np.random.default_rng(0).exponential(2.0, 10)
    likelihood, asked = Exponential(y), np.array([[1.2, 2.6]])
    own = likelihood.hyperparameters
    inference = infer(likelihood, likelihood.alpha, own)
    found = profile_intervals(likelihood, likelihood.alpha, own, inference, targets=asked)
    top = likelihood.scored().total
    for end, root in zip(found.intervals[0], asked[0], strict=True):
        assert np.sqrt(2.0 * (top - likelihood(np.array([end])).total)) == pytest.approx(
            root, abs=0.011
        )


# ------------------------------------------------------------------------- where it is asked for


def test_surfaces_serve_the_drawn_data_without_runs() -> None:
    choices: dict[str, Any] = {
        "noise": Noise(0.05), "vectorized": False,
        "propagation": ResponseSurface(surfaces="process"),
    }  # fmt: skip
    plain, small = identified(TABLE, **choices), identified(TABLE, **choices, small_sample=True)
    assert small.runs == plain.runs
    assert small.alpha["x.sd"].interval > (small.alpha["x.sd"].unadjusted or ())


def test_recovery_adjusts_its_intervals_too() -> None:
    truth = {"x.mean": 1.0, "x.sd": 0.2}
    plain, small = (
        recover(lambda load, x: load * x, TABLE[["load"]], NORMAL, truth, vectorized=True,
                replicates=2, small_sample=chosen)
        for chosen in (False, True)
    )  # fmt: skip
    assert np.all(np.ptp(small.intervals, axis=2) > np.ptp(plain.intervals, axis=2))


def test_other_principles_than_the_likelihood_are_refused() -> None:
    believed = Inputs({"x": Normal(Free(-1.0, 3.0, prior=Normal(1.0, 1.0)), Free(0.01, 2.0))})
    with pytest.raises(InputsError, match=r"x\.mean"):
        identified(TABLE, believed, small_sample=True)
    with pytest.raises(InputsError, match="restricted"):
        identified(TABLE, noise=Noise(0.1), restricted=True, small_sample=True)


@pytest.mark.parametrize(
    ("line", "key"),
    [("small_samples = true", "intervals.small_samples"), ("small_sample = 1", "small_sample")],
)
def test_a_study_says_it_in_one_key(tmp_path: Path, line: str, key: str) -> None:
    path = springs(tmp_path, f"{SPRINGS}[intervals]\nsmall_sample = true\n")
    assert load_study(path).small_sample
    assert not load_study(springs(tmp_path / "plain")).small_sample
    path.write_text(f"{SPRINGS}[intervals]\n{line}\n")
    with pytest.raises(StudyError, match=key):
        load_study(path)


def test_the_command_adjusts_what_the_study_asks_for(tmp_path: Path) -> None:
    path = springs(tmp_path, f"{SPRINGS}[intervals]\nsmall_sample = true\n")
    done("identify", path, "--output", tmp_path, "--no-verify", "--no-figures", "--quiet")
    found = load(tmp_path / "identification.json").alpha["softness.sd"]
    assert found.unadjusted is not None
    assert found.interval is not None
    assert np.all(np.greater(found.interval, found.unadjusted))
