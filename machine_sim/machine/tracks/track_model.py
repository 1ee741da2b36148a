"""Interface that both track models implement, and the choice between them."""

from __future__ import annotations

from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tracks.running_gear import with_dynamic_tracks
from machine_sim.machine.tracks.track_state import SHOE_X, SHOE_Z
from msg_bridge.kernels import BoxedTable, helper, kernel

__all__ = [
    "TRACK_MODELS",
    "ShoeTable",
    "SoleContact",
    "TrackModel",
    "Tracks",
    "sole_contact",
    "with_track_model",
]

Array = NDArray[np.float64]

TrackModel = Literal["kinematic", "dynamic"]
"""`kinematic`: one degree of freedom for each belt. `dynamic`: hinged rigid shoes."""

TRACK_MODELS: tuple[TrackModel, ...] = ("kinematic", "dynamic")
"""All track models."""


def with_track_model(spec: MachineSpec, model: TrackModel) -> MachineSpec:
    """Return a machine with the number of shoes and the sprocket radius of a track model."""
    return with_dynamic_tracks(spec) if model == "dynamic" else spec


class Tracks(Protocol):
    """The two tracks of a machine on the ground.

    Attributes:
        spec: the machine with tracks of this model, see `with_track_model`.
        command: commanded belt speeds left, right [m/s], shape (2,).
        travel: distance that each belt has run, modulo its length [m], shape (2,).
        speed: belt speeds relative to the machine [m/s], shape (2,).
        shoe_poses: x, z [m] and pitch about +y [rad] of each shoe in the base frame, left track
            first, shape (2, shoe_count, 3); y is plus and minus half the gauge, or close to it.
        shoe_loads: normal load on each shoe [N], shape (2, shoe_count).
        sinkage: mean depth of the soles of each side below the undisturbed ground, weighted by
            load [m], shape (2,).
        drive_forces: force of each drive on its belt in the last step [N], positive forward,
            shape (2,).
        wrench: force [N] and torque about the base's centre of mass [N m] of the ground on the
            machine in the last step, map frame, shape (6,).
        num_reseats: how often the chain of each side has come off its wheels and was put back,
            left and right; a list of two.
    """

    spec: MachineSpec
    command: Array
    travel: Array
    speed: Array
    shoe_poses: Array
    shoe_loads: Array
    sinkage: Array
    drive_forces: Array
    wrench: Array
    num_reseats: list[int]

    @property
    def slip(self) -> Array:
        """Slip of each track, averaged over half a second, shape (2,); see `track_slip`."""

    def urdf(self) -> str:
        """Return the URDF of the machine with the parts of the tracks in its multibody."""

    def attach(self, client: int, body: int, position: Array, rotation: Array) -> None:
        """Create the bodies of the tracks in the physics engine and connect them to the machine.

        Args:
            client: id of the physics client.
            body: id of the machine's multibody, which is at its pose.
            position, rotation: pose of the base frame, map frame [m], shapes (3,) and (3, 3).
        """

    def step(
        self,
        dt: float,
        motion: Array,
        swing: float,
        actuators: BoxedTable,
    ) -> list[float]:
        """Advance the actuators of the machine, then the belts by one time step.

        Args:
            dt: time step [s].
            motion: packed motion of the base, see `base_motion`.
            swing: angle of the main body's joint [rad].
            actuators: boxed `ActuatorTables`, which command `command`.

        Returns:
            Force [N] on the base and torque about its centre of mass [N m] in the next step, map
            frame.
        """


class SoleContact(NamedTuple):
    """Contact of the soles with the ground; one value for the left and one for the right track.

    The soles are the shoes below the axles. An overturned machine lies on the upper run of a track:
    with the shoes there, the soles would jump by the height of the track from tick to tick.

    Attributes:
        heights: z of the loaded soles, weighted by load [m], base frame.
        front_pressures, rear_pressures: pressure on the ground at the front and the rear axle [Pa].
    """

    heights: tuple[float, float]
    front_pressures: tuple[float, float]
    rear_pressures: tuple[float, float]


class ShoeTable(NamedTuple):
    """Shoes of both tracks at the end of the last step, for `sole_contact`.

    Attributes:
        poses, loads: `shoe_poses` and `shoe_loads` of `Tracks`.
        half_axle_distance: half the distance between the axles [m].
        axle_height: height of the axles above the sole [m].
        half_thickness, width: half the thickness and the width of a shoe [m].
    """

    poses: Array
    loads: Array
    half_axle_distance: float
    axle_height: float
    half_thickness: float
    width: float

    @classmethod
    def of(cls, tracks: Tracks) -> ShoeTable:
        """Return the table of some tracks; it shares their arrays."""
        spec = tracks.spec.tracks
        return cls(
            tracks.shoe_poses,
            tracks.shoe_loads,
            0.5 * spec.axle_distance,
            float(spec.axle_height),
            0.5 * spec.shoe_thickness,
            float(spec.shoe_width),
        )


@kernel
def sole_contact(shoes):  # type: ignore[no-untyped-def]
    """Return the `SoleContact` of a `ShoeTable`.

    The pressure is linear along a track and has the load and the moment of the shoes; at an end
    that would be lifted it is 0, and at the other end that of a triangle (Wong, Theory of Ground
    Vehicles, section 2.3).
    """
    left_height, left_front, left_rear = _contact_of_side(shoes, 0)
    right_height, right_front, right_rear = _contact_of_side(shoes, 1)
    return SoleContact(
        (left_height, right_height), (left_front, right_front), (left_rear, right_rear)
    )


@helper
def _contact_of_side(shoes, side):  # type: ignore[no-untyped-def]
    """Return height of the soles [m], pressure at the front and at the rear [Pa] of one side."""
    poses, loads = shoes.poses[side], shoes.loads[side]
    half_axle_distance, width = shoes.half_axle_distance, shoes.width
    between = height = load = moment = 0.0
    for k in range(len(poses)):
        if poses[k, SHOE_Z] > shoes.axle_height:
            continue
        x = poses[k, SHOE_X]
        if abs(x) < half_axle_distance:
            between += loads[k]
            height += (poses[k, SHOE_Z] - shoes.half_thickness) * loads[k]
        load += loads[k]
        moment += loads[k] * min(max(x, -half_axle_distance), half_axle_distance)
    height /= max(between, 1.0)
    if load <= 0.0:
        return height, 0.0, 0.0
    length, center = 2.0 * half_axle_distance, moment / load
    mean, slope = load / (length * width), 6.0 * center / length
    if abs(slope) <= 1.0:
        return height, mean * (1.0 + slope), mean * (1.0 - slope)
    # A triangle whose middle is below the load; an end alone carries at most a shoe's length of it.
    contact_length = max(3.0 * (half_axle_distance - abs(center)), 0.1 * length)
    end = 2.0 * load / (contact_length * width)
    return (height, end, 0.0) if slope > 0.0 else (height, 0.0, end)
