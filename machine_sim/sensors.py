"""What sensors on the machine would say: inertial units and joint encoders, with their errors.

The state that the machine publishes is the truth. Sensors tell less: an inertial unit feels the
*specific force* (its acceleration less gravity) and its turning, in its own axes; an encoder tells
an angle a little late. Both add noise, and an inertial unit a bias that stays for a run. Errors are
drawn from a generator of their own, so that they change nothing of what happens.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.link_motion import LinkMotion, link_motions
from machine_sim.machine.spec import MachineSpec
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["EncoderReading", "ImuReading", "SensorParams", "Sensors"]

Array = NDArray[np.float64]

_GRAVITY = np.array([0.0, 0.0, -9.81])

_RNG_STREAM = 1
"""Tells the numbers drawn here from those that scatter released soil by the same seed."""


@dataclass(frozen=True)
class SensorParams(Parameters):
    """Rates and errors of the machine's sensors; none as shipped."""

    rate: float = parameter(
        50.0, "imu/<name>/data and joint_states_measured; 0: not at all", unit="Hz of simulated time",
        low=0.0, high=1000.0,
    )  # fmt: skip
    accelerometer_noise: float = parameter(
        0.0, "standard deviation of each reading", unit="m/s^2", low=0.0, high=100.0
    )
    accelerometer_bias: float = parameter(
        0.0, "standard deviation of the bias that each axis has in a run", unit="m/s^2",
        low=0.0, high=10.0,
    )  # fmt: skip
    gyro_noise: float = parameter(
        0.0, "standard deviation of each reading", unit="rad/s", low=0.0, high=10.0
    )
    gyro_bias: float = parameter(
        0.0, "standard deviation of the bias that each axis has in a run", unit="rad/s",
        low=0.0, high=1.0,
    )  # fmt: skip
    encoder_noise: float = parameter(
        0.0, "standard deviation of each angle", unit="rad", low=0.0, high=1.0
    )
    encoder_speed_noise: float = parameter(
        0.0, "standard deviation of each speed", unit="rad/s", low=0.0, high=10.0
    )
    encoder_delay: float = parameter(
        0.0, "age of what the encoders tell", unit="s", low=0.0, high=2.0
    )


class ImuReading(NamedTuple):
    """Of one inertial unit.

    Attributes:
        name: of the unit.
        frame: link that it is fixed to, whose axes are its own.
        quaternion: link to map, x, y, z, w.
        spin: angular velocity [rad/s], link axes, shape (3,).
        specific_force: [m/s^2], link axes, shape (3,): at rest 9.81 upward.
    """

    name: str
    frame: str
    quaternion: Array
    angular_velocity: Array
    specific_force: Array


class EncoderReading(NamedTuple):
    """Of all joints.

    Attributes:
        time: simulation time that it is of [s].
        angles, speeds: [rad], [rad/s], in the order of the joints.
    """

    time: float
    angles: Array
    speeds: Array


class MachineMotion(Protocol):
    """A machine, as far as sensors look at it."""

    @property
    def base_pose(self) -> tuple[Array, Array]: ...
    @property
    def base_velocity(self) -> tuple[Array, Array]: ...
    @property
    def joint_positions(self) -> Array: ...
    @property
    def joint_velocities(self) -> Array: ...


class Sensors:
    """The sensors of one machine; `read` at equal intervals.

    What an inertial unit feels is the mean over the time since it was read last, as its filter
    would have it: the motion of a machine on tracks is too rough for single moments.
    """

    def __init__(
        self, spec: MachineSpec, params: SensorParams, seed: int, machine_index: int = 0
    ) -> None:
        """
        Args:
            description: the machine, which says where its inertial units are.
            params: errors.
            seed: of the errors.
            number: of the machine among those of its node, whose errors are others.
        """
        self._machine_spec = spec
        self._params = params
        self._rng = np.random.default_rng((seed, _RNG_STREAM, machine_index))
        draw = self._rng.normal
        count = len(spec.imus)
        self._accelerometer_bias = params.accelerometer_bias * draw(size=(count, 3))
        self._gyro_bias = params.gyro_bias * draw(size=(count, 3))
        self._last: tuple[float, list[Array]] | None = None
        self._history: deque[EncoderReading] = deque()

    def read(self, machine: MachineMotion, time: float) -> tuple[list[ImuReading], EncoderReading]:
        """What the sensors say at simulation time `time` [s], later than the last time."""
        angles, speeds = machine.joint_positions, machine.joint_velocities
        motions = link_motions(
            self._machine_spec, *machine.base_pose, *machine.base_velocity, angles, speeds
        )
        return self._imus(motions, time), self._encoders(EncoderReading(time, angles, speeds))

    def _imus(self, motions: dict[str, LinkMotion], time: float) -> list[ImuReading]:
        units = self._machine_spec.imus
        velocities = [motions[unit.link].velocity_at(unit.position) for unit in units]
        before = self._last
        self._last = (time, velocities)
        readings = []
        for k, unit in enumerate(units):
            motion = motions[unit.link]
            acceleration = np.zeros(3)
            if before is not None and time > before[0]:
                acceleration = (velocities[k] - before[1][k]) / (time - before[0])
            force = motion.rotation.T @ (acceleration - _GRAVITY)
            angular_velocity = motion.rotation.T @ motion.angular_velocity
            readings.append(
                ImuReading(
                    unit.name,
                    unit.link,
                    motion.quaternion,
                    angular_velocity + self._gyro_bias[k] + self._noise(self._params.gyro_noise, 3),
                    force
                    + self._accelerometer_bias[k]
                    + self._noise(self._params.accelerometer_noise, 3),
                )
            )
        return readings

    def _encoders(self, now: EncoderReading) -> EncoderReading:
        """The newest reading that is old enough, or the oldest there is."""
        self._history.append(now)
        # Half a nanosecond: sums of time steps are not exact.
        due = now.time - self._params.encoder_delay + 5e-10
        while len(self._history) > 1 and self._history[1].time <= due:
            self._history.popleft()
        time, angles, speeds = self._history[0]
        return EncoderReading(
            time,
            angles + self._noise(self._params.encoder_noise, angles.size),
            speeds + self._noise(self._params.encoder_speed_noise, speeds.size),
        )

    def _noise(self, deviation: float, count: int) -> Array:
        return deviation * self._rng.normal(size=count)
