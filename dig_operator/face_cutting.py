"""Cutting a face with a road header: sump in at a lower corner, then passes from side to side.

    start -> (sump -> slew -> (rise -> slew) x rows -> lower) x rounds -> back -> done

A pass goes across the face at one height; the next one is as much higher as the head cuts. What
the head meets is felt by its spin: where it slows down, so do drive, slewing and lifting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dig_operator.dig_cycle import CycleReport
from dig_operator.observation import Command, Observation
from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tools.drum import DrumShape
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["ROAD_HEADER_JOINTS", "FaceCuttingParams", "FaceCuttingTask"]

ROAD_HEADER_JOINTS = ("turn", "lift", "head")
"""Joints of a machine that this operator can work with: about z, about y, and the head's spin."""

_JOINT_TOLERANCE = 0.02
"""A joint this near to where it should be is there [rad]."""
_POSITION_GAIN = 3.0
"""Speed of a joint over the way it has to go [1/s]."""
_UNLOADED_SPEED_FRACTION = 0.9
"""Part of the wanted spin from which on the head is not hindered."""
_STALL_SPEED_FRACTION = 0.4
"""Part at which the operator waits for it."""


@dataclass(frozen=True)
class FaceCuttingParams(Parameters):
    """The face, and how it is cut; defaults suit a 24 t road header."""

    width: float = parameter(3.6, "of the face, head included", unit="m", low=1.0, high=20.0)
    height: float = parameter(2.2, "of the face", unit="m", low=0.5, high=10.0)
    advance: float = parameter(0.3, "deep each round", unit="m", low=0.05, high=2.0)
    rounds: int = parameter(2, "rounds to cut", low=1, high=1000)
    overlap: float = parameter(
        0.3, "of a pass with the one below, in radii of the head", low=0.0, high=1.5
    )
    head_angular_velocity: float = parameter(5.0, "of the head", unit="rad/s", low=0.5, high=50.0)
    slew_speed: float = parameter(0.15, "of the turning boom", unit="rad/s", low=0.01, high=1.0)
    sumping_speed: float = parameter(0.12, "driving into the face", unit="m/s", low=0.01, high=1.0)
    approach: float = parameter(
        10.0, "longest way to the face before it gives up", unit="m", low=0.0, high=100.0
    )
    timeout: float = parameter(
        600.0, "simulated time after which the task is given up", unit="s", low=1.0, high=1e6
    )


