"""A result of a search as a text, and back."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np

from aleator.search.interface import Ascent, Optimum, SearchResult, Step


def written(result: SearchResult) -> str:
    """A result as JSON: numbers to the last bit."""
    return json.dumps(asdict(result), default=np.ndarray.tolist)


def read(text: str) -> SearchResult:
    """The result that was written.

    >>> one = SearchResult(np.array([0.1, 1 / 3]), -1.5, (), (), (Step(3, 0.2, -1.5),), "climb")
    >>> again = read(written(one))
    >>> again.alpha.tolist() == one.alpha.tolist(), again.trace == one.trace, again.method
    (True, True, 'climb')
    """
    told = json.loads(text)
    return SearchResult(
        np.array(told["alpha"]),
        told["log_likelihood"],
        tuple(
            Ascent(**{**one, "start": np.array(one["start"]), "alpha": np.array(one["alpha"])})
            for one in told["ascents"]
        ),
        tuple(Optimum(**{**one, "alpha": np.array(one["alpha"])}) for one in told["optima"]),
        tuple(Step(**one) for one in told["trace"]),
        told["method"],
        told["once"],
    )
