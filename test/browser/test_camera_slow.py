"""Camera images of a running simulation, drawn by a real browser."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, Image
from support.node_scenes import Scene

from earthmoving_sim.figures.digging import excavator_world
from machine_sim.machine.forward_kinematics import link_frame_names, link_poses
from machine_sim.machine.rotations import rotation_matrix
from msg_bridge.codec.qos import ROWS, STATE
from msg_bridge.testing.ros_context import Ros
from viewer.cameras.node import CameraNode
from viewer.rendering.camera import MachineCamera
from viewer.rendering.page_renderer import PageRenderer
from viewer.rendering.picture import PictureSize

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

MAX_TIME = 300.0  # wall time for the first image [s]: shaders are compiled on the CPU


def test_image_is_published_with_matrices_and_frame(
    ros: Ros, chromium: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CHROMIUM", chromium)
    scene = Scene(ros, sync="realtime")
    scene.machine()
    ros.add(CameraNode, parameters={"width": 160, "height": 120})
    client = ros.node("client")
    images: list[Image] = []
    infos: list[CameraInfo] = []
    transforms: list[TransformStamped] = []
    topic = "/excavator/camera/cab"
    client.create_subscription(Image, f"{topic}/image", images.append, STATE)
    client.create_subscription(CameraInfo, f"{topic}/camera_info", infos.append, STATE)
    client.create_subscription(TransformStamped, "/excavator/transforms", transforms.append, ROWS)
    ros.spin_until(lambda: images and infos, timeout=MAX_TIME)
    image, info = images[0], infos[0]
    assert (image.width, image.height, image.encoding) == (160, 120, "rgb8")
    assert (image.header.stamp, image.header.frame_id) == (info.header.stamp, info.header.frame_id)
    assert image.header.stamp.sec + image.header.stamp.nanosec > 0
    assert image.header.frame_id in {each.child_frame_id for each in transforms}
    pixels = np.frombuffer(bytes(image.data), np.uint8)
    assert pixels.std() > 10.0  # a view, not one colour


@pytest.mark.parametrize("view", ["cab", "bucket"])
def test_picture_is_taken_from_the_optical_frame_of_the_machine(
    chromium: str, monkeypatch: pytest.MonkeyPatch, view: str
) -> None:
    monkeypatch.setenv("CHROMIUM", chromium)
    world = excavator_world()
    with closing(PageRenderer(world.scene, quality="low")) as renderer:
        picture = renderer.render(MachineCamera(view, fov=60.0), PictureSize(160, 120))
    machine = world.machine().machine
    poses = link_poses(machine.spec, *machine.base_pose, machine.joint_positions)
    index = link_frame_names(machine.spec).index(f"{view}_camera_optical")
    np.testing.assert_allclose(picture.position, poses.positions[index], atol=1e-3)
    np.testing.assert_allclose(
        rotation_matrix(picture.rotation), rotation_matrix(poses.quaternions[index]), atol=1e-3
    )
    assert picture.fov == 60.0
    world.close()
