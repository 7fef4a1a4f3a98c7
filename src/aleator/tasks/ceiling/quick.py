"""The best possible law as a line of every report where it costs seconds."""

from __future__ import annotations

from aleator.inference.ceiling.bootstrap import judged
from aleator.inference.fit import Fit
from aleator.inference.likelihood_at import IndividualsAt
from aleator.likelihood.individual import OnSurfaces
from aleator.progress import Progress
from aleator.tasks.ceiling.ceiling import best_of
from aleator.tasks.ceiling.sought import Sought

REPLICATES = 39
FEWEST = 5
"""Experiments below which any law explains them."""
PARAMETERS = 2
VALUES = 20_000
"""Nodes of all observations together up to which a fit is quick."""
DIRECT, ON_SURFACES = 100_000, 300_000
"""Values of a simulator itself, and of surfaces, that a replicate may take."""


def best_possible(fit: Fit, seed: int, progress: Progress) -> dict[str, float] | None:
    """Its log-likelihood, the `gap` to it, its p value and replicates; None where it is not quick.

    Quick are fits by individual parameters of one or two that scatter, with few nodes, and few
    values to compute for a replicate. So counted, and not timed, the answer is always the same.
    """
    if not _small(fit):
        return None
    sought = Sought.of(fit)
    if len(fit.table.observations) * sought.count > _allowed(fit):
        return None
    best = best_of(sought, seed).log_likelihood
    test = judged(fit, sought.points, REPLICATES, seed, progress)
    if test is None:
        return None
    return {
        "log_likelihood": best,
        "gap": best - fit.scored().likelihood,
        "p_value": test.p_value,
        "replicates": float(test.replicates),
    }


def _small(fit: Fit) -> bool:
    inputs = fit.inputs
    return (
        isinstance(fit.likelihood, IndividualsAt)
        and not inputs.regressed
        and 1 <= inputs.scattering <= PARAMETERS
        and fit.count >= FEWEST
        and len(fit.table.observations) * fit.likelihood.integral.nodes.xi.shape[1] <= VALUES
    )


def _allowed(fit: Fit) -> int:
    assert isinstance(fit.likelihood, IndividualsAt)
    return ON_SURFACES if isinstance(fit.likelihood.integral.predictor, OnSurfaces) else DIRECT
