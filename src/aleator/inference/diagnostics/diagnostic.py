"""One thing that a reader of an answer must know."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Diagnostic:
    """Something to know before the numbers are used: about what, and what to do.

    `concerns` are the names of what is concerned: ids of experiments, hyperparameters, or the
    parameters of the simulator.
    """

    about: str
    message: str
    remedy: str
    concerns: tuple[str, ...] = ()
