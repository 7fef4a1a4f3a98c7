"""What the maximum itself tells: too few experiments, a search that did not arrive, limits met."""

from __future__ import annotations

from collections.abc import Sequence

from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.laws import Hyperparameter
from aleator.results.values import Diagnostic
from aleator.search import SearchResult, wide_limits

LARGEST_EDM = 5e-3
"""Distance to the maximum, in log-likelihood, that still counts as arrived: 0.1 standard errors."""
FEW_EXPERIMENTS = 5
"""Experiments for each free hyperparameter below which intervals of a normal law hold the truth in
less than 93 % of all cases: 92 % at four, 91 % at three, by the laws of Student and Helmert."""


def count_warnings(experiments: int, inference: Inference) -> list[Diagnostic]:
    """Whether normal theory can be trusted at this number of experiments."""
    free = inference.identified.size
    if experiments >= FEW_EXPERIMENTS * free:
        return []
    return [
        Diagnostic(
            "experiments",
            f"{experiments} experiments for {free} free hyperparameters: intervals hold the truth "
            "in less than 93 % of all cases, estimates -+ 1.96 standard errors in less than 90 %, "
            "and estimated standard deviations tend to be too small, by about the ratio of "
            "hyperparameters to experiments",
            "take the intervals, not the standard errors; fix some, or add experiments "
            f"({2 * FEW_EXPERIMENTS} for each is a start)",
        )
    ]


def search_refusals(
    inference: Inference, hyperparameters: Sequence[Hyperparameter]
) -> list[Diagnostic]:
    """Whether the answer is a maximum, and the search arrived there."""
    warnings = []
    wide = wide_limits(hyperparameters)
    narrow = f"; narrow the limits of {', '.join(wide)}, many orders of magnitude wide"
    also = narrow if wide else ""
    if not inference.positive:
        warnings.append(
            Diagnostic(
                "search",
                "the information matrix at the answer is not positive definite: it is no maximum, "
                "or a hyperparameter has no effect",
                f"fix a hyperparameter, or search from more starts{also}",
            )
        )
    elif not inference.edm < LARGEST_EDM:
        warnings.append(
            Diagnostic(
                "search",
                "the search did not arrive: the maximum is an estimated "
                f"{inference.edm:.2g} higher in log-likelihood",
                f"allow more evaluations a start, search from more starts, or polish{also}",
            )
        )
    return warnings


def once_warnings(found: SearchResult) -> list[Diagnostic]:
    """Whether the maximum is one that no second start came to."""
    if not found.once:
        return []
    return [
        Diagnostic(
            "search",
            f"of {len(found.ascents)} starts of the search not two came to the same best "
            "log-likelihood: there may be a higher maximum",
            "search from more starts, give a hyperparameter a start or narrower limits, or fix one",
        )
    ]


def bound_warnings(
    hyperparameters: Sequence[Hyperparameter], inference: Inference, profile: Profile
) -> list[Diagnostic]:
    """Estimates on a limit, and intervals of which an end was not found."""
    warnings = [
        _on_limit(h, side)
        for h, side in zip(hyperparameters, inference.at_bound, strict=True)
        if side is not None
    ]
    unknown = [hyperparameters[k] for k in profile.unknown(inference.identified)]
    if unknown and inference.positive:
        names = tuple(h.name for h in unknown)
        warnings.append(
            Diagnostic(
                "interval",
                f"no interval is told of {', '.join(names)}: an end of it could not be found, at "
                "which the profile of the log-likelihood has dropped by 1.92",
                "take the standard error for what it is worth, or a bootstrap of the experiments; "
                "see whether the likelihood is rough because the simulator jumps",
                names,
            )
        )
    return warnings


def _on_limit(h: Hyperparameter, side: str) -> Diagnostic:
    if side == "lower" and h.reaches_zero:
        return Diagnostic(
            "bounds",
            f"{h.name} ends at zero: as far as these experiments tell, it is no scatter. It has no "
            "standard error, and those of the others hold with it at zero",
            "take a constant in place of a law that does not scatter, or leave it and say so",
            (h.name,),
        )
    scatter = side == "lower" and h.log and not h.name.startswith("noise.")
    constant = '; if its parameter is the same in all experiments, take law = "constant"'
    return Diagnostic(
        "bounds",
        f"{h.name} ends on its {side} limit {h.lower if side == 'lower' else h.upper:.6g}; "
        "it has no standard error, and those of the others hold with it fixed there",
        "widen the limit if it is not physical, or fix the hyperparameter"
        + (constant if scatter else ""),
        (h.name,),
    )
