"""Habits of the scripted operator, and its task."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["BehaviourParams", "DigTaskParams"]


@dataclass(frozen=True)
class BehaviourParams(Parameters):
    """How the operator works; defaults suit a 20 t excavator in loose ground."""

    min_radius: float = parameter(4.4, "smallest radius of the lip", unit="m", low=1.0, high=30.0)
    max_radius: float = parameter(7.3, "largest radius of the lip", unit="m", low=1.0, high=30.0)
    max_dig_depth: float = parameter(
        3.0, "depth below the machine to which it digs", unit="m", low=0.1, high=20.0
    )
    max_cut_depth: float = parameter(
        0.45, "soil over the lip in one pass", unit="m", low=0.05, high=2.0
    )
    dig_sector_half_width: float = parameter(
        0.22, "half width of the sector it digs in", unit="rad", low=0.0, high=1.5
    )
    dig_speed: float = parameter(
        0.6, "speed of the lip in the soil", unit="m/s", low=0.05, high=3.0
    )
    entry_angle: float = parameter(
        0.45, "angle of the lip below its way at entry", unit="rad", low=-0.5, high=1.2
    )
    exit_angle: float = parameter(
        -0.75, "angle of the lip below its way at exit", unit="rad", low=-1.2, high=0.8
    )
    relief_angle: float = parameter(
        0.1, "least angle between the bucket's floor and its way", unit="rad", low=-1.0, high=0.5
    )
    curl_lift: float = parameter(
        0.3, "rise of the bucket while it curls", unit="m", low=0.0, high=3.0
    )
    clearance: float = parameter(
        0.5, "distance kept from the ground when moving", unit="m", low=0.05, high=5.0
    )
    dump_radius: float = parameter(
        6.0, "radius of the bucket pin over the dump", unit="m", low=2.0, high=20.0
    )
    target_fill: float = parameter(
        1.15, "soil it plans to sweep, in parts of the room in the bucket", low=0.1, high=2.0
    )
    min_fill: float = parameter(
        0.8, "fill it wants over the dump; with less after a pass it digs again", low=0.1, high=1.5
    )
    overfill_threshold: float = parameter(
        1.25, "fill at which it stops a drag early, and plans less next time", low=0.5, high=2.0
    )
    empty_threshold: float = parameter(0.01, "fill with which it stops dumping", low=0.0, high=0.5)
    max_pitch: float = parameter(
        0.12,
        "forward lean by its load from which it lets some of that fall",
        unit="rad",
        low=0.01,
        high=1.0,
    )
    max_passes: int = parameter(3, "drags before it carries what it has", low=1, high=10)
    dump_opening_angle: float = parameter(
        2.3, "how far it opens the bucket from level", unit="rad", low=0.5, high=3.0
    )
    base_filter_time: float = parameter(
        1.5, "time over which it averages how the base stands", unit="s", low=0.01, high=60.0
    )
    dump_timeout: float = parameter(
        3.0, "longest wait for the bucket to empty", unit="s", low=0.0, high=60.0
    )
    swing_speed: float = parameter(0.5, "of the swing joint", unit="rad/s", low=0.05, high=2.0)
    lip_travel_speed: float = parameter(
        1.0, "speed of the bucket in the air, outward and up", unit="m/s", low=0.1, high=5.0
    )
    curl_speed: float = parameter(
        0.8, "at which the bucket turns", unit="rad/s", low=0.05, high=2.0
    )
    max_swing_acceleration: float = parameter(
        0.6, "how fast it moves the swing lever", unit="rad/s^2", low=0.05, high=10.0
    )
    max_boom_acceleration: float = parameter(
        0.6, "how fast it moves the boom lever", unit="rad/s^2", low=0.05, high=10.0
    )
    max_arm_acceleration: float = parameter(
        1.2, "how fast it moves the arm lever", unit="rad/s^2", low=0.05, high=10.0
    )
    max_bucket_acceleration: float = parameter(
        2.0, "how fast it moves the bucket lever", unit="rad/s^2", low=0.05, high=10.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_radius < self.min_radius + 1.0:
            raise ParameterError(
                f"BehaviourParams.max_radius is {self.max_radius} m and min_radius {self.min_radius} m; give a max_radius that is at"
                " least 1 m more, so that there is room for a drag"
            )

    @property
    def max_joint_accelerations(self) -> tuple[float, float, float, float]:
        """Swing, boom, arm, bucket [rad/s^2]: a jerked lever rocks the machine."""
        return (
            self.max_swing_acceleration,
            self.max_boom_acceleration,
            self.max_arm_acceleration,
            self.max_bucket_acceleration,
        )


@dataclass(frozen=True)
class DigTaskParams(Parameters):
    """What the operator is asked to do."""

    cycles: int = parameter(5, "bucketfuls to move", low=1, high=1000)
    approach: float = parameter(2.0, "way driven before digging", unit="m", low=0.0, high=20.0)
    dump_angle: float = parameter(
        90.0, "from the dig to the dump, to the left", unit="deg", low=-180.0, high=180.0
    )
    timeout: float = parameter(
        900.0, "simulated time after which the task is given up", unit="s", low=1.0, high=1e6
    )
