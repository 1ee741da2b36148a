"""A machine's node: takes commands, steps the machine and its particles, tells their state.

Its namespace is the machine's name. When it may step is told by `machine_sim.run`, what happens in
a step by `machine_sim.core`; callbacks here only hand over. It takes the terrain, the length of a
tick and the swell of the soil from the soil's own topics.
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from typing import Any

import numpy as np
from std_msgs.msg import String

from machine_sim.commands import CommandBoard, CommandParams
from machine_sim.machine import JOINT_NAMES, Excavator, fitted_with, load_description
from machine_sim.machine.appearance import link_boxes, link_frames, link_poses, shoe_look
from machine_sim.machine.pistons import piston_joints
from machine_sim.machine.urdf import urdf_text
from machine_sim.node_params import MachineNodeParams
from machine_sim.params import MachineSimParams
from machine_sim.particles import ParticleParams, warm_up
from machine_sim.run import MachineRun, first_life
from machine_sim.sensors import SensorParams, Sensors
from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.codec.markers import MarkerSet
from msg_bridge.codec.sim_config import RunFacts, config_text, run_facts
from msg_bridge.codec.stamps import stamp_of_tick
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Keyframe, Message
from msg_bridge.exchange.machine_side import Phase
from msg_bridge.nodes.command_topics import CommandTopics
from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.inbox import Inbox
from msg_bridge.nodes.lean_node import LeanNode
from msg_bridge.nodes.listeners import unheard_topics
from msg_bridge.nodes.machine_carrier import MachineCarrier
from msg_bridge.nodes.machine_topics import JointValues, MachineTopics, ToolWrench
from msg_bridge.nodes.parameters import declare_parameters, on_change
from msg_bridge.nodes.runtime import run_node
from msg_bridge.nodes.sensor_topics import SensorTopics

__all__ = ["MachineNode", "main"]

_REMIND_PERIOD = 0.25
"""Wall time without an answer after which what is missing is asked for again [s]."""


_REFUSED_PERIOD = 5.0
"""Wall time after which one that was refused asks again [s]."""


_CHANGEABLE = ("state_rate", "particle_rate", "transform_rate", "marker_rate", "hash_rate")
"""Parameters that may be set while the node runs."""


class MachineNode(LeanNode):
    """One machine and the soil it moves.

    Attributes:
        run: the machine in the present run of the soil; None until there is one.
        diagnostics: what `/diagnostics` says of it.
    """

    def __init__(self, **kwargs: Any) -> None:
        """
        Args:
            kwargs: for `rclpy.node.Node`; the namespace is `/excavator` if not given.

        Raises:
            EarthmovingError: a bad parameter or machine file.
        """
        super().__init__("machine_sim", **{"namespace": "/excavator", **kwargs})
        self._params = declare_parameters(self, MachineNodeParams, changeable=_CHANGEABLE)
        on_change(self, MachineNodeParams, "", _CHANGEABLE, self._take_params)
        self._stepping = declare_parameters(self, MachineSimParams, "stepping.")
        self._particles = declare_parameters(self, ParticleParams, "particles.")
        self._sensor_params = declare_parameters(self, SensorParams, "sensors.")
        commands = declare_parameters(self, CommandParams, "commands.")
        description = load_description(find_config(self._params.machine))
        self._description = fitted_with(description, self._stepping.tracks)
        self._board = CommandBoard(self._description, commands)
        name = self.get_namespace().strip("/")
        self._prefix = self._params.frame_prefix or (f"{name}/" if name else "")
        warm_up(self._particles)
        self.run: MachineRun | None = None
        self.diagnostics = Diagnostics(self, "machine_sim", self._description.name)
        self.diagnostics.add_task(self._diagnose)
        looks = (link_boxes(self._description), shoe_look(self._description))
        frames = link_frames(self._description)
        self._topics = MachineTopics(
            self,
            prefix=self._prefix,
            link_frames=frames,
            tool_frame="bucket",
            markers=MarkerSet(frames, *looks, namespace=name or self._description.name),
            publish_tf=self._params.publish_tf,
        )
        self._sensor_topics = SensorTopics(
            self, self._prefix, [imu.name for imu in self._description.imus]
        )
        self._facts: RunFacts | None = None
        self._keyframe: Keyframe | None = None
        self._leaving = False
        self._place: tuple[Any, ...] = ()  # where it stood when looked at last
        self._since = 0.0  # wall clock since when it stands there [s]
        self._slowest = 0.0
        refuse = self.diagnostics.refuse
        inbox = self._inbox = Inbox(self, self._go_on)
        self._carrier = MachineCarrier(self, inbox, self._receive, refuse)
        inbox.subscribe(String, "/sim/config", qos.LATCHED, self._on_config)
        self._orders = Inbox(self, self._go_on)
        self._commands = CommandTopics(self._orders, self._board, lambda: self.run, refuse)
        self.create_timer(_REMIND_PERIOD, self._on_silence)

    def stop(self) -> None:
        """Leave the run, so that the others need not wait."""
        self._leaving = True
        if self.run is not None and self.run.side.ready:
            self._do_step(self.run)

    @property
    def stopping(self) -> bool:
        """Whether it still has to say goodbye."""
        return self.run is not None and self.run.side.exchange.joined

    def _take_params(self, params: MachineNodeParams) -> None:
        self._params = params

    def destroy_node(self) -> None:
        """Free the machine, too."""
        run = getattr(self, "run", None)  # not there if a parameter was bad
        if run is not None:
            run.close()
            self.run = None
        super().destroy_node()

    # Entering a run.

    def _on_config(self, msg: String) -> None:
        try:
            self._facts = run_facts(msg.data)
        except EarthmovingError as error:
            self.diagnostics.refuse("/sim/config", str(error))
            return
        self._carrier.maps.set_cell(self._facts.cell)
        self._begin_if_new()

    def _receive(self, message: Message) -> None:
        if isinstance(message, Keyframe) and (
            self._keyframe is None or message.epoch != self._keyframe.epoch
        ):
            self._keyframe = message
            self._begin_if_new()
        if self.run is not None:
            self.run.side.receive(message)

    def _begin_if_new(self) -> None:
        """Take part in the run that the soil has begun, once both its words on it are here."""
        facts, keyframe = self._facts, self._keyframe
        if facts is None or keyframe is None or facts.epoch != keyframe.epoch or self._leaving:
            return
        if self.run is not None:
            if self.run.facts.epoch == facts.epoch:
                return
            self.run.close()
            self._board.forget()
        self.run = MachineRun(
            self._description,
            self._params,
            self._stepping,
            self._particles,
            self._board,
            facts,
            keyframe,
            life=first_life(self.get_namespace(), facts.epoch, time.time()),
        )
        self._sensors = Sensors(self._description, self._sensor_params, self._params.seed)
        self._entered_life = -1
        self._topics.describe(
            urdf_text(self._description, prefix=self._prefix, virtual_base=True, pistons=True),
            self._config(),
        )
        self._join(self.run)

    def _join(self, run: MachineRun) -> None:
        missing = unheard_topics(self, self._params.await_listeners)
        if missing:
            text = f"waiting for listeners of {', '.join(missing)}"
            self.get_logger().info(text, throttle_duration_sec=2.0)
            return
        run.side.join()
        self._send(run)

    # The tick.

    def _go_on(self) -> None:
        """Take the soil's answer if it is complete, and do the next tick."""
        run = self.run
        if run is None:
            return
        exchange = run.side.exchange
        answered = run.side.poll() is not None
        self._inbox.look_again(exchange.lacks_rows)
        if answered and run.due(run.tick, self._params.hash_rate):
            self._topics.state_hash(run.tick, run.sim.state_hash())
        if run.side.ready and exchange.life != self._entered_life:
            self._entered_life = exchange.life
            self._tell(run, run.tick)
        if run.side.ready:
            self._orders.empty()  # all commands that have come by now count
            if run.may_step or self._leaving:
                self._do_step(run)
        elif exchange.phase is Phase.OUT and not self._leaving:
            self._out(run)

    def _out(self, run: MachineRun) -> None:
        exchange = run.side.exchange
        if exchange.dropped:
            self.get_logger().warning("the soil went on without this machine; it comes back now")
            self.diagnostics.count("times_dropped")
            self._join(run)
        elif exchange.refusal:
            self.diagnostics.problem(f"refused by the soil: {exchange.refusal}", Level.ERROR)
            text = f"refused by the soil: {exchange.refusal}"
            self.get_logger().error(text, throttle_duration_sec=5.0)

    def _do_step(self, run: MachineRun) -> None:
        began = time.perf_counter()
        applied = run.command(time.monotonic())
        # Told before the step, so that who commands knows at once.
        velocities = np.concatenate([applied.joints, applied.tracks])
        self._topics.applied(velocities, self._stamp(run, run.side.next_tick))
        run.side.step(leave=self._leaving)
        self._send(run)
        self._tell(run, run.tick)
        self._slowest = max(self._slowest, time.perf_counter() - began)

    def _send(self, run: MachineRun) -> None:
        self._carrier.send(run.side.take_outbox(), self._stamp(run, max(run.tick, 0)))

    def _on_silence(self) -> None:
        """Ask again for what has not come; judged by what goes on, since others are heard too."""
        run = self.run
        if run is None or (self._leaving and not run.side.exchange.joined):
            return
        exchange, now = run.side.exchange, time.monotonic()
        place = (exchange.epoch, exchange.life, exchange.tick, exchange.phase)
        stuck = place == self._place
        if not stuck:
            self._place, self._since = place, now
        if exchange.phase is Phase.OUT:
            # One that was refused is refused again unless something has changed: no hurry.
            if not exchange.refusal or now - self._since >= _REFUSED_PERIOD:
                self._join(run)
        elif exchange.phase is Phase.READY and not run.may_step:
            self._tell(run, run.tick)  # a controller that has just come must see the state
            self._topics.state_hash(run.tick, run.sim.state_hash())
        if stuck and exchange.phase is not Phase.OUT:
            exchange.remind()
            self._send(run)

    # What is published.

    def _tell(self, run: MachineRun, tick: int) -> None:
        """Publish the state at the end of a tick, as far as it is due."""
        sim, machine, params = run.sim, run.sim.machine, self._params
        stamp = self._stamp(run, tick)

        def due(rate: float) -> bool:
            return run.due(tick, rate)

        if due(params.state_rate):
            base = BaseState(*machine.base_pose, *machine.base_velocity)
            load = PayloadState(**asdict(sim.payload), time=tick * run.facts.tick)
            wrench = ToolWrench(*sim.tool_wrench, machine.tool_pose[0])
            self._topics.state(self._joint_values(machine), base, load, wrench, stamp)
            self._topics.cylinders(machine.cylinders, tick * run.facts.tick)
        if due(self._sensor_params.rate):
            self._tell_sensors(machine, tick * run.facts.tick, stamp)
        if due(params.particle_rate):
            self._topics.particles(sim.particles.store, stamp)
        if due(params.transform_rate) or due(params.marker_rate):
            poses = link_poses(self._description, *machine.base_pose, machine.joint_positions)
            if due(params.transform_rate):
                self._topics.transforms(*poses, stamp)
            if due(params.marker_rate):
                self._topics.markers(poses, machine.tracks.shoe_poses, stamp)

    def _tell_sensors(self, machine: Excavator, time: float, stamp: Any) -> None:
        imus, encoders = self._sensors.read(machine, time)
        for imu in imus:
            frame = "base_link" if imu.frame == "base" else imu.frame
            self._sensor_topics.imu(
                imu.name, frame, imu.quaternion, imu.spin, imu.specific_force, stamp
            )
        self._sensor_topics.encoders(JOINT_NAMES, *encoders)

    def _joint_values(self, machine: Excavator) -> JointValues:
        """All joints: those of the arm, then those of the pistons, which only follow."""
        angles, rates = machine.joint_positions, machine.joint_velocities
        pistons = piston_joints(self._description, angles.tolist(), rates.tolist())
        return JointValues(
            [*JOINT_NAMES, *pistons.names],
            [*angles, *pistons.positions],
            [*rates, *pistons.velocities],
            [*machine.joint_efforts, *[0.0] * len(pistons.names)],
        )

    def _stamp(self, run: MachineRun, tick: int) -> Any:
        return stamp_of_tick(tick, run.facts.tick)

    def _config(self) -> str:
        assert self._facts is not None
        sections = {
            "machine_sim": asdict(self._params),
            "stepping": asdict(self._stepping),
            "particles": asdict(self._particles),
            "sensors": asdict(self._sensor_params),
            "commands": asdict(self._board.params),
        }
        return config_text(self._facts, sections)

    def _diagnose(self) -> None:
        run = self.run
        if run is None:
            self.diagnostics.set("phase", "waiting for the soil")
            return
        particles, machine = run.sim.particles, run.sim.machine
        for key, value in {
            "phase": run.side.exchange.phase.value,
            "tick": run.tick,
            "particles": particles.count,
            "pending_mm3": run.sim.pending.total_mm3,
            "tunnelled": particles.tunnelled_tool + particles.tunnelled_ground,
            "payload_fill": f"{run.sim.payload.fill:.3f}",
            "emergency_stop": self._board.stopped,
            "tilt_rad": f"{machine.tilt:.3f}",
            "overturned": machine.overturned,
            "slowest_tick_ms": f"{1e3 * self._slowest:.2f}",
        }.items():
            self.diagnostics.set(key, value)
        self._slowest = 0.0
        if machine.overturned:
            self.diagnostics.problem("the machine has fallen over; begin anew by /sim/reset")
        elif run.side.exchange.joined:
            self.diagnostics.clear()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    return run_node(MachineNode, args)


if __name__ == "__main__":
    sys.exit(main())
