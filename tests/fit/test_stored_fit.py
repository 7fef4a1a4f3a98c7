"""Fits that are made again from a stored answer: the same numbers, without runs, or a refusal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aleator import (
    AleatorError,
    Check,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    Store,
    ceiling,
    identify,
    load,
    next_experiments,
)
from aleator.core.types import Array
from aleator.observations.experiments import Experiments
from aleator.simulators import FunctionSimulator, Runner

MADE = list[float]()
LAW = Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.9))})
TABLE = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0, 2.0, 3.0], "y": [1.5, 1.2, 4.2, 3.4, 2.1, 2.2]})
OFFERED = pd.DataFrame({"load": [0.1, 1.0, 9.0]})


def length(load: float, x: float) -> float:
    MADE.append(load)
    return load * x


def lengths(load: Array, x: Array) -> Array:
    return load * x


SLOW = FunctionSimulator(length, vectorized=False)


def experiments(table: pd.DataFrame = TABLE) -> Experiments:
    return Experiments.from_frame(table, outcome="y")


def identified(path: Path, store: Store, noise: Noise | None) -> Identification:
    runner = Runner(SLOW, experiments(), LAW.names, store=store)
    found = identify(
        runner, experiments(), LAW, noise=noise, verification=Check(0), consistency=False,
        best_law=False,
    )  # fmt: skip
    found.save(path)
    return found


@pytest.mark.parametrize("noise", [None, Noise(0.1)])
def test_a_stored_answer_tells_the_next_experiment_as_the_identification_does(
    tmp_path: Path, noise: Noise | None
) -> None:
    path = tmp_path / "found.json"
    with Store(tmp_path / "runs.sqlite") as store:
        found = identified(path, store, noise)
        expected = next_experiments(found, OFFERED, count=1)
        given: dict[str, Any] = {
            "simulator": SLOW, "inputs": LAW, "noise": noise, "experiments": experiments()
        }  # fmt: skip
        MADE.clear()
        again = load(path, **given, store=store).with_fit()
        assert not MADE
        assert again.fit.alpha.tolist() == found.fit.alpha.tolist()
        assert again.fit.inference.information == pytest.approx(
            found.fit.inference.information, rel=1e-6
        )
        assert again.fit.likelihood.log_likelihood() == pytest.approx(
            found.log_likelihood.estimated, abs=1e-6
        )
        plan = next_experiments(again, OFFERED, count=1)
        assert not set(MADE) - set(OFFERED["load"])
        assert plan.now == pytest.approx(expected.now, rel=1e-6)
        assert plan.alone == pytest.approx(expected.alone, rel=1e-6)
        if noise is not None:
            best = [ceiling(one, replicates=0).gap for one in (found, again)]
            assert best[1] == pytest.approx(best[0], abs=1e-5)
        # the surfaces belong to the estimates of this simulator, and to a store
        with pytest.raises(AleatorError, match="surfaces"):
            load(path, **given).with_fit()


def test_a_stored_answer_of_another_study_is_refused(tmp_path: Path) -> None:
    """Of other measured values, experiments, laws, noise, priors or another simulator."""
    path = tmp_path / "found.json"
    noise = Noise(0.1)
    identify(
        lengths, experiments(), LAW, noise=noise, vectorized=True, verification=Check(0),
        consistency=False, best_law=False,
    ).save(path)  # fmt: skip
    given: dict[str, Any] = {
        "simulator": lengths, "inputs": LAW, "noise": noise, "experiments": experiments(),
        "vectorized": True,
    }  # fmt: skip
    assert np.isfinite(load(path, **given).with_fit().fit.alpha).all()
    believed = Inputs({"x": Normal(Free(0.5, 1.5, prior=Normal(1.0, 0.1)), Free(0.01, 0.9))})
    moved = TABLE.assign(y=[1.5, 1.3, *TABLE["y"][2:]])
    others: list[tuple[str, dict[str, Any]]] = [
        ("experiment '2'", {"experiments": experiments(moved)}),
        ("experiments", {"experiments": experiments(TABLE[:5])}),
        ("log-likelihood", {"experiments": experiments(TABLE.assign(load=TABLE["load"] + 0.1))}),
        ("noise", {"noise": Noise(0.2)}),
        ("log-likelihood", {"simulator": lambda load, x: load * x + 0.1}),
        ("priors", {"inputs": believed}),
    ]
    for told, other in others:
        with pytest.raises(AleatorError, match=told):
            load(path, **{**given, **other}).with_fit()
