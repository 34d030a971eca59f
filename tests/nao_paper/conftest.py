"""Fixtures of several tests of this folder."""

import numpy as np
import pytest
from nao_paper_bench.stance_pool import (
    find_stances,
)

from calib.nao.chain import SIDES
from recorded.nao_scenes import CAMERA


@pytest.fixture(scope="session")
def pool():
    rng = np.random.default_rng(7)
    return [s for side in SIDES for s in find_stances(side, CAMERA, 40, rng)]
