"""Response surfaces: polynomials that stand for the simulator, made exact in rounds of runs.

Three nouns: a `ResponseSurface` is the user's choice of how exact surfaces are, and at what price;
a `Surface` has the polynomials of all experiments over a region, with their estimated errors;
`AdaptiveSurfaces` are surfaces with the runs that they go through, which rounds of runs improve.

Each experiment has a polynomial of its own (`emulator`, `fit`), or all share one Gaussian process
over conditions and parameters (`shared`), of which polynomials are taken.
"""

from aleator.surrogates.adaptive import AdaptiveSurfaces, build_surface, surfaces_of
from aleator.surrogates.choice import ResponseSurface
from aleator.surrogates.surface import Surface

__all__ = ["AdaptiveSurfaces", "ResponseSurface", "Surface", "build_surface", "surfaces_of"]
