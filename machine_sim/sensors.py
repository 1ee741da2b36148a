"""Sensors of a machine: inertial measurement units and joint encoders, with their errors.

The state that the machine publishes is exact. An inertial unit measures the specific force (its
acceleration minus gravity) and its angular velocity in its own axes; an encoder reports the joint
angle with a delay. Both add noise, and an inertial unit a bias that is constant in a run. Errors
come from a separate generator, so that they do not change the simulation.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.link_motion import LinkMotion, link_motions
from machine_sim.machine.spec import MachineSpec
from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["EncoderReading", "ImuReading", "SensorParams", "Sensors"]

Array = NDArray[np.float64]

_GRAVITY_VECTOR = np.array([0.0, 0.0, -GRAVITY])

_RNG_STREAM = 1
"""Stream of the generator: distinct from that of released soil with the same seed."""


@dataclass(frozen=True)
class SensorParams(Parameters):
    """Rates and errors of the machine's sensors; the defaults have no errors."""

    rate: float = parameter(
        50.0,
        "rate of imu/<name>/data and joint_states_measured; 0: not published",
        unit="Hz of simulated time",
        low=0.0,
        high=1000.0,
    )
    accelerometer_noise: float = parameter(
        0.0, "standard deviation of the noise", unit="m/s^2", low=0.0, high=100.0
    )
    accelerometer_bias: float = parameter(
        0.0, "standard deviation of the constant bias of each axis", unit="m/s^2",
        low=0.0, high=10.0,
    )  # fmt: skip
    gyro_noise: float = parameter(
        0.0, "standard deviation of the noise", unit="rad/s", low=0.0, high=10.0
    )
    gyro_bias: float = parameter(
        0.0, "standard deviation of the constant bias of each axis", unit="rad/s",
        low=0.0, high=1.0,
    )  # fmt: skip
    encoder_noise: float = parameter(
        0.0, "standard deviation of the noise of angles", unit="rad", low=0.0, high=1.0
    )
    encoder_speed_noise: float = parameter(
        0.0, "standard deviation of the noise of velocities", unit="rad/s", low=0.0, high=10.0
    )
    encoder_delay: float = parameter(
        0.0, "delay of angles and velocities", unit="s", low=0.0, high=2.0
    )


class ImuReading(NamedTuple):
    """Reading of one inertial unit.

    Attributes:
        name: name of the unit.
        frame: link that it is fixed to; the unit has the link's axes.
        quaternion: rotation link to map, x, y, z, w.
        angular_velocity: [rad/s], link axes, shape (3,).
        specific_force: [m/s^2], link axes, shape (3,); at rest 9.81 upward.
    """

    name: str
    frame: str
    quaternion: Array
    angular_velocity: Array
    specific_force: Array


class EncoderReading(NamedTuple):
    """Reading of the encoders of all joints.

    Attributes:
        time: simulation time of the measurement [s].
        angles, speeds: [rad] and [rad/s], in the order of the joints, shape (joints,).
    """

    time: float
    angles: Array
    speeds: Array


class MachineMotion(Protocol):
    """Motion of a machine, as sensors need it."""

    @property
    def base_pose(self) -> tuple[Array, Array]: ...
    @property
    def base_velocity(self) -> tuple[Array, Array]: ...
    @property
    def joint_positions(self) -> Array: ...
    @property
    def joint_velocities(self) -> Array: ...


class Sensors:
    """Sensors of one machine; `read` is called at equal intervals.

    The specific force is the mean since the last reading, as after an anti-aliasing filter: the
    instantaneous acceleration of a machine on tracks is too rough.
    """

    def __init__(
        self, spec: MachineSpec, params: SensorParams, seed: int, machine_index: int = 0
    ) -> None:
        """
        Args:
            spec: machine with its inertial units.
            params: rates and errors.
            seed: seed of the errors.
            machine_index: index of the machine in its node, for independent errors.
        """
        self._machine_spec = spec
        self._params = params
        self._rng = np.random.default_rng((seed, _RNG_STREAM, machine_index))
        draw = self._rng.normal
        count = len(spec.imus)
        self._accelerometer_bias = params.accelerometer_bias * draw(size=(count, 3))
        self._gyro_bias = params.gyro_bias * draw(size=(count, 3))
        self._last_velocities: tuple[float, list[Array]] | None = None
        self._history: deque[EncoderReading] = deque()

    def read(self, machine: MachineMotion, time: float) -> tuple[list[ImuReading], EncoderReading]:
        """Return the readings at simulation time `time` [s], which increases from call to call."""
        angles, speeds = machine.joint_positions, machine.joint_velocities
        motions = link_motions(
            self._machine_spec, *machine.base_pose, *machine.base_velocity, angles, speeds
        )
        return self._imus(motions, time), self._encoders(EncoderReading(time, angles, speeds))

    def _imus(self, motions: dict[str, LinkMotion], time: float) -> list[ImuReading]:
        """Return the readings of all inertial units."""
        units = self._machine_spec.imus
        velocities = [motions[unit.link].velocity_at(unit.position) for unit in units]
        previous = self._last_velocities
        self._last_velocities = (time, velocities)
        readings = []
        for k, unit in enumerate(units):
            motion = motions[unit.link]
            acceleration = np.zeros(3)
            if previous is not None and time > previous[0]:
                acceleration = (velocities[k] - previous[1][k]) / (time - previous[0])
            force = motion.rotation.T @ (acceleration - _GRAVITY_VECTOR)
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
        """Return the newest reading that is at least `encoder_delay` old, or else the oldest."""
        self._history.append(now)
        # A tolerance of half a nanosecond: sums of time steps are not exact.
        due_time = now.time - self._params.encoder_delay + 5e-10
        while len(self._history) > 1 and self._history[1].time <= due_time:
            self._history.popleft()
        time, angles, speeds = self._history[0]
        return EncoderReading(
            time,
            angles + self._noise(self._params.encoder_noise, angles.size),
            speeds + self._noise(self._params.encoder_speed_noise, speeds.size),
        )

    def _noise(self, deviation: float, count: int) -> Array:
        """Return Gaussian noise of a standard deviation, shape (count,)."""
        return deviation * self._rng.normal(size=count)
