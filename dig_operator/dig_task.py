"""DigTask: drive up, dig a number of cycles, and wait until all soil is at rest.

approach -> brace -> dig cycles -> settle -> done
              ^          |
           retreat <- stow     where the ground in reach is dug out
"""

from __future__ import annotations

import math

import numpy as np

from dig_operator.bucket_kinematics import BucketKinematics
from dig_operator.cycle_waypoints import WaypointPlanner
from dig_operator.dig_cycle import CycleReport, DigCycle
from dig_operator.dig_stations import DigStations, is_exhausted
from dig_operator.dump_target import BedTarget, DumpTarget, HeapTarget
from dig_operator.observation import Command, Observation
from dig_operator.params import BehaviourParams, DigTaskParams
from dig_operator.phases import OperatorPhase
from dig_operator.track_drive import Line, TrackDrive
from machine_sim.machine.errors import ReachError
from machine_sim.machine.spec import MachineSpec

__all__ = ["DigTask"]

_DRIVE_SPEED = 0.8
"""Speed of both tracks during the approach, and maximum speed of a retreat [m/s]."""

_DUG_OUT_FRACTION = 0.1
"""Volume of a plan, as a fraction of what the pass should sweep, below which there is nothing left
to dig at the last station."""

_CLEARANCE, _TURN_SPEED = 0.6, 0.5
"""Distance to keep from other machines [m], and the speed of turns on the spot [rad/s]."""

_BRACE_TIME = 0.5
"""Time between stopping and digging [s]: the machine rocks when it stops."""

_SETTLE_TIME = 0.1
"""Time without motion after which the soil counts as at rest [s]."""

_MAX_SETTLE_TIME = 3.0
"""Maximum time to wait for the soil to come to rest [s]."""

_PHASES_FROM_DUMP = (OperatorPhase.REACH, OperatorPhase.STOW)
"""Phases in which the bucket moves away from the dump."""

_FINAL_PHASES = (OperatorPhase.SETTLE, OperatorPhase.DONE)

_MAX_SINKAGE, _MAX_TURN = 0.2, math.radians(10.0)
"""Sinkage [m] and turn [rad] of the machine at a station that may be why it cannot reach."""


