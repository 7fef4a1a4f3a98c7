"""Response surfaces: polynomials that replace the simulator, refined by rounds of simulator runs.

A `ResponseSurface` is the user's choice of how exact the surfaces are and how many runs they may
take. A `Surface` holds the polynomials of all experiments over a region of the parameters, with
their estimated errors. `AdaptiveSurfaces` are surfaces with the runs that they are fitted to; each
round of runs improves them.

For an identification, Gaussian processes over conditions and parameters learn from the runs of all
experiments (`processes`, `kriging`), and polynomials are fitted to them. With a tolerance, or under
a given law, each experiment has a polynomial of its own (`emulator`, `fit`).
"""

from aleator.surrogates.adaptive import AdaptiveSurfaces, build_surface, surfaces_of
from aleator.surrogates.choice import ResponseSurface
from aleator.surrogates.surface import Surface

__all__ = ["AdaptiveSurfaces", "ResponseSurface", "Surface", "build_surface", "surfaces_of"]
