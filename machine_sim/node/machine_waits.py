"""What a machine node waits for: the run's data, subscribers, the soil, or a command."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping

from std_msgs.msg import Bool

from machine_sim.node.machine_run import AwaitedCommand, MachineRun
from machine_sim.node.run_membership import RunMembership
from msg_bridge.contract import topics
from msg_bridge.contract.topics import parent_namespace, resolve
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.nodes.wait_log import REPORT_TIME, Wait

__all__ = ["SoilContact", "find_machine_waits"]


class SoilContact:
    """State of the soil node as seen by the machine node, beside the run.

    Attributes:
        last_message_time: monotonic wall clock of the last message of the soil [s].
        paused: whether the soil has paused simulated time.
    """

    def __init__(self) -> None:
        self.last_message_time = -float("inf")
        self.paused = False

    def take_paused(self, msg: Bool) -> None:
        """Take a message that states whether time stands still."""
        self.paused = bool(msg.data)

    @property
    def is_silent(self) -> bool:
        """Whether no message has arrived for `REPORT_TIME`: a soil node that lives repeats its
        last header at least every quarter of a second.
        """
        return time.monotonic() - self.last_message_time >= REPORT_TIME


def find_machine_waits(
    namespace: str, membership: RunMembership, run: MachineRun | None, soil: SoilContact
) -> Iterator[Wait]:
    """Yield what a machine node waits for now. A pause is no wait.

    Args:
        namespace: namespace of the node.
        membership: its membership.
        run: its present run.
        soil: its soil node.
    """
    simulation = parent_namespace(namespace)
    facts = membership.facts
    if facts is None:
        yield Wait(
            resolve(topics.SIM_CONFIG, simulation),
            f"is a soil_sim running in namespace {simulation}, the parent of this node's namespace"
            f" {namespace}?",
        )
        return
    is_held = membership.is_held(run, soil_is_silent=soil.is_silent)
    if run is None or (run.facts.run_id != facts.run_id and not is_held):
        yield Wait(
            f"the terrain on {resolve(topics.TERRAIN_MAP, simulation)}",
            "restart the soil node if it has ended",
            facts.run_id,
        )
        return
    exchange = run.endpoint.exchange
    if exchange.join_state is JoinState.OUT:
        if membership.missing_subscribers:
            missing = ", ".join(membership.missing_subscribers)
            yield Wait(
                f"subscribers to {missing}", "start them, or remove them from required_subscribers"
            )
    elif exchange.join_state is JoinState.JOINING:
        if soil.is_silent or not soil.paused:
            yield Wait(
                "the answer to the request to join",
                "the soil answers once all expected machines have requested it, see what it waits"
                " for in /diagnostics",
                exchange.session_id,
            )
    elif soil.is_silent:
        yield Wait(
            f"messages of the soil on {resolve(topics.SOIL_TICK, simulation)}",
            "it is stopped or has ended: continue it, or start a new one",
            soil.last_message_time,
        )
    elif run.endpoint.is_ready:
        if not run.can_step:
            yield _command_wait(run.awaited_commands, run.tick)
    elif not soil.paused:
        yield Wait(
            "the soil's answer to a tick", "see what the soil waits for in /diagnostics", run.tick
        )


def _command_wait(awaited_commands: Mapping[str, AwaitedCommand], tick: int) -> Wait:
    """Return the wait for the commands of the next tick.

    The stamps of the last commands are advice: they change with each command of a wrong stamp,
    and the wait continues.
    """
    what = ", ".join(
        f"a command for {name} with a stamp of {awaited.stamp:.6g} s or later"
        for name, awaited in awaited_commands.items()
    )
    advice = ["command_wait_period is set, start the controller"]
    advice += [
        f"the last command for {name} had the stamp {awaited.last_stamp:.6f} s: stamp each with the"
        " time of its state"
        for name, awaited in awaited_commands.items()
        if awaited.last_stamp is not None
    ]
    return Wait(what, "; ".join(advice), tick)
