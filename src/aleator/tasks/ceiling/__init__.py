"""The best possible law of what was identified: its value, its points, and its p value."""

from aleator.tasks.ceiling.ceiling import Ceiling, ceiling
from aleator.tasks.ceiling.sought import require_one_law

__all__ = ["Ceiling", "ceiling", "require_one_law"]
