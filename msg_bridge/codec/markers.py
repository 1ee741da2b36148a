"""The machine as markers in the frame `map`, for a viewer that knows no TF and no URDF.

Each box of a link is a cube. Each track is one list of cubes, since single markers are dear; but
the cubes of a list are all turned like the list, and shoes turn on their way round the sprocket.
So a shoe is a row of square bars across the track: a square bar turned by up to 45 degrees more
or less looks the same to within a fifth of its edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Vector3
from numpy.typing import ArrayLike, NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import (  # type: ignore[import-untyped, import-not-found, unused-ignore]
    Marker,
    MarkerArray,
)

from msg_bridge.codec.errors import CodecError

__all__ = ["LinkBox", "MarkerSet", "TrackAppearance"]

Array = NDArray[np.float64]
Vec3 = tuple[float, float, float]
Rgba = tuple[float, float, float, float]


class LinkBox(NamedTuple):
    """A box that is fixed to a link.

    Attributes:
        link: name of the link.
        size: edge lengths [m].
        center: its middle in the link frame [m].
        pitch: turn about the link's +y [rad].
        color: red, green, blue, opacity, 0 to 1.
    """

    link: str
    size: Vec3
    center: Vec3
    pitch: float
    color: Rgba


class TrackAppearance(NamedTuple):
    """How the shoes of a pair of tracks look.

    Attributes:
        shoe_size: along the belt, across, thick [m].
        shoe_count: of one track.
        gauge: between the tracks' middles [m].
        color: red, green, blue, opacity, 0 to 1.
    """

    shoe_size: Vec3
    shoe_count: int
    gauge: float
    color: Rgba


class MarkerSet:
    """The markers of one machine, made once and moved.

    Namespaces are `<namespace>/<link>` with ids from 0 for its boxes, and `<namespace>/tracks`
    with ids 0 left and 1 right; a viewer can hide each. They last until they are deleted.
    """

    def __init__(
        self,
        links: Sequence[str],
        boxes: Sequence[tuple[str, Vec3, Vec3, float, Rgba]],
        tracks: tuple[Vec3, int, float, Rgba] | None = None,
        *,
        namespace: str,
        frame_id: str = "map",
    ) -> None:
        """
        Args:
            links: names of the links, in the order of their poses; the tracks are on the first.
            boxes: as `LinkBox`.
            tracks: as `TrackAppearance`; a machine without has none.
            namespace: the machine's name.
            frame_id: frame of the poses.

        Raises:
            CodecError: a box of a link that is not among `links`.
        """
        order = {name: k for k, name in enumerate(links)}
        looks = [LinkBox(*box) for box in boxes]
        strange = sorted({box.link for box in looks} - set(order))
        if strange:
            raise CodecError(f"boxes are of {', '.join(strange)}; the links are {', '.join(links)}")
        self._link_count = len(order)
        self._link = np.array([order[box.link] for box in looks], dtype=np.intp)
        self._center = np.array([box.center for box in looks], dtype=np.float64).reshape(-1, 3)
        half = 0.5 * np.array([box.pitch for box in looks], dtype=np.float64)
        self._cosine, self._sine = np.cos(half), np.sin(half)
        seen = dict.fromkeys(order, 0)
        self._boxes = []
        for box in looks:
            marker = _marker(Marker.CUBE, frame_id, f"{namespace}/{box.link}", seen[box.link])
            marker.scale, marker.color = _size(box.size), _color(box.color)
            seen[box.link] += 1
            self._boxes.append(marker)
        self._tracks = _Tracks(TrackAppearance(*tracks), frame_id, namespace) if tracks else None
        shown = [*self._boxes, *(self._tracks.markers if self._tracks else ())]
        self._stamps = [marker.header for marker in shown]
        self._message = MarkerArray(markers=shown)

    def at(
        self,
        link_poses: tuple[ArrayLike, ArrayLike],
        shoe_poses: ArrayLike | None,
        stamp: Time,
    ) -> MarkerArray:
        """The markers with the machine in a pose.

        Args:
            link_poses: origins of the links [m], shape (n, 3), and unit quaternions x, y, z, w
                link to map, shape (n, 4), map frame.
            shoe_poses: x, z [m] and pitch about +y [rad] of each shoe in the first link's frame,
                shape (2, shoes, 3), left track first; None for a machine without tracks.
            stamp: end of the tick it is the pose of.

        Returns:
            The one message of this set: it is changed by the next call, so publish it first.

        Raises:
            CodecError: poses of other shapes.
        """
        origin, turn = (np.asarray(each, dtype=np.float64) for each in link_poses)
        count = self._link_count
        if origin.shape != (count, 3) or turn.shape != (count, 4):
            raise CodecError(
                f"link poses have shapes {origin.shape} and {turn.shape}; give ({count}, 3) and"
                f" ({count}, 4)"
            )
        if self._tracks:
            self._tracks.move(shoe_poses, origin[0].tolist(), turn[0].tolist())
        self._move_boxes(origin, turn)
        for header in self._stamps:
            header.stamp = stamp
        return self._message

    def _move_boxes(self, origin: Array, turn: Array) -> None:
        link = self._link
        middles = origin[link] + np.einsum("kij,kj->ki", _matrices(turn)[link], self._center)
        x, y, z, w = turn[link].T
        s, c = self._sine, self._cosine
        turns = np.stack((c * x - s * z, c * y + s * w, c * z + s * x, c * w - s * y), axis=1)
        for marker, middle, quaternion in zip(
            self._boxes, middles.tolist(), turns.tolist(), strict=True
        ):
            _set_pose(marker.pose, middle, quaternion)


class _Tracks:
    """Both tracks' shoes, each a list of square bars in the frame of the base."""

    def __init__(self, look: TrackAppearance, frame_id: str, namespace: str) -> None:
        length, across, thick = look.shoe_size
        bars = max(round(length / thick), 1)
        self._shape = (2, look.shoe_count, 3)
        self._along = length * ((np.arange(bars) + 0.5) / bars - 0.5)
        self.markers = []
        for k in range(2):
            marker = _marker(Marker.CUBE_LIST, frame_id, f"{namespace}/tracks", k)
            marker.scale = _size((length / bars, across, thick))
            marker.color = _color(look.color)
            y = (0.5 - k) * look.gauge
            marker.points = [Point(y=y) for _ in range(look.shoe_count * bars)]
            self.markers.append(marker)

    def move(
        self, shoe_poses: ArrayLike | None, origin: Sequence[float], turn: Sequence[float]
    ) -> None:
        poses = np.asarray(shoe_poses, dtype=np.float64)
        if poses.shape != self._shape:
            raise CodecError(f"shoe poses have shape {poses.shape}; give {self._shape}")
        pitch = poses[:, :, 2, None]
        along = poses[:, :, 0, None] + np.cos(pitch) * self._along
        above = poses[:, :, 1, None] - np.sin(pitch) * self._along
        for side, marker in enumerate(self.markers):
            _set_pose(marker.pose, origin, turn)
            xs, zs = along[side].ravel().tolist(), above[side].ravel().tolist()
            for point, x, z in zip(marker.points, xs, zs, strict=True):
                point.x = x
                point.z = z


def _matrices(quaternions: Array) -> Array:
    """Rotation matrices, shape (n, 3, 3), of unit quaternions x, y, z, w, shape (n, 4)."""
    x, y, z, w = quaternions.T
    elements = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(elements), 2, 0)


def _marker(kind: int, frame_id: str, namespace: str, number: int) -> Marker:
    marker = Marker(type=kind, action=Marker.ADD, ns=namespace, id=number)
    marker.header.frame_id = frame_id
    return marker


def _set_pose(pose: Pose, position: Sequence[float], quaternion: Sequence[float]) -> None:
    at, turn = pose.position, pose.orientation
    at.x, at.y, at.z = position
    turn.x, turn.y, turn.z, turn.w = quaternion


def _size(size: Vec3) -> Vector3:
    x, y, z = map(float, size)
    return Vector3(x=x, y=y, z=z)


def _color(color: Rgba) -> ColorRGBA:
    r, g, b, a = map(float, color)
    return ColorRGBA(r=r, g=g, b=b, a=a)
