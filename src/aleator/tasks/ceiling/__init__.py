"""The best possible law of what was identified: its value, its points, and its p value."""

from aleator.tasks.ceiling.ceiling import Ceiling, ceiling, gap_of
from aleator.tasks.ceiling.sought import require_one_law

__all__ = ["Ceiling", "ceiling", "gap_of", "require_one_law"]
