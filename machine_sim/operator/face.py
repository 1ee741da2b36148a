"""Cutting a face with a road header: sump in at a lower corner, then passes from side to side.

    start -> (sump -> slew -> (rise -> slew) x rows -> lower) x rounds -> back -> done

A pass goes across the face at one height; the next one is as much higher as the head cuts. What
the head meets is felt by its spin: where it slows down, so do drive, slewing and lifting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from machine_sim.machine.description import MachineDescription
from machine_sim.machine.errors import MachineError
from machine_sim.machine.tools.drum import DrumShape
from machine_sim.operator.cycle import CycleReport
from machine_sim.operator.view import Command, View
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["HEADER_JOINTS", "FaceCut", "FaceParams"]

HEADER_JOINTS = ("turn", "lift", "head")
"""Joints of a machine that this operator can work with: about z, about y, and the head's spin."""

_THERE = 0.02
"""A joint this near to where it should be is there [rad]."""
_GAIN = 3.0
"""Speed of a joint over the way it has to go [1/s]."""
_EASY = 0.9
"""Part of the wanted spin from which on the head is not hindered."""
_LABOURED = 0.4
"""Part at which the operator waits for it."""


@dataclass(frozen=True)
class FaceParams(Parameters):
    """The face, and how it is cut; defaults suit a 24 t road header."""

    width: float = parameter(3.6, "of the face, head included", unit="m", low=1.0, high=20.0)
    height: float = parameter(2.2, "of the face", unit="m", low=0.5, high=10.0)
    advance: float = parameter(0.3, "deep each round", unit="m", low=0.05, high=2.0)
    rounds: int = parameter(2, "rounds to cut", low=1, high=1000)
    overlap: float = parameter(
        0.3, "of a pass with the one below, in radii of the head", low=0.0, high=1.5
    )
    spin: float = parameter(5.0, "of the head", unit="rad/s", low=0.5, high=50.0)
    slew_speed: float = parameter(0.15, "of the turning boom", unit="rad/s", low=0.01, high=1.0)
    crawl: float = parameter(0.12, "driving into the face", unit="m/s", low=0.01, high=1.0)
    approach: float = parameter(
        10.0, "longest way to the face before it gives up", unit="m", low=0.0, high=100.0
    )
    longest: float = parameter(
        600.0, "simulated time after which the task is given up", unit="s", low=1.0, high=1e6
    )