class DigTask:
    """Operator of an excavator with a digging task.

    Attributes:
        phase: `APPROACH`, `BRACE`, a phase of the dig cycle, `RETREAT`, `SETTLE` or `DONE`.
        station: number of the station it digs at, from 0.
        abort_reason: why the task was aborted; empty if it was not.
    """

    def __init__(
        self, machine: MachineSpec, behaviour: BehaviourParams, params: DigTaskParams
    ) -> None:
        """
        Args:
            machine: the excavator.
            behaviour: behaviour of the operator.
            params: the task.
        """
        self.phase = OperatorPhase.APPROACH
        self.abort_reason = ""
        self._machine, self._behaviour, self._params = machine, behaviour, params
        BucketKinematics(machine).warm_up()
        self._initial_observation: Observation | None = None
        self._station_height = self._station_yaw = 0.0  # of the base when it began to dig there
        self._phase_start_time = 0.0  # of brace and settle
        self._last_motion_time = 0.0  # of soil, while settling
        self._waiting_time = 0.0  # for the truck [s]
        self._obstacle = ""  # name of the machine in the way of the approach or retreat
        self.station = 0
        self._stations = DigStations(0.0, 0.0, 0.0, params.station_spacing, 1)
        self._first_report = 0  # of the present station
        self._planned_cycle = 0  # of which the plan has been judged; 0: none at this station
        self._is_complete = False
        self._dig_cycle: DigCycle | None = None
        self._target: DumpTarget | None = None
        self._drive = self._create_drive()

    @property
    def cycle(self) -> int:
        """Number of the present cycle, from 1; of the last one when all are done."""
        number = self._dig_cycle.cycle if self._dig_cycle else 1
        return number if self._params.truck else min(number, self._params.cycles)

    @property
    def reports(self) -> list[CycleReport]:
        """Report of each finished cycle."""
        return self._dig_cycle.reports if self._dig_cycle else []

    @property
    def done(self) -> bool:
        """Whether the task has ended."""
        return self.phase is OperatorPhase.DONE

    def command(self, observation: Observation, dt: float) -> Command:
        """Return the command for the next `dt` [s]; zero velocities once the task has ended."""
        if self._initial_observation is None:
            self._initial_observation = observation
        if (
            self.phase is OperatorPhase.APPROACH
            and self._distance_driven(observation) >= self._params.approach_distance
        ):
            self._enter_phase(OperatorPhase.BRACE, observation)
        if (
            self.phase is OperatorPhase.BRACE
            and observation.time - self._phase_start_time >= _BRACE_TIME
        ):
            if self._dig_cycle is None:
                self._dig_cycle = self._begin_digging(observation)
            else:
                self._dig_cycle.resume()
            self.phase = OperatorPhase.REACH
            self._station_height = float(observation.base_position[2])
            self._station_yaw = observation.yaw
        # A truck may come late.
        self._waiting_time += dt if self.phase is OperatorPhase.WAIT else 0.0
        elapsed = self._elapsed(observation) - self._waiting_time
        timeout = self._params.duration + self._params.timeout
        if self.phase not in _FINAL_PHASES and elapsed > timeout:
            self._abort(
                f"the task was not finished within {timeout:g} s of simulation time",
                observation,
            )
        if self.phase is OperatorPhase.APPROACH:
            return self._approach(observation, dt)
        if self.phase is OperatorPhase.RETREAT:
            return self._retreat(observation, dt)
        if self.phase is OperatorPhase.BRACE:
            return _standstill()
        if self._dig_cycle is not None and self.phase not in _FINAL_PHASES:
            return self._dig(self._dig_cycle, observation, dt)
        if self.phase is OperatorPhase.SETTLE:
            self._settle(observation)
        return _standstill()

    def _begin_digging(self, observation: Observation) -> DigCycle:
        """Return the dig cycle at the first station, which is here."""
        assert self._initial_observation is not None
        yaw, params = self._initial_observation.yaw, self._params
        x, y, _ = observation.base_position.tolist()
        self._stations = DigStations(x, y, yaw, params.station_spacing, params.stations)
        self._target = self._create_target(yaw)
        planner = WaypointPlanner(
            self._machine, self._behaviour, dig_azimuth=yaw, dump_target=self._target
        )
        return DigCycle(planner)

    def _elapsed(self, observation: Observation) -> float:
        """Return the time since the task began [s]."""
        assert self._initial_observation is not None
        return observation.time - self._initial_observation.time

    def _create_target(self, yaw: float) -> DumpTarget:
        """Return the place to dump at for an initial heading [rad]."""
        behaviour, params = self._behaviour, self._params
        if not params.truck:
            return HeapTarget(yaw + math.radians(params.dump_angle), behaviour.dump_radius)
        return BedTarget(
            params.truck,
            BucketKinematics(self._machine),
            min_radius=behaviour.min_radius,
            max_radius=behaviour.max_radius,
            full_fill=params.full_fill,
        )

    def _approach(self, observation: Observation, dt: float) -> Command:
        """Drive straight ahead; stop before other machines."""
        line = Line((0.0, 0.0), observation.yaw)
        self._obstacle = self._drive.find_obstacle(observation, line)
        speed = 0.0 if self._obstacle else _DRIVE_SPEED
        return Command(np.zeros(4), np.full(2, speed))

    @property
    def wait_reason(self) -> str:
        """What it waits for, for the user; empty if it does not wait."""
        if self.phase in (OperatorPhase.APPROACH, OperatorPhase.RETREAT) and self._obstacle:
            return f"{self._obstacle}, which is in the way"
        if self.phase is OperatorPhase.WAIT and self._dig_cycle is not None:
            return self._dig_cycle.wait_reason
        return ""

    def _find_completion(self, dig_cycle: DigCycle, observation: Observation) -> bool:
        """Whether all loads, or all cycles of a task without a truck, are done, or the duration has
        passed and no load has begun."""
        params = self._params
        is_late = 0.0 < params.duration <= self._elapsed(observation)
        if isinstance(self._target, BedTarget):
            is_over = is_late and not self._target.is_loading
            return is_over or self._target.num_loads >= params.loads
        return is_late or len(dig_cycle.reports) >= params.cycles

    def _dig(self, dig_cycle: DigCycle, observation: Observation, dt: float) -> Command:
        # A load begins with the swing of its first bucket; WAIT comes before.
        if not dig_cycle.has_dug or dig_cycle.phase is OperatorPhase.WAIT:
            self._is_complete = self._find_completion(dig_cycle, observation)
        # Above a truck the bucket would be in the way.
        is_above_truck = bool(self._params.truck) and dig_cycle.phase in _PHASES_FROM_DUMP
        if self._is_complete and not is_above_truck:
            self._enter_phase(OperatorPhase.SETTLE, observation)
            return _standstill()
        try:
            command = dig_cycle.command(observation, dt)
        except ReachError as error:
            is_reaching = dig_cycle.phase is OperatorPhase.REACH  # no ground is left in reach
            if is_reaching and self._has_next_station(observation):
                dig_cycle.stow()
            else:
                self._abort(f"{error}{self._describe_yielding(observation)}", observation)
            return _standstill()
        self.phase = dig_cycle.phase
        self._stow_if_exhausted(dig_cycle, observation)
        if dig_cycle.is_stowed:
            self.station += 1
            self._first_report = len(dig_cycle.reports)
            self._drive = self._create_drive()
            self._planned_cycle = 0
            self._enter_phase(OperatorPhase.RETREAT, observation)
        return command

    def _describe_yielding(self, observation: Observation) -> str:
        """Return how far the ground has yielded under the machine; empty if it has not by much."""
        sinkage = self._station_height - float(observation.base_position[2])
        turn = math.remainder(observation.yaw - self._station_yaw, 2.0 * math.pi)
        if sinkage <= _MAX_SINKAGE and abs(turn) <= _MAX_TURN:
            return ""
        return (
            f"; since it began to dig here the machine has sunk by {max(sinkage, 0.0):.2f} m and"
            f" turned by {abs(math.degrees(turn)):.0f} deg: the ground is too soft for it"
        )

    def _has_next_station(self, observation: Observation) -> bool:
        return self._stations.exists(self.station + 1, observation.grid)

    def _stow_if_exhausted(self, dig_cycle: DigCycle, observation: Observation) -> None:
        """Once in each cycle, stow the bucket to move on if the ground in reach is dug out."""
        plan_fraction = dig_cycle.plan_fraction
        if plan_fraction is None or dig_cycle.cycle == self._planned_cycle:
            return
        self._planned_cycle = dig_cycle.cycle
        if not self._has_next_station(observation):
            if plan_fraction < _DUG_OUT_FRACTION:
                self._abort(
                    f"the ground in reach of the last of {self.station + 1} stations is dug out",
                    observation,
                )
            return
        passes = [report.num_passes for report in dig_cycle.reports[self._first_report :]]
        if is_exhausted(plan_fraction, passes, min_plan_fraction=self._params.min_plan_fraction):
            dig_cycle.stow()

    def _retreat(self, observation: Observation, dt: float) -> Command:
        """Reverse to the next station; stop before other machines."""
        line = self._stations.line_to(self.station)
        self._obstacle = self._drive.find_obstacle(observation, line)
        if self._obstacle:
            return Command(np.zeros(4), self._drive.stop(dt))
        tracks, is_done = self._drive.follow(observation, line, _DRIVE_SPEED, dt)
        if is_done:
            self._enter_phase(OperatorPhase.BRACE, observation)
            return _standstill()
        return Command(np.zeros(4), tracks)

    def _create_drive(self) -> TrackDrive:
        return TrackDrive(self._machine, clearance=_CLEARANCE, turn_speed=_TURN_SPEED)

    def _settle(self, observation: Observation) -> None:
        if observation.is_soil_moving:
            self._last_motion_time = observation.time
        is_at_rest = observation.time - self._last_motion_time >= _SETTLE_TIME
        if is_at_rest or observation.time - self._phase_start_time >= _MAX_SETTLE_TIME:
            self.phase = OperatorPhase.DONE

    def _distance_driven(self, observation: Observation) -> float:
        """Return the horizontal distance from the initial position [m]."""
        assert self._initial_observation is not None
        offset = observation.base_position - self._initial_observation.base_position
        return float(np.hypot(offset[0], offset[1]))

    def _enter_phase(self, phase: OperatorPhase, observation: Observation) -> None:
        self.phase = phase
        self._phase_start_time = self._last_motion_time = observation.time

    def abort(self, reason: str) -> None:
        """End the task at once.

        Args:
            reason: why, for the user.
        """
        self.phase, self.abort_reason = OperatorPhase.DONE, reason

    def _abort(self, reason: str, observation: Observation) -> None:
        self.abort_reason = reason
        self._enter_phase(OperatorPhase.SETTLE, observation)


def _standstill() -> Command:
    """Return zero velocities: the joints hold their angles."""
    return Command(np.zeros(4), np.zeros(2))
