"""The shifting time against known values."""

from __future__ import annotations

import numpy as np
import pytest

from aleator.clutch import shifting_time

SCALES = [(1.0, 1.0), (0.91, 0.55), (0.6, 0.4), (1.3, 1.15)]
# Computed by two other integrators, which agree to 5e-8 s.
KNOWN = {
    1: ((0.070, 0.248, 0.070, 1200.0, 20.0), (1.1445475, 0.9166339, 0.7116423, 1.2500312)),
    16: ((0.110, 0.260, 0.070, 1200.0, 80.0), (0.8715967, 0.6269692, 0.5042846, 1.2534958)),
}


@pytest.mark.parametrize("experiment", KNOWN)
def test_known_shifting_times(experiment: int) -> None:
    conditions, expected = KNOWN[experiment]
    names = ("pulse_duration", "hold_current", "pulse_current", "motor_speed", "brake_torque")
    c2_scale, zp_scale = np.transpose(SCALES)
    times = shifting_time(
        **dict(zip(names, conditions, strict=True)), c2_scale=c2_scale, zp_scale=zp_scale
    )
    assert times == pytest.approx(expected, abs=1e-6)
