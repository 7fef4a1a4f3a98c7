"""The further scales of the clutch against a second model whose parameters are really changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aleator.clutch import reference, shifting_time
from aleator.clutch.parameters import CLUTCH, Clutch
from aleator.errors import SimulatorError

CONDITIONS = {
    "pulse_duration": 0.090,
    "hold_current": 0.260,
    "pulse_current": 0.070,
    "motor_speed": 1350.0,
    "brake_torque": 80.0,
    "c2_scale": 0.9,
    "zp_scale": 0.7,
}
SCALES = ["alpha_scale", "gamma_scale", "omega_scale", "brake_scale", "j2_scale", "b_scale"]


def changed(name: str, factor: float) -> Clutch:
    hydraulics, plates, shafts = CLUTCH.hydraulics, CLUTCH.plates, CLUTCH.shafts
    return {
        "alpha_scale": replace(CLUTCH, plates=replace(plates, alpha=plates.alpha * factor)),
        "gamma_scale": replace(CLUTCH, plates=replace(plates, gamma=plates.gamma * factor)),
        "omega_scale": replace(
            CLUTCH,
            hydraulics=replace(hydraulics, natural_frequency=hydraulics.natural_frequency * factor),
        ),
        "brake_scale": CLUTCH,
        "j2_scale": replace(CLUTCH, shafts=replace(shafts, inertia_2=shafts.inertia_2 * factor)),
        "b_scale": replace(CLUTCH, shafts=replace(shafts, viscous=shafts.viscous * factor)),
    }[name]


@pytest.mark.parametrize("factor", [0.8, 1.25])
@pytest.mark.parametrize("name", SCALES)
def test_a_scale_is_that_of_its_parameter(
    name: str, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reference, "CLUTCH", changed(name, factor))
    conditions = dict(CONDITIONS)
    if name == "brake_scale":
        conditions["brake_torque"] *= factor
    expected = reference.reference_shifting_time(**conditions)
    found = shifting_time(**CONDITIONS, **{name: factor})[0]
    assert found == pytest.approx(expected, abs=1e-6)
    assert abs(found - shifting_time(**CONDITIONS)[0]) > 2e-5  # it has an effect


def test_runs_with_different_scales_do_not_touch_each_other() -> None:
    rng = np.random.default_rng(0)
    scales = {name: rng.uniform(0.8, 1.2, 7) for name in SCALES}
    together = shifting_time(**CONDITIONS, **scales)
    alone = [
        shifting_time(**CONDITIONS, **{name: values[k] for name, values in scales.items()})[0]
        for k in range(7)
    ]
    np.testing.assert_allclose(together, alone, rtol=0.0, atol=1e-11)


def test_scales_of_one_change_no_bit() -> None:
    assert np.array_equal(
        shifting_time(**CONDITIONS), shifting_time(**CONDITIONS, **dict.fromkeys(SCALES, 1.0))
    )


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_that_is_none_is_refused(value: float) -> None:
    with pytest.raises(SimulatorError, match="inertia_factor"):
        shifting_time(**CONDITIONS, j2_scale=value)
