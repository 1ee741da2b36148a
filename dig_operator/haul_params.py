"""Parameters of the dumper's task."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["HaulTaskParams"]


@dataclass(frozen=True)
class HaulTaskParams(Parameters):
    """Where a dumper is loaded and where it tips, and how it drives; for `site_machines.yaml`."""

    loads: int = parameter(2, "number of loads to haul", low=1, high=1000)
    full_fill: float = parameter(
        0.75, "fill of the bed at which it leaves, as a fraction of the heaped capacity",
        low=0.05, high=1.0,
    )  # fmt: skip
    duration: float = parameter(
        0.0, "time after which it begins no other load; 0: no limit", unit="s", low=0.0, high=1e6
    )
    loader: str = parameter(
        "", "namespace of the machine that loads it, one of `other_machines`: spot_x and spot_y are"
        " relative to its position, along the map's axes; empty: relative to the map",
    )  # fmt: skip
    spot_x: float = parameter(0.0, "where it stands to be loaded, x", unit="m", low=-1e4, high=1e4)
    spot_y: float = parameter(5.8, "the same, y", unit="m", low=-1e4, high=1e4)
    spot_yaw: float = parameter(180.0, "its heading there", unit="deg", low=-360.0, high=360.0)
    spot_approach: float = parameter(
        9.0, "distance over which it reverses to there", unit="m", low=0.0, high=100.0
    )
    tip_x: float = parameter(
        -9.0, "where it tips its first load, map x", unit="m", low=-1e4, high=1e4
    )
    tip_y: float = parameter(-0.5, "the same, map y", unit="m", low=-1e4, high=1e4)
    tip_yaw: float = parameter(90.0, "its heading there", unit="deg", low=-360.0, high=360.0)
    tip_approach: float = parameter(
        6.3, "distance over which it reverses to there", unit="m", low=0.0, high=100.0
    )
    tip_columns: int = parameter(4, "number of places in a row", low=1, high=100)
    tip_rows: int = parameter(1, "number of rows", low=1, high=100)
    tip_spacing: float = parameter(
        4.0, "distance to the left between the places in a row",
        unit="m", low=-50.0, high=50.0,
    )  # fmt: skip
    tip_row_spacing: float = parameter(
        4.5, "distance forward between the rows", unit="m", low=0.1, high=50.0
    )
    via: tuple[float, ...] = parameter(
        (), "points x, y between both approaches that the way leads over", unit="m",
        items=float, low=-1e4, high=1e4,
    )  # fmt: skip
    drive_speed: float = parameter(1.5, "speed forward", unit="m/s", low=0.1, high=10.0)
    reverse_speed: float = parameter(1.0, "speed backward", unit="m/s", low=0.1, high=10.0)
    turn_speed: float = parameter(
        0.5, "angular speed of a turn on the spot", unit="rad/s", low=0.05, high=2.0
    )
    clearance: float = parameter(
        0.6, "distance to keep from other machines", unit="m", low=0.1, high=10.0
    )
    tip_timeout: float = parameter(
        20.0, "maximum time to raise the bed and to empty it", unit="s", low=1.0, high=300.0
    )
    obstacle_timeout: float = parameter(
        600.0, "time that it stops before the same machine, after which the task is"
        " aborted", unit="s", low=1.0, high=1e6,
    )  # fmt: skip
    timeout: float = parameter(
        3600.0, "duration of the task, or time beyond `duration`, after which it is aborted",
        unit="s", low=1.0, high=1e6,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.via) % 2:
            raise ParameterError(
                f"HaulTaskParams.via has {len(self.via)} numbers; give x and y of each point"
            )
        num_places = self.tip_rows * self.tip_columns
        if self.loads > num_places and self.duration == 0.0:
            raise ParameterError(
                f"HaulTaskParams.loads is {self.loads}, and the tip area has {num_places} places,"
                f" {self.tip_rows} rows of {self.tip_columns}; increase tip_rows or tip_columns,"
                " haul fewer loads, or set a duration"
            )
        depth = self.tip_row_spacing * (self.tip_rows - 1)
        if depth > self.tip_approach:
            raise ParameterError(
                f"HaulTaskParams.tip_approach is {self.tip_approach} m, and the last of"
                f" {self.tip_rows} rows is {depth} m before the first; make the approach longer"
            )
