"""What a careful reader must be told before trusting an answer: warnings, statuses, refusals."""

from aleator.inference.diagnostics.budget import UNCHECKED, budget_warnings
from aleator.inference.diagnostics.check import exact_density
from aleator.inference.diagnostics.failures import boxes_proposed, failure_report, failure_warnings
from aleator.inference.diagnostics.levels import by_finer_cells, cells_error
from aleator.inference.diagnostics.near_outcomes import ACCURACY, Doubt, doubt
from aleator.inference.diagnostics.reach import out_of_reach, shortfalls, unreachable
from aleator.inference.diagnostics.review import review, statuses
from aleator.inference.diagnostics.steps import step_warnings
from aleator.inference.diagnostics.surfaces import surface_errors, surface_report

__all__ = [
    "ACCURACY",
    "UNCHECKED",
    "Doubt",
    "boxes_proposed",
    "budget_warnings",
    "by_finer_cells",
    "cells_error",
    "doubt",
    "exact_density",
    "failure_report",
    "failure_warnings",
    "out_of_reach",
    "review",
    "shortfalls",
    "statuses",
    "step_warnings",
    "surface_errors",
    "surface_report",
    "unreachable",
]
