"""Response surfaces: a polynomial an experiment, built once, or sharpened round by round."""

from aleator.surrogates.build import ResponseSurface, build_surface
from aleator.surrogates.shared import Shared
from aleator.surrogates.sharpened import Sharpened
from aleator.surrogates.surface import Surface

__all__ = ["ResponseSurface", "build_surface", "Sharpened", "Shared", "Surface"]
