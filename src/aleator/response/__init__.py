"""Response surfaces: a polynomial an experiment, built once, or sharpened round by round."""

from aleator.response.build import ResponseSurface, build_surface
from aleator.response.shared import Shared
from aleator.response.sharpened import Sharpened
from aleator.response.surface import Surface

__all__ = ["ResponseSurface", "build_surface", "Sharpened", "Shared", "Surface"]
