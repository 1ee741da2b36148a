"""Drive a machine from the keys of this terminal.

Two levers and two pedals, as in a cab: the left hand has w a s d, the right hand i j k l, the
arrows drive the tracks. Space is the emergency stop. Start `soil_sim` and `machine_sim` first; the
page shows all keys and the state of the machine. Which joint a lever moves follows from the
parameter `commands.joy_pattern` of the machine (iso or sae) and from its machine file.

A terminal with the keyboard protocol of kitty (kitty, foot, WezTerm, Ghostty, iTerm2) reports
released keys, and any number of keys can be held. Any other one repeats only the last key: hold one
at a time, and the motion ends up to 0.5 s after a short press.
"""

import argparse
from functools import partial

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "drive a machine from the keys of this terminal"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the machine and the speed."""
    parser.add_argument(
        "--machine",
        default="/excavator",
        metavar="NAMESPACE",
        help="namespace of the machine (default: /excavator)",
    )
    parser.add_argument(
        "--speed",
        type=int,
        default=100,
        metavar="PERCENT",
        choices=range(10, 101),
        help="deflection of a held key in percent, 10 to 100 (default: 100)",
    )


def run(args: argparse.Namespace) -> int:
    """Drive until `q`; return 0.

    Raises:
        EarthmovingError: there is no terminal, or the namespace is invalid.
    """
    from rclpy.exceptions import InvalidNamespaceException
    from rclpy.validate_namespace import validate_namespace

    from msg_bridge.contract.errors import EarthmovingError
    from msg_bridge.nodes.process_main import run_node
    from teleop.node import TeleopNode
    from teleop.terminal import Terminal

    machine = "/" + args.machine.strip("/")
    try:
        validate_namespace(machine)
    except InvalidNamespaceException as error:
        raise EarthmovingError(f"--machine {args.machine}: {error}") from None
    with Terminal() as terminal:
        make_node = partial(TeleopNode, terminal, args.speed / 100.0, namespace=machine)
        # Log lines would damage the page; warnings of the machine are shown on it.
        return run_node(make_node, ["teleop", "--ros-args", "--disable-stdout-logs"], name="teleop")
