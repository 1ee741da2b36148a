"""Soil resistance: the wrenches of the soil on a tool that cuts it or rests on it.

The soil answers a tick with FORCE rows, which arrive one or two ticks later. They hold the maximum
of two wrenches: the resistance to cutting, against the tool's motion, and the bearing reaction,
normal to the plates that touch the ground. Each wrench applies until the next FORCE row replaces
it; its contact point is fixed to the tool. Both act through a capped spring-damper
(`machine_sim.tool_soil.capped_spring_damper`), so that they resist and never drive the tool.

The resistance to cutting is what the soil ahead can exert at most: on the edge, and on the soil in
the tool, which transmits it. What the soil in the tool exerts already, besides its weight, is
therefore not exerted on the edge again.

The soil computes a bearing reaction whether the tool moves or not, but none while the tool has
bounced off the ground. It computes a resistance to cutting only while the tool cuts; a zero for a
tool that stalls, or is pressed back a little, is no statement about the soil ahead of it. A zero
therefore leaves the previous wrench in force. A wrench is removed once the tool is
`_RELEASE_DISTANCE` away from where the wrench was set, or after `FORCE_TIMEOUT_TICKS` ticks
without any FORCE row.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineError
from machine_sim.machine.box import Vec3
from machine_sim.tool_soil.capped_spring_damper import (
    FORCE,
    MAX_FORCE,
    STATE,
    distance_to_contact,
    reset_wrench,
    set_wrench,
    spring_damper_record,
    step_spring_damper,
)
from msg_bridge.contract.rows import Rows, SoilReaction
from msg_bridge.kernels import fixed_signature_kernel, helper, kernel

__all__ = [
    "FORCE_TIMEOUT_TICKS",
    "SoilResistance",
    "machine_contact",
    "reset_contact",
    "step_resistance",
]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

_CUT, _BEARING = int(SoilReaction.CUT), int(SoilReaction.BEARING)

FORCE_TIMEOUT_TICKS = 5
"""Number of ticks without a FORCE row after which a wrench is removed."""

_RELEASE_DISTANCE = 0.05
"""Distance [m] at which a tool has left the soil: the elastic rebound of soil under the weight of
a machine."""

_PUSH_TIME = 0.1
"""Time constant of the mean of the force of the soil in the tool [s]."""

_INFLOW_MARGIN = 0.2
"""Part of the resistance to cutting below which the soil in the tool must push for soil to enter
without restriction."""

_UPDATE_DISTANCE = 0.01
"""Distance [m] within which the largest resistance to cutting counts: at a stall the direction of
motion changes from tick to tick."""

_TOOL_EFFECTIVE_MASS_FRACTION = 0.3
"""Minimum effective mass at the cutting edge, as a fraction of the tool's mass: the tool turns
about its pin."""

_MACHINE_EFFECTIVE_MASS_FRACTION = 0.11
"""Effective mass that the ground lifts under the tool, as a fraction of the machine's mass. The
machine turns about its tracks: about 1 / (1 + d^2 / r^2) for a tool d = 4 m from its centre and a
radius of gyration r = 1.5 m."""

_STIFFNESS = 0.2
"""Stiffness of the spring over m / dt^2. Explicit steps are stable for k + 2 c < 4. Where the
bucket's drive yields, the effective mass is below `_TOOL_EFFECTIVE_MASS_FRACTION`, and a bearing
under high load may chatter."""

_DAMPING = 0.5
"""Damping of the damper over m / dt."""


class SoilResistance:
    """Resistance to cutting and bearing reaction of one tool.

    Attributes:
        is_active: whether soil resists or supports the tool.
        spring_dampers: records of the resistance to cutting and of the bearing reaction, see
            `capped_spring_damper`, shape (2, slots).
        mean_push: mean force of the soil in the tool on it [N], map axes, shape (3,).
    """

    def __init__(self, tool_mass: float, machine_mass: float, dt: float) -> None:
        """
        Args:
            tool_mass: mass of the tool's link [kg].
            machine_mass: mass of the whole machine [kg].
            dt: physics step [s].
        """
        self.spring_dampers: Array = np.array(
            [
                _spring_damper(_TOOL_EFFECTIVE_MASS_FRACTION * tool_mass, dt, 0.0),
                machine_contact(machine_mass, dt, _RELEASE_DISTANCE),
            ]
        )
        self.mean_push: Array = np.zeros(3)
        self.is_active = False
        self._ticks_since_update = 0

    @property
    def deliverable_work(self) -> float:
        """Return 0: the tool does not mill."""
        return 0.0

    @property
    def inflow_fraction(self) -> float:
        """Fraction of the room of the tool that the soil ahead can push soil into, from 0 to 1.

        The soil in the tool resists with its push; at the resistance to cutting the soil ahead
        yields instead.
        """
        if not self.is_active:
            return 1.0
        fraction: float = _inflow_fraction(self.spring_dampers, self.mean_push)
        return fraction

    @property
    def state(self) -> Array:
        """All values that the next steps depend on, for the state hash."""
        values = self.spring_dampers[:, STATE].reshape(-1)
        return np.concatenate([values, self.mean_push, [self._ticks_since_update]])

    def receive(self, rows: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            rows: FORCE rows of the tool, shape (n,), n >= 1.
            pose: of the tool frame at the end of that tick.

        Raises:
            MachineError: a wrench that is not finite; the previous wrenches stay in force.
        """
        invalid, self.is_active = _receive(rows, *pose, self.spring_dampers, self.is_active)
        if invalid >= 0:
            raise MachineError(
                f"the FORCE row of the tool is {rows[invalid]}; give finite numbers [m, N, N m]"
            )
        self._ticks_since_update = 0

    def begin_tick(self) -> None:
        """Begin a tick: remove wrenches that were not updated for `FORCE_TIMEOUT_TICKS`."""
        self._ticks_since_update += 1
        if self._ticks_since_update > FORCE_TIMEOUT_TICKS:
            self.reset()

    def reset(self) -> None:
        """Remove both wrenches until the next FORCE rows."""
        if self.is_active:
            for record in self.spring_dampers:
                reset_contact(record)
            self.is_active = False
        self.mean_push.fill(0.0)

    def step(
        self, pose: Pose, velocity: tuple[Vec3, Vec3], dt: float, push: Vec3 = (0.0, 0.0, 0.0)
    ) -> tuple[Vec3, Vec3]:
        """Return the wrench of the next physics step.

        Args:
            pose, velocity, dt, push: see `ToolResistance.step`.

        Returns:
            Force [N] on the tool and torque about its frame's origin [N m], map axes.
        """
        wrench: tuple[Vec3, Vec3] = _step(
            self.spring_dampers, self.mean_push, pose[0], velocity, dt, push
        )
        return wrench


