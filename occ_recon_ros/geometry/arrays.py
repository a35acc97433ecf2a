"""The array types that signatures name; what their axes hold, docstrings tell."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
