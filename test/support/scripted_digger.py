"""A controller that digs without end; each command depends only on the tick that it answers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from msg_bridge.codec.qos import STATE
from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.testing.ros_context import Ros
from support.machine_scenes import COMMAND_NAMES
from support.node_scenes import TICK, drag_angles, joint_command, ready_to_dig

__all__ = ["ScriptedDigger"]

DRIVE, DRAG, LIFT, SWING, DUMP, SWING_BACK = 60, 300, 120, 150, 120, 200
"""Ticks of each phase of a cycle."""

_CYCLE = DRIVE + DRAG + LIFT + SWING + DUMP + SWING_BACK
_SWING = 0.9
"""Angle from the cut to the heap [rad]."""


class ScriptedDigger:
    """Answers each state of the excavator with a command.

    Attributes:
        tick: newest tick that was answered.
    """

    def __init__(self, ros: Ros) -> None:
        self.tick = -1
        self._machine = ready_to_dig()
        self._publisher: Publisher = ros.publisher("/excavator/joint_commands", JointState)
        ros.helper.create_subscription(JointState, "/excavator/joint_states", self._on_state, STATE)

    def _on_state(self, state: JointState) -> None:
        tick = tick_from_stamp(state.header.stamp, TICK)
        self.tick = max(self.tick, tick)
        self._publisher.publish(self.command(tick))

    def command(self, tick: int) -> JointState:
        """Return the command that answers the state of a tick."""
        k = tick % _CYCLE
        if k < DRIVE:
            return joint_command(tick, [0.0, 0.0, 0.0, 0.0, 0.3, 0.25])
        message = joint_command(tick, np.zeros(len(COMMAND_NAMES)))
        message.name = list(self._machine.joint_names)
        message.position = self._target(k - DRIVE).tolist()
        message.velocity = []
        return message

    def _target(self, k: int) -> NDArray[np.float64]:
        """Return the target angles of all joints in tick `k` after the drive [rad]."""
        lifted = drag_angles(self._machine, 1.0) + np.array([-0.5, -0.1, 0.0])
        opened = np.array([*lifted[:2], -0.5])
        phases = (
            (DRAG, 0.0, drag_angles(self._machine, min(k / DRAG, 1.0))),
            (LIFT, 0.0, lifted),
            (SWING, _SWING, lifted),
            (DUMP, _SWING, opened),
            (SWING_BACK, 0.0, drag_angles(self._machine, 0.0)),
        )
        ends = np.cumsum([duration for duration, _, _ in phases])
        _, swing, angles = phases[int(np.searchsorted(ends, k, side="right"))]
        return np.array([swing, *angles])