class FaceCut:
    """An operator of a road header with a face to cut.

    Attributes:
        phase: what it is doing: `start`, `sump`, `slew`, `rise`, `lower`, `back`, `done`.
        cycle: number of the round, from 1.
        reports: none; a round carries nothing.
        given_up: why the task was not finished, empty if it was or is not over yet.
    """

    def __init__(self, machine: MachineDescription, task: FaceParams) -> None:
        """
        Args:
            machine: what it operates.
            task: the face.

        Raises:
            MachineError: a machine of other joints or without a drum, or a face that its boom does
                not reach.
        """
        if machine.joint_names != HEADER_JOINTS:
            raise MachineError(
                f"a {machine.name} has joints {', '.join(machine.joint_names)}; give a machine with"
                f" {', '.join(HEADER_JOINTS)}"
            )
        self._drum = next(
            (t.shape for t in machine.tools.values() if isinstance(t.shape, DrumShape)), None
        )
        if self._drum is None:
            raise MachineError(f"a {machine.name} has no drum: give it one among its tools")
        self._machine, self._task = machine, task
        turn, lift, head = machine.joints.values()
        self._check(self._drum, head.speed)
        self._pivot = turn.origin[2] + lift.origin[2]
        self._boom = head.origin[0]
        self._swung = lift.origin[0] + self._boom
        self._side = self._turn_for(0.5 * (task.width - self._drum.width))
        self._rows = self._heights()
        for height in self._rows:
            self._lift_for(height)
        self.phase, self.cycle, self.given_up = "start", 1, ""
        self.reports: list[CycleReport] = []
        self._row, self._sign = 0, 1.0
        self._began: float | None = None
        self._from = np.zeros(3)
        self._met: float | None = None  # way gone when the head met the face
        self._head: float | None = None
        self._spin = 0.0

    @property
    def done(self) -> bool:
        """Whether it has left the levers."""
        return self.phase == "done"

    def command(self, view: View, dt: float) -> Command:
        """What to do in the next `dt` [s].

        Args:
            view: what is seen; its joints are turn, lift and head.
            dt: [s] since the last look, and until the next.
        """
        if self._began is None:
            self._began, self._from = view.time, view.base_position.copy()
        if view.time - self._began > self._task.longest:
            self._give_up(f"the face was not cut within {self._task.longest:g} s")
        self._feel(view, dt)
        turn, lift = float(view.joints[0]), float(view.joints[1])
        drive = 0.0
        if self.phase == "start":
            if self._at(turn, lift) and self._spin > _EASY * self._task.spin:
                self._begin("sump", view)
        elif self.phase == "sump":
            drive = self._sump(view)
        elif self.phase == "slew":
            if abs(turn - self._sign * self._side) < _THERE:
                self._row += 1
                self.phase = "rise" if self._row < len(self._rows) else "lower"
                if self.phase == "lower":
                    self._row = 0
        elif self.phase == "rise":
            if self._at(turn, lift):
                self._sign = -self._sign
                self.phase = "slew"
        elif self.phase == "lower":
            if self._at(turn, lift):
                self._next_round(view)
        elif self.phase == "back":
            drive = -self._task.crawl
            if self._gone(view) < -2.0 * self._task.advance:
                self.phase = "done"
        spin = 0.0 if self.done else self._task.spin
        return Command(
            np.array([*self._toward(turn, lift), spin]), np.array([drive, drive], dtype=np.float64)
        )

    def _sump(self, view: View) -> float:
        """Drive into the face; the speed [m/s]."""
        gone, ease = self._gone(view), self._ease
        if self._met is None and ease < 1.0:
            self._met = gone
        if self._met is None and gone > self._task.approach:
            self._give_up(f"there is no face within {self._task.approach:g} m")
            return 0.0
        if self._met is not None and gone >= self._met + self._task.advance:
            self._sign = -self._sign
            self.phase = "slew"
            return 0.0
        return self._task.crawl * ease

    def _next_round(self, view: View) -> None:
        if self.cycle < self._task.rounds:
            self.cycle += 1
            self._begin("sump", view)
            self._met = 0.0
        else:
            self._begin("back", view)

    def _begin(self, phase: str, view: View) -> None:
        self.phase = phase
        self._from = view.base_position.copy()

    def _give_up(self, reason: str) -> None:
        if not self.done:
            self.phase, self.given_up = "done", reason

    def _gone(self, view: View) -> float:
        """Way forward since the phase began [m]."""
        return float((view.base_position - self._from) @ view.base_rotation[:, 0])

    def _feel(self, view: View, dt: float) -> None:
        """How fast the head spins [rad/s], by how far it has turned."""
        angle = float(view.joints[2])
        if self._head is not None and dt > 0.0:
            turned = math.remainder(angle - self._head, 2.0 * math.pi)
            self._spin += min(1.0, dt / 0.1) * (turned / dt - self._spin)
        self._head = angle

    @property
    def _ease(self) -> float:
        """How little the head is hindered: 1 not at all, 0 as far as it may be."""
        share = self._spin / self._task.spin
        return min(max((share - _LABOURED) / (_EASY - _LABOURED), 0.0), 1.0)

    def _target(self) -> tuple[float, float]:
        """Angles of turn and lift where the phase ends [rad]."""
        return self._sign * self._side, self._lift_for(self._rows[self._row])

    def _at(self, turn: float, lift: float) -> bool:
        side, height = self._target()
        return abs(turn - side) < _THERE and abs(lift - height) < _THERE

    def _toward(self, turn: float, lift: float) -> tuple[float, float]:
        """Velocities of turn and lift [rad/s]."""
        if self.phase in ("done", "back"):
            return 0.0, 0.0
        side, height = self._target()
        free = self.phase in ("start", "lower")
        most = self._task.slew_speed * (2.0 if free else self._ease)
        ways = (side - turn, height - lift)
        fast, slow = (min(max(_GAIN * way, -most), most) for way in ways)
        return fast, slow

    def _check(self, drum: DrumShape, fastest: float) -> None:
        task = self._task
        if task.spin > fastest:
            raise MachineError(
                f"spin is {task.spin} rad/s, the head reaches {fastest}; give that or less"
            )
        if task.width < drum.width or task.height < 2.0 * drum.radius:
            raise MachineError(
                f"a face {task.width} m wide and {task.height} m high is smaller than the head;"
                f" give a width from {drum.width} m and a height from {2.0 * drum.radius} m up"
            )

    def _turn_for(self, aside: float) -> float:
        if not 0.0 <= aside < self._swung:
            raise MachineError(f"a face {2.0 * aside:.2f} m wider than the head is beyond the boom")
        turn = math.asin(aside / self._swung)
        limits = self._machine.joints["turn"]
        most = min(limits.upper, -limits.lower)
        if turn > most:
            raise MachineError(
                f"the boom would have to turn {turn:.2f} rad to either side, its limit is {most};"
                " give a face that is not as wide"
            )
        return turn

    def _lift_for(self, height: float) -> float:
        sine = (self._pivot - height) / self._boom
        limits = self._machine.joints["lift"]
        if not -1.0 <= sine <= 1.0 or not limits.lower <= math.asin(sine) <= limits.upper:
            raise MachineError(
                f"the boom cannot put its head {height:.2f} m high; give a face of another height"
            )
        return math.asin(sine)

    def _heights(self) -> list[float]:
        """Heights of the head's axis in each row, from the floor up [m]."""
        assert self._drum is not None
        low, high = self._drum.radius, self._task.height - self._drum.radius
        step = (2.0 - self._task.overlap) * self._drum.radius
        count = max(math.ceil((high - low) / step), 0) + 1
        return [float(height) for height in np.linspace(low, max(high, low), count)]
