"""What a comparison of models found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from aleator.inference.criteria import Criteria
from aleator.inference.leave_one_out import LeaveOneOut, summed_error
from aleator.inference.likelihood_ratio import LikelihoodRatio
from aleator.results import printed

RATIO = ("smaller", "larger", "ratio", "df", "reference", "p", "bootstrap_p", "replicates")
"""The columns of likelihood ratios."""


@dataclass(frozen=True, eq=False)
class Competitor:
    """One model: its two verdicts, its criteria, its predictions.

    `below_ceiling` is how far its log-likelihood is below that of the best of all laws; NaN where
    that is not known.
    """

    name: str
    sound: bool
    consistent: bool | None
    criteria: Criteria
    left_out: LeaveOneOut
    below_ceiling: float


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Models of N experiments `ids`, those that predict best first, and likelihood ratios."""

    ids: tuple[str, ...]
    models: tuple[Competitor, ...]
    ratios: tuple[LikelihoodRatio, ...]

    def __repr__(self) -> str:
        return f"{self.table().to_string()}\n\n{self.nested().to_string()}"

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        best = f"{self.models[0].name} predicts best." if len(self.models) > 1 else ""
        head = f"{len(self.models)} models of {len(self.ids)} experiments"
        return printed.shown(head, self.table(), best)

    def table(self) -> pd.DataFrame:
        """A row for each model, by its name.

        Columns `sound`, `consistent`, `log_likelihood`, `below_ceiling`, `free` hyperparameters,
        `aic`, `aicc`, `bic`, `elpd` (the predictive log-likelihood of experiments left out) with
        `elpd_error`, its `difference` to the best with `difference_error`, and `refits`: maxima
        that were climbed to.
        """
        best = self.models[0].left_out.each
        rows = [
            {
                "sound": model.sound,
                "consistent": model.consistent,
                "log_likelihood": model.criteria.log_likelihood,
                "below_ceiling": model.below_ceiling,
                "free": model.criteria.free,
                "aic": model.criteria.aic,
                "aicc": model.criteria.aicc,
                "bic": model.criteria.bic,
                "elpd": model.left_out.total,
                "elpd_error": model.left_out.error,
                "difference": float(np.sum(model.left_out.each - best)),
                "difference_error": summed_error(model.left_out.each - best) if place else 0.0,
                "refits": int(np.sum(model.left_out.refitted)),
            }
            for place, model in enumerate(self.models)
        ]
        return pd.DataFrame(rows, index=pd.Index([m.name for m in self.models], name="model"))

    def experiments(self) -> pd.DataFrame:
        """log p of each experiment (N rows) by the maximum of the others, a column a model."""
        columns = {model.name: model.left_out.each for model in self.models}
        return pd.DataFrame(columns, index=pd.Index(self.ids, name="id"))

    def nested(self) -> pd.DataFrame:
        """A row for each likelihood ratio.

        `smaller`, `larger`, `ratio`, `df`, `reference`, its `p`, and `bootstrap_p` of so many
        `replicates`; NaN where there is none.
        """
        rows = [
            {
                "smaller": ratio.smaller, "larger": ratio.larger, "ratio": ratio.statistic,
                "df": ratio.df, "reference": ratio.reference, "p": ratio.p,
                "bootstrap_p": ratio.bootstrap_p,
                "replicates": int(np.sum(np.isfinite(ratio.bootstrap))),
            }
            for ratio in self.ratios
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=[*RATIO])

    def to_dict(self) -> dict[str, Any]:
        """The document compare.json as plain dictionaries, lists, numbers and texts."""
        details = {
            model.name: {
                "of_law": model.criteria.of_law,
                "of_rest": model.criteria.of_rest,
                "observations": model.criteria.observations,
                "not_arrived": int(np.sum(~model.left_out.arrived)),
            }
            for model in self.models
        }
        return {
            "experiments": len(self.ids),
            "models": [
                {"name": name, **row, **details[str(name)]}
                for name, row in self.table().to_dict("index").items()
            ],
            "nested": self.nested().to_dict("records"),
            "left_out": self.experiments().rename_axis("id").reset_index().to_dict("records"),
        }
