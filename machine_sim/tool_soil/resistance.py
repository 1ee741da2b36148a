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
from machine_sim.tool_soil.capped_spring_damper import CappedSpringDamper, norm
from msg_bridge.contract.rows import FORCE_VECTORS, Rows, SoilReaction

__all__ = ["FORCE_TIMEOUT_TICKS", "SoilResistance", "machine_contact"]

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
        cut: resistance to cutting.
        bearing: bearing reaction.
    """

    def __init__(self, tool_mass: float, machine_mass: float, dt: float) -> None:
        """
        Args:
            tool_mass: mass of the tool's link [kg].
            machine_mass: mass of the whole machine [kg].
            dt: physics step [s].
        """
        self.cut = _spring_damper(_TOOL_EFFECTIVE_MASS_FRACTION * tool_mass, dt, 0.0)
        self.bearing = machine_contact(machine_mass, dt, _RELEASE_DISTANCE)
        self._ticks_since_update = 0
        self._mean_push = [0.0, 0.0, 0.0]

    @property
    def is_active(self) -> bool:
        """Whether soil resists or supports the tool."""
        return self.cut.max_force > 0.0 or self.bearing.max_force > 0.0

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
        if self.cut.max_force == 0.0:
            return 1.0
        share = 1.0 - self._transmitted() / self.cut.max_force
        return min(max(share / _INFLOW_MARGIN, 0.0), 1.0)

    @property
    def state(self) -> Array:
        """All values that the next steps depend on, for the state hash."""
        return np.array(
            [*self.cut.state, *self.bearing.state, *self._mean_push, self._ticks_since_update],
            dtype=np.float64,
        )

    def receive(self, rows: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            rows: FORCE rows of the tool, shape (n,), n >= 1.
            pose: of the tool frame at the end of that tick.

        Raises:
            MachineError: a wrench that is not finite; the previous wrenches stay in force.
        """
        wrenches = {}
        vectors = rows.view(FORCE_VECTORS)["values"].tolist()
        for reaction, values in zip(rows["reaction"].tolist(), vectors, strict=True):
            if not math.isfinite(sum(values)):
                raise MachineError(
                    f"the FORCE row of the tool has point, force and torque {values}; give finite"
                    " numbers [m, N, N m]"
                )
            if any(values[3:6]):
                point, force, torque = np.array(values).reshape(3, 3)
                wrenches[reaction] = (point, force, torque)
        self._ticks_since_update = 0
        self._receive_cut(wrenches.get(_CUT), pose)
        if _BEARING in wrenches:
            self.bearing.set_wrench(wrenches[_BEARING], pose)
        else:
            _reset_if_released(self.bearing, pose)

    def _receive_cut(self, wrench: tuple[Array, Array, Array] | None, pose: Pose) -> None:
        if wrench is None:
            _reset_if_released(self.cut, pose)
        elif (
            norm(wrench[1]) >= self.cut.max_force
            or self.cut.distance_to_contact(pose) >= _UPDATE_DISTANCE
        ):
            self.cut.set_wrench(wrench, pose)

    def begin_tick(self) -> None:
        """Begin a tick: remove wrenches that were not updated for `FORCE_TIMEOUT_TICKS`."""
        self._ticks_since_update += 1
        if self._ticks_since_update > FORCE_TIMEOUT_TICKS:
            self.reset()

    def reset(self) -> None:
        """Remove both wrenches until the next FORCE rows."""
        self.cut.reset()
        self.bearing.reset()
        self._mean_push = [0.0, 0.0, 0.0]

    def step(
        self, pose: Pose, velocity: tuple[Vec3, Vec3], dt: float, push: Vec3 = (0.0, 0.0, 0.0)
    ) -> tuple[Vec3, Vec3]:
        """Return the wrench of the next physics step.

        Args:
            pose, velocity, dt, push: see `ToolResistance.step`.

        Returns:
            Force [N] on the tool and torque about its frame's origin [N m], map axes.
        """
        cut = self.cut.step(pose, velocity, dt, self._remaining_resistance(push, dt))
        bearing = self.bearing.step(pose, velocity, dt)
        fx, fy, fz, tx, ty, tz = (a + b for a, b in zip(cut, bearing, strict=True))
        return (fx, fy, fz), (tx, ty, tz)

    def _remaining_resistance(self, push: Vec3, dt: float) -> float:
        """Return the resistance to cutting that the soil in the tool does not transmit [N]."""
        fraction = min(dt / _PUSH_TIME, 1.0)
        for axis in range(3):
            self._mean_push[axis] += fraction * (push[axis] - self._mean_push[axis])
        if self.cut.max_force == 0.0:
            return 0.0
        return max(self.cut.max_force - self._transmitted(), 0.0)

    def _transmitted(self) -> float:
        """Return the part of the resistance to cutting that the soil in the tool transmits [N]."""
        fx, fy, fz = self.cut.force.tolist()
        x, y, z = self._mean_push
        against: float = (x * fx + y * fy + z * fz) / self.cut.max_force
        return max(against, 0.0)


def _reset_if_released(contact: CappedSpringDamper, pose: Pose) -> None:
    """Remove the wrench, if there is one, of a tool that has left the soil."""
    if contact.max_force > 0.0 and contact.distance_to_contact(pose) > _RELEASE_DISTANCE:
        contact.reset()


def machine_contact(machine_mass: float, dt: float, slack: float = 0.0) -> CappedSpringDamper:
    """Return a spring-damper for a tool that bears the machine, without a wrench.

    Args:
        machine_mass: mass of the whole machine [kg].
        dt: physics step [s].
        slack: see `CappedSpringDamper`.
    """
    return _spring_damper(_MACHINE_EFFECTIVE_MASS_FRACTION * machine_mass, dt, slack)


def _spring_damper(mass: float, dt: float, slack: float) -> CappedSpringDamper:
    """Return a spring-damper for an effective mass [kg] and a physics step [s]."""
    return CappedSpringDamper(_STIFFNESS * mass / dt**2, _DAMPING * mass / dt, slack)
