"""Links, joints and shapes of a machine, as plain values for the page."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = [
    "HydraulicsModel",
    "JointModel",
    "MachineModel",
    "Mimic",
    "Origin",
    "TrackModel",
    "Visual",
]

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Origin:
    """Pose of a shape or joint in its link.

    Attributes:
        xyz: position [m].
        rpy: roll, pitch, yaw about fixed axes [rad].
    """

    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Visual:
    """A shape of a link.

    Attributes:
        kind: box, cylinder, sphere or mesh.
        origin: its pose.
        color: red, green, blue, opacity, each 0 to 1.
        size: edges of a box [m].
        radius: of a cylinder or sphere [m].
        length: of a cylinder along z [m].
        glb: a mesh as binary glTF.
        scale: factors of a mesh along its axes.
    """

    kind: str
    origin: Origin
    color: tuple[float, float, float, float]
    size: Vector | None = None
    radius: float | None = None
    length: float | None = None
    glb: bytes | None = None
    scale: Vector | None = None


@dataclass(frozen=True)
class Mimic:
    """A joint whose value is `multiplier` times that of another, plus `offset`."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class JointModel:
    """A joint between two links.

    Attributes:
        name: its name.
        type: fixed, revolute, continuous or prismatic.
        parent, child: names of the links.
        origin: pose of the child in the parent at value 0.
        axis: direction in the frame of the joint.
        lower, upper: limits [rad or m]; None without.
        mimic: the joint that it follows; None if it has a value of its own.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Origin
    axis: Vector
    lower: float | None = None
    upper: float | None = None
    mimic: Mimic | None = None


@dataclass(frozen=True)
class TrackModel:
    """A crawler track: shoes around a sprocket and an idler.

    Attributes:
        joint: joint of the sprocket.
        link: link that carries the track.
        y: lateral position of its middle [m].
        x_front: position of the front wheel [m]; None: half the axle distance.
        axle_distance: distance of the wheels [m].
        axle_height: height of the axles in the link [m]; None: the radius above the ground.
        radius: radius of the wheels with the belt [m].
        shoe_count: number of shoes.
        shoe_size: length, width, thickness of a shoe [m].
        color: red, green, blue, opacity, each 0 to 1.
    """

    joint: str
    link: str
    y: float
    x_front: float | None
    axle_distance: float
    axle_height: float | None
    radius: float
    shoe_count: int
    shoe_size: Vector
    color: tuple[float, float, float, float]


@dataclass(frozen=True)
class HydraulicsModel:
    """Limits of the pressures in cylinders.

    Attributes:
        main_relief_pressure: maximum pressure of a moving cylinder [Pa].
        port_relief_pressure: maximum pressure of a locked cylinder [Pa].
    """

    main_relief_pressure: float
    port_relief_pressure: float


@dataclass(frozen=True)
class MachineModel:
    """A machine.

    Attributes:
        name: name of the machine.
        links: shapes by link, in the order of the file.
        joints: the joints, in the order of the file.
        tracks: crawler tracks.
        rated_power: of the engine [W]; None if it is not known.
        hydraulics: its relief pressures; None if they are not known.
        shoe: mesh of a shoe as binary glTF; None without one.
    """

    name: str
    links: dict[str, tuple[Visual, ...]]
    joints: tuple[JointModel, ...]
    tracks: tuple[TrackModel, ...] = ()
    rated_power: float | None = None
    hydraulics: HydraulicsModel | None = None
    shoe: bytes | None = None
    joint_index: dict[str, int] = field(init=False, compare=False)

    def __post_init__(self) -> None:
        """Number the joints."""
        index = {joint.name: number for number, joint in enumerate(self.joints)}
        object.__setattr__(self, "joint_index", index)

    @property
    def has_virtual_base(self) -> bool:
        """Whether joints from `map` give the pose of the machine."""
        return any(joint.parent == "map" for joint in self.joints)
