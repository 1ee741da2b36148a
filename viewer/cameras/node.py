"""The camera node: publishes images of cameras on machines.

It keeps a scene equal to the public topics, as the viewer does, and draws it as the page does, in a
thread of its own. Cameras take turns; the next one that is due is drawn as soon as the one before
is done, so without a GPU images are rarer than `rate`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from sensor_msgs.msg import CameraInfo, Image

from msg_bridge.codec import qos
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.contract.topics import camera_topics, resolve
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.process_main import run_node
from msg_bridge.nodes.ros_parameters import declare_parameters
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.wait_log import Wait, WaitLog
from viewer.cameras.camera_info import to_camera_info, to_image
from viewer.cameras.params import CameraParams
from viewer.cameras.picture_worker import PictureWorker
from viewer.cameras.usage import USAGE
from viewer.rendering.browser import find_browser
from viewer.rendering.camera import MachineCamera
from viewer.rendering.page_renderer import PageRenderer
from viewer.scene.machine_model import MachineModel
from viewer.scene.scene import Scene
from viewer.sources.live import LiveSource

__all__ = ["CameraNode", "main"]

_CHECK_PERIOD = 0.02
"""Wall time between checks whether an image is due [s]."""

_TIME_TOLERANCE = 1e-6
"""Time by which simulation times may be rounded [s]."""

_STOP_TIME = 10.0
"""Maximum wall time to wait for the end of the browser [s]."""


@dataclass
class _Camera:
    """One camera.

    Attributes:
        machine, view: where it is.
        frame: its optical frame.
        image, info: publishers.
        last_time: simulation time of its last image [s]; minus infinity before the first.
    """

    machine: str
    view: str
    frame: str
    image: Any
    info: Any
    last_time: float = -math.inf

    @property
    def is_subscribed(self) -> bool:
        """Whether anyone receives its images."""
        return bool(self.image.get_subscription_count() or self.info.get_subscription_count())


class CameraNode(SimNode):
    """Publishes images of cameras on machines, while they have subscribers.

    Attributes:
        scene: what is shown.
        diagnostics: the node's part of `/diagnostics`.
    """

    def __init__(self, **kwargs: Any) -> None:
        """
        Args:
            kwargs: arguments of `rclpy.node.Node`; the namespace is that of the simulation.

        Raises:
            EarthmovingError: a parameter is not valid, or there is no browser.
        """
        super().__init__("camera", **kwargs)
        self._params = declare_parameters(self, CameraParams)
        find_browser()
        simulation = self._params.simulation_namespace or self.get_namespace()
        self.diagnostics = Diagnostics(self, simulation_namespace=simulation)
        self.scene = Scene()
        self._source = LiveSource(
            self, self.scene, self.diagnostics.reject, simulation_namespace=simulation
        )
        self._cameras: dict[tuple[str, str], _Camera] = {}  # by machine and view
        self._num_images = 0
        guard = self.create_guard_condition(self._publish)
        self._worker = PictureWorker(self._start_renderer, self._params.size, guard.trigger)
        self.create_timer(_CHECK_PERIOD, self._request)
        WaitLog(self, self.diagnostics, self._find_waits)

    @property
    def has_cameras(self) -> bool:
        """Whether a machine with cameras was found."""
        return bool(self._cameras)

    def stop(self) -> None:
        """End the browser."""
        self._worker.close(_STOP_TIME)

    def destroy_node(self) -> None:
        """End the browser with the node."""
        worker = getattr(self, "_worker", None)
        if worker is not None:
            worker.close(_STOP_TIME)
        super().destroy_node()

    def _start_renderer(self) -> PageRenderer:
        params = self._params
        return PageRenderer(self.scene, quality=params.quality, gpu=params.gpu, window=params.size)

    def _request(self) -> None:
        """Request the picture of that camera which is due and whose last image is the oldest."""
        self._update_cameras()
        if self._worker.is_busy:
            return
        with self.scene.lock:
            now, has_terrain = self.scene.time, self.scene.terrain.tiles is not None
            shown = {name for name, each in self.scene.machines.items() if each.joints}
        if not has_terrain:
            return
        due = [
            camera
            for camera in self._cameras.values()
            # After a reset of the simulation the last image is later than now.
            if not 0.0 <= now - camera.last_time < 1.0 / self._params.rate - _TIME_TOLERANCE
            and camera.machine in shown
            and camera.is_subscribed
        ]
        if due:
            camera = min(due, key=lambda each: each.last_time)
            camera.last_time = now
            self._worker.request(MachineCamera(camera.view, camera.machine, fov=self._params.fov))

    def _update_cameras(self) -> None:
        """Add the cameras of machines that were found, and remove those of machines that left."""
        with self.scene.lock:
            models = {
                name: machine.model
                for name, machine in self.scene.machines.items()
                if machine.model is not None and self._params.has_machine(name)
            }
        for machine, model in models.items():
            for view in self._params.views:
                if (machine, view) not in self._cameras:
                    self._cameras[machine, view] = self._make_camera(machine, view, model)
        for key in [key for key in self._cameras if key[0] not in models]:
            camera = self._cameras.pop(key)
            self.destroy_publisher(camera.image)
            self.destroy_publisher(camera.info)

    def _make_camera(self, machine: str, view: str, model: MachineModel) -> _Camera:
        image, info = (resolve(name, machine) for name in camera_topics(view))
        return _Camera(
            machine,
            view,
            _optical_frame(machine, view, model),
            self.create_publisher(Image, image, qos.STATE),
            self.create_publisher(CameraInfo, info, qos.STATE),
        )

    def _publish(self) -> None:
        """Publish the image that was drawn."""
        taken = self._worker.take()
        if taken is None:
            return
        camera = self._cameras.get((taken.camera.machine, taken.camera.view))
        if camera is not None:
            stamp, picture = stamp_from_seconds(taken.picture.time), taken.picture
            camera.info.publish(to_camera_info(picture.size, picture.fov, camera.frame, stamp))
            camera.image.publish(to_image(picture, camera.frame, stamp))
            self._num_images += 1
            self.diagnostics.set("images", self._num_images)
        self._request()

    def _find_waits(self) -> Iterator[Wait]:
        """Yield what the node waits for now."""
        if not self._cameras or self.scene.terrain.tiles is None:
            yield Wait("a machine and the terrain map")


def _optical_frame(machine: str, view: str, model: MachineModel) -> str:
    """Return the frame of the images: that of the robot description, with its prefix."""
    frame = f"{view}_camera_optical"
    found = (link for link in model.links if link == frame or link.endswith(f"/{frame}"))
    return next(found, f"{machine.strip('/')}/{frame}")


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    return run_node(CameraNode, args, name="camera", usage=USAGE)


if __name__ == "__main__":
    sys.exit(main())
