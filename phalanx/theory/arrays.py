"""Array types for every room."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""An array of float64."""
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
