"""What is missing or wrong is named with its remedy; a search of a user's own keeps its word."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest
from landscapes import box, ridge
from searches import DIFFERENTIAL

from aleator.core.types import Array
from aleator.errors import AleatorError, InputsError
from aleator.search import CMAES, CustomSearch, DifferentialEvolution, GeneticAlgorithm
from reproduction.trials import compare

# ------------------------------------------------------------------------------ extras


@pytest.mark.parametrize(("make", "package"), [(GeneticAlgorithm, "pymoo"), (CMAES, "cma")])
def test_a_missing_package_is_named_with_its_remedy(make, package, monkeypatch) -> None:
    for name in [n for n in sys.modules if n.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(AleatorError, match=package) as caught:
        make()
    assert f"pip install {package}" in caught.value.remedy
    # the others do without
    assert DIFFERENTIAL.maximize(ridge, box(), seed=0).converged


@pytest.mark.parametrize(
    "make",
    [
        lambda: GeneticAlgorithm(population=3),
        lambda: GeneticAlgorithm(generations=0),
        lambda: GeneticAlgorithm(patience=0),
        lambda: DifferentialEvolution(population=4),
        lambda: DifferentialEvolution(generations=0),
        lambda: CMAES(runs=0),
        lambda: CMAES(evaluations=0),
        lambda: CMAES(population=3),
        lambda: CMAES(step=0.0),
        lambda: CMAES(step=float("nan")),
        lambda: compare([], ridge, box(), seed=0),
    ],
)
def test_misuse_has_a_remedy(make) -> None:
    with pytest.raises(InputsError) as caught:
        make()
    assert caught.value.remedy


# ------------------------------------------------------------------------------ a user's own


@pytest.mark.parametrize("returned", [None, "best", [1.0], [np.nan, 1.0], [9.0, 1.0], [[1.0, 1.0]]])
def test_a_custom_search_must_return_alpha_within_the_limits(returned) -> None:
    search = CustomSearch(lambda *_: returned)
    with pytest.raises(InputsError, match=re.escape(repr(returned))):
        search.maximize(ridge, box(), seed=0)


def test_a_custom_search_starts_at_the_best_guess_and_keeps_the_best_it_met() -> None:
    seen = {}

    def careless(value, lower, upper, start, rng) -> Array:
        seen.update(start=start.copy(), lower=lower, upper=upper, draw=rng.random())
        value(np.array([1.0, 1.0]))
        return lower

    search = CustomSearch(careless, polish=False, name="careless")
    guesses = [np.array([-4.0, 0.0]), np.array([1.1, 1.2])]
    found = search.maximize(ridge, box(), seed=7, guesses=guesses)
    assert seen["start"].tolist() == [1.1, 1.2]
    assert seen["lower"].tolist() == [-5.0, -5.0]
    assert seen["upper"].tolist() == [5.0, 5.0]
    assert seen["draw"] == np.random.default_rng(7).random()
    assert found.alpha.tolist() == [1.0, 1.0]
    assert found.log_likelihood == 0.0


def test_what_a_custom_search_raises_is_not_caught() -> None:
    def broken(*_) -> Array:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        CustomSearch(broken).maximize(ridge, box(), seed=0)


@pytest.mark.parametrize(
    "function",
    [
        lambda value, lower, upper, start: start,  # noqa: ARG005
        lambda value, *, start, rng, lower, upper: start,  # noqa: ARG005
        lambda value, lower, upper, start, rng, more: start,  # noqa: ARG005
        "nelder-mead",
    ],
)
def test_a_custom_search_that_takes_other_arguments_is_refused_with_those_it_gets(function) -> None:
    with pytest.raises(InputsError) as caught:
        CustomSearch(function)
    assert "(value, lower, upper, start, rng)" in caught.value.remedy


def test_a_function_that_does_not_tell_its_arguments_is_taken_at_its_word() -> None:
    """Its signature cannot be read; called with a function, `max` raises what it raises."""
    with pytest.raises(TypeError):
        CustomSearch(max).maximize(ridge, box(), seed=0)
