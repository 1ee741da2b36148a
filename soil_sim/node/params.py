"""Parameters of the soil node: tick, machines, rates."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["SoilNodeParams"]


@dataclass(frozen=True)
class SoilNodeParams(Parameters):
    """Time keeping and publishing of the soil node."""

    tick_period: float = parameter(
        0.01, "length of a tick, for soil and machines", unit="s", low=0.001, high=0.2
    )
    sync: str = parameter(
        "realtime",
        "realtime: ticks follow the wall clock; lockstep: as fast as possible, soil and machines"
        " waiting for one another, repeatable",
        choices=("realtime", "lockstep"),
    )
    overload: str = parameter(
        "slow_clock",
        "in real time, when a machine's part of a tick is late; slow_clock: simulation time waits"
        " for it, and the real-time factor falls below 1; skip_ticks: simulation time continues,"
        " and the machine skips the tick and moves less",
        choices=("slow_clock", "skip_ticks"),
    )
    expected_machines: tuple[int, ...] = parameter(
        (1,), "ids of the machine nodes that must join before the first tick",
        low=1, high=65535,
    )  # fmt: skip
    admit_other_machines: bool = parameter(
        False,
        "whether machine nodes whose ids are not in expected_machines may join, before or during a"
        " run",
    )
    max_tool_speed: float = parameter(
        20.0,
        "maximum speed of a tool along each axis; faster sweeps, and sweeps that do not begin where"
        " the last one ended, are rejected",
        unit="m/s", low=0.1, high=1e4,
    )  # fmt: skip
    exchange_key_file: str = parameter(
        "",
        "file with a secret key that soil and machine nodes share; they authenticate the messages"
        " of the exchange with it and reject others; empty: no authentication",
    )
    machine_timeout: float = parameter(
        2.0,
        "wall clock time without a message after which a machine is reported, and in real time"
        " dropped",
        unit="s", low=0.1, high=3600.0,
    )  # fmt: skip
    required_subscribers: tuple[str, ...] = parameter(
        (),
        "names of nodes that must be subscribed to every topic before the first tick, such as"
        " exchange_recorder",
        items=str,
    )  # fmt: skip
    paused: bool = parameter(False, "start paused")
    map_rate: float = parameter(
        2.0,
        "maximum rate of terrain maps, tiles and views in simulated time, published if changed",
        unit="Hz", low=1.0 / 3600.0, high=20.0,
    )  # fmt: skip
    view_region: tuple[float, ...] = parameter(
        (),
        "part of the terrain that /terrain/view shows: x and y of two opposite corners; empty: all",
        unit="m", items=float, low=-1e6, high=1e6,
    )  # fmt: skip
    view_decimation: int = parameter(
        0,
        "every how many-th row and column of the terrain /terrain/view shows; 0: so many that it"
        " has at most 257 of either",
        low=0, high=10_000,
    )  # fmt: skip
    hash_rate: float = parameter(
        1.0, "rate of state hashes in simulated time", unit="Hz", low=1.0 / 3600.0, high=1000.0
    )
    save_path: str = parameter(
        "out/terrain.npz", "file that /soil/save writes: .npy, .npz, .png, .asc or .tif"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.view_region) not in (0, 4):
            raise ParameterError(
                f"view_region has {len(self.view_region)} numbers; give x and y of two opposite"
                " corners, or none"
            )
