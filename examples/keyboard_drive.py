"""Drive and dig from the keyboard of a terminal.

Start the simulation, then run

    python examples/keyboard_drive.py

    w s  both tracks forward, backward      a d  turn left, right
    j l  swing left, right                  i k  boom up, down
    u o  arm out, in                        y h  bucket open, curl
    space  stop                             q  quit

A key sets a velocity that stays until another key changes it; space sets all to zero. Ctrl-Z sets
them to zero, too; `fg` continues. Keys may also be piped in, for example to raise the
boom for two seconds: `(echo i; sleep 2) | python examples/keyboard_drive.py`.
"""

import argparse
import os
import signal
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

KEY_TABLE = __doc__.split("\n\n")[3]
PERIOD = 0.05  # time between commands [s]; they expire after 0.3 s

# Joint velocities [rad/s] and track speeds [m/s] of each key.
KEYS = {
    "w": {"left_track": 0.8, "right_track": 0.8},
    "s": {"left_track": -0.8, "right_track": -0.8},
    "a": {"left_track": -0.4, "right_track": 0.4},
    "d": {"left_track": 0.4, "right_track": -0.4},
    "j": {"swing": 0.3},
    "l": {"swing": -0.3},
    "i": {"boom": -0.2},
    "k": {"boom": 0.2},
    "u": {"arm": -0.3},
    "o": {"arm": 0.3},
    "y": {"bucket": -0.5},
    "h": {"bucket": 0.5},
}
JOINTS = ("swing", "boom", "arm", "bucket", "left_track", "right_track")
STOPPED = dict.fromkeys(JOINTS, 0.0)


def update(velocities: dict[str, float], key: str) -> dict[str, float]:
    """Return the velocities after a key; unknown keys change nothing."""
    return dict(STOPPED) if key == " " else {**velocities, **KEYS.get(key, {})}


def to_message(velocities: dict[str, float]) -> JointState:
    """Return velocities as a message for `joint_commands`."""
    return JointState(name=list(velocities), velocity=list(velocities.values()))


def read_keys(stop: Callable[[], None]) -> Iterator[str]:
    """Yield the keys pressed, one by one, until the input ends or `q` is pressed.

    Args:
        stop: stops the machine; called when the program is suspended, and when it continues.
    """
    is_terminal = sys.stdin.isatty()
    saved = termios.tcgetattr(sys.stdin) if is_terminal else None

    def suspend(*_: object) -> None:
        stop()
        os.kill(os.getpid(), signal.SIGSTOP)

    def resume(*_: object) -> None:
        stop()
        tty.setcbreak(sys.stdin)  # the shell has set its own mode

    if is_terminal:
        signal.signal(signal.SIGTSTP, suspend)
        signal.signal(signal.SIGCONT, resume)
        tty.setcbreak(sys.stdin)
    try:
        while (key := sys.stdin.read(1)) not in ("", "q"):
            yield key
    finally:
        if saved is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, saved)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--machine", default="/excavator", help="its namespace (%(default)s)")
    machine = parser.parse_args().machine.rstrip("/")
    print(KEY_TABLE, flush=True)
    # rclpy's own handler of SIGTERM would leave the terminal waiting for a key.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
    node = rclpy.create_node("keyboard_drive")
    commands = node.create_publisher(JointState, f"{machine}/joint_commands", 10)
    velocities = dict(STOPPED)
    node.create_timer(PERIOD, lambda: commands.publish(to_message(velocities)))

    def spin() -> None:
        with suppress(ExternalShutdownException):
            rclpy.spin(node)

    def stop() -> None:
        nonlocal velocities
        velocities = dict(STOPPED)
        commands.publish(to_message(velocities))

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        for key in read_keys(stop):
            velocities = update(velocities, key)
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.shutdown()
        thread.join()


if __name__ == "__main__":
    main()
