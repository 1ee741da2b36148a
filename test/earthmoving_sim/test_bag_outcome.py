"""What a bag tells of a run is what the run tells of itself."""

import json
from collections.abc import Callable
from dataclasses import asdict, astuple
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from support.bag_recording import Recording
from support.bag_scenes import terrain_cloud

from earthmoving_sim.bag_outcome import outcome_of_bag
from earthmoving_sim.bag_words import BagOutcomeError
from earthmoving_sim.dig_run import DigRun
from earthmoving_sim.outcome import Outcome
from earthmoving_sim.report import print_summary, write_pictures
from earthmoving_sim.run_config import load_run_config
from machine_sim.machine.appearance import LINK_FRAMES, link_boxes, link_poses, shoe_look
from machine_sim.node import MachineNode
from machine_sim.operator import CycleReport
from machine_sim.operator.node import OperatorNode
from msg_bridge.bag.reader import BagReadError
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec.chunks import to_chunk_cloud
from msg_bridge.codec.headers import to_multi_array
from msg_bridge.codec.machine_state import BaseState, to_joint_state
from msg_bridge.codec.markers import MarkerSet
from msg_bridge.codec.particles import to_particle_cloud
from msg_bridge.codec.poses import to_odometry
from msg_bridge.codec.sim_config import RunFacts, config_text
from msg_bridge.codec.stamps import stamp_of_tick
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import RowChunk, SoilHeader, Stream
from msg_bridge.recorder.node import Recorder
from soil_sim.node import SoilNode
from soil_sim.side import SoilSide
from soil_sim.terrain import rough, save_terrain

TICK = 0.01
CYCLES, PHASE = "/excavator/operator/cycles", "/excavator/operator/phase"
REPORTS = [CycleReport(1, 2, 1.15, 0.98, 0.9, 0.01, 18.5, 0.8), CycleReport(2, *[1.0] * 7)]


class RecordedDig:
    """A DigRun in one process, whose messages are written as its nodes would."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **asked: Any) -> None:
        self.recording = Recording()
        self._said = ""
        self.fewest = 0  # particles seen
        take = SoilSide.take_outbox

        def watched(side: SoilSide) -> list:
            messages = take(side)
            for message in messages:
                self._say_soil(message, side.tick)
            return messages

        monkeypatch.setattr(SoilSide, "take_outbox", watched)
        self.recording.add("/sim/config", String(data=self._config()))
        self.run = DigRun(load_run_config("demo.yaml", asked))
        machine = self.run.machine.machine
        looks = (link_boxes(machine.description), shoe_look(machine.description))
        self._markers = MarkerSet(LINK_FRAMES, *looks, namespace="excavator")
        config = {"machine_sim": {"machine": "machines/excavator.yaml"}}
        text = config_text(RunFacts(1, TICK, False, 0.2, 0.15), config)
        self._say("config", String(data=text))
        self._say_tick(self.run.world.ledger)
        self._watch(self.run)
        self.outcome = self.run.run()
        self._diagnose()

    def _config(self) -> str:
        return config_text(RunFacts(1, TICK, False, 0.2, 0.15), {})

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
        if tick % 50 == 0:
            self.recording.add("/terrain/map", terrain_cloud(run.world.soil, 1, tick))
        if tick % 100 == 0:
            text = f"{tick} {run.world.state_hash()}"
            self.recording.add("/soil/state_hash", String(data=text))
        machine, store = run.machine.machine, run.machine.particles.store
        if tick % 2 == 0:
            base = BaseState(*machine.base_pose, *machine.base_velocity)
            joints = (machine.joint_positions, machine.joint_velocities, machine.joint_efforts)
            self._say("joint_states", to_joint_state(*joints, base, stamp))
            self._say("odom", to_odometry(base, "base_link", stamp))
        if tick % 5 == 0:
            rows = (store.position, store.velocity, store.radius, store.particle_id)
            more = (store.volume_mm3, store.soil, "map", stamp)
            self._say("particles", to_particle_cloud(*rows, *more))
            self.fewest = max(self.fewest, run.machine.particles.count)
        if tick % 10 == 0:
            poses = link_poses(
                machine.description, *machine.base_pose, machine.joint_positions
            )
            markers = self._markers.at(poses, machine.tracks.shoe_poses, stamp)
            self.recording.messages.append(
                ("/excavator/markers", 1000 * len(self.recording.messages), _copy(markers))
            )

    def _diagnose(self) -> None:
        particles = self.run.machine.particles
        tunnelled = particles.tunnelled_tool + particles.tunnelled_ground
        values = [KeyValue(key="tunnelled", value=str(tunnelled))]
        status = DiagnosticStatus(name="excavator/machine_sim: machine_sim", values=values)
        self.recording.add("/diagnostics", DiagnosticArray(status=[status]))
