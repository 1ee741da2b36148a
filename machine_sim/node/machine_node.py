"""A node of one machine or several: takes commands, steps them and their soil, tells their state.

Its namespace is the name of its only machine, or lies above those of several. When they may step is
told by `machine_sim.node.machine_run`, what happens in a step by `machine_sim.simulation`, what is told of each by
`machine_sim.node.machine_publishers`; callbacks here only hand over. It takes the terrain, the length of a tick and
the swell of the soil from the soil's own topics.
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from functools import partial
from typing import Any

from std_msgs.msg import String

from machine_sim.commands import CommandParams
from machine_sim.dem import ParticleParams, warm_up
from machine_sim.machine.forward_kinematics import link_frame_name, link_frame_names
from machine_sim.machine.visuals import link_visual_boxes, shoe_visual
from machine_sim.node.command_scheduler import CommandScheduler
from machine_sim.node.command_subscriptions import CommandSubscriptions
from machine_sim.node.machine_instance import MachineInstance, create_machine_instances
from machine_sim.node.machine_publishers import MachinePublishers
from machine_sim.node.machine_run import MachineRun, first_session_id
from machine_sim.node.machine_transport import MachineTransport
from machine_sim.node.params import BinParams, MachineInstanceParams, MachineNodeParams
from machine_sim.node.sensor_publishers import SensorPublishers
from machine_sim.node.shared_publishers import SharedPublishers
from machine_sim.node.state_publishers import StatePublishers
from machine_sim.node.usage import USAGE
from machine_sim.params import MachineSimParams
from machine_sim.sensors import SensorParams
from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import PayloadState
from msg_bridge.codec.markers import MarkerSet
from msg_bridge.codec.run_config import RunFacts, parse_run_facts, to_config_yaml
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.state_hash import StateHash
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Keyframe, Message
from msg_bridge.contract.topics import parent_namespace, resolve
from msg_bridge.exchange.machine_exchange import JoinState
from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.process_main import run_node
from msg_bridge.nodes.ros_parameters import declare_parameters, on_parameter_change
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.subscriber_matching import unmatched_topics
from msg_bridge.nodes.subscription_poller import SubscriptionPoller

__all__ = ["MachineNode", "main"]

_RETRANSMIT_PERIOD = 0.25
"""Wall time without an answer after which what is missing is asked for again [s]."""


_REJOIN_PERIOD = 5.0
"""Wall time after which one that was refused asks again [s]."""


_CHANGEABLE = ("state_rate", "particle_rate", "transform_rate", "marker_rate", "hash_rate")
"""Parameters that may be set while the node runs."""


class MachineNode(SimNode):
    """Machines and the soil they move.

    Attributes:
        units: the machines.
        run: they in the present run of the soil; None until there is one.
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
        on_parameter_change(self, MachineNodeParams, "", _CHANGEABLE, self._set_params)
        self._stepping = declare_parameters(self, MachineSimParams, "stepping.")
        self._particles = declare_parameters(self, ParticleParams, "particles.")
        self._sensor_params = declare_parameters(self, SensorParams, "sensors.")
        self._commands = declare_parameters(self, CommandParams, "commands.")
        several = self._params.machines
        each = {
            name: declare_parameters(self, MachineInstanceParams, f"{name}.") for name in several
        }
        self.instances = create_machine_instances(
            each or {"": self._params}, self._stepping.track_model, self._commands
        )
        self._bins = {
            name: declare_parameters(self, BinParams, f"{name}.") for name in self._params.bins
        }
        warm_up(self._particles)
        self.run: MachineRun | None = None
        kinds = ", ".join(unit.spec.name for unit in self.instances)
        simulation = parent_namespace(self.get_namespace())
        self.diagnostics = Diagnostics(self, "machine_sim", kinds, simulation_namespace=simulation)
        self.diagnostics.add_task(self._diagnose)
        self._shared_publishers = SharedPublishers(self, self._bins)
        self._machine_publishers = [self._create_publishers(unit) for unit in self.instances]
        self._facts: RunFacts | None = None
        self._keyframe: Keyframe | None = None
        self._leaving = False
        self._last_progress: tuple[Any, ...] = ()  # where it stood when looked at last
        self._stalled_since = 0.0  # wall clock since when it stands there [s]
        self._max_tick_duration = 0.0
        reject = self.diagnostics.reject
        inbox = self._poller = SubscriptionPoller(self, self._advance)
        self._transport = MachineTransport(self, inbox, self._receive, reject)
        self._config_topic = resolve(topics.SIM_CONFIG, simulation)
        inbox.subscribe(String, self._config_topic, qos.TRANSIENT_LOCAL, self._on_config)
        self._command_poller = SubscriptionPoller(self, self._advance)
        for k, unit in enumerate(self.instances):
            CommandSubscriptions(
                self._command_poller,
                unit.arbiter,
                partial(self._command_scheduler, k),
                reject,
                unit.topic_prefix,
            )
        self.create_timer(_RETRANSMIT_PERIOD, self._check_progress)

    def stop(self) -> None:
        """Leave the run, so that the others need not wait."""
        self._leaving = True
        if self.run is not None and self.run.endpoint.is_ready:
            self._do_step(self.run)

    @property
    def stopping(self) -> bool:
        """Whether it still has to say goodbye."""
        return self.run is not None and self.run.endpoint.exchange.joined

    def _set_params(self, params: MachineNodeParams) -> None:
        self._params = params

    def destroy_node(self) -> None:
        """Free the machines, too."""
        run = getattr(self, "run", None)  # not there if a parameter was bad
        if run is not None:
            run.close()
            self.run = None
        super().destroy_node()

    def _create_publishers(self, unit: MachineInstance) -> MachinePublishers:
        """A machine's topics."""
        machine, namespace = unit.spec, self.get_namespace().strip("/")
        prefix, frames = unit.frame_prefix(namespace), link_frame_names(machine)
        looks = (link_visual_boxes(machine), shoe_visual(machine))
        topics = StatePublishers(
            self,
            unit.topic_prefix,
            frame_prefix=prefix,
            command_names=unit.command_names,
            frames=frames,
            link_count=len(machine.links),
            tool_frames={
                name: link_frame_name(mount.link) for name, mount in machine.tools.items()
            },
            has_payload=machine.can_carry_soil,
            markers=MarkerSet(frames, *looks, namespace=unit.name or namespace or machine.name),
            publish_tf=self._params.publish_tf,
        )
        imus = [imu.name for imu in machine.imus]
        sensor_topics = SensorPublishers(self, unit.topic_prefix, frame_prefix=prefix, imus=imus)
        return MachinePublishers(unit, topics, sensor_topics, self._sensor_params, prefix)

    def _command_scheduler(self, k: int) -> CommandScheduler | None:
        """The levers of the machine of some number; None while there is no run."""
        return None if self.run is None else self.run.schedulers[k]

    # Entering a run.

    def _on_config(self, msg: String) -> None:
        try:
            self._facts = parse_run_facts(msg.data)
        except EarthmovingError as error:
            self.diagnostics.reject(self._config_topic, str(error))
            return
        self._transport.maps.set_cell(self._facts.cell)
        self._start_new_run()

    def _receive(self, message: Message) -> None:
        if isinstance(message, Keyframe) and (
            self._keyframe is None or message.run_id != self._keyframe.run_id
        ):
            self._keyframe = message
            self._start_new_run()
        if self.run is not None:
            self.run.endpoint.receive(message)

    def _start_new_run(self) -> None:
        """Take part in the run that the soil has begun, once both its words on it are here."""
        facts, keyframe = self._facts, self._keyframe
        if facts is None or keyframe is None or facts.run_id != keyframe.run_id or self._leaving:
            return
        if self.run is not None:
            if self.run.facts.run_id == facts.run_id:
                return
            self.run.close()
            for unit in self.instances:
                unit.arbiter.reset()
        self.run = MachineRun(
            self.instances,
            self._params,
            self._stepping,
            self._particles,
            facts,
            keyframe,
            bins=[params.spec for params in self._bins.values()],
            session_id=first_session_id(self.get_namespace(), facts.run_id, time.time()),
        )
        self._published_session_id = -1
        for k, station in enumerate(self._machine_publishers):
            station.start_run(self._params.seed, k)
        self._shared_publishers.publish_config(self._config(facts))
        self._join(self.run)

    def _join(self, run: MachineRun) -> None:
        missing = unmatched_topics(self, self._params.required_subscribers)
        if missing:
            text = f"waiting for listeners of {', '.join(missing)}"
            self.get_logger().info(text, throttle_duration_sec=2.0)
            return
        run.endpoint.join()
        self._send(run)

    # The tick.

    def _advance(self) -> None:
        """Take the soil's answer if it is complete, and do the next tick."""
        run = self.run
        if run is None:
            return
        exchange = run.endpoint.exchange
        answered = run.endpoint.poll() is not None
        self._poller.set_polling(exchange.is_missing_rows)
        if answered and run.is_due(run.tick, self._params.hash_rate):
            self._publish_state_hash(run)
        if run.endpoint.is_ready and exchange.session_id != self._published_session_id:
            self._published_session_id = exchange.session_id
            self._publish_state(run, run.tick)
        if run.endpoint.is_ready:
            self._command_poller.take_all()  # all commands that have come by now count
            if run.can_step or self._leaving:
                self._do_step(run)
        elif exchange.join_state is JoinState.OUT and not self._leaving:
            self._handle_not_joined(run)

    def _handle_not_joined(self, run: MachineRun) -> None:
        exchange = run.endpoint.exchange
        if exchange.dropped:
            self.get_logger().warning("the soil went on without this machine; it comes back now")
            self.diagnostics.count("times_dropped")
            self._join(run)
        elif exchange.rejection_reason:
            self.diagnostics.problem(
                f"refused by the soil: {exchange.rejection_reason}", Level.ERROR
            )
            text = f"refused by the soil: {exchange.rejection_reason}"
            self.get_logger().error(text, throttle_duration_sec=5.0)

    def _do_step(self, run: MachineRun) -> None:
        began = time.perf_counter()
        stamp = self._stamp(run, run.endpoint.next_tick)
        # Told before the step, so that who commands knows at once.
        for station, command in zip(
            self._machine_publishers, run.apply_commands(time.monotonic()), strict=True
        ):
            station.publish_applied_command(command, stamp)
        run.endpoint.step(leave=self._leaving)
        self._send(run)
        self._publish_state(run, run.tick)
        self._max_tick_duration = max(self._max_tick_duration, time.perf_counter() - began)

    def _send(self, run: MachineRun) -> None:
        self._transport.send(run.endpoint.drain_outbox(), self._stamp(run, max(run.tick, 0)))

    def _check_progress(self) -> None:
        """Ask again for what has not come; judged by what goes on, since others are heard too."""
        run = self.run
        if run is None or (self._leaving and not run.endpoint.exchange.joined):
            return
        exchange, now = run.endpoint.exchange, time.monotonic()
        place = (exchange.run_id, exchange.session_id, exchange.tick, exchange.join_state)
        stuck = place == self._last_progress
        if not stuck:
            self._last_progress, self._stalled_since = place, now
        if exchange.join_state is JoinState.OUT:
            # One that was refused is refused again unless something has changed: no hurry.
            if not exchange.rejection_reason or now - self._stalled_since >= _REJOIN_PERIOD:
                self._join(run)
        elif exchange.join_state is JoinState.READY and not run.can_step:
            self._publish_state(run, run.tick)  # a controller that has just come must see the state
            self._publish_state_hash(run)
        if stuck and exchange.join_state is not JoinState.OUT:
            exchange.request_missing()
            self._send(run)

    # What is published.

    def _publish_state_hash(self, run: MachineRun) -> None:
        stamp, digest = self._stamp(run, run.tick), run.sim.state_hash()
        self._shared_publishers.publish_state_hash(
            StateHash(run.facts.run_id, run.tick, stamp, digest)
        )

    def _publish_state(self, run: MachineRun, tick: int) -> None:
        """Publish the state at the end of a tick, as far as it is due."""
        sim, stamp = run.sim, self._stamp(run, tick)
        is_due = partial(run.is_due, tick)
        for station, rig in zip(self._machine_publishers, sim.simulated_machines, strict=True):
            station.publish(rig, self._params, is_due, tick * run.facts.tick_period, stamp)
        if is_due(self._params.state_rate):
            for name, each in zip(self._bins, sim.bins, strict=True):
                load = PayloadState(**asdict(each.payload), time=tick * run.facts.tick_period)
                self._shared_publishers.publish_payload(name, load)
        if is_due(self._params.particle_rate):
            self._shared_publishers.publish_particles(sim.particles, stamp)

    def _stamp(self, run: MachineRun, tick: int) -> Any:
        return stamp_from_tick(tick, run.facts.tick_period)

    def _config(self, facts: RunFacts) -> str:
        several = {unit.name: asdict(unit.params) for unit in self.instances if unit.name}
        sections = {
            "machine_sim": asdict(self._params),
            **({"machines": several} if several else {}),
            "bins": {name: asdict(params) for name, params in self._bins.items()},
            "stepping": asdict(self._stepping),
            "particles": asdict(self._particles),
            "sensors": asdict(self._sensor_params),
            "commands": asdict(self._commands),
        }
        return to_config_yaml(facts, sections)

    def _diagnose(self) -> None:
        run = self.run
        if run is None:
            self.diagnostics.set("join_state", "waiting for the soil")
            return
        sim, particles = run.sim, run.sim.particles
        values: dict[str, Any] = {
            "join_state": run.endpoint.exchange.join_state.value,
            "tick": run.tick,
            "particles": particles.count,
            "pending_mm3": sim.pending_mm3,
            "tunnelled": particles.num_plate_tunnellings + particles.num_ground_tunnellings,
            "slowest_tick_ms": f"{1e3 * self._max_tick_duration:.2f}",
        }
        self._max_tick_duration = 0.0
        for station, rig in zip(self._machine_publishers, sim.simulated_machines, strict=True):
            values |= station.diagnostics(rig)
        for key, value in values.items():
            self.diagnostics.set(key, value)
        pairs = zip(self.instances, sim.simulated_machines, strict=True)
        fallen = [unit.name or "the machine" for unit, rig in pairs if rig.machine.overturned]
        if fallen:
            told = ", ".join(f"{name} has fallen over" for name in fallen)
            self.diagnostics.problem(f"{told}; begin anew by /sim/reset")
        elif run.endpoint.exchange.joined:
            self.diagnostics.clear()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    return run_node(MachineNode, args, name="machine_sim", usage=USAGE)


if __name__ == "__main__":
    sys.exit(main())
