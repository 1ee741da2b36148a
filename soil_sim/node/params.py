"""Parameters of the soil's node: the tick, and whom it waits for."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["SoilNodeParams"]


@dataclass(frozen=True)
class SoilNodeParams(Parameters):
    """How the soil's node keeps time and what it publishes when."""

    tick_period: float = parameter(
        0.01, "length of a soil tick; machines take it from here", unit="s", low=0.001, high=0.2
    )
    sync: str = parameter(
        "realtime",
        "realtime: ticks follow the wall clock; lockstep: as fast as soil and machines can, each"
        " waiting for the other, so that a run is repeatable",
        choices=("realtime", "lockstep"),
    )
    expected_machines: tuple[int, ...] = parameter(
        (1,), "source numbers of the machines without which the first tick does not begin",
        low=1, high=65535,
    )  # fmt: skip
    machine_timeout: float = parameter(
        2.0,
        "silence (wall clock) after which a machine is reported, and in real time counted absent",
        unit="s", low=0.1, high=3600.0,
    )  # fmt: skip
    required_subscribers: tuple[str, ...] = parameter(
        (),
        "names of nodes that must be subscribed to every topic before the first tick, such as"
        " recorder",
        items=str,
    )  # fmt: skip
    paused: bool = parameter(False, "begin paused")
    map_period: float = parameter(
        0.5,
        "simulated time between terrain maps, where anything changed; longer in proportion above"
        " 513 x 513 cells",
        unit="s", low=0.05, high=3600.0,
    )  # fmt: skip
    hash_period: float = parameter(
        1.0, "simulated time between state hashes", unit="s", low=0.001, high=3600.0
    )
    save_path: str = parameter(
        "out/terrain.npz", "file that /soil/save writes: .npy, .npz, .png, .asc or .tif"
    )
