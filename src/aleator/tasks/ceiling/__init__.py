"""The best possible law of what was identified: its value, its points, and its p value."""

from aleator.tasks.ceiling.ceiling import Ceiling, ceiling

__all__ = ["Ceiling", "ceiling"]
