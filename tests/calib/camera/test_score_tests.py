"""Score tests of what may be wrong with views."""

from calib.camera.score_tests import error_hypotheses
from pictures.targets import CHARUCO, fitted


def test_suspects_are_silent_about_sound_views():
    sigmas = [s.sigmas for seed in range(6) for s in error_hypotheses(*reversed(fitted(200 + seed)), CHARUCO)]
    assert max(sigmas) < 4.5
