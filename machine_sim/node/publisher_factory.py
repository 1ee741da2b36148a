"""Create the publishers of one machine from its specification."""

from __future__ import annotations

from rclpy.node import Node

from machine_sim.machine.forward_kinematics import link_frame_name, link_frame_names
from machine_sim.machine.visuals import marker_boxes, shoe_visual
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.machine_publishers import MachinePublishers
from machine_sim.node.params import MachineNodeParams
from machine_sim.node.sensor_publishers import SensorPublishers
from machine_sim.node.state_publishers import StatePublishers
from machine_sim.sensors import SensorParams
from msg_bridge.codec.markers import MarkerSet

__all__ = ["create_machine_publishers"]


def create_machine_publishers(
    node: Node, instance: MachineInstance, params: MachineNodeParams, sensor_params: SensorParams
) -> MachinePublishers:
    """Create the topics of a machine.

    Args:
        node: node of the publishers.
        instance: the machine.
        params: parameters of the node.
        sensor_params: rate and errors of the sensors.
    """
    machine, namespace = instance.spec, node.get_namespace().strip("/")
    prefix, frames = instance.frame_prefix(namespace), link_frame_names(machine)
    visuals = (marker_boxes(machine), shoe_visual(machine))
    state_publishers = StatePublishers(
        node,
        instance.topic_prefix,
        frame_prefix=prefix,
        command_names=instance.command_names,
        frames=frames,
        tool_frames={name: link_frame_name(mount.link) for name, mount in machine.tools.items()},
        has_payload=machine.can_carry_soil,
        markers=MarkerSet(frames, *visuals, namespace=instance.name or namespace or machine.name),
        publish_tf=params.publish_tf,
    )
    imus = [imu.name for imu in machine.imus]
    sensor_publishers = SensorPublishers(
        node, instance.topic_prefix, frame_prefix=prefix, imus=imus
    )
    return MachinePublishers(
        instance,
        state_publishers,
        sensor_publishers,
        sensor_params,
        prefix,
        params.description_meshes,
    )
