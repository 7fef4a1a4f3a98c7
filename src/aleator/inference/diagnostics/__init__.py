"""What a careful reader must be told before trusting an answer: warnings, statuses, refusals."""

from aleator.inference.diagnostics.experiments import (
    boxes_proposed,
    by_finer_cells,
    cells_error,
    density_refusals,
    failure_report,
    failure_warnings,
    statuses,
)
from aleator.inference.diagnostics.surfaces import (
    ACCURACY,
    UNCHECKED,
    Doubt,
    budget_warnings,
    doubt,
    exact_density,
    out_of_reach,
    shortfalls,
    step_warnings,
    surface_report,
    unreachable,
)

__all__ = [
    "ACCURACY",
    "UNCHECKED",
    "Doubt",
    "boxes_proposed",
    "budget_warnings",
    "by_finer_cells",
    "cells_error",
    "density_refusals",
    "doubt",
    "exact_density",
    "failure_report",
    "failure_warnings",
    "out_of_reach",
    "shortfalls",
    "statuses",
    "step_warnings",
    "surface_report",
    "unreachable",
]
