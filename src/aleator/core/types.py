"""Arrays by what they hold; shapes stand in the docstrings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers."""
Indices = NDArray[np.intp]
"""Positions in another array."""
Flags = NDArray[np.bool_]
"""One truth value for each entry."""
