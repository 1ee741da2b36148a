"""A machine node in lockstep that computes one tick at a time."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState

from msg_bridge.codec.machine_state import from_command_state
from msg_bridge.codec.stamps import stamp_from_seconds, tick_from_stamp
from msg_bridge.exchange.stream_buffers import PIPELINE_DEPTH
from msg_bridge.testing.ros_context import Ros
from support.machine_scenes import COMMAND_NAMES
from support.node_scenes import TICK, Scene


def twist(linear: float, angular: float, stamp: float = 0.0) -> TwistStamped:
    """Return a `cmd_vel` message [m/s], [rad/s], stamp [s]."""
    message = TwistStamped()
    message.header.stamp = stamp_from_seconds(stamp)
    message.twist.linear.x, message.twist.angular.z = linear, angular
    return message


class SteppedMachine:
    """A machine in lockstep with a paused soil, which steps one tick at a time."""

    def __init__(self, ros: Ros, **parameters: Any) -> None:
        self.applied = ros.collect("/excavator/applied_commands", JointState)
        self.scene = Scene(ros, paused=True)
        self.machine = self.scene.machine(**parameters)
        ros.spin_until(lambda: self.scene.tick == 0)
        self.scene.step()
        self.ros = ros
        self.until_waiting()

    def until_waiting(self) -> None:
        """Spin until the machine has computed all ticks possible without the next soil tick."""
        last = self.scene.tick + 1 + PIPELINE_DEPTH
        self.ros.spin_until(lambda: self.machine.run is not None and self.machine.run.tick == last)

    def send(self, topic: str, message: Any) -> None:
        """Publish a command to its subscription."""
        publisher = self.ros.publisher(f"/excavator/{topic}", type(message), subscriptions=1)
        publisher.publish(message)

    def current_command(self) -> list[float]:
        """Return the command that the arbiter would apply now: joints, then tracks."""
        run = self.machine.run
        assert run is not None
        scheduler = run.schedulers[0]
        command = scheduler.arbiter.command_at(scheduler.sim_time, run.sim.machine.joint_positions)
        return [*command.joints.tolist(), *command.tracks.tolist()]

    def step(self) -> list[float]:
        """Step the soil by one tick; return the command of the machine's next tick."""
        self.scene.step()
        tick = self.scene.tick + 1 + PIPELINE_DEPTH
        self.ros.spin_until(lambda: self.applied and self.ticks[-1] >= tick)
        assert self.ticks[-1] == tick
        return from_command_state(self.applied[-1], COMMAND_NAMES).tolist()

    @property
    def ticks(self) -> list[int]:
        """Ticks of the received applied commands."""
        return [tick_from_stamp(message.header.stamp, TICK) for message in self.applied]
