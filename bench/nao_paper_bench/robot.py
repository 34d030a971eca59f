"""A simulated NAO on its back: joints that take their time, encoders in whole steps, images that arrive late."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.errors import ExecutionStopped
from arm.se3 import Array, frozen
from calib.nao.chain import HEAD, LEG, SIDES, nao_model
from nao_paper_bench.kinematics import NaoKinematics

_LEGS = tuple(side + joint for side in SIDES for joint in LEG)


@dataclass(frozen=True)
class Servos:
    """How the joints move and are read; the paper's figures where it gives any (section 1 and eq. 2), else assumed.

    Attributes:
        speed: of the joint that has the longest way, rad/s.
        lag: time constant with which joints follow, s.
        stuck: largest distance at which friction stops a joint from where it was sent, rad.
        step: of encoders and commands, rad; 0 for exact ones that stop where they were sent.
        encoder_period: between readings, s.
        image_period: between images, s.
        image_lag: from the light on the chip to the image in hand, s.
    """

    speed: float = 1.0
    lag: float = 0.06
    stuck: float = np.radians(0.2)
    step: float = np.radians(0.1)
    encoder_period: float = 0.01
    image_period: float = 1.0 / 30.0
    image_lag: float = 0.07


@dataclass(frozen=True, eq=False)
class _Move:
    began: float
    a: Array
    b: Array
    ramp: float  # s until the command has reached b

    def at(self, t: float, lag: float) -> Array:
        """Encoder angles at a time, of joints that follow a ramp with a lag."""
        since = max(t - self.began, 0.0)
        if self.ramp <= 0.0:
            return self.b
        ramp = min(since, self.ramp)
        part = (ramp - lag * (1.0 - np.exp(-ramp / lag))) / self.ramp
        if since > self.ramp:
            part = 1.0 - (1.0 - part) * np.exp(-(since - self.ramp) / lag)
        return np.asarray(self.a + part * (self.b - self.a))


@dataclass(frozen=True, eq=False)
class Glimpse:
    """What a camera had before it when an image was taken: encoder angles, exact, of all joints."""

    taken: float
    arrived: float
    angles: Array


class SimulatedNao:
    """The robot and its clock."""

    def __init__(
        self, true: NaoKinematics, posture: Array, rng: np.random.Generator, servos: Servos | None = None
    ) -> None:
        """
        Args:
            true: what it really is.
            posture: encoder angles of all joints at the start, in the order of the model.
            rng: of friction.
            servos: how joints move.
        """
        self.true = true
        self.servos = servos or Servos()
        self.time = 0.0
        self._rng = rng
        self._moves = [_Move(0.0, posture, posture, 0.0)]
        model = nao_model()
        self._at = {name: model.joints[model.getJointId(name)].idx_q for name in (*HEAD, *_LEGS)}

    def send(self, posture: Array) -> float:
        """Command all joints; returns when they should be there, s."""
        step = self.servos.step
        wanted = np.rint(posture / step) * step if step else posture
        now = self._moves[-1].at(self.time, self.servos.lag)
        moving = np.abs(wanted - now) > 2.0 * self.servos.stuck
        if step:
            off = self._rng.uniform(-self.servos.stuck, self.servos.stuck, len(posture))
            end = np.where(moving, wanted + off, now)  # what is near enough stays where it is
        else:
            end = wanted
        ramp = float(np.abs(end - now).max() / self.servos.speed)
        self._moves = [*self._moves[-2:], _Move(self.time, now, end, ramp)]
        return self.time + ramp

    def wait(self, until: float) -> None:
        """Let time pass."""
        self.time = max(self.time, until)

    def encoders(self) -> Array:
        """The newest readings of all joints."""
        read = np.floor(self.time / self.servos.encoder_period) * self.servos.encoder_period
        step, angles = self.servos.step, self._angles(read)
        return np.rint(angles / step) * step if step else angles

    def image(self) -> Glimpse:
        """The newest image that has arrived."""
        period, lag = self.servos.image_period, self.servos.image_lag
        taken = np.floor((self.time - lag) / period) * period
        return Glimpse(float(taken), float(taken + lag), frozen(self._angles(taken)))

    def settle(self, still: float = 0.25, at_most: float = 10.0) -> None:
        """Wait until the encoders have shown the same for `still` s, and an image of that has arrived.

        Raises:
            ExecutionStopped: they still move after `at_most` s.
        """
        began = same_since = self.time
        last = self.encoders()
        while self.time - same_since < still:
            if self.time - began > at_most:
                raise ExecutionStopped(f"the NAO's joints still move {at_most:g} s after their command")
            self.time += self.servos.encoder_period
            now = self.encoders()
            if np.abs(now - last).max() > 1e-6:
                same_since = self.time
            last = now
        self.time += self.servos.image_lag + self.servos.image_period

    def of_leg(self, side: str, angles: Array) -> Array:
        """A leg's (6,) of all joints' angles."""
        return self._some([side + joint for joint in LEG], angles)

    def of_head(self, angles: Array) -> Array:
        """The head's (2,) of all joints' angles."""
        return self._some(HEAD, angles)

    def _some(self, names: Sequence[str], angles: Array) -> Array:
        return angles[[self._at[n] for n in names]]

    def _angles(self, t: float) -> Array:
        move = next((m for m in reversed(self._moves) if m.began <= t), self._moves[0])
        return move.at(t, self.servos.lag)
