"""``a465 emulate`` with a camera whose noise depends on the state of its cell alone.

The camera of the program draws its noise image after image, and how many images it has written by then depends on the
load of the host. Here each set of images begins anew, with a seed of the arm's counts and of what the jaws have done.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cell.cli.start import main as a465
from cell.sim.camera import SimulatedCamera


class SteadyCamera(SimulatedCamera):
    """A camera that takes the same images of the same state."""

    def grab(self, count: int) -> list[npt.NDArray[np.uint8]]:
        state = [*np.asarray(self._counts()), len(self._simulated.history)]
        self._camera.noise = np.random.default_rng(
            [self._simulated.world.seed, *(int(n) % 2**32 for n in state)]
        )
        return super().grab(count)


def main() -> None:
    """Run the command of ``sys.argv``."""
    import cell.sim.camera

    cell.sim.camera.SimulatedCamera = SteadyCamera  # type: ignore[misc]
    a465()
