"""What a careful reader must be told before trusting an answer: warnings, statuses, refusals."""

from aleator.findings.check import score_steps
from aleator.findings.failures import boxes_proposed, failure_report, failure_warnings
from aleator.findings.reach import refuse_unreachable, unreachable
from aleator.findings.review import MOMENTS_STAND_IN, quadrature_gap, review, statuses
from aleator.findings.surfaces import surface_errors, surface_report

__all__ = [
    "MOMENTS_STAND_IN",
    "boxes_proposed",
    "failure_report",
    "failure_warnings",
    "quadrature_gap",
    "refuse_unreachable",
    "review",
    "score_steps",
    "statuses",
    "surface_errors",
    "surface_report",
    "unreachable",
]
