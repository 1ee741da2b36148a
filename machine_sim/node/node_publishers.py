"""All publishers of a machine node: those of its machines and bins, and those that they share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from builtin_interfaces.msg import Time
from rclpy.node import Node

from machine_sim.commands import AppliedCommand
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.machine_run import MachineRun
from machine_sim.node.params import BinParams, MachineNodeParams
from machine_sim.node.publisher_factory import create_machine_publishers
from machine_sim.node.shared_publishers import SharedPublishers
from machine_sim.sensors import SensorParams
from msg_bridge.codec.machine_state import PayloadState
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.state_hash import StateHash

__all__ = ["NodePublishers"]


class NodePublishers:
    """Publishes the state of the machines of a node, each part at its rate."""

    def __init__(
        self,
        node: Node,
        instances: Sequence[MachineInstance],
        bins: Mapping[str, BinParams],
        params: MachineNodeParams,
        sensor_params: SensorParams,
    ) -> None:
        """
        Args:
            node: node of the publishers.
            instances: the machines.
            bins: parameters of each bin by name.
            params: parameters of the node.
            sensor_params: rate and errors of the sensors.
        """
        self._bins = tuple(bins)
        self._shared = SharedPublishers(
            node,
            {name: each.spec for name, each in bins.items()},
            machines=[each.name or each.spec.name for each in instances],
        )
        self._machines = [
            create_machine_publishers(node, each, params, sensor_params) for each in instances
        ]

    def reset(self, seed: int) -> None:
        """Reset what depends on earlier ticks, for a run; `seed` is that of sensor errors."""
        for k, publishers in enumerate(self._machines):
            publishers.reset(seed, k)

    def start_run(self, config: str, seed: int) -> None:
        """Begin a run with a configuration [YAML]; `seed` as in `reset`."""
        self.reset(seed)
        for publishers in self._machines:
            publishers.publish_description()
        self._shared.publish_config(config)

    def publish_applied_commands(self, commands: Sequence[AppliedCommand], stamp: Time) -> None:
        """Publish the command of each machine in the tick that ends at `stamp`."""
        for publishers, command in zip(self._machines, commands, strict=True):
            publishers.publish_applied_command(command, stamp)

    def publish_state_hash(self, run: MachineRun) -> None:
        """Publish the state hash of the last tick."""
        digest = run.sim.state_hash()
        state = StateHash(run.facts.run_id, run.tick, _stamp(run), digest)
        self._shared.publish_state_hash(state)

    def publish_contacts(self, run: MachineRun) -> None:
        """Publish the contacts that began or ended in the last tick."""
        # The simulation counts its own ticks; the run may have begun before, or have skipped some.
        offset = (run.tick - run.sim.tick) * run.facts.tick_period
        for contact in run.sim.contacts.take_changes():
            self._shared.publish_contact(contact, offset)

    def publish_state(self, run: MachineRun, params: MachineNodeParams) -> None:
        """Publish those parts of the state at the end of the last tick that are due.

        Args:
            run: the machines.
            params: the present rates.
        """
        sim, stamp = run.sim, _stamp(run)
        is_due = partial(run.is_due, run.tick)
        sim_time = run.tick * run.facts.tick_period
        for publishers, simulated in zip(self._machines, sim.simulated_machines, strict=True):
            publishers.publish(simulated, params, is_due, run.progress, sim_time, stamp)
        if is_due(params.state_rate):
            for name, each in zip(self._bins, sim.bins, strict=True):
                payload = PayloadState(**each.payload._asdict(), time_s=sim_time)
                self._shared.publish_payload(name, payload)
        if is_due(params.marker_rate):
            for name, each in zip(self._bins, sim.bins, strict=True):
                self._shared.publish_bin_markers(name, each, stamp)
        if is_due(params.particle_rate):
            self._shared.publish_particles(sim.particles, stamp)


def _stamp(run: MachineRun) -> Time:
    """Return the simulation time at the end of the last tick."""
    return stamp_from_tick(run.tick, run.facts.tick_period)
