"""A run of the operator in one process, recorded as its nodes would be."""

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

from earthmoving_sim.dig_run import REACTION, DigRun
from earthmoving_sim.run_config import load_run_config
from machine_sim.machine.appearance import link_boxes, link_frames, link_poses, shoe_look
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec.chunks import to_chunk_cloud
from msg_bridge.codec.headers import to_multi_array
from msg_bridge.codec.machine_state import BaseState, JointValues, to_joint_state
from msg_bridge.codec.markers import MarkerSet
from msg_bridge.codec.particles import to_particle_cloud
from msg_bridge.codec.poses import to_odometry
from msg_bridge.codec.sim_config import RunFacts, config_text
from msg_bridge.codec.stamps import stamp_of_tick
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import RowChunk, SoilHeader, Stream
from soil_sim.side import SoilSide
from soil_sim.terrain import HeightMap, rough
from support.bag_recording import Recording
from support.bag_scenes import terrain_cloud

TICK = 0.01
CYCLES, PHASE = "/excavator/operator/cycles", "/excavator/operator/phase"


def small_site() -> HeightMap:
    """Ground of 24 m, almost level."""
    grid = Grid(121, 121, 0.2)
    return rough(grid, rms=0.05, correlation_length=4.0, rng=np.random.default_rng(1))


class RecordedDig:
    """A DigRun in one process, whose messages are written as its nodes would."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, site: HeightMap, **asked: Any) -> None:
        self.recording = Recording()
        self._said = ""
        self.seen = 0  # most particles told of
        take = SoilSide.take_outbox

        def watched(side: SoilSide) -> list:
            messages = take(side)
            for message in messages:
                self._say_soil(message, side.tick)
            return messages

        monkeypatch.setattr(SoilSide, "take_outbox", watched)
        facts = RunFacts(1, TICK, False, 0.2, (LooseSoil(0.15),))
        self.recording.add("/sim/config", String(data=config_text(facts, {})))
        self.run = DigRun(load_run_config("demo.yaml", asked), site)
        machine = self.run.machine.machine
        looks = (link_boxes(machine.description), shoe_look(machine.description))
        self._markers = MarkerSet(link_frames(machine.description), *looks, namespace="excavator")
        machine_node = {"machine": "machines/excavator.yaml", "command_delay": REACTION}
        config = {"machine_sim": machine_node}
        self._say("config", String(data=config_text(facts, config)))
        self._say_tick(self.run.world.ledger)
        self._watch(self.run)
        self.outcome = self.run.run()
        self._diagnose()

    def _watch(self, run: DigRun) -> None:
        step, command = run.world.step, run.operator.command

        def stepped():
            ledger = step()
            self._say_tick(ledger)
            return ledger

        def commanded(view, dt):
            made = command(view, dt)
            shift = run.operator
            now = {"cycle": shift.cycle, "phase": shift.phase, "given_up": shift.given_up}
            if json.dumps(now) != self._said:
                self._said = json.dumps(now)
                self._say("operator/phase", String(data=json.dumps({"time": view.time, **now})))
            return made

        run.world.step, run.operator.command = stepped, commanded

    def _say(self, name: str, message: Any) -> None:
        self.recording.add(f"/excavator/{name}", message)

    def _say_soil(self, message: Any, tick: int) -> None:
        if isinstance(message, SoilHeader):
            self.recording.add("/soil/tick", to_multi_array(message))
        elif isinstance(message, RowChunk) and message.stream is Stream.CHANGED:
            cloud = to_chunk_cloud(message, "map", stamp_of_tick(tick, TICK))
            self.recording.add("/terrain/changes", cloud)

    def _say_tick(self, ledger: Any) -> None:
        """All that is told of the end of a tick, as often as nodes do."""
        run, tick = self.run, ledger.tick
        stamp = stamp_of_tick(tick, TICK)
        self.recording.add("/soil/ledger", to_multi_array(ledger))
        if tick % 200 == 0:
            self.recording.add("/terrain/map", terrain_cloud(run.world.soil, 1, tick))
        if tick % 100 == 0:
            text = f"{tick} {run.world.state_hash()}"
            self.recording.add("/soil/state_hash", String(data=text))
        machine, store = run.machine.machine, run.machine.particles.store
        if tick % 2 == 0:
            base = BaseState(*machine.base_pose, *machine.base_velocity)
            joints = JointValues(
                machine.description.joint_names,
                machine.joint_positions,
                machine.joint_velocities,
                machine.joint_efforts,
            )
            self._say("joint_states", to_joint_state(joints, base, stamp))
            self._say("odom", to_odometry(base, "base_link", stamp))
        if tick % 5 == 0:
            rows = (store.position, store.velocity, store.radius, store.particle_id)
            more = (store.volume_mm3, store.soil, "map", stamp)
            self._say("particles", to_particle_cloud(*rows, *more))
            self.seen = max(self.seen, run.machine.particles.count)
        if tick % 10 == 0:
            poses = link_poses(machine.description, *machine.base_pose, machine.joint_positions)
            markers = self._markers.at(poses, machine.tracks.shoe_poses, stamp)
            # The set's one message: it is changed by the next.
            copy = deserialize_message(serialize_message(markers), MarkerArray)
            self._say("markers", copy)

    def _diagnose(self) -> None:
        particles = self.run.machine.particles
        tunnelled = particles.tunnelled_tool + particles.tunnelled_ground
        values = [KeyValue(key="tunnelled", value=str(tunnelled))]
        status = DiagnosticStatus(name="excavator/machine_sim: machine_sim", values=values)
        self.recording.add("/diagnostics", DiagnosticArray(status=[status]))


def write(folder: Path, recording: Recording, *, finish: bool = True, cycles: str = CYCLES) -> Path:
    """A bag with the topic of cycles, even if there was none."""
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
