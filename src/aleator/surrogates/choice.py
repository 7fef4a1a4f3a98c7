"""What a user chooses of the response surfaces: how exact they are, and at what price."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from aleator.errors import InputsError
from aleator.laws.quadrature import Cubature
from aleator.surrogates.fit import PLACES

Surfaces = Literal["none", "own", "shared"]


@dataclass(frozen=True)
class ResponseSurface:
    """The choice of response surfaces: how exact, and at what price.

    tolerance: estimated root-mean-square error over the scatter of the outcome, both over the
    region, in (0, 1). None: the surfaces are made exact where the law has its mass, and no more
    exact than the answer needs.
    max_runs: the most runs for one experiment, from 4 to 4096.
    accuracy: relative accuracy of the simulator, in [0, 1); an error below accuracy times the size
    of the outcome counts as converged.
    nodes: Gauss nodes a parameter, or a cubature, when the surfaces are propagated; None leaves it
    open.
    surfaces: "own": each experiment has a surface of its own. "shared": one surface, over
    conditions and parameters, serves all experiments. "none": the simulator itself is run at every
    node. None: no surfaces of a vectorized simulator, own ones of any other. A tolerance
    and nodes go with surfaces of their own.

    Raises InputsError for a value outside these ranges.

    >>> ResponseSurface(tolerance=0.01).max_runs
    1000
    """

    tolerance: float | None = None
    max_runs: int = 1000
    accuracy: float = 1e-6
    nodes: int | Cubature | None = None
    surfaces: Surfaces | None = None

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return "response_surface"

    def __post_init__(self) -> None:
        kinds, most = get_args(Surfaces), PLACES.candidates
        admitted = self.tolerance is None or 0.0 < self.tolerance < 1.0
        _require("tolerance", self.tolerance, admitted, "choose one in (0, 1), e.g. 0.02")
        _require("max_runs", self.max_runs, 4 <= self.max_runs <= most, f"choose 4 to {most}")
        exact = 0.0 <= self.accuracy < 1.0
        _require("accuracy", self.accuracy, exact, "choose one in [0, 1), e.g. 1e-6")
        known = self.surfaces in (None, *kinds)
        _require("surfaces", self.surfaces, known, f"choose one of {', '.join(kinds)}")
        alone = self.surfaces in (None, "own") or self.tolerance is None
        remedy = "leave out the tolerance, which is one of own surfaces"
        _require("surfaces", self.surfaces, alone, remedy)
        enough = not isinstance(self.nodes, int) or self.nodes >= 1
        _require("nodes", self.nodes, enough, "choose at least 1")


def _require(name: str, value: object, admitted: bool, remedy: str) -> None:
    if not admitted:
        raise InputsError(f"response surface: {name} {value}", remedy)
