"""Response surfaces: a polynomial an experiment over the box, built once, with its error."""

from aleator.response.build import ResponseSurface, build_surface
from aleator.response.surface import Surface

__all__ = ["ResponseSurface", "build_surface", "Surface"]
