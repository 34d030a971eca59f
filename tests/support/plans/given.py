"""Arguments that are no configurations."""

from __future__ import annotations

import numpy as np

from tasks.task2 import Q_START

NAN, INF = float("nan"), float("inf")

HOME = np.array(Q_START)

NO_CONFIGURATION = {
    "three numbers": [0.0, 1.0, 2.0],
    "two rows": np.zeros((2, 6)),
    "nothing": None,
    "text": "home",
    "texts": ["0"] * 6,
    "nan": [NAN, *HOME[1:]],
    "inf": [*HOME[:5], INF],
    "huge": np.full(6, 1e300),
    "empty": [],
    "ragged": [[0.0], [0.0, 1.0]],
}
