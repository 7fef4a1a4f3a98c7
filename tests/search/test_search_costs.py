"""What searches ask for, what they tell meanwhile, and how several are compared."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from landscapes import Heard, Recorded, box, hills, ridge, waves
from searches import ALL, GENETIC, PLAIN, POPULATIONS, each

from aleator.core.types import Array
from aleator.search import (
    CMAES,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
    objective_of,
)
from aleator.search.interface import LogLikelihood
from reproduction.trials import TracedObjective, compare

# ------------------------------------------------------------------------------ what it costs


@each(PLAIN[:3])
def test_a_plain_population_asks_for_values_in_batches_and_for_no_score(search) -> None:
    objective = Recorded(hills)
    found = search.maximize(objective, box(), seed=0)
    # CMA-ES takes the scores of its distinct ends to tell them apart
    assert objective.scored == (len(found.optima) if isinstance(search, CMAES) else 0)
    assert found.evaluations == sum(objective.batches)
    smallest = 6 if isinstance(search, CMAES) else 40
    assert np.mean(objective.batches) >= smallest


def test_a_genetic_search_takes_no_more_than_its_generations() -> None:
    search = GeneticAlgorithm(population=20, generations=7, patience=100, polish=False)
    objective = Recorded(waves)
    found = search.maximize(objective, box(), seed=0)
    assert found.evaluations == len(objective.asked) <= 7 * 20
    assert not found.converged


def test_differential_evolution_takes_no_more_than_its_generations() -> None:
    objective = Recorded(waves)
    found = DifferentialEvolution(20, 7, polish=False).maximize(objective, box(), seed=0)
    assert found.evaluations == len(objective.asked) == 7 * 20
    assert not found.converged


def test_a_run_of_cma_es_takes_no_more_than_its_evaluations_and_one_population() -> None:
    found = CMAES(runs=2, evaluations=30, population=8, polish=False).maximize(ridge, box(), seed=0)
    assert all(30 <= ascent.evaluations <= 38 for ascent in found.ascents)
    assert not found.converged


@each(POPULATIONS)
def test_start_and_guesses_are_the_first_to_be_asked(search) -> None:
    objective, guess = Recorded(waves), np.array([-3.25, 2.75])
    search.maximize(objective, box(), seed=0, guesses=[guess])
    if isinstance(search, CMAES):
        # its runs begin around them
        found = search.maximize(waves, box(), seed=0, guesses=[guess])
        starts = [ascent.start for ascent in found.ascents[:2]]
    else:
        starts = objective.asked[:2]
    np.testing.assert_allclose(starts, [[4.0, 4.0], guess], rtol=1e-12)


# ------------------------------------------------------------------------------ progress


@each(ALL)
def test_progress_goes_forward_to_its_total(search) -> None:
    heard = Heard()
    found = search.maximize(ridge, box(), seed=0, progress=heard)
    assert heard.updates
    assert f"best log-likelihood {found.log_likelihood:.2f}" in heard.updates[-1][0] or (
        found.log_likelihood > -0.01
    )
    done = [d for _, d, _ in heard.updates if d is not None]
    assert done == sorted(done)
    assert all(d <= t for _, d, t in heard.updates if d is not None and t is not None)


@each([*ALL, *PLAIN])
def test_ctrl_c_passes_through(search) -> None:
    calls = 0

    def interrupted(alpha: Array) -> LogLikelihood:
        nonlocal calls
        calls += 1
        if calls > 30:
            raise KeyboardInterrupt
        return ridge(alpha)

    with pytest.raises(KeyboardInterrupt):
        search.maximize(interrupted, box(), seed=0)
    assert calls == 31


@each(ALL)
def test_the_trace_rises_to_the_answer(search) -> None:
    traced = TracedObjective(hills)
    found = search.maximize(traced, box(), seed=0)
    values = [step.log_likelihood for step in traced.trace]
    counts = [step.evaluations for step in traced.trace]
    seconds = [step.seconds for step in traced.trace]
    assert values == sorted(values)
    assert counts == sorted(counts)
    assert seconds == sorted(seconds)
    assert values[-1] == found.log_likelihood
    assert counts[-1] <= found.evaluations


# ------------------------------------------------------------------------------ comparison


def test_a_comparison_counts_what_was_asked() -> None:
    objective = Recorded(hills)
    trials = compare([GENETIC, GradientMultistart(5)], objective, box(), seed=0)
    assert [t.name for t in trials] == ["genetic(40)", "gradient_multistart(5)"]
    assert sum(t.evaluations for t in trials) == len(objective.asked)
    assert sum(t.scored for t in trials) == objective.scored
    for trial in trials:
        close = trial.reached(np.log(1.6) - 0.01)
        closer = trial.reached(np.log(1.6) - 1e-4)
        assert close is not None
        assert closer is not None
        assert close.evaluations <= closer.evaluations <= trial.evaluations
        assert close.seconds <= closer.seconds <= trial.seconds
        assert trial.reached(1.0) is None


def test_choices_travel_to_other_processes() -> None:
    for search in (GradientMultistart(3), *POPULATIONS):
        assert pickle.loads(pickle.dumps(search)) == search


def test_a_plain_function_is_an_objective() -> None:
    alphas = np.array([[0.0, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(objective_of(ridge).values(alphas), [-1.0, 0.0])
    recorded = Recorded(ridge)
    assert objective_of(recorded) is recorded
