"""ROS node of one machine or several: receives commands, steps the simulation, publishes the state.

The node's namespace is the name of its only machine, or the parent of those of several. Callbacks
only pass messages on; the package's docstring states which module does what.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from functools import partial
from typing import Any

from builtin_interfaces.msg import Time
from std_msgs.msg import Bool, String

from machine_sim.commands import CommandParams
from machine_sim.dem import ParticleParams
from machine_sim.node.command_conflicts import CommandConflicts
from machine_sim.node.command_scheduler import CommandScheduler
from machine_sim.node.command_subscriptions import CommandSubscriptions
from machine_sim.node.emergency_stop import EmergencyStops
from machine_sim.node.machine_diagnostics import MachineDiagnostics
from machine_sim.node.machine_instance import (
    create_machine_instances,
    describe_machines,
    find_input_files,
)
from machine_sim.node.machine_journal import MachineJournal, MachineRunBegin
from machine_sim.node.machine_recovery import LastTicks, RunSetup, continue_run
from machine_sim.node.machine_run import MachineRun
from machine_sim.node.machine_transport import MachineTransport
from machine_sim.node.machine_waits import SoilContact, find_machine_waits
from machine_sim.node.node_publishers import NodePublishers
from machine_sim.node.params import BinParams, MachineInstanceParams, MachineNodeParams
from machine_sim.node.run_config import run_config
from machine_sim.node.run_membership import RunMembership
from machine_sim.node.session_log import SessionLog
from machine_sim.node.usage import USAGE
from machine_sim.params import MachineSimParams
from machine_sim.sensors import SensorParams
from machine_sim.warm_up import warm_up
from msg_bridge.codec import qos
from msg_bridge.codec.run_config import RunFacts, parse_run_facts
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError, ExchangeError
from msg_bridge.contract.messages import Keyframe, Message
from msg_bridge.contract.topics import parent_namespace, resolve
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.session_key import random_session_id
from msg_bridge.kernels import log_compilation, warn_of_compilation
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.duplicate_node import check_no_other_node
from msg_bridge.nodes.endpoint_monitor import EndpointMonitor
from msg_bridge.nodes.process_main import run_node
from msg_bridge.nodes.ros_parameters import declare_parameters, on_parameter_change
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.subscriber_matching import unmatched_topics
from msg_bridge.nodes.subscription_poller import SubscriptionPoller
from msg_bridge.nodes.wait_log import Wait, WaitLog
from msg_bridge.recovery.node_recovery import NodeRecovery
from msg_bridge.recovery.params import RecoveryParams

__all__ = ["MachineNode", "main"]

_PROGRESS_CHECK_PERIOD = 0.25
"""Wall time without progress after which missing messages are requested again [s]."""

_DISCOVERY_TIME = 0.5
"""Wall time from the start in which the process looks for another node in its namespace [s]."""

_CHANGEABLE = ("state_rate", "particle_rate", "transform_rate", "marker_rate", "hash_rate")
"""Parameters that may be changed while the node runs."""


class MachineNode(SimNode):
    """Node of one machine or several.

    Attributes:
        instances: the machines, independent of a run.
        run: the machines in the present run of the soil; None until there is one.
        diagnostics: diagnostics of the node.
    """

    def __init__(self, *, discovery_time: float = 0.0, **kwargs: Any) -> None:
        """
        Args:
            discovery_time: minimum wall time in which another machine node in this namespace is
                looked for [s], the time to load the kernels included; 0: none is looked for.
            kwargs: arguments of `rclpy.node.Node`; the namespace is `/excavator` by default.

        Raises:
            DuplicateNodeError: another node publishes the same topics.
            EarthmovingError: an invalid parameter or machine file.
        """
        super().__init__("machine_sim", **{"namespace": "/excavator", **kwargs})
        deadline = time.monotonic() + discovery_time
        self._params = declare_parameters(self, MachineNodeParams, changeable=_CHANGEABLE)
        on_parameter_change(self, MachineNodeParams, "", _CHANGEABLE, self._set_params)
        self._stepping = declare_parameters(self, MachineSimParams, "stepping.")
        self._particles = declare_parameters(self, ParticleParams, "particles.")
        self._sensor_params = declare_parameters(self, SensorParams, "sensors.")
        self._commands = declare_parameters(self, CommandParams, "commands.")
        recovery = declare_parameters(self, RecoveryParams, "recovery.")
        params_of_machines = {
            name: declare_parameters(self, MachineInstanceParams, f"{name}.")
            for name in self._params.machines
        }
        self.instances = create_machine_instances(
            params_of_machines or {"": self._params}, self._stepping.track_model, self._commands
        )
        self._input_files = find_input_files(self.instances)
        self._bins = {
            name: declare_parameters(self, BinParams, f"{name}.") for name in self._params.bins
        }
        with log_compilation(self.get_logger().info):
            warm_up([each.spec for each in self.instances], self._stepping, self._particles)
        warn_of_compilation(self.get_logger().warning)
        if discovery_time > 0.0:
            states = [each.topic_prefix + topics.JOINT_STATES for each in self.instances]
            remedy = "start each machine node in its own namespace, with its own machine_id"
            check_no_other_node(self, [topics.MACHINE_TICK, *states], deadline, remedy=remedy)
        self._recovery = NodeRecovery.of_node(recovery, self)
        self._last_ticks = LastTicks()  # before a restart
        self.run: MachineRun | None = None
        kinds = ", ".join(instance.spec.name for instance in self.instances)
        simulation = parent_namespace(self.get_namespace())
        self.diagnostics = Diagnostics(self, "machine_sim", kinds, simulation_namespace=simulation)
        self._recovery.report_to(self.diagnostics)
        self._machine_diagnostics = MachineDiagnostics(
            self.diagnostics, self.instances, bins=tuple(self._bins)
        )
        self._node_publishers = NodePublishers(
            self, self.instances, self._bins, self._params, self._sensor_params
        )
        missing_subscribers = partial(unmatched_topics, self, self._params.required_subscribers)
        self._membership = RunMembership(
            missing_subscribers, self._send, self.diagnostics, self.get_logger()
        )
        self._session_log = SessionLog(
            self.get_logger(), self.diagnostics, self._params.machine_id, self.instances
        )
        self._leaving, self._published_session_id = False, -1
        reject = self.diagnostics.reject
        self._poller = SubscriptionPoller(self, self._advance)
        key_file = self._params.exchange_key_file
        self._transport = MachineTransport(self, self._poller, self._receive, reject, key_file)
        self._transport.maps.is_needed = lambda n: self.run is None or self.run.needs_map(n)
        self._config_topic = resolve(topics.SIM_CONFIG, simulation)
        self._poller.subscribe(String, self._config_topic, qos.TRANSIENT_LOCAL, self._on_config)
        self._soil_contact = SoilContact()
        paused = resolve(topics.SIM_PAUSED, simulation)
        self._poller.subscribe(Bool, paused, qos.TRANSIENT_LOCAL, self._soil_contact.take_paused)
        self._command_poller = SubscriptionPoller(self, self._advance)
        record = self._record_commands
        conflicts = CommandConflicts(self, self.diagnostics, self.instances)
        for k, (arbiter, prefix) in enumerate((m.arbiter, m.topic_prefix) for m in self.instances):
            clock, observe = partial(self._command_scheduler, k), partial(conflicts.record, k)
            inputs = self._command_poller, arbiter, clock, reject, prefix
            CommandSubscriptions(*inputs, record=record, observe=observe)
        # After the commands, so that the executor runs its callbacks after theirs: of what arrives
        # together, a command is dropped by a stop, and is older than its release.
        self._emergency_stops = EmergencyStops(self, self.diagnostics, self.instances, record)
        self.create_timer(_PROGRESS_CHECK_PERIOD, self._check_progress)
        self._wait_log = WaitLog(self, self.diagnostics, self._find_waits)
        EndpointMonitor(self, self.diagnostics)
        self._continue_run()

    def stop(self) -> None:
        """Leave the run in one more tick, so that other nodes need not wait for a timeout."""
        self._leaving = True
        self._wait_log.close()
        if self.run is not None and self.run.endpoint.is_ready:
            self._do_step(self.run)
        self._recovery.end()

    @property
    def stopping(self) -> bool:
        """Whether the departure from the run is not complete yet."""
        return self.run is not None and self.run.endpoint.exchange.joined

    def _set_params(self, params: MachineNodeParams) -> None:
        self._params = params

    def destroy_node(self) -> None:
        """Destroy the node and release the physics of its machines."""
        run = getattr(self, "run", None)  # missing if a parameter was invalid
        if run is not None:
            run.close()
            self.run = self._machine_diagnostics.run = None
        if recovery := getattr(self, "_recovery", None):
            recovery.close()
        super().destroy_node()

    def _command_scheduler(self, k: int) -> CommandScheduler | None:
        """Return the command scheduler of machine `k`; None while there is no run."""
        return None if self.run is None else self.run.schedulers[k]

    def _record_commands(self) -> None:
        if self.run is not None:
            self.run.record_arbiters()

    # Joining a run.

    def _on_config(self, msg: String) -> None:
        try:
            facts = parse_run_facts(msg.data)
        except EarthmovingError as error:
            self.diagnostics.reject(self._config_topic, str(error))
            return
        is_contested = self.count_publishers(self._config_topic) > 1
        self._membership.announce(facts, self.run, is_contested=is_contested)
        self._try_new_run()

    def _receive(self, message: Message) -> None:
        if self.run is None or message.run_id == self.run.facts.run_id:
            self._soil_contact.last_message_time = time.monotonic()
        if isinstance(message, Keyframe) and self._membership.offer_keyframe(message):
            self._start_new_run()
        if self.run is not None:
            self.run.endpoint.receive(message)

    def _try_new_run(self) -> None:
        """Begin the run that was announced, unless the present one continues."""
        facts, is_silent = self._membership.facts, self._soil_contact.is_silent
        if facts is not None and not self._membership.is_held(self.run, soil_is_silent=is_silent):
            self._transport.maps.set_cell(facts.cell)  # decodes a map that has arrived earlier
            self._start_new_run()

    def _start_new_run(self) -> None:
        """Set up the machines for a run that has begun, and join it."""
        new_run = self._membership.new_run(self.run, soil_is_silent=self._soil_contact.is_silent)
        if new_run is None or self._leaving:
            return
        facts, keyframe = new_run
        session_id = random_session_id()
        run = self._make_run(facts, keyframe, session_id)
        config = self._config(run, session_id)
        run.journal.begin(MachineRunBegin(facts, keyframe, session_id, config))
        run.record_arbiters()
        if self.run is not None:  # closed only now: if the new run is invalid, this one ends well
            self.run.close()
            for instance in self.instances:
                instance.arbiter.reset()
        self._last_ticks = LastTicks()
        self._published_session_id = -1
        self._enter_run(run, config)
        machines = describe_machines(self._params.machine_id, self.instances)
        self.get_logger().info(f"run {facts.run_id} started; joining as {machines}")
        self._membership.join(run)

    def _make_run(self, facts: RunFacts, keyframe: Keyframe, session_id: int) -> MachineRun:
        """Return the machines on the initial terrain of a run; errors as of `MachineRun`."""
        return MachineRun(
            self.instances,
            self._params,
            self._stepping,
            self._particles,
            facts,
            keyframe,
            bins=[params.spec for params in self._bins.values()],
            session_id=session_id,
            journal=MachineJournal(self._recovery.journal),
        )

    def _enter_run(self, run: MachineRun, config: str) -> None:
        """Make a run the present one, and publish its configuration [YAML]."""
        self.run = run
        self._machine_diagnostics.start_run(run)
        self._node_publishers.start_run(config, self._params.seed)

    def _continue_run(self) -> None:
        """Continue the run of a process that did not end it, if there is one."""
        ignored = {f"machine_sim.{name}" for name in _CHANGEABLE}
        publishers = self.hold_publications, self._node_publishers, self._transport
        setup = RunSetup(self._make_run, self._config, ignored, *publishers, self._params)
        found = continue_run(self._recovery, setup)
        if found is None:
            return
        run, begin, self._last_ticks = found
        self._membership.resume(begin.facts, begin.keyframe)
        self._published_session_id = run.endpoint.exchange.session_id
        self._enter_run(run, begin.config)

    def _publish_last_ticks(self, run: MachineRun) -> None:
        """Publish the last ticks of a continued run again, once there are subscribers."""
        if not (self._recovery.is_settling or self._membership.find_missing_subscribers()):
            self._last_ticks.publish()
            self._repeat_state(run)
            self._advance()

    def _repeat_state(self, run: MachineRun) -> None:
        """Publish the state for new controllers, and those before whose answers were lost."""
        self._last_ticks.publish_unanswered_states(run)
        self._node_publishers.publish_state(run, self._params)

    def _find_waits(self) -> Iterable[Wait]:
        namespace = self.get_namespace()
        return find_machine_waits(namespace, self._membership, self.run, self._soil_contact)

    # The tick.

    def _advance(self) -> None:
        """Apply the soil's answer if it is complete, and perform the next tick."""
        run = self.run
        if run is None:
            return
        exchange = run.endpoint.exchange
        has_answer = self._apply_answer(run)
        self._poller.set_polling(exchange.is_missing_rows)
        if has_answer and run.is_due(run.tick, self._params.hash_rate):
            self._node_publishers.publish_state_hash(run)
        if run.endpoint.is_ready and exchange.session_id != self._published_session_id:
            self._session_log.log_joined(run, is_first=self._published_session_id < 0)
            self._published_session_id = exchange.session_id
            self._node_publishers.publish_state(run, self._params)
        if not self._last_ticks.is_published:  # a request to rejoin would overtake them
            return
        if run.endpoint.is_ready:
            self._command_poller.take_all()  # commands that have arrived by now apply
            self._emergency_stops.take_all()
            if run.can_step or self._leaving:
                self._do_step(run)
        elif exchange.join_state is JoinState.OUT and not self._leaving:
            self._membership.handle_not_joined(run)

    def _apply_answer(self, run: MachineRun) -> bool:
        """Apply the soil's answer and return whether there was one."""
        try:
            return run.endpoint.poll() is not None
        except ExchangeError as error:
            self.diagnostics.reject(self._transport.tick_topic, error.coded_message)
            return False

    def _do_step(self, run: MachineRun) -> None:
        """Perform one tick and publish its results."""
        start = time.perf_counter()
        stamp = self._stamp(run, run.endpoint.next_tick)
        # Published before the step, without its computing time as delay.
        commands = run.apply_commands(time.monotonic(), leave=self._leaving)
        self._node_publishers.publish_applied_commands(commands, stamp)
        run.step(leave=self._leaving)
        self._send(run)
        self._node_publishers.publish_contacts(run)
        self._node_publishers.publish_state(run, self._params)
        run.checkpoint_if_due()
        self._machine_diagnostics.record_tick(time.perf_counter() - start)

    def _send(self, run: MachineRun) -> None:
        """Send the messages that the exchange has produced."""
        self._transport.send(run.endpoint.drain_outbox(), self._stamp(run, max(run.tick, 0)))

    def _check_progress(self) -> None:
        """Recover from lost messages, drops and rejections, and repeat the state while waiting."""
        run = self.run
        self._transport.follow_maps(self._membership.needs_maps(run))
        if run is None or (self._leaving and not run.endpoint.exchange.joined):
            return
        if not self._last_ticks.is_published:
            self._publish_last_ticks(run)
        elif run.endpoint.exchange.join_state is JoinState.READY and not run.can_step:
            self._repeat_state(run)
            self._node_publishers.publish_state_hash(run)
        if self._last_ticks.is_published or run.endpoint.exchange.join_state is not JoinState.OUT:
            self._membership.recover(run, time.monotonic())
        if self._membership.facts is not None and self._membership.facts.run_id != run.facts.run_id:
            self._try_new_run()

    def _stamp(self, run: MachineRun, tick: int) -> Time:
        """Return the simulation time at the end of a tick."""
        return stamp_from_tick(tick, run.facts.tick_period)

    def _config(self, run: MachineRun, session_id: int) -> str:
        """Return all parameters of the node as YAML, with the id of its first session."""
        return run_config(
            run,
            session_id,
            node=self._params,
            machines={each.name: each.params for each in self.instances},
            bins=self._bins,
            particles=self._particles,
            sensors=self._sensor_params,
            commands=self._commands,
            input_files=self._input_files,
        )


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    make_node = partial(MachineNode, discovery_time=_DISCOVERY_TIME)
    return run_node(make_node, args, name="machine_sim", usage=USAGE)


if __name__ == "__main__":
    sys.exit(main())
