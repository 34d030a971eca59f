"""What a preview shows."""

import numpy as np


def matrix(numbers: list[float]) -> np.ndarray:
    return np.vstack([np.reshape(numbers, (3, 4)), [0.0, 0.0, 0.0, 1.0]])
