"""Milling resistance: the work of a drum in the soil, and the thrust out of the face.

With each tick the drum reports the work that it can deliver: what its drive delivers in a tick at
the present speed, and a part of the kinetic energy above that of its loaded speed. The soil removes
no more than this work covers, and answers, one or two ticks later, with the work that it took. That
work is a debt, which the picks take out of the drum during the next tick. A drum that falls below
its loaded speed, or whose debt is not paid, reports less. The debt closes the balance of energy:

    work of drive and feed = increase of kinetic energy + milling + work against particles

The soil in front of the drum bears it like any tool (`capped_spring_damper`): soil that is removed
at once with the thrust on the picks, their cutting force times a ratio; soil that the work did not
suffice to remove with its strength, so that the feed stalls. Conversely picks that are pressed
against the soil with a force cut with that force over the ratio; they reach the depth of that force
after the drum has turned by the angle between two rows of picks. If the torque is beyond that of
the drive, the drum slows down and stalls until the feed is reduced. Work of the picks beyond the
debt is kept for the next ticks.

The force on the picks is against their motion over the soil, by the spin and the motion of the
drum, and is limited to what stops them in a step. A drum that is not driven is supported by the
soil like any other tool (`machine_sim.tool_soil.resistance`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import MachineError, Tool
from machine_sim.machine.box import Vec3
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.machine.tools.tool import MIN_DRUM_SPEED
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.capped_spring_damper import LOCAL_POINT, MAX_FORCE, STATE
from machine_sim.tool_soil.milling_kernels import (
    DEBT,
    MILLED,
    NOT_MILLED,
    PICK_FORCE,
    WORK_STATE,
    drum_wrench,
    milling_record,
    receive_milling,
    step_picks,
)
from machine_sim.tool_soil.resistance import (
    FORCE_TIMEOUT_TICKS,
    SoilResistance,
    machine_contact,
    reset_contact,
)
from msg_bridge.contract.rows import Rows

__all__ = ["MillingResistance"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

_LOADED_SPEED_FRACTION = 0.95
"""Speed of the drum at full load as a fraction of the commanded one [-], typical of the slip of an
induction motor."""

_ENERGY_GAIN = 0.3
"""Fraction of the difference to the kinetic energy at the loaded speed that a tick may use. An
answer lags by up to three ticks; the speed oscillates above 2 sin(pi / 14) = 0.45."""

_STORE_TICKS = 10.0
"""Maximum work of the picks beyond the debt that is kept, in ticks of the drive's work."""

_STOPPING_FRACTION = 0.7
"""Maximum fraction of its velocity over the soil that a drum without drive loses in a step."""


