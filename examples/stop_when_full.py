"""Curl the bucket until it is full, then stop: a closed loop over two topics.

Start the simulation, bring the bucket into the soil, then run

    python examples/stop_when_full.py --fill 0.8
"""

import argparse

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

PERIOD = 0.05  # time between commands [s]; they expire after 0.3 s
DRAG = {"arm": 0.2, "bucket": 0.1}  # joint velocities that draw the bucket in [rad/s]


class StopWhenFull(Node):
    """Moves arm and bucket until the payload reaches a fill."""

    def __init__(self, fill: float) -> None:
        super().__init__("stop_when_full")
        self.target_fill = fill
        self.fill = 0.0
        self.commands = self.create_publisher(JointState, "/excavator/joint_commands", 10)
        self.create_subscription(Float64MultiArray, "/excavator/payload", self.on_payload, 10)
        self.create_timer(PERIOD, self.send_command)

    @property
    def is_full(self) -> bool:
        return self.fill >= self.target_fill

    def on_payload(self, msg: Float64MultiArray) -> None:
        # The label names the values: bank_m3,loose_m3,mass_kg,fill,time_s.
        names = msg.layout.dim[0].label.split(",")
        self.fill = dict(zip(names, msg.data, strict=True))["fill"]

    def send_command(self) -> None:
        velocities = [0.0 if self.is_full else velocity for velocity in DRAG.values()]
        self.commands.publish(JointState(name=list(DRAG), velocity=velocities))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--fill", type=float, default=0.8, help="fraction of heaped capacity")
    fill = parser.parse_args().fill
    rclpy.init()
    node = StopWhenFull(fill)
    while rclpy.ok() and not node.is_full:
        rclpy.spin_once(node)
    node.send_command()  # zero velocities
    rclpy.spin_once(node, timeout_sec=0.2)
    print(f"bucket {100 * node.fill:.0f} % full")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
