"""Record a run of the operator in one process as its nodes would publish it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import COMMAND_DELAY_TICKS, SingleProcessDig
from machine_sim.machine.forward_kinematics import link_frame_names, link_poses
from machine_sim.machine.visuals import marker_boxes, shoe_visual
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec.machine_state import BaseState, JointValues, to_joint_state
from msg_bridge.codec.markers import MarkerSet
from msg_bridge.codec.particles import to_particle_cloud
from msg_bridge.codec.poses import to_odometry
from msg_bridge.codec.row_chunks import to_chunk_cloud
from msg_bridge.codec.run_config import RunFacts, to_config_yaml
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.state_hash import StateHash, to_state_hash_string
from msg_bridge.codec.tick_headers import to_multi_array, with_stamp
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import RowChunk, SoilHeader, Stream
from msg_bridge.exchange.soil_exchange import SoilExchange
from soil_sim.terrain import HeightMap, rough
from support.recorded_exchange import terrain_cloud
from support.recorded_messages import Recording

TICK = 0.01
CYCLES, PHASE = "/excavator/operator/cycles", "/excavator/operator/phase"


def small_site() -> HeightMap:
    """Return almost level ground of 24 m x 24 m."""
    grid = Grid(121, 121, 0.2)
    return rough(grid, rms=0.05, correlation_length=4.0, rng=np.random.default_rng(1))


class RecordedDig:
    """A SingleProcessDig whose messages are recorded as its nodes would publish them.

    Attributes:
        recording: the messages.
        run: the run.
        outcome: its outcome.
        max_published_particles: the largest number of particles in a message.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, site: HeightMap, **overrides: Any) -> None:
        self.recording = Recording()
        self._last_phase = ""
        self.max_published_particles = 0
        drain_outbox = SoilExchange.drain_outbox

        def publish_and_drain(exchange: SoilExchange) -> list:
            messages = drain_outbox(exchange)
            for message in messages:
                self._publish_soil(message, exchange.tick)
            return messages

        monkeypatch.setattr(SoilExchange, "drain_outbox", publish_and_drain)
        facts = RunFacts(1, TICK, False, 0.2, (LooseSoil(0.15),))
        self.recording.add("/sim/config", String(data=to_config_yaml(facts, {})))
        self.run = SingleProcessDig(load_run_config("demo.yaml", overrides), site)
        machine = self.run.machine.machine
        shapes = (marker_boxes(machine.spec), shoe_visual(machine.spec))
        self._markers = MarkerSet(link_frame_names(machine.spec), *shapes, namespace="excavator")
        machine_node = {"machine": "machines/excavator.yaml", "command_delay": COMMAND_DELAY_TICKS}
        config = {"machine_sim": machine_node}
        self._publish("config", String(data=to_config_yaml(facts, config)))
        self._publish_tick(self.run.world.ledger)
        self._instrument(self.run)
        self.outcome = self.run.run()
        self._publish_diagnostics()

    def _instrument(self, run: SingleProcessDig) -> None:
        step, command = run.world.step, run.task.command

        def step_and_publish():
            ledger = step()
            self._publish_tick(ledger)
            return ledger

        def command_and_publish(observation, dt):
            setpoint = command(observation, dt)
            task = run.task
            phase = {"cycle": task.cycle, "phase": task.phase, "abort_reason": task.abort_reason}
            if json.dumps(phase) != self._last_phase:
                self._last_phase = json.dumps(phase)
                text = json.dumps({"time": observation.time, **phase})
                self._publish("operator/phase", String(data=text))
            return setpoint

        run.world.step, run.task.command = step_and_publish, command_and_publish

    def _publish(self, name: str, message: Any) -> None:
        self.recording.add(f"/excavator/{name}", message)

    def _publish_soil(self, message: Any, tick: int) -> None:
        if isinstance(message, SoilHeader):
            self.recording.add("/soil/tick", to_multi_array(message))
        elif isinstance(message, RowChunk) and message.stream is Stream.MAP_UPDATE:
            cloud = to_chunk_cloud(message, "map", stamp_from_tick(tick, TICK))
            self.recording.add("/terrain/map_updates", cloud)

    def _publish_tick(self, ledger: Any) -> None:
        """Publish the state at the end of a tick, at the rates of the nodes."""
        run, tick = self.run, ledger.tick
        stamp = stamp_from_tick(tick, TICK)
        self.recording.add("/soil/ledger", to_multi_array(with_stamp(ledger, stamp)))
        if tick % 200 == 0:
            self.recording.add("/terrain/map", terrain_cloud(run.world.soil, 1, tick))
        if tick % 100 == 0:
            state_hash = StateHash(1, tick, stamp, run.world.state_hash())
            self.recording.add("/soil/state_hash", to_state_hash_string(state_hash))
        machine, particles = run.machine.machine, run.machine.particles
        if tick % 2 == 0:
            base = BaseState(*machine.base_pose, *machine.base_velocity)
            joints = JointValues(
                machine.spec.joint_names,
                machine.joint_positions,
                machine.joint_velocities,
                run.machine.simulated_machines[0].joint_efforts,
            )
            self._publish("joint_states", to_joint_state(joints, base, stamp))
            self._publish("odom", to_odometry(base, "base_link", stamp))
        if tick % 5 == 0:
            cloud = to_particle_cloud(
                *(particles.positions, particles.velocities, particles.radii, particles.ids),
                *(particles.volumes_mm3, particles.soil, "map", stamp),
            )
            self._publish("particles", cloud)
            self.max_published_particles = max(
                self.max_published_particles, run.machine.particles.count
            )
        if tick % 10 == 0:
            poses = link_poses(machine.spec, *machine.base_pose, machine.joint_positions)
            markers = self._markers.at(poses, machine.tracks.shoe_poses, stamp)
            # MarkerSet reuses its message.
            copy = deserialize_message(serialize_message(markers), MarkerArray)
            self._publish("markers", copy)

    def _publish_diagnostics(self) -> None:
        particles = self.run.machine.particles
        tunnelled = particles.num_plate_tunnellings + particles.num_ground_tunnellings
        values = [KeyValue(key="tunnelled", value=str(tunnelled))]
        status = DiagnosticStatus(name="excavator/machine_sim: machine_sim", values=values)
        self.recording.add("/diagnostics", DiagnosticArray(status=[status]))


def write(folder: Path, recording: Recording, *, finish: bool = True, cycles: str = CYCLES) -> Path:
    """Write a bag, with a topic of cycles even if none was completed."""
    writer = BagWriter(folder, chunk_size=64 * 1024, compression="none")
    writer.add_topic(cycles, "std_msgs/msg/String")
    for topic, time, message in recording.messages:
        if topic not in writer.topics:
            kind = type(message)
            writer.add_topic(topic, f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}")
        writer.write(topic, serialize_message(message), time, time)
    if finish:
        writer.close()
    return folder