class MillingResistance:
    """Resistance of the soil to one drum.

    Attributes:
        static_resistance: resistance while the drum is not driven.
        contact: record of the spring-damper of the soil in front of a driven drum, see
            `capped_spring_damper`.
    """

    def __init__(
        self, tool: Tool, shape: DrumShape, machine_mass: float, params: MachineSimParams
    ) -> None:
        """
        Args:
            tool: the drum.
            shape: its shape.
            machine_mass: mass of the whole machine [kg].
            params: stepping of the node.
        """
        self._tool, self._radius = tool, shape.radius
        self._tick_period = params.tick_period
        self.static_resistance = SoilResistance(tool.mass, machine_mass, params.physics_step)
        self.contact = machine_contact(machine_mass, params.physics_step)
        self._ticks_since_update = 0
        self._power = 0.0  # at which the debt is paid in this tick [W]
        self._record = milling_record(shape.radius, 2.0 * math.pi / shape.vanes)

    @property
    def debt(self) -> float:
        """Work that milled soil has taken and the picks have yet to take out of the drum [J].

        Negative: work of the picks that no soil has taken yet.
        """
        return float(self._record[DEBT])

    @property
    def is_active(self) -> bool:
        """Whether soil resists or supports the drum."""
        return bool(
            self.contact[MAX_FORCE] > 0.0
            or self._record[DEBT] > 0.0
            or self._record[PICK_FORCE] > 0.0
            or self.static_resistance.is_active
        )

    @property
    def inflow_fraction(self) -> float:
        """Return 1: a drum has no room that could fill up."""
        return 1.0

    @property
    def deliverable_work(self) -> float:
        """Work that the drum can deliver to the soil in a tick [J]."""
        speed, commanded = self._tool.drum_speed, self._tool.commanded_drum_speed
        if abs(speed) < MIN_DRUM_SPEED:
            return 0.0
        loaded_speed = _LOADED_SPEED_FRACTION * abs(commanded) if self._is_driving else 0.0
        surplus = 0.5 * self._tool.inertia * (speed**2 - loaded_speed**2)
        return max(self._drive_work + _ENERGY_GAIN * surplus - self.debt, 0.0)

    @property
    def state(self) -> Array:
        """All values that the next steps depend on, for the state hash."""
        debt, *picks = self._record[WORK_STATE].tolist()
        parts = (
            self.contact[LOCAL_POINT : LOCAL_POINT + 3],
            (debt, self._power, *picks),
            [self._ticks_since_update],
            self.contact[STATE],
            self.static_resistance.state,
        )
        return np.concatenate(parts)

    @property
    def _is_driving(self) -> bool:
        """Whether the drive is commanded in the direction in which the drum spins."""
        return self._tool.drum_speed * self._tool.commanded_drum_speed > 0.0

    @property
    def _max_store(self) -> float:
        """Maximum work of the picks beyond the debt that is kept [J]."""
        speed = max(abs(self._tool.drum_speed), abs(self._tool.commanded_drum_speed))
        return _STORE_TICKS * self._tool.drum_torque * speed * self._tick_period

    @property
    def _drive_work(self) -> float:
        """Work of the drive in a tick at the present speed and its maximum torque [J]."""
        if not self._is_driving:
            return 0.0
        return self._tool.drum_torque * abs(self._tool.drum_speed) * self._tick_period

    def receive(self, rows: Rows, pose: Pose) -> None:
        """Take the soil's answer to a tick.

        Args:
            rows: FORCE rows of the tool, shape (n,), n >= 1.
            pose: of the drum's non-spinning frame at the end of that tick.

        Raises:
            MachineError: values that are not finite; the previous ones stay in force.
        """
        travel = self._radius * abs(self._tool.drum_speed) * self._tick_period
        answer = receive_milling(rows, *pose, travel, self._record, self.contact)
        if answer == NOT_MILLED:
            self.static_resistance.receive(rows, pose)
            reset_contact(self.contact)
        elif answer == MILLED:
            self.static_resistance.reset()
        else:
            raise MachineError(
                f"the FORCE row of the drum is {rows[answer]}; give finite numbers, and a work of 0"
                " J or more"
            )
        self._ticks_since_update = 0

    def begin_tick(self) -> None:
        """Begin a tick: remove a wrench that was not updated for `FORCE_TIMEOUT_TICKS`."""
        self._ticks_since_update += 1
        if self._ticks_since_update > FORCE_TIMEOUT_TICKS:
            reset_contact(self.contact)
        self.static_resistance.begin_tick()
        self._power = max(self.debt, 0.0) / self._tick_period

    def reset(self) -> None:
        """Remove all wrenches until the next FORCE rows."""
        self.static_resistance.reset()
        reset_contact(self.contact)

    def step(
        self, pose: Pose, velocity: tuple[Vec3, Vec3], dt: float, push: Vec3 = (0.0, 0.0, 0.0)
    ) -> tuple[Vec3, Vec3]:
        """Return the wrench of the next physics step.

        Args:
            pose: of the drum's non-spinning frame.
            velocity: of its origin [m/s], and angular of the drum [rad/s], map axes.
            dt: physics step [s].
            push: has no effect: a drum holds no soil.

        Returns:
            Force [N] and torque about the frame's origin [N m], map axes.
        """
        static = self.static_resistance
        slip, arm, debt, pressed_force = step_picks(
            self._record,
            self.contact,
            static.spring_dampers,
            static.mean_push,
            static.is_active,
            pose[0],
            velocity,
            dt,
            self._max_store,
        )
        force = self._cutting_force(slip, arm, debt, pressed_force, dt)
        wrench: tuple[Vec3, Vec3] = drum_wrench(self._record, pose[0], force)
        return wrench

    def _cutting_force(
        self, slip: float, arm: float, debt: float, pressed_force: float, dt: float
    ) -> float:
        """Return the force on the picks in the next step, 0 or more [N].

        Args:
            slip: velocity of the picks over the soil [m/s].
            arm: their lever arm about the axis [m].
            debt: see above [J].
            pressed_force: force of picks that are pressed into the soil [N].
            dt: physics step [s].
        """
        if slip == 0.0:
            return 0.0
        debt_force = min(self._power, max(debt, 0.0) / dt) / abs(slip)
        stopping_force = _STOPPING_FRACTION * self._tool.inertia / arm**2 * abs(slip) / dt
        if slip * self._tool.commanded_drum_speed > 0.0:
            stopping_force += self._tool.drum_torque / arm
        return min(max(debt_force, pressed_force), stopping_force)
