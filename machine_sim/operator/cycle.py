"""The scripted operator: dig, lift, swing, dump, return, over and over.

It sees what public topics carry and sends what a person would send. It plans each dig from the
terrain as it is, curls early when the bucket is full, digs again when it has not come out full,
and asks for more or less next time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.description import MachineDescription
from machine_sim.operator.arm import ArmPlane, Place
from machine_sim.operator.dig import DigPlan, plan_dig
from machine_sim.operator.motion import Motion, Target
from machine_sim.operator.params import OperatorParams
from machine_sim.operator.survey import Survey
from machine_sim.operator.view import Command, SteadyBase, View

__all__ = ["CycleReport", "DigCycle"]

Array = NDArray[np.float64]

_LOADED = ("lift", "swing")
"""Phases in which too much in the bucket may tip the machine over."""

_SPILL = np.array([0.0, 0.0, 0.0, -0.4])
"""Joint velocities [rad/s] that let some of the load fall."""

_TURN, _TURN_SPEED = 1.5, 0.4
"""Most the bucket turns on its way through the soil [rad/m], [rad/s]: levers move slowly."""

_NEXT = {"reach": "dig", "dig": "curl", "curl": "lift", "lift": "swing", "swing": "dump"}

_AT_REST = ("reach", "swing")
_STILL = 0.05
"""Phases that end with the machine at rest, and the joint speed that counts as rest [rad/s]."""

_LEAST, _MOST = 0.6, 1.6
"""Appetites it does not learn to go beyond; one it is given may lie beyond them."""


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
        moved: bank volume dumped [m^3].
    """

    number: int
    passes: int
    planned: float
    carried: float
    delivered: float
    left: float
    duration: float
    moved: float = 0.0


