"""WorldScene: shows a world of one process, without DDS, as the live page shows nodes."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time

from earthmoving_sim.figures.soil_scene import RUN_ID, show_soil, soil_colors
from earthmoving_sim.world import World
from machine_sim.machine.cylinder_visuals import cylinder_joint_states
from machine_sim.machine.description import description_text
from machine_sim.machine.track_wheels import BeltOdometer, track_wheels
from machine_sim.simulated_machine import SimulatedMachine
from machine_sim.simulation import MachineSim
from msg_bridge.codec.machine_state import BaseState, JointValues, to_joint_state
from msg_bridge.codec.particles import PARTICLE
from msg_bridge.codec.poses import to_odometry
from msg_bridge.contract.rows import Rows
from msg_bridge.contract.topics import MAP_FRAME
from viewer.scene.scene import Scene
from viewer.scene.urdf import parse_urdf
from viewer.sources.scene_writer import SceneWriter

__all__ = ["WorldScene"]


class WorldScene:
    """Sets a scene from a world.

    Attributes:
        scene: what is shown.
    """

    def __init__(self, world: World, tick_period: float) -> None:
        """
        Args:
            world: soil and machines.
            tick_period: duration of a tick [s].
        """
        self.scene = Scene()
        self._world, self._tick_period = world, tick_period
        self._writer = SceneWriter(self.scene)
        self._shown_revision: int | None = None
        self._machines = {
            f"/{machine.machine.spec.name}_{number}": machine
            for number, machine in enumerate(_machines(world), 1)
        }
        self._odometers = {
            namespace: BeltOdometer(machine.machine.spec)
            for namespace, machine in self._machines.items()
        }
        with self.scene.lock:
            self.scene.start_run(RUN_ID)
            self.scene.set_soils(soil_colors(world.soil))
        for namespace, machine in self._machines.items():
            self._writer.set_model(namespace, parse_urdf(description_text(machine.machine.spec)))
        self.update()

    @property
    def machines(self) -> tuple[str, ...]:
        """Namespaces of the machines, in the order of the world."""
        return tuple(self._machines)

    @property
    def time(self) -> float:
        """Simulation time [s]."""
        return self._world.tick * self._tick_period

    def count_travel(self) -> None:
        """Add the travel of the tracks since the last call; call it at least once in a tick."""
        for namespace, machine in self._machines.items():
            self._odometers[namespace].update(machine.machine.tracks.travel.tolist())

    def update(self) -> None:
        """Show the present state of the world."""
        soil = self._world.soil
        if soil.revision != self._shown_revision:
            self._shown_revision = soil.revision
            show_soil(self.scene, soil)
        for number, sim in self._world.machines.items():
            self._writer.set_particles(f"/{number}", _particle_rows(sim))
        for namespace, machine in self._machines.items():
            self._update_machine(namespace, machine)
        with self.scene.lock:
            self.scene.set_tick(self._world.ledger)
            self.scene.time = self.time

    def _update_machine(self, namespace: str, simulated: SimulatedMachine) -> None:
        machine = simulated.machine
        stamp = _stamp(self.time)
        base = BaseState(*machine.base_pose, *machine.base_velocity)
        values = _joint_values(simulated, self._odometers[namespace])
        joints = to_joint_state(values, base, stamp)
        self._writer.on_joints(namespace, joints)
        self._writer.on_odometry(
            namespace, to_odometry(base, "base_link", stamp, frame_id=MAP_FRAME)
        )
        payload = simulated.payload
        with self.scene.lock:
            view = self.scene.machine(namespace)
            view.payload = {
                "fill": payload.fill,
                "mass": payload.mass_kg,
                "bank_m3": payload.bank_m3,
            }
            view.set_cylinders(
                {
                    joint: {
                        "length": state.length,
                        "speed": state.speed,
                        "force": state.force,
                        "cap": state.cap_side_pressure,
                        "rod": state.rod_side_pressure,
                    }
                    for joint, state in simulated.cylinders.items()
                }
            )
            self.scene.machines_changed()


def _machines(world: World) -> list[SimulatedMachine]:
    return [machine for sim in world.machines.values() for machine in sim.simulated_machines]


def _joint_values(simulated: SimulatedMachine, odometer: BeltOdometer) -> JointValues:
    """Return the values of the machine's joints, then of pistons, then of the sprockets."""
    machine = simulated.machine
    spec = machine.spec
    angles, rates = machine.joint_positions, machine.joint_velocities
    pistons = cylinder_joint_states(spec, angles.tolist(), rates.tolist())
    sprockets = [wheel.joint for wheel in track_wheels(spec) if wheel.is_sprocket]
    speeds = (machine.tracks.speed / spec.tracks.sprocket_radius).tolist()
    names = [*spec.joint_names, *pistons.names, *sprockets]
    return JointValues(
        names,
        [*angles, *pistons.positions, *odometer.angles],
        [*rates, *pistons.velocities, *speeds],
        [0.0] * len(names),
    )


def _particle_rows(sim: MachineSim) -> Rows:
    particles = sim.particles
    rows = np.zeros(particles.count, dtype=PARTICLE)
    for axis, name in enumerate("xyz"):
        rows[name] = particles.positions[:, axis]
        rows[f"v{name}"] = particles.velocities[:, axis]
    rows["diameter"] = 2.0 * particles.radii
    rows["id"] = particles.ids
    rows["volume_mm3"] = particles.volumes_mm3
    rows["soil"] = particles.soil
    return rows


def _stamp(time: float) -> Time:
    seconds = int(time)
    return Time(sec=seconds, nanosec=int(1e9 * (time - seconds)))