def machine_contact(machine_mass: float, dt: float, slack: float = 0.0) -> Array:
    """Return the record of a spring-damper for a tool that bears the machine, without a wrench.

    Args:
        machine_mass: mass of the whole machine [kg].
        dt: physics step [s].
        slack: see `spring_damper_record`.
    """
    return _spring_damper(_MACHINE_EFFECTIVE_MASS_FRACTION * machine_mass, dt, slack)


def _spring_damper(mass: float, dt: float, slack: float) -> Array:
    """Return the record of a spring-damper for an effective mass [kg] and a physics step [s]."""
    return spring_damper_record(_STIFFNESS * mass / dt**2, _DAMPING * mass / dt, slack)


@kernel
def _receive(rows, rotation, origin, spring_dampers, is_active):  # type: ignore[no-untyped-def]
    """Set or remove the wrenches by FORCE rows.

    Args:
        rows: FORCE rows of the tool.
        rotation, origin: pose of the tool frame.
        spring_dampers: records of `SoilResistance`; updated.
        is_active: whether there is a wrench.

    Returns:
        Index of the first row with a number that is not finite, which changes nothing, or -1; and
        whether there is a wrench now.
    """
    cut_row, bearing_row = -1, -1
    for n in range(rows.size):
        row = rows[n]
        for value in (row.x, row.y, row.z, row.fx, row.fy, row.fz, row.tx, row.ty, row.tz):
            if not math.isfinite(value):
                return n, is_active
        if row.fx != 0.0 or row.fy != 0.0 or row.fz != 0.0:
            if row.reaction == _CUT:
                cut_row = n
            elif row.reaction == _BEARING:
                bearing_row = n
    cut, bearing = spring_dampers[0], spring_dampers[1]
    if cut_row < 0:
        _reset_if_released(cut, rotation, origin)
    else:
        point, force, torque = _wrench(rows[cut_row])
        fx, fy, fz = force
        if (
            math.sqrt(fx * fx + fy * fy + fz * fz) >= cut[MAX_FORCE]
            or distance_to_contact(cut, rotation, origin) >= _UPDATE_DISTANCE
        ):
            set_wrench(cut, point, force, torque, rotation, origin)
    if bearing_row < 0:
        _reset_if_released(bearing, rotation, origin)
    else:
        point, force, torque = _wrench(rows[bearing_row])
        set_wrench(bearing, point, force, torque, rotation, origin)
    return -1, cut[MAX_FORCE] > 0.0 or bearing[MAX_FORCE] > 0.0


