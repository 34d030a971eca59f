"""A chain read from a URDF model."""

import numpy as np
import pytest

from calib.model.chain import Motion, Unknown
from calib.model.from_urdf import chain_from_root
from calib.nao.chain import LEG, nao_model


def test_geometric_errors_stand_after_the_joint_they_belong_to():
    shift = Motion(np.array([0.0, 0.0, 1.0]), turns=False, unknowns=(Unknown(0),))
    columns = {f"L{joint}": i for i, joint in enumerate(LEG)}
    chain = chain_from_root(
        nao_model(), "L_sole", columns, after=lambda joint: (shift,) if joint == "LKneePitch" else ()
    )
    q = np.zeros((1, 6))
    q[0, 3] = np.pi / 2  # the tibia lies along -x then, and its length with it
    longer, plain = (chain.evaluate(q, np.array([u])).T[0] for u in (0.01, 0.0))
    assert longer[:3, 3] - plain[:3, 3] == pytest.approx([0.01, 0.0, 0.0], abs=1e-9)
