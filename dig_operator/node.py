"""The operator as a ROS 2 node: an example of an autonomy stack that uses public topics only.

It subscribes to joint states, odometry, payload, terrain and ledger, and publishes
`joint_commands`. Each command carries the stamp of the state it was computed from, so that a
machine with `command_wait_period` set can wait for it.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from numpy.typing import ArrayLike
from rclpy.duration import Duration
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray, Int64MultiArray, String

from dig_operator.bed import has_bed
from dig_operator.dig_task import DigTask
from dig_operator.face_cutting import FaceCuttingTask
from dig_operator.face_geometry import ROAD_HEADER_JOINTS
from dig_operator.face_params import FaceCuttingParams
from dig_operator.haul_params import HaulTaskParams
from dig_operator.haul_task import HaulTask
from dig_operator.machine_topics import joint_angles, subscribe_to_machines
from dig_operator.node_params import DigOperatorNodeParams
from dig_operator.observation_builder import MachineSample, ObservationBuilder, TerrainSnapshot
from dig_operator.other_machines import OtherMachines, check_other_machines, node_namespace
from dig_operator.params import BehaviourParams, DigTaskParams
from dig_operator.peer_monitor import PeerMonitor
from dig_operator.sample_synchronizer import SampleSynchronizer, SyncedSample
from dig_operator.usage import USAGE
from machine_sim.commands import TRACK_NAMES
from machine_sim.ground.contact_surface import surface_at
from machine_sim.machine import load_machine_spec
from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import PayloadState, from_payload_array, to_command_state
from msg_bridge.codec.poses import from_odometry
from msg_bridge.codec.run_config import RunFacts, parse_run_facts
from msg_bridge.codec.stamps import stamp_from_seconds, stamp_from_tick, tick_from_stamp
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.config_files import find_config
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError, ParameterError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.topics import parent_namespace, resolve
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.endpoint_monitor import EndpointMonitor
from msg_bridge.nodes.process_main import run_node
from msg_bridge.nodes.ros_parameters import declare_parameters
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.subscription_poller import SubscriptionPoller
from msg_bridge.nodes.terrain_subscriber import TerrainSubscriber
from msg_bridge.nodes.wait_log import Wait, WaitLog

__all__ = ["DigOperatorNode", "main"]

_REPEAT_PERIOD = 0.1
"""Wall-clock period at which the last command is repeated in lockstep [s]."""

_INITIAL_INTERVAL_TICKS = 2
"""Ticks assumed between the first sample and the one before it."""

_ACK_TIMEOUT = 2.0
"""Maximum time to wait at the end until the last messages are acknowledged [s]."""


class DigOperatorNode(SimNode):
    """Operates the machine in its namespace: an excavator digs, a road header cuts, a dumper hauls.

    Attributes:
        task: the operator's task.
        diagnostics: the node's part of `/diagnostics`.
    """

    def __init__(self, **kwargs: Any) -> None:
        """
        Args:
            kwargs: arguments of `rclpy.node.Node`; the default namespace is `/excavator`.

        Raises:
            EarthmovingError: a parameter or the machine file is not valid.
        """
        super().__init__("dig_operator", **{"namespace": "/excavator", **kwargs})
        params = declare_parameters(self, DigOperatorNodeParams)
        self._keep_running = params.keep_running
        self._behaviour = declare_parameters(self, BehaviourParams, "behaviour.")
        self._task_params = declare_parameters(self, DigTaskParams, "task.")
        self._face_params = declare_parameters(self, FaceCuttingParams, "face.")
        self._haul_params = declare_parameters(self, HaulTaskParams, "haul.")
        self._machine_spec = load_machine_spec(find_config(params.machine))
        self._joints = self._machine_spec.joint_names
        simulation = params.simulation_namespace or parent_namespace(self.get_namespace())
        check_other_machines(params.other_machines, self.get_namespace())
        self._others = OtherMachines(params.other_machines, simulation)
        if self._task_params.truck not in ("", *self._others.names):
            raise ParameterError(
                f"task.truck is {self._task_params.truck!r}; add it to other_machines"
            )
        if self._haul_params.loader not in ("", *self._others.names):
            raise ParameterError(
                f"haul.loader is {self._haul_params.loader!r}; add it to other_machines"
            )
        self.diagnostics = Diagnostics(self, "dig_operator", simulation_namespace=simulation)
        self._facts: RunFacts | None = None
        self._peers = PeerMonitor()
        surface_at(np.zeros((2, 2)), 0.0, 0.0, 1.0, 0.0, 0.0)  # compile before the first dig
        self._start_task()
        self._commands = self.create_publisher(JointState, topics.JOINT_COMMANDS, qos.STATE)
        self._phases = self.create_publisher(String, topics.OPERATOR_PHASE, qos.ROWS)
        self._cycles = self.create_publisher(String, topics.OPERATOR_CYCLES, qos.ROWS)
        self._poller = SubscriptionPoller(self, self._process_samples)
        self._terrain = TerrainSubscriber(
            self,
            self._poller,
            self.diagnostics.reject,
            self._process_samples,
            simulation_namespace=simulation,
        )
        self._simulation = simulation
        self._config_topic = resolve(topics.SIM_CONFIG, simulation)
        self._subscribe(String, self._config_topic, qos.TRANSIENT_LOCAL, self._on_config)
        # Only the last messages of a tick trigger the processing: the payload of the machine's
        # state (odometry if the machine carries no soil), and the ledger.
        self._has_payload = self._machine_spec.can_carry_soil
        self._subscribe(JointState, topics.JOINT_STATES, qos.STATE, self._on_joints, triggers=False)
        self._subscribe(
            Odometry, topics.ODOM, qos.STATE, self._on_odom, triggers=not self._has_payload
        )
        if self._has_payload:
            self._subscribe(Float64MultiArray, topics.PAYLOAD, qos.STATE, self._on_payload)
        self._ledger_topic = resolve(topics.SOIL_LEDGER, simulation)
        self._subscribe(Int64MultiArray, self._ledger_topic, qos.ROWS, self._on_ledger)
        paused_topic = resolve(topics.SIM_PAUSED, simulation)
        self._subscribe(Bool, paused_topic, qos.TRANSIENT_LOCAL, self._on_paused)
        node = node_namespace(self.get_namespace(), simulation)
        config_topic = resolve(topics.MACHINE_CONFIG, node)
        self._subscribe(String, config_topic, qos.TRANSIENT_LOCAL, self._on_machine_config)
        subscribe_to_machines(self._others, self._subscribe, self._tick_of)
        self.create_timer(_REPEAT_PERIOD, self._repeat_last_command)
        WaitLog(self, self.diagnostics, self._find_waits)
        EndpointMonitor(self, self.diagnostics)

    @property
    def finished(self) -> bool:
        """Whether the task has ended, and the node with it."""
        is_aborted = bool(self.task.abort_reason)
        return self.task.done and (is_aborted or not self._keep_running)

    @property
    def exit_code(self) -> int:
        """1 if the task was aborted, else 0."""
        return 1 if self.task.abort_reason else 0

    def stop(self) -> None:
        """Wait until the last phase and cycle report are acknowledged."""
        for publisher in (self._phases, self._cycles):
            publisher.wait_for_all_acked(Duration(seconds=_ACK_TIMEOUT))

    @property
    def _lockstep(self) -> bool:
        return self._facts is not None and not self._facts.realtime

    def _start_task(self) -> None:
        """Start the task from its beginning."""
        self.task: DigTask | FaceCuttingTask | HaulTask
        if has_bed(self._machine_spec):
            self.task = HaulTask(self._machine_spec, self._haul_params)
        elif self._joints == ROAD_HEADER_JOINTS:
            self.task = FaceCuttingTask(self._machine_spec, self._face_params)
        else:
            self.task = DigTask(self._machine_spec, self._behaviour, self._task_params)
        self._others.start_run()
        self._observation_builder = ObservationBuilder()
        self._synchronizer = SampleSynchronizer(every_tick=self._lockstep)
        self._last_command: JointState | None = None
        self._last_tick: int | None = None
        self._last_status, self._num_reported = "", 0
        self._is_abort_logged = False

    def _subscribe(
        self,
        msg_type: Any,
        topic: str,
        profile: Any,
        callback: Callable[[Any], None],
        *,
        triggers: bool = True,
    ) -> None:
        """Subscribe, and count messages that the callback rejects in the diagnostics."""

        def on_message(msg: Any) -> None:
            try:
                callback(msg)
            except EarthmovingError as error:
                self.diagnostics.reject(topic, str(error))

        self._poller.subscribe(msg_type, topic, profile, on_message, triggers=triggers)

    def _tick_of(self, stamp: Time) -> int | None:
        """Return the tick that ended at a stamp; None while the tick period is not known."""
        facts = self._facts
        return None if facts is None else tick_from_stamp(stamp, facts.tick_period)

    def _missing_machines(self) -> tuple[str, ...]:
        """Return the machines without whose state nothing is commanded now.

        In lockstep it is the state of the same tick, in real time any.
        """
        tick = self._synchronizer.next_tick
        if self._lockstep and tick is not None:
            return self._others.missing(tick)
        return self._others.unseen()

    def _find_waits(self) -> Iterator[Wait]:
        """Yield what the node waits for now."""
        joints_topic = self.resolve_topic_name(topics.JOINT_STATES)
        if self.task.done:
            return
        if self._facts is None:
            yield Wait(
                self._config_topic,
                f"is `simulation_namespace` ({self._simulation}) that of a running soil_sim?",
            )
        elif missing := self._missing_machines():
            yield Wait(
                f"the state of {', '.join(missing)}",
                "are they machines of a running machine_sim, as `other_machines` states?",
                missing,
            )
        elif self._last_tick is None:
            yield Wait(
                f"a tick with {joints_topic}",
                f"does a machine_sim run in the namespace {self.get_namespace()}?",
                self._facts.run_id,
            )
        elif self.task.wait_reason and not self._peers.paused:
            what, _, advice = self.task.wait_reason.partition("; ")
            yield Wait(what, advice)
        else:
            yield from self._peers.find_waits(self._last_tick, self._ledger_topic, joints_topic)

    def _on_paused(self, msg: Bool) -> None:
        self._peers.paused = bool(msg.data)

    def _on_machine_config(self, msg: String) -> None:
        reason = self._peers.find_session_change(msg.data)
        if reason and self._last_tick is not None:
            self._abort(reason)

    def _abort(self, reason: str) -> None:
        """Stop the machine and end the task."""
        assert self._facts is not None
        tick = self._last_tick or 0
        self._publish_command(np.zeros(len(self._joints)), np.zeros(len(TRACK_NAMES)), tick)
        self.task.abort(reason)
        self._publish_progress(tick * self._facts.tick_period)

    def _on_config(self, msg: String) -> None:
        facts = parse_run_facts(msg.data)
        before, self._facts = self._facts, facts
        if before is None or facts.run_id != before.run_id:
            again = "" if before is None else " again"
            self.get_logger().info(
                f"run {facts.run_id}: the task of the {self._machine_spec.name} starts{again}"
            )
            self._start_task()
            self._peers.start_run()
        self._terrain.follower.start_run(facts.run_id)
        self._terrain.maps.set_cell(facts.cell)

    def _on_joints(self, msg: JointState) -> None:
        self._peers.machine_time = time.monotonic()
        if (tick := self._tick_of(msg.header.stamp)) is not None:
            self._synchronizer.add_joints(tick, joint_angles(msg, self._joints))

    def _on_odom(self, msg: Odometry) -> None:
        if (tick := self._tick_of(msg.header.stamp)) is not None:
            self._synchronizer.add_base(tick, from_odometry(msg))
            if not self._has_payload:
                self._synchronizer.add_payload(tick, PayloadState(0.0, 0.0, 0.0, 0.0))

    def _on_payload(self, msg: Float64MultiArray) -> None:
        payload = from_payload_array(msg)
        if (tick := self._tick_of(stamp_from_seconds(payload.time_s))) is not None:
            self._synchronizer.add_payload(tick, payload)

    def _on_ledger(self, msg: Int64MultiArray) -> None:
        ledger = from_multi_array(msg)
        if isinstance(ledger, Ledger):
            self._peers.soil_time = time.monotonic()
            self._synchronizer.add_ledger(ledger)

    def _process_samples(self) -> None:
        """Publish a command for each new sample."""
        follower, facts = self._terrain.follower, self._facts
        if facts is None or follower.run_id != facts.run_id:
            return
        while not self.finished:
            if self._lockstep:
                # The machine makes ticks of its command delay before all topics are connected.
                self._synchronizer.skip_to(self._others.first_tick)
                next_tick = self._synchronizer.next_tick or 0
                follower.advance_to(next_tick)
            if self._missing_machines():
                return
            sample = self._synchronizer.pop_next(follower.tick)
            if sample is None:
                return
            self._send_command(sample, facts)

    def _send_command(self, sample: SyncedSample, facts: RunFacts) -> None:
        follower = self._terrain.follower
        assert follower.grid is not None, "the terrain is known when there is a sample"
        observation = self._observation_builder.build(
            sample.tick * facts.tick_period,
            MachineSample(sample.joints, sample.base, sample.payload),
            TerrainSnapshot(follower.grid, follower.elevation, follower.revision),
            sample.ledger,
            self._others.observe(sample.tick, facts.tick_period),
        )
        interval_ticks = (
            _INITIAL_INTERVAL_TICKS if self._last_tick is None else sample.tick - self._last_tick
        )
        self._last_tick = sample.tick
        interval = interval_ticks * facts.tick_period
        if jump := self._peers.find_jump(observation.base_position, interval):
            self._abort(jump)
            return
        command = self.task.command(observation, interval)
        self._publish_progress(observation.time)
        if self.finished:
            return
        self._publish_command(command.joints, command.tracks, sample.tick)

    def _publish_command(self, joints: ArrayLike, tracks: ArrayLike, tick: int) -> None:
        """Publish velocities of joints [rad/s] and tracks [m/s] that answer the state of a tick."""
        assert self._facts is not None
        self._last_command = to_command_state(
            (*self._joints, *TRACK_NAMES),
            np.concatenate([joints, tracks]),
            stamp_from_tick(tick, self._facts.tick_period),
        )
        self._commands.publish(self._last_command)

    def _repeat_last_command(self) -> None:
        """Publish the last command again in lockstep: the machine waits for it if it was lost."""
        if self._lockstep and self._last_command is not None and not self.finished:
            self._commands.publish(self._last_command)

    def _publish_progress(self, time: float) -> None:
        """Publish and log reports of new cycles, and the phase if it has changed."""
        task = self.task
        for report in task.reports[self._num_reported :]:
            self._cycles.publish(String(data=json.dumps(asdict(report))))
            self._num_reported += 1
            self.get_logger().info(
                f"cycle {report.number} finished in {report.duration:.1f} s:"
                f" {report.moved_volume:.2f} bank m3 moved"
            )
        fields = {
            "cycle": task.cycle,
            "phase": task.phase.value,
            "abort_reason": task.abort_reason,
        }
        status = json.dumps(fields)
        if status != self._last_status:
            self._last_status = status
            self._phases.publish(String(data=json.dumps({"time": time, **fields})))
            self.diagnostics.set("cycle", task.cycle)
            self.diagnostics.set("phase", task.phase.value)
            self.get_logger().info(f"cycle {task.cycle}: {task.phase}")
            if task.abort_reason and not self._is_abort_logged:
                self._is_abort_logged = True
                self.get_logger().error(f"the task is aborted: {task.abort_reason}")


def main(args: list[str] | None = None) -> int:
    """Run the node until its task has ended or it is stopped."""
    return run_node(DigOperatorNode, args, name="dig_operator", usage=USAGE)


if __name__ == "__main__":
    sys.exit(main())
