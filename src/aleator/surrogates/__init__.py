"""Response surfaces: polynomials that stand for the simulator, made exact in rounds of runs."""

from aleator.surrogates.adaptive import AdaptiveSurfaces, build_surface, surfaces_of
from aleator.surrogates.choice import ResponseSurface
from aleator.surrogates.surface import Surface

__all__ = ["AdaptiveSurfaces", "ResponseSurface", "Surface", "build_surface", "surfaces_of"]
