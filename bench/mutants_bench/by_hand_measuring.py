"""Mutants written by hand of `vision` and `calib`; see `mutants_bench.by_hand`."""

from __future__ import annotations

_LIMBS = ("calib/nao/test_limbs.py",)
_SCATTER = ("calib/chain/test_scatter.py",)
_SHIFT = ("vision/background/test_camera_shift.py",)
_FEATURES = ("vision/background/test_features.py",)
_TRACKING = ("vision/background/test_tracking.py",)
_WATCH = ("vision/background/test_watch.py",)
_VIDEO = ("vision/camera/video/test_camera.py",)
_READER = ("vision/camera/video/test_reader.py",)
_SETTINGS = ("vision/camera/video/test_settings.py",)

ROWS: tuple[tuple[str, str, str, str, str, tuple[str, ...]], ...] = (
    # name, file, old, new, what, tests
    (
        "limbs-sign",
        "calib/nao/limbs.py",
        "            float(test.amount[k]),\n",
        "            -float(test.amount[k]),\n",
        "a limb that is longer is told as shorter",
        _LIMBS,
    ),
    (
        "limbs-one-leg",
        "calib/nao/limbs.py",
        "for n in LIMB_NAMES if n[0] in sides]\n",
        "for n in LIMB_NAMES]\n",
        "limbs of a leg that was not seen are tested",
        _LIMBS,
    ),
    (
        "limbs-prior",
        "calib/nao/limbs.py",
        "    S[n:, n:] += np.eye(len(limbs)) / LIMB_SIGMA**2\n",
        "    S[n:, n:] += np.eye(len(limbs)) / (0.1 * LIMB_SIGMA) ** 2\n",
        "limbs are held near the data sheet's lengths",
        _LIMBS,
    ),
    (
        "limbs-other-cause",
        "calib/nao/limbs.py",
        "    return Trial(part, max(test.drop - max(others), 0.0), test.limit)\n",
        "    return Trial(part, test.drop, test.limit)\n",
        "limbs stand in for a target of another size",
        _LIMBS,
    ),
    (
        "limbs-chance",
        "calib/nao/limbs.py",
        "    limit = largest_rise(MEANINGLESS, len(limbs), problem.noise_freedom) * excess\n",
        "    limit = 0.0\n",
        "limbs that explain no more than chance are shown",
        _LIMBS,
    ),
    (
        "scatter-base",
        "calib/chain/scatter.py",
        "    variances = data.base**2 + scatter**2\n",
        "    variances = scatter**2\n",
        "errors of readings that are known count as scatter",
        _SCATTER,
    ),
    (
        "scatter-robust",
        "calib/chain/scatter.py",
        "            weights = (_HEAVY + 6.0) / (_HEAVY + solved.distances)\n",
        "            weights = np.ones(len(data.y))\n",
        "wrong images pass for scatter",
        _SCATTER,
    ),
    (
        "scatter-used",
        "calib/chain/scatter.py",
        "        used = (weights > 0.0).astype(float)\n",
        "        used = np.ones(len(weights))\n",
        "images that are left out make the scatter small",
        _SCATTER,
    ),
    (
        "scatter-smooth",
        "calib/chain/scatter.py",
        "        precision[data.smooth] = sizes.smooth**-2.0\n",
        "        pass\n",
        "smooth errors may have any size",
        _SCATTER,
    ),
    (
        "scatter-restricted",
        "calib/chain/scatter.py",
        "        value += 0.5 * float(np.linalg.slogdet(scaled)[1] + np.log(diagonal).sum()) + count * theta[-1]\n",
        "",
        "the likelihood is not restricted: unknowns hide scatter",
        _SCATTER,
    ),
    (
        "background-scale",
        "vision/background/camera_shift.py",
        "        if abs(self.scale) > max(LARGEST_SCALE, SURE * self.scale_sigma):\n",
        "        if False:\n",
        "a camera that was lowered is corrected as if it had turned",
        _SHIFT,
    ),
    (
        "background-limit",
        "vision/background/camera_shift.py",
        "        if self.move > limit:\n",
        "        if False:\n",
        "a shift of any size is corrected",
        _SHIFT,
    ),
    (
        "background-gate",
        "vision/background/camera_shift.py",
        "        now = squares < GATE**2\n",
        "        now = squares < np.inf\n",
        "features that disagree take part in the fit",
        _SHIFT,
    ),
    (
        "background-translation",
        "vision/background/camera_shift.py",
        "        return found + np.outer(v, v) / 3.0\n",
        "        return found\n",
        "that a shift may be a translation is not in the covariance",
        _SHIFT,
    ),
    (
        "background-covered",
        "vision/background/features.py",
        "            cv2.fillConvexPoly(usable, cv2.convexHull(np.rint(outline).astype(np.int32)), 0)\n",
        "            pass\n",
        "features are taken on boards",
        _FEATURES,
    ),
    (
        "background-calibration",
        "vision/background/features.py",
        "    if (size, digest) != (camera.size, camera.digest):\n",
        "    if size != camera.size:\n",
        "the background of another calibration is used",
        _FEATURES,
    ),
    (
        "background-alike",
        "vision/background/tracking.py",
        "    if peak < ALIKE:\n",
        "    if False:\n",
        "a feature is found where nothing is like it",
        _TRACKING,
    ),
    (
        "background-each-image",
        "vision/background/watch.py",
        "            shifts[-1].require_small(self.limit)\n",
        "            shifts[0].require_small(self.limit)\n",
        "later images of a look may be off by any amount",
        _WATCH,
    ),
    (
        "video-old-frame",
        "vision/camera/video/camera.py",
        "                fits = frame.taken >= after and not frame.repeats\n",
        "                fits = frame.received >= after and not frame.repeats\n",
        "a frame that the network held back is used",
        _VIDEO,
    ),
    (
        "video-frozen",
        "vision/camera/video/camera.py",
        "                fits = frame.taken >= after and not frame.repeats\n",
        "                fits = frame.taken >= after\n",
        "a stream that is frozen is used",
        _VIDEO,
    ),
    (
        "video-recording",
        "vision/camera/video/camera.py",
        '        if chosen.kind == "stream" and device.get(cv2.CAP_PROP_FRAME_COUNT) > 0.0:\n',
        "        if False:\n",
        "a recording that is sent over the network passes for a camera",
        _VIDEO,
    ),
    (
        "video-size",
        "vision/camera/video/camera.py",
        "                    self._require_size(frame.image)\n",
        "",
        "frames of another size than the calibration's are used",
        _VIDEO,
    ),
    (
        "video-stamps-back",
        "vision/camera/video/reader.py",
        "        elif stamp <= self.stamp:\n",
        "        elif False:\n",
        "time stamps may go back",
        _READER,
    ),
    (
        "video-setting",
        "vision/camera/video/settings.py",
        "    if not accepted or abs(now - wanted) > near:\n",
        "    if not accepted:\n",
        "a setting that the driver changed counts as made",
        _SETTINGS,
    ),
)
