"""Performance of a machine as brochures state it: masses, forces, speeds and times.

Forces follow ISO 6015: those at the cutting edge, perpendicular to its distance from the pin, at
the main relief pressure and the most favourable angle. Speeds and times are measured in the
simulation: the machine stands on firm level ground with an empty bucket, and one lever is moved
fully. The time of a cylinder ends when 99 % of its stroke is done. The boom moves between the
ground and its highest position with extended arm and opened bucket, as in the service manuals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine import EXCAVATOR_JOINTS, MachineSpec
from machine_sim.machine.reference_machine import FIGURE_UNITS
from machine_sim.machine.tools.open_container import OpenContainer
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.grid import Grid

__all__ = ["machine_figures"]

_MAX_TIME = 20.0
"""Time after which a motion counts as not finished [s]."""

_STROKE_FRACTION = 0.99
"""Fraction of a stroke after which its time ends."""

_SETTLE_TIME = 1.0
"""Time before a motion in which the machine comes to rest [s]."""

_BOOM_ANGLE = -0.3
"""Angle of the boom at which arm and bucket move [rad]."""

_WORKING_ARM_ANGLE = 1.6
"""Angle of the arm at which the bucket moves: about vertical [rad]."""


def machine_figures(spec: MachineSpec) -> dict[str, float]:
    """Return the figures that the machine has, in the order and units of `FIGURE_UNITS`."""
    figures = {"operating_mass": spec.mass, "drawbar_pull": 2e-3 * spec.tracks.max_tractive_effort}
    figures["travel_speed"] = _travel_speed(spec)
    if spec.supply is not None:
        figures["engine_power"] = 1e-3 * spec.supply.engine_power
        figures["pump_flow"] = 6e4 * spec.supply.pump_flow
        figures["main_relief_pressure"] = 1e-6 * spec.supply.main_relief_pressure
    if spec.tracks.motor is not None:
        figures["travel_relief_pressure"] = 1e-6 * spec.tracks.motor.relief_pressure
    capacities = [
        tool.shape.heaped_capacity
        for tool in spec.tools.values()
        if isinstance(tool.shape, OpenContainer)
    ]
    if capacities:
        figures["heaped_capacity"] = sum(capacities)
    if spec.joint_names == EXCAVATOR_JOINTS:
        figures |= _excavator_figures(spec)
    return {name: figures[name] for name in FIGURE_UNITS if name in figures}


def _excavator_figures(spec: MachineSpec) -> dict[str, float]:
    """Return the figures of swing and arm."""
    figures = {
        "swing_torque": 1e-3 * spec.joints["swing"].max_effort,
        "swing_speed": _swing_speed(spec),
    }
    if "swing" in spec.motors:
        figures["swing_relief_pressure"] = 1e-6 * spec.motors["swing"].relief_pressure
    if {"arm", "bucket"} <= spec.cylinders.keys():
        figures |= _digging_forces(spec)
    return figures | _boom_times(spec) | _stroke_times(spec)


def _digging_forces(spec: MachineSpec) -> dict[str, float]:
    """Return the forces of bucket and arm at the cutting edge [kN]."""
    lip_x, lip_z = spec.bucket.profile[0]
    linkage = spec.cylinders["bucket"].linkage
    angles = np.linspace(linkage.lower, linkage.upper, 101)
    strongest = max(angles.tolist(), key=lambda angle: abs(linkage.lever_arm(angle)))
    arm_length = math.hypot(spec.joints["bucket"].origin[0], spec.joints["bucket"].origin[2])
    # The bucket is at the angle of its largest force.
    lip = math.atan2(-lip_z, lip_x) + strongest
    lip_radius = math.hypot(lip_x, lip_z)
    arm_radius = math.hypot(arm_length + lip_radius * math.cos(lip), lip_radius * math.sin(lip))
    return {
        "bucket_force": 1e-3 * spec.joints["bucket"].max_effort / lip_radius,
        "arm_force": 1e-3 * spec.joints["arm"].max_effort / arm_radius,
    }


def _boom_times(spec: MachineSpec) -> dict[str, float]:
    """Return the times to lower and to raise the boom [s]."""
    boom = spec.joints["boom"]
    top, arm, bucket = boom.lower, spec.joints["arm"].lower, spec.joints["bucket"].lower
    run = _Run(spec, [0.0, top, arm, bucket])
    lowering = run.time({"boom": boom.max_velocity}, lambda: run.lip_height <= 0.0)
    run.wait(_SETTLE_TIME)
    bottom = run.angle("boom")
    end = bottom + _STROKE_FRACTION * (top - bottom)
    raising = run.time({"boom": -boom.max_velocity}, lambda: run.angle("boom") <= end)
    run.close()
    return {"boom_raise_time": raising, "boom_lower_time": lowering}


def _stroke_times(spec: MachineSpec) -> dict[str, float]:
    """Return the times of full strokes of arm and bucket [s]."""
    times = {}
    for name, home in (
        ("arm", [0.0, _BOOM_ANGLE, spec.joints["arm"].lower, 0.0]),
        ("bucket", [0.0, _BOOM_ANGLE, _WORKING_ARM_ANGLE, spec.joints["bucket"].lower]),
    ):
        joint = spec.joints[name]
        part = (1.0 - _STROKE_FRACTION) * (joint.upper - joint.lower)
        run = _Run(spec, home)
        times[f"{name}_in_time"] = run.time(
            {name: joint.max_velocity}, _above(run, name, joint.upper - part)
        )
        run.wait(_SETTLE_TIME)
        times[f"{name}_out_time"] = run.time(
            {name: -joint.max_velocity}, _below(run, name, joint.lower + part)
        )
        run.close()
    return times


def _above(run: _Run, joint: str, angle: float) -> Callable[[], bool]:
    return lambda: run.angle(joint) >= angle


def _below(run: _Run, joint: str, angle: float) -> Callable[[], bool]:
    return lambda: run.angle(joint) <= angle


def _swing_speed(spec: MachineSpec) -> float:
    """Return the swing speed at full lever [rpm]."""
    run = _Run(spec, spec.home.tolist())
    run.wait(_MAX_TIME / 2, {"swing": spec.joints["swing"].max_velocity})
    speed = run.speed("swing")
    run.close()
    return speed * 30.0 / math.pi


def _travel_speed(spec: MachineSpec) -> float:
    """Return the travel speed at full lever [km/h]."""
    run = _Run(spec, spec.home.tolist())
    run.wait(_MAX_TIME / 4, {}, spec.tracks.max_speed)
    speed = float(np.linalg.norm(run.sim.machine.base_velocity[0]))
    run.close()
    return 3.6 * speed


class _Run:
    """A machine on firm level ground, whose levers are moved.

    Attributes:
        sim: simulation of the machine.
    """

    def __init__(self, spec: MachineSpec, home: list[float]) -> None:
        """
        Args:
            spec: specification of the machine.
            home: initial joint angles [rad].
        """
        angles: NDArray[np.float64] = np.array(home)
        angles.setflags(write=False)
        grid = Grid(257, 257, 0.2)
        self.sim = MachineSim(
            [Placement(replace(spec, home=angles))],
            grid,
            np.zeros(grid.shape),
            params=MachineSimParams(steps_per_tick=1),
        )
        self._names = spec.joint_names
        self.wait(_SETTLE_TIME)

    def close(self) -> None:
        """Release the physics engine."""
        self.sim.close()

    def wait(
        self, seconds: float, joints: Mapping[str, float] | None = None, tracks: float = 0.0
    ) -> None:
        """Command joint velocities [rad/s] and track speeds [m/s] for a time [s]."""
        self.sim.machine.command(joints or {}, [tracks, tracks])
        for _ in range(round(seconds / self.sim.params.physics_step)):
            self.sim.step()

    def time(self, joints: Mapping[str, float], is_done: Callable[[], bool]) -> float:
        """Command joint velocities [rad/s] until `is_done`; return the time [s], nan if never."""
        self.sim.machine.command(joints, [0.0, 0.0])
        step = self.sim.params.physics_step
        for k in range(round(_MAX_TIME / step)):
            if is_done():
                self.sim.machine.command({}, [0.0, 0.0])
                return k * step
            self.sim.step()
        return math.nan

    def angle(self, joint: str) -> float:
        """Return the angle of a joint [rad]."""
        return float(self.sim.machine.joint_positions[self._names.index(joint)])

    def speed(self, joint: str) -> float:
        """Return the speed of a joint [rad/s]."""
        return float(self.sim.machine.joint_velocities[self._names.index(joint)])

    @property
    def lip_height(self) -> float:
        """Height of the cutting lip above the ground [m]."""
        rotation, origin = self.sim.machine.tool.pose
        lip_x, lip_z = self.sim.machine.spec.bucket.profile[0]
        return float(origin[2] + rotation[2, 0] * lip_x + rotation[2, 2] * lip_z)
