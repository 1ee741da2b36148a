"""A node of one machine or several: takes commands, steps them and their soil, tells their state.

Its namespace is the name of its only machine, or lies above those of several. When they may step is
told by `machine_sim.run`, what happens in a step by `machine_sim.core`, what is told of each by
`machine_sim.station`; callbacks here only hand over. It takes the terrain, the length of a tick and
the swell of the soil from the soil's own topics.
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from functools import partial
from typing import Any

from std_msgs.msg import String

from machine_sim.cab import Cab
from machine_sim.commands import CommandParams
from machine_sim.machine.appearance import frame_of, link_boxes, link_frames, shoe_look
from machine_sim.node_params import BinParams, MachineNodeParams, UnitParams
from machine_sim.params import MachineSimParams
from machine_sim.particles import ParticleParams, warm_up
from machine_sim.run import MachineRun, first_life
from machine_sim.sensors import SensorParams
from machine_sim.station import Station
from machine_sim.unit import Unit, make_units
from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import PayloadState
from msg_bridge.codec.markers import MarkerSet
from msg_bridge.codec.sim_config import RunFacts, config_text, run_facts
from msg_bridge.codec.stamps import stamp_of_tick
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Keyframe, Message
from msg_bridge.exchange.machine_side import Phase
from msg_bridge.nodes.command_topics import CommandTopics
from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.inbox import Inbox
from msg_bridge.nodes.lean_node import LeanNode
from msg_bridge.nodes.listeners import unheard_topics
from msg_bridge.nodes.machine_carrier import MachineCarrier
from msg_bridge.nodes.machine_topics import MachineTopics
from msg_bridge.nodes.parameters import declare_parameters, on_change
from msg_bridge.nodes.runtime import run_node
from msg_bridge.nodes.sensor_topics import SensorTopics
from msg_bridge.nodes.shared_topics import SharedTopics

__all__ = ["MachineNode", "main"]

_REMIND_PERIOD = 0.25
"""Wall time without an answer after which what is missing is asked for again [s]."""


_REFUSED_PERIOD = 5.0
"""Wall time after which one that was refused asks again [s]."""


_CHANGEABLE = ("state_rate", "particle_rate", "transform_rate", "marker_rate", "hash_rate")
"""Parameters that may be set while the node runs."""


class MachineNode(LeanNode):
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
        on_change(self, MachineNodeParams, "", _CHANGEABLE, self._take_params)
        self._stepping = declare_parameters(self, MachineSimParams, "stepping.")
        self._particles = declare_parameters(self, ParticleParams, "particles.")
        self._sensor_params = declare_parameters(self, SensorParams, "sensors.")
        self._commands = declare_parameters(self, CommandParams, "commands.")
        several = self._params.machines
        each = {name: declare_parameters(self, UnitParams, f"{name}.") for name in several}
        self.units = make_units(each or {"": self._params}, self._stepping.tracks, self._commands)
        self._bins = {
            name: declare_parameters(self, BinParams, f"{name}.") for name in self._params.bins
        }
        warm_up(self._particles)
        self.run: MachineRun | None = None
        kinds = ", ".join(unit.description.name for unit in self.units)
        self.diagnostics = Diagnostics(self, "machine_sim", kinds)
        self.diagnostics.add_task(self._diagnose)
        self._topics = SharedTopics(self, self._bins)
        self._stations = [self._station(unit) for unit in self.units]
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
        for k, unit in enumerate(self.units):
            CommandTopics(self._orders, unit.board, partial(self._cab, k), refuse, unit.folder)
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
        """Free the machines, too."""
        run = getattr(self, "run", None)  # not there if a parameter was bad
        if run is not None:
            run.close()
            self.run = None
        super().destroy_node()

    def _station(self, unit: Unit) -> Station:
        """A machine's topics."""
        machine, namespace = unit.description, self.get_namespace().strip("/")
        prefix, frames = unit.frame_prefix(namespace), link_frames(machine)
        looks = (link_boxes(machine), shoe_look(machine))
        topics = MachineTopics(
            self,
            unit.folder,
            prefix=prefix,
            command_names=unit.command_names,
            frames=frames,
            link_count=len(machine.links),
            tool_frames={name: frame_of(mount.link) for name, mount in machine.tools.items()},
            holds_soil=machine.holds_soil,
            markers=MarkerSet(frames, *looks, namespace=unit.name or namespace or machine.name),
            publish_tf=self._params.publish_tf,
        )
        imus = [imu.name for imu in machine.imus]
        sensor_topics = SensorTopics(self, unit.folder, prefix=prefix, imus=imus)
        return Station(unit, topics, sensor_topics, self._sensor_params, prefix)

    def _cab(self, k: int) -> Cab | None:
        """The levers of the machine of some number; None while there is no run."""
        return None if self.run is None else self.run.cabs[k]

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
            for unit in self.units:
                unit.board.forget()
        self.run = MachineRun(
            self.units,
            self._params,
            self._stepping,
            self._particles,
            facts,
            keyframe,
            bins=[params.bin for params in self._bins.values()],
            life=first_life(self.get_namespace(), facts.epoch, time.time()),
        )
        self._entered_life = -1
        for k, station in enumerate(self._stations):
            station.begin(self._params.seed, k)
        self._topics.config(self._config(facts))
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
        stamp = self._stamp(run, run.side.next_tick)
        # Told before the step, so that who commands knows at once.
        for station, command in zip(self._stations, run.command(time.monotonic()), strict=True):
            station.applied(command, stamp)
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
        sim, stamp = run.sim, self._stamp(run, tick)
        due = partial(run.due, tick)
        for station, rig in zip(self._stations, sim.rigs, strict=True):
            station.tell(rig, self._params, due, tick * run.facts.tick, stamp)
        if due(self._params.state_rate):
            for name, each in zip(self._bins, sim.bins, strict=True):
                load = PayloadState(**asdict(each.payload), time=tick * run.facts.tick)
                self._topics.payload(name, load)
        if due(self._params.particle_rate):
            self._topics.particles(sim.particles.store, stamp)

    def _stamp(self, run: MachineRun, tick: int) -> Any:
        return stamp_of_tick(tick, run.facts.tick)

    def _config(self, facts: RunFacts) -> str:
        several = {unit.name: asdict(unit.params) for unit in self.units if unit.name}
        sections = {
            "machine_sim": asdict(self._params),
            **({"machines": several} if several else {}),
            "bins": {name: asdict(params) for name, params in self._bins.items()},
            "stepping": asdict(self._stepping),
            "particles": asdict(self._particles),
            "sensors": asdict(self._sensor_params),
            "commands": asdict(self._commands),
        }
        return config_text(facts, sections)

    def _diagnose(self) -> None:
        run = self.run
        if run is None:
            self.diagnostics.set("phase", "waiting for the soil")
            return
        sim, particles = run.sim, run.sim.particles
        values: dict[str, Any] = {
            "phase": run.side.exchange.phase.value,
            "tick": run.tick,
            "particles": particles.count,
            "pending_mm3": sim.pending_mm3,
            "tunnelled": particles.tunnelled_tool + particles.tunnelled_ground,
            "slowest_tick_ms": f"{1e3 * self._slowest:.2f}",
        }
        self._slowest = 0.0
        for station, rig in zip(self._stations, sim.rigs, strict=True):
            values |= station.diagnosis(rig)
        for key, value in values.items():
            self.diagnostics.set(key, value)
        pairs = zip(self.units, sim.rigs, strict=True)
        fallen = [unit.name or "the machine" for unit, rig in pairs if rig.machine.overturned]
        if fallen:
            told = ", ".join(f"{name} has fallen over" for name in fallen)
            self.diagnostics.problem(f"{told}; begin anew by /sim/reset")
        elif run.side.exchange.joined:
            self.diagnostics.clear()


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    return run_node(MachineNode, args)


if __name__ == "__main__":
    sys.exit(main())
