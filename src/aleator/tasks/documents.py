"""The results of tasks as plain lists and numbers, in the form of their JSON files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from aleator.core.types import Array
from aleator.observations.experiments import Experiments
from aleator.observations.gross_errors import slips_of
from aleator.tasks.box import FeasibleBox
from aleator.tasks.ceiling import Ceiling
from aleator.tasks.first_look import Cost, Look
from aleator.tasks.recover import Recovery
from aleator.tasks.screen import Sensitivity


def look_document(
    look: Look,
    cost: Cost | None,
    workers: int,
    held: Mapping[str, Mapping[str, float]],
    understated: Mapping[str, Mapping[str, float]],
    array_fault: str,
    table: Experiments,
) -> dict[str, Any]:
    """The first runs of a study and its cost, as plain lists and numbers: the file check.json.

    Outcomes are in their own units, also where their logarithm enters the likelihood. An outcome
    comes to a measured value if it lies within the ends `accepted`, which the noise widens. `held`
    are the known numbers of the noise on which the law rests, `understated` has the responses whose
    repeats scatter more than the noise explains, and `array_fault` says why a
    function that was tried with arrays is called once a run. `gross_errors` has the row of the
    `table`, the value, and the value that would fit, of what looks like a slip of the pen.
    """
    plan, response = look.plan, np.array(look.response)
    of = {name: response == name for name in dict.fromkeys(look.response)}
    lower, upper, reached = map(look.untransformed, (look.lower, look.upper, look.reached))
    lower = np.where(np.isfinite(look.lower), lower, look.lower)
    accepted = look.untransformed(
        np.stack([look.lower - look.margin, look.upper + look.margin], axis=1)
    )
    with np.errstate(invalid="ignore"):
        beyond = np.where(look.beyond > 0.0, lower - reached[:, 1], upper - reached[:, 0])
    beyond = np.where(look.beyond == 0.0, 0.0, beyond)
    outcome = look.untransformed(look.outcome)
    return {
        "runs": look.runs,
        "failed": look.failed,
        "fault": look.fault,
        "failing": {name: list(where) for name, where in look.failing.items()},
        "at_limit": look.at_limit,
        "seconds_a_run": look.seconds,
        "conditions": {"all": plan.count, "looked_at": look.looked_at},
        "parameters": [
            {
                "name": plan.names[i],
                "lower": plan.region[i, 0],
                "upper": plan.region[i, 1],
                "moves": {r: _known(np.median, look.swing[own, j]) for r, own in of.items()},
                "moves_at_most": {r: _known(np.max, look.swing[own, j]) for r, own in of.items()},
                "influence": not look.without_influence[j],
                "values": plan.x[plan.star[j], i],
            }
            for j, i in enumerate(plan.moving)
        ],
        "lost": dict(look.lost),
        "fixed_noise": {name: dict(one) for name, one in held.items()},
        "understated_noise": {name: dict(one) for name, one in understated.items()},
        "array_fault": array_fault,
        "gross_errors": [
            {"row": slip.place, "response": slip.response, "value": slip.value, "fits": slip.fits}
            for slip in slips_of(table)
        ],
        "noise": bool(np.any(look.margin > 0.0)),
        "measured": {r: _range(lower[own], upper[own]) for r, own in of.items()},
        "observations": [
            {
                "id": name,
                "experiment": look.owner[k],
                "response": look.response[k],
                "lower": lower[k],
                "upper": upper[k],
                "accepted": accepted[k],
                "reached": reached[k],
                "beyond": beyond[k],
                "by_parameter": [outcome[k][star] for star in plan.star],
            }
            for k, name in enumerate(look.ids)
        ],
        "noises_beyond": look.noises_beyond,
        "out_of_reach": [look.ids[k] for k in look.out_of_reach],
        "cost": None
        if cost is None
        else {
            "least_runs": cost.least,
            "most_runs": cost.most,
            "direct": cost.direct,
            "reused": cost.reused,
            "workers": workers,
            "hours": [n * look.seconds / 3600.0 / workers for n in (cost.least, cost.most)],
        },
    }


def _known(of: Callable[[Array], Any], values: Array) -> float:
    """A statistic of the known values; NaN if none is known."""
    known = values[~np.isnan(values)]
    return float(of(known)) if known.size else float("nan")


def _range(lower: Array, upper: Array) -> list[float]:
    """The least and the largest measured value; of a censored one the finite bound counts."""
    known = np.concatenate([lower, upper])
    known = known[np.isfinite(known)]
    return [float(known.min()), float(known.max())]


def box_document(found: FeasibleBox) -> dict[str, Any]:
    """A feasible box as plain lists and numbers: the content of box.json."""
    return {
        "box": dict(zip(found.names, found.box.tolist(), strict=True)),
        "limits": dict(zip(found.names, found.limits.tolist(), strict=True)),
        "sides": [
            {
                "parameter": side.parameter,
                "side": "upper" if side.upper else "lower",
                "value": side.value,
                "experiment": side.experiment,
                "failed_at": None
                if side.at is None
                else dict(zip(found.names, side.at.tolist(), strict=True)),
            }
            for side in found.sides
        ],
        "share": found.share,
        "runs": found.runs,
        "tested": found.tested,
        "confirmed": found.confirmed,
        "without": dict(found.without),
    }


def sensitivity_document(found: Sensitivity) -> dict[str, Any]:
    """A sensitivity study as plain lists and numbers: the content of sensitivity.json."""
    expansion, sobol = found.expansion, found.sobol

    def named(values: Any) -> dict[str, float]:
        return dict(zip(found.names, values.tolist(), strict=True))

    return {
        "parameters": _records(found.parameters()),
        "pairs": _records(found.pairs()),
        "expansion": {
            "runs": found.runs,
            "terms": len(expansion.indices),
            "degree": int(expansion.indices.sum(axis=1).max()),
            "converged": found.converged,
            "unexplained": {
                name: float(np.quantile(expansion.unexplained, share))
                for name, share in (("median", 0.5), ("nine_in_ten", 0.9), ("largest", 1.0))
            },
        },
        "experiments": [
            {
                "id": name,
                "mean": expansion.mean[l],
                "standard_deviation": np.sqrt(sobol.variance[l]),
                "unexplained": expansion.unexplained[l],
                "first": named(sobol.first[l]),
                "total": named(sobol.total[l]),
                "effect": named(found.effects[l]),
                "second": sobol.second[l],
            }
            for l, name in enumerate(found.ids)
        ],
    }


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(key): value for key, value in row.items()} for row in table.to_dict("records")]


def recovery_document(recovery: Recovery) -> dict[str, Any]:
    """A recovery study as plain lists and numbers: its table, and the estimates of replicates."""
    alpha, ends = recovery.alpha.tolist(), recovery.intervals.tolist()
    rows = zip(alpha, ends, recovery.log_likelihood, recovery.converged, strict=True)
    return {
        "hyperparameters": recovery.table().to_dict("index"),
        "replicates": [
            {
                "alpha": dict(zip(recovery.names, values, strict=True)),
                "intervals": dict(zip(recovery.names, intervals, strict=True)),
                "log_likelihood": float(log_likelihood),
                "converged": bool(converged),
            }
            for values, intervals, log_likelihood, converged in rows
        ],
    }


def ceiling_document(found: Ceiling) -> dict[str, Any]:
    """A best possible law as plain lists and numbers: the content of ceiling.json."""
    test, values = found.judged, found.map
    return {
        "log_likelihood": {
            "ceiling": found.log_likelihood,
            "error": found.error,
            "verified": found.verified,
            "estimated": found.estimated,
            "gap": found.gap,
        },
        "bootstrap": None if test is None else dict(vars(test)),
        "points": found.points.to_dict("records"),
        "gains": [{"id": name, "gain": gain} for name, gain in found.gains.items()],
        "region": {name: list(ends) for name, ends in found.region.items()},
        "held": dict(found.held),
        "covered": found.covered,
        "edges": list(found.edges),
        "curves": {name: curve.to_dict("list") for name, curve in found.curves.items()},
        "map": None
        if values is None
        else {
            "first": values.columns.tolist(),
            "second": values.index.tolist(),
            "gradient": values.to_numpy().tolist(),
        },
    }
