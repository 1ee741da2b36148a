"""Raise the boom while the upper body turns: the smallest controller.

Start the simulation, then run

    python examples/ten_lines.py
"""

import argparse
import signal
from contextlib import suppress

import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

argparse.ArgumentParser(description=__doc__.split("\n")[0]).parse_args()
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # with its own, spin may raise RCLError
signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
node = rclpy.create_node("my_controller")
commands = node.create_publisher(JointState, "/excavator/joint_commands", 10)
# Velocities [rad/s]. Positive angles of boom, arm and bucket lower them.
command = JointState(name=["swing", "boom"], velocity=[0.2, -0.1])
# A command that is not renewed for 0.3 s expires; the joints then hold their angles.
node.create_timer(0.05, lambda: commands.publish(command))
with suppress(KeyboardInterrupt):  # until Ctrl-C or SIGTERM
    rclpy.spin(node)
