"""HaulTask: a dumper that is loaded, hauls its load, tips it and returns.

    (approach -> spot -> load -> haul -> back -> tip -> pull_off -> lower) x loads -> done

It reverses to both places, so that its bed is where it is filled and where it empties. It leaves
the place of loading when it is full and nothing is above it, and stops before other machines. It
pulls forward while the raised bed empties, since the heap behind it would block the soil. Where the
machine that loads it moves along, it follows. It ends when there is no place left to tip at.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dig_operator.bed import EMPTY_FILL, bed_joint
from dig_operator.haul_lines import distance_left, line_to, polyline
from dig_operator.haul_params import HaulTaskParams
from dig_operator.load_report import LoadReport
from dig_operator.observation import Command, Observation
from dig_operator.phases import OperatorPhase
from dig_operator.tip_area import Place, TipArea
from dig_operator.track_drive import Line, TrackDrive
from machine_sim.machine import MachineSpec

__all__ = ["HaulTask"]

Array = NDArray[np.float64]

_PULL_OFF_SPEED = 0.6
"""Speed while the raised bed empties [m/s]."""

_PULL_OFF_DISTANCE = 3.0
"""Distance driven with the raised bed [m]."""

_MIN_FILL_CHANGE = 0.01
"""Change of the fill that shows that the bed is being loaded."""

_MAX_IDLE_TIME = 60.0
"""Time without soil after which the wait for it is reported, or ended after the duration [s]."""

_JOINT_TOLERANCE = 0.02
"""Error of the bed that has reached its target [rad]."""

_LOWER_TIME_FACTOR = 3.0
"""Maximum time to lower the bed, as a multiple of that at full speed."""

_MAX_SPOT_SHIFT = 1.0
"""Distance of the place of loading from the dumper above which it follows [m]."""

_MAX_LATERAL_SHIFT = 0.5
"""The part of it across the heading above which it follows by a new approach [m]."""

_RETURN_PHASES = (OperatorPhase.APPROACH, OperatorPhase.SPOT)
"""Phases in which the task may end without a load."""


class HaulTask:
    """Operator of a dumper.

    Attributes:
        phase: `APPROACH`, `SPOT`, `LOAD`, `HAUL`, `BACK`, `TIP`, `PULL_OFF`, `LOWER` or `DONE`.
        reports: one report per load.
        abort_reason: why the task was aborted; empty if it was not.
        wait_reason: what it waits for, for the user; empty if it does not.
    """

    def __init__(self, machine: MachineSpec, params: HaulTaskParams) -> None:
        """
        Args:
            machine: the dumper.
            params: the task.

        Raises:
            MachineError: the machine has no bed that tips.
        """
        self.phase = OperatorPhase.APPROACH
        self.reports: list[LoadReport] = []
        self.abort_reason = self.wait_reason = ""
        self._params = params
        self._drive = TrackDrive(machine, clearance=params.clearance, turn_speed=params.turn_speed)
        self._joint_index = bed_joint(machine)
        joint = machine.joints[machine.joint_names[self._joint_index]]
        self._num_joints = len(machine.joints)
        home = float(machine.home[self._joint_index])
        self._lowered_angle = home
        self._raised_angle = max((joint.lower, joint.upper), key=lambda angle: abs(angle - home))
        self._bed_speed = joint.max_velocity
        angle = abs(self._raised_angle - home)
        self._lower_timeout = _LOWER_TIME_FACTOR * angle / self._bed_speed
        self._tip_area: TipArea | None = None  # once the map is known
        self._is_planned = False  # the way to the place of loading, in the present round
        self._lines: list[Line] = []  # left to drive in the present phase
        self._start_time: float | None = None
        self._round_start_time = self._phase_start_time = 0.0
        self._initial_fill = 0.0  # of the present round: what sticks to the bed
        self._loading_since: float | None = None  # in the present round
        self._loading_time = 0.0
        self._is_full = False  # since it is being loaded; the soil settles afterwards
        self._loaded_fill, self._loaded_time = 0.0, 0.0  # when soil fell into the bed last
        self._obstacle, self._obstacle_since = "", 0.0  # the machine that it stops before
        self._fill, self._hauled_volume = 0.0, 0.0  # when it left
        self._advance: dict[OperatorPhase, Callable[[Observation, float], Command]] = {
            OperatorPhase.APPROACH: self._drive_ahead,
            OperatorPhase.SPOT: self._back_up,
            OperatorPhase.LOAD: self._load,
            OperatorPhase.HAUL: self._drive_ahead,
            OperatorPhase.BACK: self._back_up,
            OperatorPhase.TIP: self._tip,
            OperatorPhase.PULL_OFF: self._pull_off,
            OperatorPhase.LOWER: self._lower,
        }

    @property
    def cycle(self) -> int:
        """Number of the present load, from 1; of the last one when all are done."""
        return min(len(self.reports) + 1, self._params.loads)

    @property
    def done(self) -> bool:
        """Whether the task has ended."""
        return self.phase is OperatorPhase.DONE

    def abort(self, reason: str) -> None:
        """End the task at once.

        Args:
            reason: why, for the user.
        """
        self.phase, self.abort_reason = OperatorPhase.DONE, reason

    def command(self, observation: Observation, dt: float) -> Command:
        """Return the command for the next `dt` [s]; zero velocities once the task has ended."""
        if self._start_time is None:
            self._start_time = self._round_start_time = observation.time
            self._tip_area = TipArea(self._params, observation.grid)
            self._begin_round(observation)
        elapsed = observation.time - self._start_time
        timeout = self._params.duration + self._params.timeout
        if not self.done and elapsed > timeout:
            self.abort(f"the task was not finished within {timeout:g} s of simulation time")
        if (
            self._is_late(observation)
            and self.phase in _RETURN_PHASES
            and not self._is_loaded(observation)
        ):
            self.phase = OperatorPhase.DONE
        self.wait_reason, before, self._obstacle = "", self._obstacle, ""
        if self.done:
            return self._command(0.0, np.zeros(2))
        command = self._advance[self.phase](observation, dt)
        if not self._obstacle or self._obstacle != before:
            self._obstacle_since = observation.time
        elif observation.time - self._obstacle_since > self._params.obstacle_timeout:
            self.abort(
                f"{self._obstacle} has been in the way for {self._params.obstacle_timeout:g} s;"
                " move it, or set haul.via and the places of loading and tipping so that the way"
                " does not lead past it"
            )
        return command

    def _enter(self, phase: OperatorPhase, observation: Observation) -> None:
        """Begin a phase, and plan the lines to drive."""
        self.phase, self._phase_start_time = phase, observation.time
        params, position = self._params, observation.base_position[:2]
        via = list(zip(params.via[::2], params.via[1::2], strict=True))
        if phase is OperatorPhase.APPROACH:
            start = self._spot(observation).approach_start
            is_following = self._loading_since is not None  # the way from the tip is behind it
            points = [start] if is_following else [*reversed(via), start]
            self._lines, self._is_planned = polyline(position, points), True
        elif phase is OperatorPhase.HAUL:
            self._lines = polyline(position, [*via, self._tip_place.approach_start])
        elif phase is OperatorPhase.LOAD:
            if self._loading_since is None:
                self._loading_since = observation.time
            self._is_full = False
            self._loaded_fill, self._loaded_time = observation.fill, observation.time
        elif phase is OperatorPhase.SPOT:
            self._lines = [line_to(self._spot(observation), position)]
        elif phase is OperatorPhase.BACK:
            self._lines = [line_to(self._tip_place, position)]
        elif phase is OperatorPhase.PULL_OFF:
            x, y = position.tolist()
            c, s = math.cos(observation.yaw), math.sin(observation.yaw)
            end = (x + _PULL_OFF_DISTANCE * c, y + _PULL_OFF_DISTANCE * s)
            self._lines = [Line(end, observation.yaw)]

    def _begin_round(self, observation: Observation) -> None:
        """Return for a load, if there is a place to tip it at."""
        self._round_start_time, self._loading_since = observation.time, None
        self._initial_fill = observation.fill
        assert self._tip_area is not None
        area = self._tip_area
        if area.place(len(self.reports)) is not None:
            self.phase, self._lines, self._is_planned = OperatorPhase.APPROACH, [], False
        elif self.reports and self._params.duration > 0.0:
            self._enter(OperatorPhase.DONE, observation)
        else:
            left_out = area.num_planned - area.num_places
            off_map = f", {left_out} others are not on the map" if left_out else ""
            self.abort(
                f"the tip area is full: it has {area.num_places} places{off_map}; set"
                " haul.tip_columns and haul.tip_rows"
            )

    def _is_late(self, observation: Observation) -> bool:
        """Return whether the duration has passed."""
        assert self._start_time is not None, "the task has begun"
        return 0.0 < self._params.duration <= observation.time - self._start_time

    def _is_loaded(self, observation: Observation) -> bool:
        """Return whether soil was loaded in this round."""
        return observation.fill > self._initial_fill + EMPTY_FILL

    def _spot(self, observation: Observation) -> Place:
        """Return the place of loading, beside the machine that loads if it is named.

        Raises:
            LookupError: the state of that machine is not known; see `_is_spot_known`.
        """
        if not self._is_spot_known(observation):
            raise LookupError(f"the state of {self._params.loader} is not known")
        params = self._params
        x, y, yaw = params.spot_x, params.spot_y, math.radians(params.spot_yaw)
        for machine in observation.others:
            if machine.name == params.loader:
                x += float(machine.base_position[0])
                y += float(machine.base_position[1])
        return Place(x, y, yaw, params.spot_approach)

    def _is_spot_known(self, observation: Observation) -> bool:
        """Return whether the machine that loads, if it is named, has been observed."""
        loader = self._params.loader
        return not loader or any(machine.name == loader for machine in observation.others)

    @property
    def _tip_place(self) -> Place:
        """Place of the present tip."""
        assert self._tip_area is not None
        place = self._tip_area.place(len(self.reports))
        assert place is not None, "a round begins only with a place to tip at"
        return place

    def _drive_ahead(self, observation: Observation, dt: float) -> Command:
        """Drive to the start of an approach, and turn to its heading."""
        is_returning = self.phase is OperatorPhase.APPROACH
        if is_returning and not self._is_spot_known(observation):
            return self._wait_for_loader(dt)
        if is_returning and not self._is_planned:
            self._enter(OperatorPhase.APPROACH, observation)
        if self._lines:
            tracks, is_done = self._follow(observation, self._params.drive_speed, dt)
            if is_done:
                self._lines.pop(0)
            return self._command(0.0, tracks)
        place = self._spot(observation) if is_returning else self._tip_place
        if self._must_stop(observation, None):
            return self._command(0.0, self._drive.stop(dt))
        tracks, is_done = self._drive.turn(observation, place.yaw, dt)
        if is_done:
            self._enter(OperatorPhase.SPOT if is_returning else OperatorPhase.BACK, observation)
        return self._command(0.0, tracks)

    def _back_up(self, observation: Observation, dt: float) -> Command:
        """Reverse to the place of loading or tipping."""
        tracks, is_done = self._follow(observation, self._params.reverse_speed, dt)
        if is_done:
            is_spot = self.phase is OperatorPhase.SPOT
            self._enter(OperatorPhase.LOAD if is_spot else OperatorPhase.TIP, observation)
        return self._command(0.0, tracks)

    def _load(self, observation: Observation, dt: float) -> Command:
        """Stand until the bed is full and nothing is above it.

        After the duration it stands only while soil arrives.
        """
        if abs(observation.fill - self._loaded_fill) > _MIN_FILL_CHANGE:
            self._loaded_fill, self._loaded_time = observation.fill, observation.time
        is_idle = observation.time - self._loaded_time > _MAX_IDLE_TIME
        if is_idle and self._is_late(observation) and not self._is_loaded(observation):
            self._enter(OperatorPhase.DONE, observation)
            return self._command(0.0, np.zeros(2))
        self._is_full |= observation.fill >= self._params.full_fill
        self._is_full |= is_idle and self._is_late(observation)
        if self._is_full:
            self._obstacle = self._drive.find_obstacle(observation, None)
            if self._obstacle:
                self.wait_reason = f"{self._obstacle}, whose bucket is above the bed"
            else:
                self._fill, self._hauled_volume = observation.fill, observation.bank_m3
                assert self._loading_since is not None, "it is being loaded"
                self._loading_time = observation.time - self._loading_since
                self._enter(OperatorPhase.HAUL, observation)
        elif not self._is_spot_known(observation):
            return self._wait_for_loader(dt)
        elif self._is_left_behind(observation) and not self._must_stop(observation, None):
            lateral = distance_left(self._spot(observation), observation.base_position)
            is_beside = abs(lateral) > _MAX_LATERAL_SHIFT
            self._enter(OperatorPhase.APPROACH if is_beside else OperatorPhase.SPOT, observation)
        elif is_idle:
            self.wait_reason = "soil; does an excavator load this machine?"
        return self._command(0.0, self._drive.stop(dt))

    def _is_left_behind(self, observation: Observation) -> bool:
        """Return whether the machine that loads has moved along, and the place of loading too."""
        spot, position = self._spot(observation), observation.base_position
        distance = math.hypot(spot.x - float(position[0]), spot.y - float(position[1]))
        return bool(self._params.loader) and distance > _MAX_SPOT_SHIFT

    def _wait_for_loader(self, dt: float) -> Command:
        """Stand while it is not known where the machine that loads is."""
        self.wait_reason = f"{self._params.loader}, whose state is not known"
        return self._command(0.0, self._drive.stop(dt))

    def _tip(self, observation: Observation, dt: float) -> Command:
        """Raise the bed."""
        velocity = self._bed_velocity(observation, self._raised_angle)
        is_late = observation.time - self._phase_start_time > self._params.tip_timeout
        if velocity == 0.0 or is_late or observation.fill <= EMPTY_FILL:
            self._enter(OperatorPhase.PULL_OFF, observation)
        return self._command(velocity, self._drive.stop(dt))

    def _pull_off(self, observation: Observation, dt: float) -> Command:
        """Drive forward with the raised bed."""
        tracks, is_done = self._follow(observation, _PULL_OFF_SPEED, dt)
        elapsed = observation.time - self._phase_start_time
        is_empty = observation.fill <= EMPTY_FILL or elapsed > self._params.tip_timeout
        if is_done and is_empty:
            self._enter(OperatorPhase.LOWER, observation)
        return self._command(self._bed_velocity(observation, self._raised_angle), tracks)

    def _lower(self, observation: Observation, dt: float) -> Command:
        """Lower the bed, report the load, and begin the next round."""
        velocity = self._bed_velocity(observation, self._lowered_angle)
        if velocity == 0.0:
            self._finish_round(observation)
        elif observation.time - self._phase_start_time > self._lower_timeout:
            self.abort(
                f"the bed was not lowered within {self._lower_timeout:.0f} s; what is below it?"
            )
        return self._command(velocity, self._drive.stop(dt))

    def _finish_round(self, observation: Observation) -> None:
        self.reports.append(
            LoadReport(
                number=len(self.reports) + 1,
                fill=self._fill,
                hauled_volume=self._hauled_volume,
                moved_volume=self._hauled_volume - observation.bank_m3,
                loading_time=self._loading_time,
                duration=observation.time - self._round_start_time,
            )
        )
        if len(self.reports) >= self._params.loads:
            self._enter(OperatorPhase.DONE, observation)
        else:
            self._begin_round(observation)

    def _follow(self, observation: Observation, speed: float, dt: float) -> tuple[Array, bool]:
        """Follow the first line; stop while another machine is in the way."""
        line = self._lines[0]
        if self._must_stop(observation, line):
            return self._drive.stop(dt), False
        return self._drive.follow(observation, line, speed, dt)

    def _must_stop(self, observation: Observation, line: Line | None) -> bool:
        """Return whether another machine is in the way; None: of a turn on the spot."""
        self._obstacle = self._drive.find_obstacle(observation, line)
        if self._obstacle:
            self.wait_reason = f"{self._obstacle}, which is in the way"
        return bool(self._obstacle)

    def _bed_velocity(self, observation: Observation, target: float) -> float:
        """Return the velocity of the bed's joint toward an angle [rad/s]; 0 once it is reached."""
        error = target - float(observation.joints[self._joint_index])
        if abs(error) < _JOINT_TOLERANCE:
            return 0.0
        return math.copysign(self._bed_speed, error)

    def _command(self, bed_velocity: float, tracks: Array) -> Command:
        joints = np.zeros(self._num_joints)
        joints[self._joint_index] = bed_velocity
        return Command(joints, tracks)
