"""An experiment that the check does not reach is said to be so, and its value verifies nothing."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import stats

from aleator import (
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    MaximumEntropy,
    MonteCarlo,
    Normal,
)
from aleator.inference.verification import Verification
from aleator.types import Array

ORDINARY = np.append(1.0 + 0.1 * np.random.default_rng(0).standard_normal(60), 1.0)
OUTLIER = np.append(ORDINARY[:-1], 3.0)


def found_from(y: Array) -> Identification:
    law = Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.5))})
    return unjudged(
        lambda x: x, pd.DataFrame({"y": y}), law, outcome="y", vectorized=True,
        density=MaximumEntropy(4), search=GradientMultistart(2), verification=MonteCarlo(),
    )  # fmt: skip


def told(found: Identification) -> list[tuple[str, ...]]:
    """The experiments that are named as not verified."""
    return [w.concerns for w in found.warnings if w.about == "verification"]


def test_a_sum_with_an_outcome_beyond_reach_is_not_called_verified() -> None:
    found = found_from(OUTLIER)
    report = found.log_likelihood
    assert [e.id for e in found.experiments if not e.verified] == ["61"]
    assert (report.verified, report.verified_standard_error) == (None, None)
    assert report.reached is not None
    mean, sd = (found.alpha[name].estimate for name in ("x.mean", "x.sd"))
    truth = stats.norm.logpdf(OUTLIER[:-1], mean, sd).sum()
    assert report.reached["experiments"] == 60
    assert report.reached["estimated"] == pytest.approx(truth, abs=1e-3)
    assert abs(report.reached["verified"] - truth) < 4.0 * report.reached["standard_error"]
    assert told(found) == [("61",)]
    without = found_from(OUTLIER[:-1]).alpha["x.sd"]
    error = found.alpha["x.sd"].standard_error
    assert error is not None
    assert found.alpha["x.sd"].estimate - without.estimate > error


def test_one_that_contributes_little_is_marked_but_no_warning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An outcome in the middle of sixty: without it alpha would be much the same."""
    module = importlib.import_module("aleator.tasks.identify")
    verify = module.verify

    def short_of_the_last(*given: object, **named: object) -> Verification:
        checked: Verification = verify(*given, **named)
        total = float(checked.each[:-1].sum())
        return replace(checked, reached=np.arange(checked.each.size) < 60, total=total)

    whole = found_from(ORDINARY)
    assert told(whole) == []
    assert whole.log_likelihood.reached is None
    assert all(e.verified for e in whole.experiments)
    monkeypatch.setattr(module, "verify", short_of_the_last)
    part = found_from(ORDINARY)
    assert told(part) == []
    assert part.log_likelihood.verified is None
    assert part.experiments[-1].verified is False
    document = part.to_dict()
    assert document["log_likelihood"]["reached"]["experiments"] == 60
    assert document["experiments"][-1]["verified"] is False


def test_without_a_check_nothing_is_told_of_it() -> None:
    law = Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.5))})
    table = pd.DataFrame({"y": ORDINARY})
    found = unjudged(
        lambda x: x, table, law, outcome="y", vectorized=True, verification=MonteCarlo(0)
    )
    assert found.log_likelihood.verified is None
    assert found.log_likelihood.reached is None
    assert {e.verified for e in found.experiments} == {None}
