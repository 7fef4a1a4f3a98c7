"""Types of arrays, by what their entries are; the shapes are written in the docstrings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""An array of floating-point numbers."""
Indices = NDArray[np.intp]
"""An array of positions in another array."""
Flags = NDArray[np.bool_]
"""An array of truth values."""
