"""Fill the bucket: lower it to the ground, draw it in until it is full, then stop.

Start the simulation, then run

    python examples/stop_when_full.py --fill 0.8

A closed loop over three topics: joint angles, force of the soil on the bucket, and payload. Boom,
arm and bucket may have any angles at the start. The fill is printed once a second of simulated
time. If the joints stop moving before the bucket is full, at their limits or because the soil is
too strong, the script ends with the reason and exit code 1; after Ctrl-C, too.
"""

import argparse
import math
import signal
import sys
import time

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

PERIOD = 0.05  # time between commands [s]; they expire after 0.3 s
READY = {"boom": -0.5, "arm": 1.0, "bucket": 0.9}  # angles of a bucket ahead, in the air [rad]
LOWER = {"boom": 0.15}  # joint velocities [rad/s]
DRAW_IN = {"arm": 0.2, "bucket": 0.1}
READY_TOLERANCE = 0.05  # of each angle [rad]
CONTACT_FORCE = 5.0e3  # force of the soil on the bucket that shows contact [N]
STALL_TIME = 3.0  # simulated time without motion after which the script gives up [s]
STALL_ANGLE = 0.01  # motion that counts [rad]
MESSAGE_TIMEOUT = 30.0  # maximum wall time between two messages [s]


class StopWhenFull(Node):
    """Moves boom, arm and bucket until the payload reaches a fill.

    Attributes:
        fill: payload as a fraction of the heaped capacity.
        step: "ready" (move the bucket ahead, above the ground), "lower" or "draw in".
        error: why the bucket cannot be filled; empty while it can.
    """

    def __init__(self, fill: float) -> None:
        super().__init__("stop_when_full")
        self.target_fill = fill
        self.fill = 0.0
        self.step = "ready"
        self.error = ""
        self.time = self.print_time = self.motion_time = -math.inf  # simulated [s]
        self.message_time = time.monotonic()  # wall time of the last payload [s]
        self.angles: dict[str, float] = {}
        self.angles_of_motion: dict[str, float] = {}  # angles at `motion_time`
        self.force = 0.0
        self.commands = self.create_publisher(JointState, "/excavator/joint_commands", 10)
        self.create_subscription(JointState, "/excavator/joint_states", self.on_joints, 10)
        self.create_subscription(WrenchStamped, "/excavator/bucket/wrench", self.on_wrench, 10)
        self.create_subscription(Float64MultiArray, "/excavator/payload", self.on_payload, 10)
        self.create_timer(PERIOD, self.send_command)

    @property
    def is_full(self) -> bool:
        return self.fill >= self.target_fill

    def on_joints(self, msg: JointState) -> None:
        angles = dict(zip(msg.name, msg.position, strict=True))
        self.angles = {name: angles[name] for name in READY}

    def on_wrench(self, msg: WrenchStamped) -> None:
        force = msg.wrench.force
        self.force = math.hypot(force.x, force.y, force.z)

    def on_payload(self, msg: Float64MultiArray) -> None:
        # The label names the values: bank_m3,loose_m3,mass_kg,fill,time_s.
        values = dict(zip(msg.layout.dim[0].label.split(","), msg.data, strict=True))
        self.fill, self.time = values["fill"], values["time_s"]
        self.message_time = time.monotonic()
        if self.time >= self.print_time + 1.0:
            print(f"{self.step}: bucket {100 * self.fill:.0f} % full", flush=True)
            self.print_time = self.time

    def send_command(self) -> None:
        """Publish a command once the machine has reported its state; set `error` if it does not."""
        if time.monotonic() - self.message_time > MESSAGE_TIMEOUT:
            self.error = "no message on /excavator/payload; start soil_sim and machine_sim"
        if self.angles and math.isfinite(self.time):
            self.publish_command()

    def publish_command(self) -> None:
        """Publish the command of the present step, or zero velocities at the end."""
        self.choose_step()
        if self.is_full or self.error:
            command = JointState(name=list(READY), velocity=[0.0] * len(READY))
        elif self.step == "ready":
            command = JointState(name=list(READY), position=list(READY.values()))
        else:
            velocities = LOWER if self.step == "lower" else DRAW_IN
            command = JointState(name=list(velocities), velocity=list(velocities.values()))
        self.commands.publish(command)

    def choose_step(self) -> None:
        """Begin the next step when one is done; set `error` when no joint moves any more."""
        if self.step == "ready" and self.largest_difference(READY) < READY_TOLERANCE:
            self.step = "lower"
        elif self.step == "lower" and self.force > CONTACT_FORCE:
            self.step = "draw in"
        if (
            not self.angles_of_motion
            or self.largest_difference(self.angles_of_motion) > STALL_ANGLE
        ):
            self.angles_of_motion, self.motion_time = self.angles, self.time
        elif self.time - self.motion_time > STALL_TIME:
            self.error = f"{self.step}: the joints are at a limit, or the soil stops them"

    def largest_difference(self, angles: dict[str, float]) -> float:
        """Return the largest distance of a joint from one of some angles [rad]."""
        return max(abs(self.angles[name] - angle) for name, angle in angles.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--fill", type=float, default=0.8, help="fraction of heaped capacity (0.8)")
    fill = parser.parse_args().fill
    if not 0.0 < fill <= 1.0:
        parser.error(f"--fill is {fill:g}; give more than 0, and at most 1 for a heaped bucket")
    # With its own handlers rclpy would shut down, and zero velocities could not be sent.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
    node = StopWhenFull(fill)
    try:
        while not (node.is_full or node.error):
            rclpy.spin_once(node)
    except KeyboardInterrupt:
        node.error = "stopped before the bucket was full"
    for _ in range(3):  # zero velocities
        node.send_command()
        time.sleep(PERIOD)
    print(f"bucket {100 * node.fill:.0f} % full")
    rclpy.shutdown()
    sys.exit(node.error or None)


if __name__ == "__main__":
    main()
