"""The second verdict: whether a model is consistent with its experiments, and what is not."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

LEVEL = 0.05
"""The model is inconsistent where the probability of all tests together is below this."""


@dataclass(frozen=True)
class Statistic:
    """One test: what it looks at, where, and its probability under the model.

    `kind` is its statistic and `of` what of the model it looks at: "outcomes", "scatter" or a
    hyperparameter. `column` and `where` say on what that may depend; None: on nothing, or along
    the whole column. `z` is the statistic in standard deviations of the replicates, `p` its
    probability, `corrected` the probability that any of the tests says as much.
    """

    kind: str
    of: str
    column: str | None
    where: str | None
    z: float
    p: float
    corrected: float


@dataclass(frozen=True)
class Discrepancy:
    """A test that contradicts the model: what it says of it, and what may mend that."""

    test: Statistic
    message: str
    remedy: str


@dataclass(frozen=True)
class Outlier:
    """An observation that was not expected: its own p, and that of the farthest of all."""

    id: str
    row: int
    response: str
    p: float
    corrected: float


@dataclass(frozen=True)
class Relation:
    """The correlation of a parameter's individual means with a column, or with another parameter.

    `other` is the name of either, and `pair` tells whether it is a parameter's. Shrinkage makes
    such a correlation smaller or larger than that of the parameters themselves; `p` accounts for
    it: the probability that a right model, whose replicates shrink as much, has one as strong.
    """

    parameter: str
    other: str
    pair: bool
    correlation: float
    p: float


@dataclass(frozen=True)
class Consistency:
    """Whether the model is consistent with the experiments.

    `p` is the probability that a right model looks as bad in any of the `tests`. `consistent` is
    whether it is at least 0.05, and None where that could not be tested: `reason` says why.
    `discrepancies` are the strongest of those that contradict it, `outliers` the observations that
    one in twenty right models would not have. `replicates` under the fitted model say what is
    usual. `relations` are those of the individual parameters of experiments with several
    observations. `copies` are columns that the outcome determines: left out.
    """

    consistent: bool | None
    p: float | None
    replicates: int
    discrepancies: tuple[Discrepancy, ...] = ()
    outliers: tuple[Outlier, ...] = ()
    tests: tuple[Statistic, ...] = ()
    reason: str = ""
    relations: tuple[Relation, ...] = ()
    copies: tuple[str, ...] = ()

    def table(self) -> pd.DataFrame:
        """A row for each test, the one that says most first.

        >>> Consistency.untested("it was not asked for").table().empty
        True
        """
        frame = pd.DataFrame([vars(test) for test in self.tests])
        return frame if frame.empty else frame.sort_values("p", ignore_index=True)

    @classmethod
    def untested(cls, reason: str) -> Consistency:
        """No verdict, and why.

        >>> Consistency.untested("it was not asked for").consistent is None
        True
        """
        return cls(None, None, 0, reason=reason)
