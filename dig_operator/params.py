"""Parameters of the excavator's operator: its behaviour and its task."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["BehaviourParams", "DigTaskParams"]


@dataclass(frozen=True)
class BehaviourParams(Parameters):
    """Behaviour of the operator; the defaults suit a 20 t excavator in loose ground."""

    min_radius: float = parameter(4.4, "smallest radius of the lip", unit="m", low=1.0, high=30.0)
    max_radius: float = parameter(7.3, "largest radius of the lip", unit="m", low=1.0, high=30.0)
    max_dig_depth: float = parameter(
        3.0, "maximum depth of the lip below the base", unit="m", low=0.1, high=20.0
    )
    max_cut_depth: float = parameter(
        0.6, "maximum depth of the lip below the surface in one pass", unit="m",
        low=0.05, high=2.0,
    )  # fmt: skip
    dig_sector_half_width: float = parameter(
        0.22, "half the angle of the sector to dig in", unit="rad", low=0.0, high=1.5
    )
    dig_speed: float = parameter(
        0.9, "speed of the lip in the soil", unit="m/s", low=0.05, high=3.0
    )
    entry_angle: float = parameter(
        0.45, "angle of the lip below its path at entry", unit="rad", low=-0.5, high=1.2
    )
    exit_angle: float = parameter(
        -0.75, "angle of the lip below its path at exit", unit="rad", low=-1.2, high=0.8
    )
    relief_angle: float = parameter(
        0.1, "minimum angle between the bucket's floor and the path of the lip", unit="rad",
        low=-1.0, high=0.5,
    )  # fmt: skip
    curl_lift: float = parameter(
        0.3, "rise of the bucket while it curls", unit="m", low=0.0, high=3.0
    )
    clearance: float = parameter(
        0.5, "minimum distance from the ground when moving in the air", unit="m",
        low=0.05, high=5.0,
    )  # fmt: skip
    dump_radius: float = parameter(
        6.0, "radius of the bucket pin over the dump", unit="m", low=2.0, high=20.0
    )
    target_fill: float = parameter(
        1.6, "volume a pass is planned to sweep, as a fraction of the bucket's heaped capacity",
        low=0.1, high=2.0,
    )  # fmt: skip
    min_fill: float = parameter(
        0.6, "fill after a pass below which another pass is dug", low=0.1, high=1.5
    )
    overfill_threshold: float = parameter(
        0.93, "fill at which a drag ends early; the next cycle then plans less", low=0.5, high=2.0
    )
    empty_threshold: float = parameter(0.01, "fill at which dumping ends", low=0.0, high=0.5)
    max_pitch: float = parameter(
        0.12,
        "forward tilt of the loaded machine beyond which it spills some of the load",
        unit="rad",
        low=0.01,
        high=1.0,
    )
    max_passes: int = parameter(3, "maximum number of passes in one cycle", low=1, high=10)
    dump_opening_angle: float = parameter(
        2.3, "angle from level by which the bucket opens to dump", unit="rad", low=0.5, high=3.0
    )
    base_filter_time: float = parameter(
        1.5, "time constant of the low-pass filter of the base pose", unit="s", low=0.01, high=60.0
    )
    dump_timeout: float = parameter(
        3.0, "maximum time for the bucket to empty", unit="s", low=0.0, high=60.0
    )
    swing_speed: float = parameter(
        0.9, "speed of the swing joint", unit="rad/s", low=0.05, high=2.0
    )
    lip_travel_speed: float = parameter(
        1.4, "speed of the bucket in the air, radially and vertically", unit="m/s",
        low=0.1, high=5.0,
    )  # fmt: skip
    curl_speed: float = parameter(
        1.6, "angular speed of the bucket", unit="rad/s", low=0.05, high=2.0
    )
    max_swing_acceleration: float = parameter(
        0.7, "maximum commanded acceleration of the swing", unit="rad/s^2", low=0.05, high=10.0
    )
    max_boom_acceleration: float = parameter(
        0.6, "maximum commanded acceleration of the boom", unit="rad/s^2", low=0.05, high=10.0
    )
    max_arm_acceleration: float = parameter(
        1.2, "maximum commanded acceleration of the arm", unit="rad/s^2", low=0.05, high=10.0
    )
    max_bucket_acceleration: float = parameter(
        2.0, "maximum commanded acceleration of the bucket", unit="rad/s^2", low=0.05, high=10.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_radius < self.min_radius + 1.0:
            raise ParameterError(
                f"BehaviourParams.max_radius is {self.max_radius} m and min_radius"
                f" {self.min_radius} m; make max_radius at least 1 m larger than min_radius, so"
                " that there is room for a drag"
            )

    @property
    def max_joint_accelerations(self) -> tuple[float, float, float, float]:
        """Maximum commanded accelerations of swing, boom, arm and bucket [rad/s^2].

        Steps of the commanded velocity would rock the machine.
        """
        return (
            self.max_swing_acceleration,
            self.max_boom_acceleration,
            self.max_arm_acceleration,
            self.max_bucket_acceleration,
        )


@dataclass(frozen=True)
class DigTaskParams(Parameters):
    """Task of the excavator's operator."""

    cycles: int = parameter(5, "number of cycles, one bucketful each", low=1, high=1000)
    approach_distance: float = parameter(
        2.0, "distance driven forward before digging", unit="m", low=0.0, high=20.0
    )
    dump_angle: float = parameter(
        90.0, "angle from dig to dump, positive to the left", unit="deg", low=-180.0, high=180.0
    )
    truck: str = parameter(
        "", "namespace of a machine to load, one of `other_machines`; empty: dump on the ground"
    )
    loads: int = parameter(
        2, "number of times to fill the truck, instead of cycles", low=1, high=1000
    )
    duration: float = parameter(
        0.0, "time after which no other load is begun; 0: no limit", unit="s", low=0.0, high=1e6
    )
    stations: int = parameter(
        1, "number of places to dig from, one behind the other", low=1, high=1000
    )
    station_spacing: float = parameter(
        2.4, "distance driven backward from one to the next", unit="m", low=0.2, high=20.0
    )
    min_plan_fraction: float = parameter(
        0.75, "volume that the ground in reach has for a pass, as a fraction of what a pass should"
        " sweep, below which the next station is driven to", low=0.1, high=1.0,
    )  # fmt: skip
    full_fill: float = parameter(
        0.75, "fill of the truck's bed at which it counts as full", low=0.05, high=1.0
    )
    timeout: float = parameter(
        900.0,
        "duration of the task, without waiting for a truck, or time beyond `duration`, after"
        " which it is aborted",
        unit="s",
        low=1.0,
        high=1e6,
    )
