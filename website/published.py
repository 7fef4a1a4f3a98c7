"""A published example: its study, its identification, and the printed numbers.

`docs/data.md` says where the tables come from and on what terms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aleator import Censoring, Experiments, Free, Identification, Inputs, Noise, identify
from aleator.core.types import Array
from aleator.laws.law import Law

DATA = Path(__file__).parents[1] / "tests" / "data"
BOOK = "R package nlme; Pinheiro and Bates 2000"


@dataclass(frozen=True)
class Published:
    """A number as it was printed, what it is, and how it follows from an identification.

    `within` is the admitted difference if the number is not met to its last printed digit, and
    `because` says why.
    """

    quantity: str
    theirs: str
    of: Callable[[Identification], float]
    within: float | None = None
    because: str = ""

    @property
    def tolerance(self) -> float:
        """The admitted difference: a unit of the last printed digit, if nothing else is stated."""
        return 10.0**-self.digits if self.within is None else self.within

    @property
    def digits(self) -> int:
        """The number of printed decimal digits.

        >>> Published("n", "12.50", lambda found: 0.0).digits
        2
        """
        return len(self.theirs.partition(".")[2])

    def cells(self, ours: float) -> tuple[str, str]:
        """Our number in as many digits, and the difference.

        >>> Published("n", "12.50", lambda found: 0.0).cells(12.5049)
        ('12.50', 'none')
        """
        off = ours - float(self.theirs)
        met = abs(off) <= 0.5 * 10.0**-self.digits
        return f"{ours:.{self.digits}f}", "none" if met else f"{off:.1g}"


@dataclass(frozen=True)
class Example:
    """A published example: its title and source, the study in a line, and its published numbers.

    A `slow` one takes more than ten seconds.
    """

    title: str
    source: str
    study: str
    identified: Callable[[], Identification]
    numbers: tuple[Published, ...]
    slow: bool = False

    @cached_property
    def answer(self) -> Identification:
        """The identification."""
        return self.identified()


def log_likelihood(found: Identification) -> float:
    """The log-likelihood of an answer."""
    return found.log_likelihood.estimated


def log_restricted(found: Identification) -> float:
    """The restricted log-likelihood of an answer."""
    return found.log_likelihood.restricted or np.nan


def deviance(found: Identification) -> float:
    """Minus two times the log-likelihood of an answer."""
    return -2.0 * log_likelihood(found)


def restricted(found: Identification) -> float:
    """Minus two times the restricted log-likelihood of an answer."""
    return -2.0 * log_restricted(found)


def estimate(name: str, to: Callable[[float], float] = float) -> Callable[[Identification], float]:
    """The estimate of a hyperparameter, as it is or transformed."""
    return lambda found: to(found.alpha[name].estimate)


def variance(name: str) -> Callable[[Identification], float]:
    """The square of an estimated standard deviation."""
    return estimate(name, lambda sd: sd**2)


def answer(
    simulator: Callable[..., Any],
    frame: pd.DataFrame,
    laws: Mapping[str, Law],
    outcome: str,
    noise: Noise | None,
    unit: str | None = None,
    correlation: Mapping[tuple[str, str], Free] | None = None,
    levels: Mapping[str, str] | None = None,
    censored: Censoring | None = None,
    *,
    restricted: bool = False,
) -> Identification:
    """An identification by default settings."""
    experiments = Experiments.from_frame(frame, outcome=outcome, id=unit, censored=censored)
    return identify(
        simulator, experiments, Inputs(dict(laws), correlation or {}, levels or {}), noise=noise,
        vectorized=True, consistency=False, best_law=False, restricted=restricted,
    )  # fmt: skip


def table(name: str) -> pd.DataFrame:
    """A published table of the tests."""
    return pd.read_csv(DATA / name)


def level(level: Array) -> Array:
    """A level."""
    return np.asarray(1.0 * level)
