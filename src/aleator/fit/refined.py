"""The result of maximizing, with what it rests on, and the region of parameters that it needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from aleator.core.types import Array
from aleator.fit.quadrature import AnyLikelihood, Maximum
from aleator.fit.question import Question
from aleator.fit.regions import REGIONS, hull, padded, reaching_out, region_of
from aleator.laws.inputs import Inputs
from aleator.search import SearchResult
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import AdaptiveSurfaces
from aleator.surrogates.samples import Sites

if TYPE_CHECKING:
    from aleator.fit.emulate import Emulation


@dataclass(frozen=True, eq=False)
class Refined:
    """A maximum, the search that led to it, and the response surfaces that it rests on.

    `question` leaves out observations whose runs all fail. `surfaces` is None where the simulator
    itself was integrated over. `sites` are the distinct outputs that have a surface each, on the
    `region` (n, 2) of the parameters. `others` are lower maxima with surfaces refined for them.
    `possible` are optima (K,) of the search whose log-likelihood is less than 1.92 below the
    maximum. If `spread` is true, the region contains the laws at the ends of the profile intervals
    and is not narrowed. `reason` says why there are surfaces, or none.
    `emulation` has the Gaussian processes, if the likelihood was maximized on them.
    """

    question: Question
    maximum: Maximum
    search_result: SearchResult
    region: Array
    reason: str
    surfaces: AdaptiveSurfaces | None = None
    sites: Sites | None = None
    others: tuple[Maximum, ...] = ()
    possible: tuple[Array, ...] = ()
    spread: bool = False
    emulation: Emulation | None = None

    @property
    def likelihood(self) -> AnyLikelihood:
        """The likelihood, with quadrature nodes adapted to the maximum."""
        return self.maximum.likelihood

    @property
    def alpha(self) -> Array:
        """The values alpha (K,) of the hyperparameters at the maximum."""
        return self.maximum.alpha


def next_region(
    inputs: Inputs, region: Array, alpha: Array, likely: Array, experiments: int, shrink: float
) -> Array:
    """The region (n, 2) of the next surfaces: a new one for the plausible laws, or the present.

    The region changes if the law alpha (K,) extends beyond it, or if the new region has less than
    the share `shrink` of its volume. `likely` (A, K) are plausible laws.
    """
    certain = region_of(inputs, [alpha], experiments, REGIONS.far)
    possible = region_of(inputs, [*likely], experiments, REGIONS.plausible)
    wanted = padded(hull(certain, possible), inputs.box)
    if reaching_out(region, inputs.box, certain).any():
        way = np.diff(region, axis=1) * np.array([-1.0, 1.0])
        return np.clip(wanted, region[:, :1] + way[:, :1], region[:, 1:] + way[:, 1:])
    moving = moving_parameters(region)
    width = np.diff(region, axis=1)[moving, 0]
    share = np.prod(np.diff(wanted, axis=1)[moving, 0] / width)
    return wanted if share < shrink else region