@helper
def _wrench(row):  # type: ignore[no-untyped-def]
    """Return point, force and torque of a FORCE row as float64."""
    return (
        (np.float64(row.x), np.float64(row.y), np.float64(row.z)),
        (np.float64(row.fx), np.float64(row.fy), np.float64(row.fz)),
        (np.float64(row.tx), np.float64(row.ty), np.float64(row.tz)),
    )


@helper
def _reset_if_released(record, rotation, origin):  # type: ignore[no-untyped-def]
    """Remove the wrench, if there is one, of a tool that has left the soil."""
    if (
        record[MAX_FORCE] > 0.0
        and distance_to_contact(record, rotation, origin) > _RELEASE_DISTANCE
    ):
        reset_wrench(record)


@fixed_signature_kernel
def reset_contact(record):  # type: ignore[no-untyped-def]
    """Remove the wrench of the record of a spring-damper, if there is one."""
    reset_wrench(record)


@fixed_signature_kernel
def _step(spring_dampers, mean_push, rotation, velocity, dt, push):  # type: ignore[no-untyped-def]
    """Run `step_resistance` alone; the velocity is linear and angular."""
    return step_resistance(spring_dampers, mean_push, rotation, velocity[0], velocity[1], dt, push)


@helper
def step_resistance(spring_dampers, mean_push, rotation, velocity, angular_velocity, dt, push):  # type: ignore[no-untyped-def]
    """Return force [N] and torque [N m] of a `SoilResistance` in the next physics step.

    Args:
        spring_dampers, mean_push: of the resistance; updated.
        rotation: of the tool frame.
        velocity, angular_velocity: of its origin [m/s], [rad/s], map axes.
        dt: physics step [s].
        push: see `ToolResistance.step`.
    """
    cut, bearing = spring_dampers[0], spring_dampers[1]
    fraction = min(dt / _PUSH_TIME, 1.0)
    for axis in range(3):
        mean_push[axis] += fraction * (push[axis] - mean_push[axis])
    remaining = 0.0  # resistance to cutting that the soil in the tool does not transmit [N]
    if cut[MAX_FORCE] > 0.0:
        remaining = max(cut[MAX_FORCE] - _transmitted(cut, mean_push), 0.0)
    ax, ay, az, bx, by, bz = step_spring_damper(
        cut, rotation, velocity, angular_velocity, dt, remaining
    )
    cx, cy, cz, dx, dy, dz = step_spring_damper(
        bearing, rotation, velocity, angular_velocity, dt, math.inf
    )
    return (ax + cx, ay + cy, az + cz), (bx + dx, by + dy, bz + dz)


@fixed_signature_kernel
def _inflow_fraction(spring_dampers, mean_push):  # type: ignore[no-untyped-def]
    """Return `SoilResistance.inflow_fraction`."""
    cut = spring_dampers[0]
    if cut[MAX_FORCE] == 0.0:
        return 1.0
    share = 1.0 - _transmitted(cut, mean_push) / cut[MAX_FORCE]
    return min(max(share / _INFLOW_MARGIN, 0.0), 1.0)


@helper
def _transmitted(cut, mean_push):  # type: ignore[no-untyped-def]
    """Return the part of the resistance to cutting that the soil in the tool transmits [N]."""
    x, y, z = mean_push[0], mean_push[1], mean_push[2]
    against = (x * cut[FORCE] + y * cut[FORCE + 1] + z * cut[FORCE + 2]) / cut[MAX_FORCE]
    return max(against, 0.0)
