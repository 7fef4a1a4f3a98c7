"""What the pictures of a report show beside the answer: curves, and what was predicted."""

from aleator.tasks.pictures.pictures import pictured as pictured

__all__ = ["pictured"]
