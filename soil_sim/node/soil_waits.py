"""What the soil node waits for: subscribers, machines to join, or a silent machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from msg_bridge.nodes.wait_log import Wait
from soil_sim.node.soil_run import SoilRun

__all__ = ["find_soil_waits"]


def find_soil_waits(
    run: SoilRun,
    missing_subscribers: Sequence[str],
    namespaces: Mapping[int, str],
    last_message_times: Mapping[int, float],
) -> Iterator[Wait]:
    """Yield what a run waits for now. A pause is no wait.

    Args:
        run: the run.
        missing_subscribers: `topic (subscriber)` of each required subscription that is missing.
        namespaces: namespace of each known machine node, by machine id.
        last_message_times: monotonic time of the last message of each machine [s], by machine id.
    """
    exchange = run.endpoint.exchange
    if run.waiting_for_subscribers:
        yield Wait(
            f"subscribers to {', '.join(missing_subscribers)}",
            "start them, or remove them from required_subscribers",
        )
    elif run.tick < 0:
        ids = ", ".join(map(str, exchange.awaited_machines))
        yield Wait(
            f"machines with machine_id {ids} to join",
            "start them in namespaces below that of this node, or remove them from"
            " expected_machines",
        )
    elif run.realtime:
        for machine_id in exchange.late:
            name = _name(machine_id, namespaces)
            yield Wait(
                f"messages of {name}",
                "it is silent, and without any for machine_timeout the run continues without it",
                last_message_times.get(machine_id),
            )
    elif run.is_due:
        for machine_id in exchange.late:
            yield Wait(*_late_machine(machine_id, run, namespaces), run.tick)
        if not exchange.joined and not run.paused:
            yield Wait("a machine to join", "all have left the run", run.tick)


def _late_machine(machine_id: int, run: SoilRun, namespaces: Mapping[int, str]) -> tuple[str, str]:
    """Describe the part of the next tick that a machine has not delivered, and give advice."""
    name = _name(machine_id, namespaces)
    if run.endpoint.exchange.is_missing_rows_of(machine_id):
        return f"rows of {name}, which its tick header counts", "they are requested again"
    return (
        f"the tick of {name}",
        "see what it waits for in /diagnostics, restart it if it is silent, or continue without it"
        " by /soil/release",
    )


def _name(machine_id: int, namespaces: Mapping[int, str]) -> str:
    return f"{namespaces.get(machine_id, 'a machine')} (machine_id {machine_id})"