class DigCycle:
    """An operator at the levers of one excavator.

    Attributes:
        params: its habits.
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
        self._survey = Survey(self._arm, params, machine.bucket)
        self._capacity = machine.bucket.heaped_capacity
        self._dig_at, self._dump_at = dig_at, dump_at
        self._entry = self._arm.attitude_of_attack(params.entry_angle)
        self._exit = self._arm.attitude_of_attack(params.exit_angle)
        self._appetite = params.appetite
        self._base = SteadyBase(params.base_patience)
        self._levers = np.zeros(4)
        self._motion: Motion | None = None
        self._plan = DigPlan.nothing()
        self._azimuth = dig_at
        self._stood = np.eye(3)  # the base, when the dig began
        self._passes = 0
        self._planned = self._carried = self._delivered = self._bank = 0.0
        self._began: float | None = None
        self._waited = 0.0

    def command(self, view: View, dt: float) -> Command:
        """What to do in the next `dt` [s]."""
        tips = self._tips(view)
        view = self._base.see(view, dt)
        if self._began is None:
            self._began = view.time
        if self._motion is None:
            self._motion = self._begin(view)
        wanted = _SPILL if tips else self._motion.advance(view, self._arm, dt)
        most = np.array(self.params.lever_rates) * dt
        self._levers = self._levers + np.minimum(np.maximum(wanted - self._levers, -most), most)
        brimful = self.phase == "dig" and view.fill > self.params.brimming
        if brimful or (self._motion.done and self._steady):
            self._end(view, dt)
        return Command(self._levers.copy(), np.zeros(2))

    def _tips(self, view: View) -> bool:
        """Whether what it has in the bucket leans the machine too far from how it stood to dig."""
        if self.phase not in _LOADED or view.fill <= self.params.empty:
            return False
        stood = replace(view, base_rotation=self._stood)
        return self._arm.rise(view) < self._arm.rise(stood) - self.params.most_lean

    @property
    def _steady(self) -> bool:
        """Whether the machine has come to rest where the next phase needs it at rest."""
        return self.phase not in _AT_REST or float(np.abs(self._levers).max()) < _STILL

    # Each phase: how it begins, as a motion, and what comes after it.

    def _begin(self, view: View) -> Motion:
        phases: dict[str, Callable[[View, Place], list[Target]]] = {
            "reach": self._reach,
            "dig": self._dig,
            "curl": self._curl,
            "lift": self._lift,
            "swing": self._swing,
            "dump": self._dump,
        }
        here = self._arm.place(view)
        return Motion(here, phases[self.phase](view, here))

    def _end(self, view: View, dt: float) -> None:
        if self.phase == "dump":
            self._waited += dt
            if view.fill > self.params.empty and self._waited < self.params.dump_wait:
                return
            self._finish(view)
            self.phase = "reach"
        elif self.phase == "lift" and self._wants_more(view):
            self.phase = "reach"
        else:
            if self.phase == "lift":
                self._carried = view.fill
            elif self.phase == "swing":
                self._delivered, self._bank = view.fill, view.bank
                self._waited = 0.0
            self.phase = _NEXT[self.phase]
        self._motion = None

    def _wants_more(self, view: View) -> bool:
        return view.fill < self.params.full and self._passes < self.params.most_passes

    def _finish(self, view: View) -> None:
        assert self._began is not None, "a cycle that ends has begun"
        self.reports.append(
            CycleReport(
                self.cycle,
                self._passes,
                self._planned,
                self._carried,
                self._delivered,
                view.fill,
                view.time - self._began,
                self._bank - view.bank,
            )
        )
        # A bucket that came short, or with so much that it spilled, teaches.
        if self._passes > 1 or self._delivered < self.params.full:
            self._appetite = min(self._appetite * 1.1, max(self._appetite, _MOST))
        elif self._carried > self.params.brimming:
            self._appetite = max(self._appetite * 0.95, min(self._appetite, _LEAST))
        self.cycle += 1
        self._passes = 0
        self._began = view.time

    def _reach(self, view: View, here: Place) -> list[Target]:
        """To above the entry of a newly planned dig, and down to it."""
        if self._passes == 0:
            self._azimuth = self._survey.least_dug(view, self._dig_at)
        wanted = self._capacity * self._appetite  # what is in it falls out where it goes in
        reach = self._survey.reach(view, self._azimuth, self._entry)
        self._plan = plan_dig(*self._survey.profile(view, self._azimuth), reach, wanted)
        if self._passes == 0:
            self._planned = self._plan.volume
        self._passes += 1
        r, z = float(self._plan.radius[0]), float(self._plan.height[0])
        slant = float(self._slants()[0])
        above = self._arm.lip_at(self._azimuth, r, z + self.params.clearance, slant)
        entry = self._arm.lip_at(self._azimuth, r, z + 0.05, slant)
        return self._paced(here, [*self._over_ground(view, here, above), above, entry])

    def _dig(self, view: View, here: Place) -> list[Target]:
        """Along the plan."""
        self._stood = view.base_rotation
        plan, slants = self._plan, self._slants()
        places = [
            self._arm.lip_at(self._azimuth, r, z, a)
            for r, z, a in zip(plan.radius, plan.height, slants, strict=True)
        ]
        way = np.hypot(np.diff(plan.radius), np.diff(plan.height)) / self.params.dig_speed
        turn = np.abs(np.diff(slants)) / _TURN_SPEED
        durations = [0.3, *np.maximum(way, turn)]
        return [Target(p, float(t)) for p, t in zip(places, durations, strict=True)]

    def _slants(self) -> Array:
        """Attitudes of the bucket along the plan [rad].

        Flatter and flatter, but never so flat that its floor drags over the ground behind the lip.
        """
        plan = self._plan
        slants = np.linspace(self._entry, self._exit, plan.radius.size)
        dips = np.arctan(np.gradient(plan.height, plan.radius))  # inward: down is positive
        dragging = [self._arm.attitude_of_attack(dip + self.params.relief) for dip in dips]
        slants = np.minimum(slants, dragging)
        # Where the way bends the floor slants more than it must: a bucket turns slowly.
        apart = np.abs(plan.radius[:, None] - plan.radius)
        return np.asarray((slants + _TURN * apart).min(axis=1))

    def _curl(self, view: View, here: Place) -> list[Target]:
        """Turn the mouth up while the lip comes out of the soil."""
        up = self.params.curl_lift
        return self._paced(
            here,
            [
                here._replace(
                    height=here.height + part * up,
                    attitude=here.attitude + part * (self._arm.level - here.attitude),
                )
                for part in (0.25, 0.5, 0.75, 1.0)
            ],
        )

    def _lift(self, view: View, here: Place) -> list[Target]:
        """Straight up, level, to the height of the swing."""
        height = self._survey.swing_height(view, here.azimuth, self._dump_at)
        level = self._arm.level
        return self._paced(here, [here._replace(height=max(height, here.height), attitude=level)])

    def _swing(self, view: View, here: Place) -> list[Target]:
        """Around to the dump, level, and up to where the open bucket clears the heap."""
        turn = math.remainder(self._dump_at - here.azimuth, 2 * math.pi)
        over = Place(
            here.azimuth + turn,
            self.params.dump_radius,
            max(here.height, self._survey.dump_height(view, self._dump_at)),
            self._arm.level,
        )
        return self._paced(here, [_between(here, over, part) for part in (0.25, 0.5, 0.75, 1.0)])

    def _dump(self, view: View, here: Place) -> list[Target]:
        """Open the bucket over the dump."""
        turn = math.remainder(self._dump_at - here.azimuth, 2 * math.pi)
        open_ = here._replace(
            azimuth=here.azimuth + turn, attitude=self._arm.level - self.params.open_by
        )
        return self._paced(here, [open_])

    def _over_ground(self, view: View, here: Place, to: Place) -> list[Place]:
        """Way points that keep the bucket clear of the ground on the way around."""
        turn = math.remainder(to.azimuth - here.azimuth, 2 * math.pi)
        height = self._survey.swing_height(view, here.azimuth, to.azimuth)
        attitude = self._arm.level if view.fill > self.params.empty else to.attitude
        up = here._replace(height=max(here.height, height))
        there = Place(here.azimuth + turn, to.radius, max(to.height, height), attitude)
        return [up, _between(up, there, 0.5), there] if abs(turn) > 0.1 else [up]

    def _paced(self, start: Place, places: list[Place]) -> list[Target]:
        """Give each way point the time that its slowest part needs."""
        speeds = np.array(
            [
                self.params.swing_speed,
                self.params.lip_speed,
                self.params.lip_speed,
                self.params.curl_speed,
            ]
        )
        targets = []
        for place in places:
            way = np.abs(np.subtract(place, start))
            way[0] = abs(math.remainder(place.azimuth - start.azimuth, 2 * math.pi))
            targets.append(Target(place, float((way / speeds).max()) + 0.02))
            start = place
        return targets


def _between(a: Place, b: Place, part: float) -> Place:
    return Place(*(x + part * (y - x) for x, y in zip(a, b, strict=True)))
