"""Reset the simulation and verify that no soil is missing.

Start the simulation, then run

    python examples/reset_run.py
"""

import argparse
import signal
import sys

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

TIMEOUT = 10.0  # of each service [s]


def call(node: Node, service: str) -> Trigger.Response:
    """Call a Trigger service and return its response."""
    client = node.create_client(Trigger, service)
    if not client.wait_for_service(TIMEOUT):
        sys.exit(f"there is no service {service}; start soil_sim")
    future = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=TIMEOUT)
    if not future.done():
        sys.exit(f"{service} did not answer within {TIMEOUT:g} s")
    return future.result()


def main() -> None:
    argparse.ArgumentParser(description=__doc__.split("\n")[0]).parse_args()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends the script, as SIGTERM does
    node = rclpy.create_node("reset_run")
    is_successful = True
    for service in ("/sim/reset", "/soil/verify"):
        response = call(node, service)
        print(f"{service}: {'ok' if response.success else 'failed'} {response.message}")
        is_successful &= response.success
    rclpy.shutdown()
    sys.exit(0 if is_successful else 1)


if __name__ == "__main__":
    main()
