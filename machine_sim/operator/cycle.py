"""The scripted operator: dig, lift, swing, dump, return, over and over.

It sees what public topics carry and sends what a person would send. It plans each dig from the
terrain as it is, digs again when the bucket has not come out full, and asks for more next time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.description import MachineDescription
from machine_sim.machine.errors import ReachError
from machine_sim.operator.arm import ArmPlane
from machine_sim.operator.dig import DigPlan, DigReach, plan_dig
from machine_sim.operator.motion import Motion, Target
from machine_sim.operator.params import OperatorParams
from machine_sim.operator.view import Command, View

__all__ = ["CycleReport", "DigCycle"]

_HOLD = np.zeros(4)
_STOP = np.zeros(2)


@dataclass(frozen=True)
class CycleReport:
    """How one cycle went.

    Attributes:
        number: from 1.
        passes: drags it took to fill the bucket.
        planned: soil the first pass was to sweep [m^3].
        carried: fill of the bucket when the swing began, in parts of heaped capacity.
        delivered: fill when it stood over the dump.
        left: fill after dumping.
        duration: [s].
    """

    number: int
    passes: int
    planned: float
    carried: float
    delivered: float
    left: float
    duration: float


class DigCycle:
    """An operator at the levers of one excavator.

    Attributes:
        phase: what it is doing: `reach`, `dig`, `curl`, `lift`, `swing`, `dump`.
        cycle: number of the cycle, from 1.
        reports: one per finished cycle.
    """

    def __init__(
        self, machine: MachineDescription, params: OperatorParams, *, dig_at: float, dump_at: float
    ) -> None:
        """
        Args:
            machine: what it operates.
            params: its habits.
            dig_at: direction to dig in [rad], map frame.
            dump_at: direction to dump in [rad], map frame.
        """
        self.params = params
        self.phase = "reach"
        self.cycle = 1
        self.reports: list[CycleReport] = []
        self._arm = ArmPlane(machine)
        self._bucket = machine.bucket
        self._dig_at, self._dump_at = dig_at, dump_at
        self._motion: Motion | None = None
        self._plan: DigPlan | None = None
        self._azimuth = dig_at
        self._appetite = params.appetite
        self._passes = 0
        self._planned = 0.0
        self._carried = self._delivered = 0.0
        self._began = 0.0
        self._waited = 0.0

    def command(self, view: View, dt: float) -> Command:
        """What to do in the next `dt` [s]."""
        if self._motion is None:
            self._motion = self._begin(view)
        velocity = self._motion.advance(view.joints, dt)
        if self._motion.done:
            self._end(view, dt)
        return Command(velocity, _STOP)

    # Each phase: how it begins, as a motion, and what comes after it.

    def _begin(self, view: View) -> Motion:
        phases: dict[str, Callable[[View], list[Target]]] = {
            "reach": self._reach,
            "dig": self._dig,
            "curl": self._curl,
            "lift": self._lift,
            "swing": self._swing,
            "dump": self._dump,
        }
        return Motion(view.joints, phases[self.phase](view))

    def _end(self, view: View, dt: float) -> None:
        following = {"reach": "dig", "dig": "curl", "curl": "lift", "lift": "swing"}
        if self.phase == "dump":
            self._waited += dt
            emptied = view.fill < self.params.empty
            if not emptied and self._waited < self.params.dump_wait:
                return
            self._finish(view)
            self.phase = "reach"
        elif self.phase == "swing":
            self._delivered = view.fill
            self._waited = 0.0
            self.phase = "dump"
        elif self.phase == "curl" and self._wants_more(view):
            self.phase = "reach"
        else:
            if self.phase == "lift":
                self._carried = view.fill
            self.phase = following[self.phase]
        self._motion = None

    def _wants_more(self, view: View) -> bool:
        return view.fill < self.params.full and self._passes < self.params.most_passes

    def _finish(self, view: View) -> None:
        self.reports.append(
            CycleReport(
                self.cycle,
                self._passes,
                self._planned,
                self._carried,
                self._delivered,
                view.fill,
                view.time - self._began,
            )
        )
        # A bucket that came short, or with so much that it spilled, teaches.
        if self._passes > 1 or self._delivered < self.params.full:
            self._appetite = min(self._appetite * 1.1, 1.6)
        elif self._carried > self.params.brimming:
            self._appetite = max(self._appetite * 0.95, 0.6)
        self.cycle += 1
        self._passes = 0
        self._began = view.time

    def _reach(self, view: View) -> list[Target]:
        """To above the entry of a newly planned dig."""
        if self._passes == 0:
            self._azimuth = self._choose_azimuth(view)
        wanted = (1.0 - view.fill) * self._bucket.heaped_capacity * self._appetite
        self._plan = self._plan_at(view, self._azimuth, wanted)
        if self._passes == 0:
            self._planned = self._plan.volume
        self._passes += 1
        above = self.params.clearance
        r, z = float(self._plan.radius[0]), float(self._plan.height[0])
        entry = self._at(view, self._azimuth, r, z + 0.05, self._entry_attitude)
        high = self._at(view, self._azimuth, r, z + above, self._entry_attitude)
        if self._passes > 1:
            # Hold what is in the bucket level until it is out there again.
            level = self._at(view, self._azimuth, r - 0.5, z + above + 0.3, self._arm.level)
            return self._paced(view.joints, [level, high, entry])
        return self._paced(view.joints, [high, entry])

    def _dig(self, view: View) -> list[Target]:
        """Along the plan, flatter and flatter, curling at the end."""
        assert self._plan is not None
        count = self._plan.radius.size
        attitude = np.linspace(self._entry_attitude, self._exit_attitude, count)
        joints = [
            self._at(view, self._azimuth, r, z, a)
            for r, z, a in zip(self._plan.radius, self._plan.height, attitude, strict=True)
        ]
        way = np.hypot(np.diff(self._plan.radius), np.diff(self._plan.height))
        durations = np.maximum(way / self.params.dig_speed, 1e-3)
        return [
            Target(self._at(view, self._azimuth, *self._first_point(), self._entry_attitude), 0.3),
            *(Target(q, float(t)) for q, t in zip(joints[1:], durations, strict=True)),
        ]

    def _curl(self, view: View) -> list[Target]:
        """Turn the mouth up while the lip comes out of the soil."""
        assert self._plan is not None
        r, z = float(self._plan.radius[-1]), float(self._plan.height[-1])
        start = self._exit_attitude
        pin = self._arm.pin(r, z, start)
        targets = []
        for part in np.linspace(0.2, 1.0, 5):
            attitude = start + part * (self._arm.level - start)
            lift = self.params.curl_lift * part
            targets.append(self._arm.joints(view, self._azimuth, pin[0], pin[1] + lift, attitude))
        return self._paced(view.joints, targets)

    def _lift(self, view: View) -> list[Target]:
        """Straight up, level, to the height of the swing."""
        r, _ = self._arm.pin_of(view)
        z = self._swing_height(view)
        azimuth = self._arm.azimuth(view)
        return self._paced(view.joints, [self._arm.joints(view, azimuth, r, z, self._arm.level)])

    def _swing(self, view: View) -> list[Target]:
        """Around to the dump, level, and up to where the open bucket clears the heap."""
        r, _ = self._arm.pin_of(view)
        low = self._swing_height(view)
        high = max(low, self._dump_height(view))
        start, end = self._arm.azimuth(view), self._dump_at
        turn = math.remainder(end - start, 2 * math.pi)
        radius = self.params.dump_radius
        targets = []
        for part in np.linspace(0.1, 1.0, 10):
            pin_r = r + part * (radius - r)
            pin_z = low + part * (high - low)
            targets.append(
                self._arm.joints(view, start + part * turn, pin_r, pin_z, self._arm.level)
            )
        return self._paced(view.joints, targets)

    def _dump(self, view: View) -> list[Target]:
        """Open the bucket where it is."""
        return self._paced(view.joints, [self._arm.opened(view)])

    # Where things are.

    def _choose_azimuth(self, view: View) -> float:
        """The direction in the dig sector where the ground is highest: least dug so far."""
        half = self.params.dig_sector
        choices = self._dig_at + np.array([0.0, -half, half, -0.5 * half, 0.5 * half])
        radius = np.linspace(self.params.near, self.params.far, 20)
        level = [view.on_line(a, radius, self._bucket.width).mean() for a in choices]
        return float(choices[int(np.argmax(np.round(level, 2)))])

    def _plan_at(self, view: View, azimuth: float, volume: float) -> DigPlan:
        radius = np.arange(self.params.near - 0.5, self.params.far + 0.5, 0.1)
        surface = view.on_line(azimuth, radius, self._bucket.width)
        reach = DigReach(
            near=self.params.near,
            far=self._far(view, azimuth, radius, surface),
            lowest=float(view.base_position[2]) - self.params.deepest,
            width=self._bucket.width,
            deepest_cut=self.params.deepest_cut,
        )
        return plan_dig(radius, surface, reach, volume)

    def _far(
        self,
        view: View,
        azimuth: float,
        radius: NDArray[np.float64],
        surface: NDArray[np.float64],
    ) -> float:
        """Largest radius at which the lip can come down from its clearance to the ground."""
        far = self.params.far
        while far > self.params.near + 1.0:
            ground = float(np.interp(far, radius, surface))
            try:
                for height in (self.params.clearance, -self.params.deepest_cut):
                    self._at(view, azimuth, far, ground + height, self._entry_attitude)
            except ReachError:
                far -= 0.1
            else:
                break
        return far

    def _first_point(self) -> tuple[float, float]:
        assert self._plan is not None
        return float(self._plan.radius[0]), float(self._plan.height[0])

    def _swing_height(self, view: View) -> float:
        """Height of the pin [m] at which the bucket clears all ground of the swing."""
        start, end = self._arm.azimuth(view), self._dump_at
        turn = math.remainder(end - start, 2 * math.pi)
        radius = np.linspace(self.params.near, self.params.far, 12)
        tops = [
            view.on_line(start + part * turn, radius, 2.0 * self._bucket.width).max()
            for part in np.linspace(0.0, 1.0, 9)
        ]
        return float(max(tops)) + self._arm.depth_below_pin + self.params.clearance

    def _dump_height(self, view: View) -> float:
        """Height of the pin [m] at which the bucket clears the heap under it while it opens."""
        length = self._bucket.tip_length
        radius = np.linspace(self.params.dump_radius - length, self.params.dump_radius + length, 12)
        top = view.on_line(self._dump_at, radius, 2.0 * self._bucket.width).max()
        return float(top) + length + self.params.clearance

    def _at(
        self, view: View, azimuth: float, r: float, z: float, attitude: float
    ) -> NDArray[np.float64]:
        """Joints with the lip at (r, z) [m], map heights, in direction `azimuth`."""
        return self._arm.joints(view, azimuth, *self._arm.pin(r, z, attitude), attitude)

    def _paced(self, start: NDArray[np.float64], joints: list[NDArray[np.float64]]) -> list[Target]:
        """Give each target the time that the slowest joint needs for it."""
        speeds = np.array(self.params.joint_speeds)
        targets = []
        for target in joints:
            targets.append(Target(target, float((np.abs(target - start) / speeds).max()) + 0.02))
            start = target
        return targets

    @property
    def _entry_attitude(self) -> float:
        return self._arm.attitude_of_attack(self.params.entry_angle)

    @property
    def _exit_attitude(self) -> float:
        return self._arm.attitude_of_attack(self.params.exit_angle)
