"""What functions of arrays take and return; a docstring gives shape, unit and frame."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
