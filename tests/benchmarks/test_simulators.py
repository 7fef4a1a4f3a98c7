"""The judge of emulators: its exact answers against closed forms and independent solutions."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.emulators import BY_NAME, exact_answer, exact_value
from benchmarks.simulators import SIMULATORS, TIMES, compartments, tabulated_clutch
from examples.wet_clutch.bench import LEVELS, design
from examples.wet_clutch.model import shifting_time


def test_the_exact_answer_of_a_line_is_the_mean_and_sd_of_its_parameter():
    """y = 1 + 3 a c without noise: a is known of each experiment, and a normal law has its sums."""
    table = BY_NAME["linear"].table(5)
    c = table.conditions["c"].to_numpy()
    a = (table.outcomes - 1.0) / (3.0 * c)
    found = exact_answer("linear", 5)
    assert found["alpha"]["a.mean"] == pytest.approx(a.mean(), abs=1e-4)
    assert found["alpha"]["a.sd"] == pytest.approx(a.std(), abs=1e-4)
    here = np.sum(-0.5 * np.log(2.0 * np.pi) - np.log(0.3 * 3.0 * c) - 0.5 * ((a - 0.5) / 0.3) ** 2)
    value = exact_value(BY_NAME["linear"], table, {"a.mean": 0.5, "a.sd": 0.3})
    assert value == pytest.approx(here, abs=1e-6)


def test_the_two_compartments_solve_their_differential_equations():
    cl, v, q, v2, dose = 0.7, 1.8, 0.5, 2.2, 3.0

    def rate(_, amounts):
        out = q / v * amounts[0] - q / v2 * amounts[1]
        return [-cl / v * amounts[0] - out, out]

    exact = solve_ivp(rate, (0.0, TIMES[-1]), [dose, 0.0], t_eval=TIMES, rtol=1e-10, atol=1e-12)
    found = compartments(dose, TIMES, cl, v, q, v2, 0.2)
    np.testing.assert_allclose(found, 0.2 + exact.y[0] / v, atol=1e-4)


def test_the_table_of_the_clutch_is_the_clutch():
    rows = design().iloc[[0, 40, 107]]
    conditions = {name: rows[name].to_numpy() for name in LEVELS}
    x = {"c2_scale": np.array([0.93, 0.8, 1.1]), "zp_scale": np.array([0.5, 0.62, 0.7])}
    found, exact = tabulated_clutch(**conditions, **x), shifting_time(**conditions, **x)
    np.testing.assert_allclose(found, exact, atol=2e-4)


QUICK = [study for study in SIMULATORS if study.name != "clutch"]  # its table takes half a minute


@pytest.mark.parametrize("study", QUICK, ids=lambda study: study.name)
def test_a_seed_gives_the_same_data_and_another_seed_others(study):
    once, again, other = (study.table(seed).observations.lower for seed in (7, 7, 8))
    assert np.array_equal(once, again)
    assert np.all(np.isfinite(once))
    assert not np.array_equal(once, other)
