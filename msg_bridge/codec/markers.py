"""The machine as markers in the frame `map`, for viewers without TF and URDF.

Each box of a link is a cube. Each track is one list of cubes, because single markers are expensive
to draw. All cubes of a list have the orientation of the list, while shoes rotate around sprocket
and idler. So a shoe is a row of square bars across the track: a square bar rotated by up to 45
degrees has the same outline to within a fifth of its edge.
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
from msg_bridge.contract.errors import ErrorCode

__all__ = ["LinkBox", "MarkerSet", "TrackAppearance"]

Array = NDArray[np.float64]
Vec3 = tuple[float, float, float]
Rgba = tuple[float, float, float, float]


class LinkBox(NamedTuple):
    """A box fixed to a link.

    Attributes:
        link: name of the link.
        size: edge lengths [m].
        center: position of its centre, link frame [m].
        pitch: rotation about +y of the link [rad].
        color: red, green, blue, alpha, 0 to 1.
    """

    link: str
    size: Vec3
    center: Vec3
    pitch: float
    color: Rgba


class TrackAppearance(NamedTuple):
    """Geometry and colour of the shoes of a pair of tracks.

    Attributes:
        shoe_size: length along the belt, width across, thickness [m].
        shoe_count: number of shoes of one track.
        gauge: distance between the centre lines of the tracks [m].
        color: red, green, blue, alpha, 0 to 1.
    """

    shoe_size: Vec3
    shoe_count: int
    gauge: float
    color: Rgba


class MarkerSet:
    """The markers of one machine, created once and then moved.

    Namespaces are `<namespace>/<link>` with ids from 0 for its boxes, and `<namespace>/tracks`
    with id 0 for the left and 1 for the right; a viewer can hide each. They have no lifetime.
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
            links: names of the links, in the order of their poses; the tracks belong to the first.
            boxes: boxes in the form of `LinkBox`.
            tracks: tracks in the form of `TrackAppearance`; None for a machine without tracks.
            namespace: name of the machine.
            frame_id: frame of the poses.

        Raises:
            CodecError: LABELS: a box of a link that is not in `links`.
        """
        order = {name: k for k, name in enumerate(links)}
        link_boxes = [LinkBox(*box) for box in boxes]
        unknown = sorted({box.link for box in link_boxes} - set(order))
        if unknown:
            raise CodecError(
                f"boxes have the links {', '.join(unknown)}; the links are {', '.join(links)}",
                ErrorCode.LABELS,
            )
        self._link_count = len(order)
        self._link = np.array([order[box.link] for box in link_boxes], dtype=np.intp)
        self._center = np.array([box.center for box in link_boxes], dtype=np.float64).reshape(-1, 3)
        half = 0.5 * np.array([box.pitch for box in link_boxes], dtype=np.float64)
        self._cosine, self._sine = np.cos(half), np.sin(half)
        num_boxes = dict.fromkeys(order, 0)
        self._boxes = []
        for box in link_boxes:
            marker = _marker(Marker.CUBE, frame_id, f"{namespace}/{box.link}", num_boxes[box.link])
            marker.scale, marker.color = _size(box.size), _color(box.color)
            num_boxes[box.link] += 1
            self._boxes.append(marker)
        self._tracks = _Tracks(TrackAppearance(*tracks), frame_id, namespace) if tracks else None
        markers = [*self._boxes, *(self._tracks.markers if self._tracks else ())]
        self._stamps = [marker.header for marker in markers]
        self._message = MarkerArray(markers=markers)

    def at(
        self,
        link_poses: tuple[ArrayLike, ArrayLike],
        shoe_poses: ArrayLike | None,
        stamp: Time,
    ) -> MarkerArray:
        """Return the markers at a pose of the machine.

        Args:
            link_poses: positions of the links [m], shape (n, 3), and unit quaternions x, y, z, w,
                link to map, shape (n, 4), map frame.
            shoe_poses: x, z [m] and pitch about +y [rad] of each shoe, frame of the first link,
                shape (2, shoe_count, 3), left track first; None for a machine without tracks.
            stamp: end of the tick of the pose.

        Returns:
            Always the same message; the next call changes it, so publish it first.

        Raises:
            CodecError: SHAPE.
        """
        origin, quaternion = (np.asarray(each, dtype=np.float64) for each in link_poses)
        count = self._link_count
        if origin.shape != (count, 3) or quaternion.shape != (count, 4):
            raise CodecError(
                f"link poses have shapes {origin.shape} and {quaternion.shape}; give"
                f" ({count}, 3) and ({count}, 4)",
                ErrorCode.SHAPE,
            )
        if self._tracks:
            self._tracks.move(shoe_poses, origin[0].tolist(), quaternion[0].tolist())
        self._move_boxes(origin, quaternion)
        for header in self._stamps:
            header.stamp = stamp
        return self._message

    def _move_boxes(self, origin: Array, quaternion: Array) -> None:
        link = self._link
        centers = origin[link] + np.einsum("kij,kj->ki", _matrices(quaternion)[link], self._center)
        x, y, z, w = quaternion[link].T
        s, c = self._sine, self._cosine
        quaternions = np.stack((c * x - s * z, c * y + s * w, c * z + s * x, c * w - s * y), axis=1)
        for marker, center, rotation in zip(
            self._boxes, centers.tolist(), quaternions.tolist(), strict=True
        ):
            _set_pose(marker.pose, center, rotation)


class _Tracks:
    """The shoes of both tracks, as lists of square bars in the frame of the base."""

    def __init__(self, appearance: TrackAppearance, frame_id: str, namespace: str) -> None:
        length, width, thickness = appearance.shoe_size
        num_bars = max(round(length / thickness), 1)
        self._shape = (2, appearance.shoe_count, 3)
        self._along = length * ((np.arange(num_bars) + 0.5) / num_bars - 0.5)
        self.markers = []
        for k in range(2):
            marker = _marker(Marker.CUBE_LIST, frame_id, f"{namespace}/tracks", k)
            marker.scale = _size((length / num_bars, width, thickness))
            marker.color = _color(appearance.color)
            y = (0.5 - k) * appearance.gauge
            marker.points = [Point(y=y) for _ in range(appearance.shoe_count * num_bars)]
            self.markers.append(marker)

    def move(
        self, shoe_poses: ArrayLike | None, origin: Sequence[float], quaternion: Sequence[float]
    ) -> None:
        """Set the poses of the bars.

        Raises:
            CodecError: SHAPE.
        """
        poses = np.asarray(shoe_poses, dtype=np.float64)
        if poses.shape != self._shape:
            raise CodecError(
                f"shoe poses have shape {poses.shape}; give {self._shape}", ErrorCode.SHAPE
            )
        pitch = poses[:, :, 2, None]
        along = poses[:, :, 0, None] + np.cos(pitch) * self._along
        above = poses[:, :, 1, None] - np.sin(pitch) * self._along
        for side, marker in enumerate(self.markers):
            _set_pose(marker.pose, origin, quaternion)
            xs, zs = along[side].ravel().tolist(), above[side].ravel().tolist()
            for point, x, z in zip(marker.points, xs, zs, strict=True):
                point.x = x
                point.z = z


def _matrices(quaternions: Array) -> Array:
    """Return the rotation matrices, shape (n, 3, 3), of unit quaternions, shape (n, 4)."""
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
    point, orientation = pose.position, pose.orientation
    point.x, point.y, point.z = position
    orientation.x, orientation.y, orientation.z, orientation.w = quaternion


def _size(size: Vec3) -> Vector3:
    x, y, z = map(float, size)
    return Vector3(x=x, y=y, z=z)


def _color(color: Rgba) -> ColorRGBA:
    r, g, b, a = map(float, color)
    return ColorRGBA(r=r, g=g, b=b, a=a)