class FaceCuttingTask:
    """An operator of a road header with a face to cut.

    Attributes:
        phase: what it is doing: `start`, `sump`, `slew`, `rise`, `lower`, `back`, `done`.
        cycle: number of the round, from 1.
        reports: none; a round carries nothing.
        given_up: why the task was not finished, empty if it was or is not over yet.
    """

    def __init__(self, machine: MachineSpec, task: FaceCuttingParams) -> None:
        """
        Args:
            machine: what it operates.
            task: the face.

        Raises:
            MachineError: a machine of other joints or without a drum, or a face that its boom does
                not reach.
        """
        if machine.joint_names != ROAD_HEADER_JOINTS:
            raise MachineError(
                f"a {machine.name} has joints {', '.join(machine.joint_names)}; give a machine with"
                f" {', '.join(ROAD_HEADER_JOINTS)}"
            )
        self._drum = next(
            (t.shape for t in machine.tools.values() if isinstance(t.shape, DrumShape)), None
        )
        if self._drum is None:
            raise MachineError(f"a {machine.name} has no drum: give it one among its tools")
        self._machine, self._task = machine, task
        turn, lift, head = machine.joints.values()
        self._validate_task(self._drum, head.max_velocity)
        self._pivot_height = turn.origin[2] + lift.origin[2]
        self._boom_length = head.origin[0]
        self._slew_radius = lift.origin[0] + self._boom_length
        self._max_turn_angle = self._turn_angle(0.5 * (task.width - self._drum.width))
        self._row_heights = self._compute_row_heights()
        for height in self._row_heights:
            self._lift_angle(height)
        self.phase, self.cycle, self.abort_reason = "start", 1, ""
        self.reports: list[CycleReport] = []
        self._row_index, self._slew_direction = 0, 1.0
        self._start_time: float | None = None
        self._phase_start_position = np.zeros(3)
        self._contact_distance: float | None = None  # way gone when the head met the face
        self._last_head_angle: float | None = None
        self._head_angular_velocity = 0.0

    @property
    def done(self) -> bool:
        """Whether it has left the levers."""
        return self.phase == "done"

    def command(self, observation: Observation, dt: float) -> Command:
        """What to do in the next `dt` [s].

        Args:
            view: what is seen; its joints are turn, lift and head.
            dt: [s] since the last look, and until the next.
        """
        if self._start_time is None:
            self._start_time, self._phase_start_position = (
                observation.time,
                observation.base_position.copy(),
            )
        if observation.time - self._start_time > self._task.timeout:
            self._abort(f"the face was not cut within {self._task.timeout:g} s")
        self._estimate_head_speed(observation, dt)
        turn, lift = float(observation.joints[0]), float(observation.joints[1])
        drive = 0.0
        if self.phase == "start":
            if (
                self._is_at_target(turn, lift)
                and self._head_angular_velocity
                > _UNLOADED_SPEED_FRACTION * self._task.head_angular_velocity
            ):
                self._start_phase("sump", observation)
        elif self.phase == "sump":
            drive = self._sump(observation)
        elif self.phase == "slew":
            if abs(turn - self._slew_direction * self._max_turn_angle) < _JOINT_TOLERANCE:
                self._row_index += 1
                self.phase = "rise" if self._row_index < len(self._row_heights) else "lower"
                if self.phase == "lower":
                    self._row_index = 0
        elif self.phase == "rise":
            if self._is_at_target(turn, lift):
                self._slew_direction = -self._slew_direction
                self.phase = "slew"
        elif self.phase == "lower":
            if self._is_at_target(turn, lift):
                self._next_round(observation)
        elif self.phase == "back":
            drive = -self._task.sumping_speed
            if self._distance_driven(observation) < -2.0 * self._task.advance:
                self.phase = "done"
        head_angular_velocity = 0.0 if self.done else self._task.head_angular_velocity
        return Command(
            np.array([*self._joint_velocities(turn, lift), head_angular_velocity]),
            np.array([drive, drive], dtype=np.float64),
        )

    def _sump(self, observation: Observation) -> float:
        """Drive into the face; the speed [m/s]."""
        gone, ease = self._distance_driven(observation), self._feed_factor
        if self._contact_distance is None and ease < 1.0:
            self._contact_distance = gone
        if self._contact_distance is None and gone > self._task.approach:
            self._abort(f"there is no face within {self._task.approach:g} m")
            return 0.0
        if (
            self._contact_distance is not None
            and gone >= self._contact_distance + self._task.advance
        ):
            self._slew_direction = -self._slew_direction
            self.phase = "slew"
            return 0.0
        return self._task.sumping_speed * ease

    def _next_round(self, observation: Observation) -> None:
        if self.cycle < self._task.rounds:
            self.cycle += 1
            self._start_phase("sump", observation)
            self._contact_distance = 0.0
        else:
            self._start_phase("back", observation)

    def _start_phase(self, phase: str, observation: Observation) -> None:
        self.phase = phase
        self._phase_start_position = observation.base_position.copy()

    def _abort(self, reason: str) -> None:
        if not self.done:
            self.phase, self.abort_reason = "done", reason

    def _distance_driven(self, observation: Observation) -> float:
        """Way forward since the phase began [m]."""
        return float(
            (observation.base_position - self._phase_start_position)
            @ observation.base_rotation[:, 0]
        )

    def _estimate_head_speed(self, observation: Observation, dt: float) -> None:
        """How fast the head spins [rad/s], by how far it has turned."""
        angle = float(observation.joints[2])
        if self._last_head_angle is not None and dt > 0.0:
            turned = math.remainder(angle - self._last_head_angle, 2.0 * math.pi)
            self._head_angular_velocity += min(1.0, dt / 0.1) * (
                turned / dt - self._head_angular_velocity
            )
        self._last_head_angle = angle

    @property
    def _feed_factor(self) -> float:
        """How little the head is hindered: 1 not at all, 0 as far as it may be."""
        share = self._head_angular_velocity / self._task.head_angular_velocity
        return min(
            max(
                (share - _STALL_SPEED_FRACTION)
                / (_UNLOADED_SPEED_FRACTION - _STALL_SPEED_FRACTION),
                0.0,
            ),
            1.0,
        )

    def _target(self) -> tuple[float, float]:
        """Angles of turn and lift where the phase ends [rad]."""
        return self._slew_direction * self._max_turn_angle, self._lift_angle(
            self._row_heights[self._row_index]
        )

    def _is_at_target(self, turn: float, lift: float) -> bool:
        side, height = self._target()
        return abs(turn - side) < _JOINT_TOLERANCE and abs(lift - height) < _JOINT_TOLERANCE

    def _joint_velocities(self, turn: float, lift: float) -> tuple[float, float]:
        """Velocities of turn and lift [rad/s]."""
        if self.phase in ("done", "back"):
            return 0.0, 0.0
        side, height = self._target()
        free = self.phase in ("start", "lower")
        most = self._task.slew_speed * (2.0 if free else self._feed_factor)
        ways = (side - turn, height - lift)
        fast, slow = (min(max(_POSITION_GAIN * way, -most), most) for way in ways)
        return fast, slow

    def _validate_task(self, drum: DrumShape, fastest: float) -> None:
        task = self._task
        if task.head_angular_velocity > fastest:
            raise MachineError(
                f"spin is {task.head_angular_velocity} rad/s, the head reaches {fastest}; give that or less"
            )
        if task.width < drum.width or task.height < 2.0 * drum.radius:
            raise MachineError(
                f"a face {task.width} m wide and {task.height} m high is smaller than the head;"
                f" give a width from {drum.width} m and a height from {2.0 * drum.radius} m up"
            )

    def _turn_angle(self, aside: float) -> float:
        if not 0.0 <= aside < self._slew_radius:
            raise MachineError(f"a face {2.0 * aside:.2f} m wider than the head is beyond the boom")
        turn = math.asin(aside / self._slew_radius)
        limits = self._machine.joints["turn"]
        most = min(limits.upper, -limits.lower)
        if turn > most:
            raise MachineError(
                f"the boom would have to turn {turn:.2f} rad to either side, its limit is {most};"
                " give a face that is not as wide"
            )
        return turn

    def _lift_angle(self, height: float) -> float:
        sine = (self._pivot_height - height) / self._boom_length
        limits = self._machine.joints["lift"]
        if not -1.0 <= sine <= 1.0 or not limits.lower <= math.asin(sine) <= limits.upper:
            raise MachineError(
                f"the boom cannot put its head {height:.2f} m high; give a face of another height"
            )
        return math.asin(sine)

    def _compute_row_heights(self) -> list[float]:
        """Heights of the head's axis in each row, from the floor up [m]."""
        assert self._drum is not None
        low, high = self._drum.radius, self._task.height - self._drum.radius
        step = (2.0 - self._task.overlap) * self._drum.radius
        count = max(math.ceil((high - low) / step), 0) + 1
        return [float(height) for height in np.linspace(low, max(high, low), count)]
