"""Runs one node as a process: arguments, signals, spinning, a clean end, and the exit code.

    def main() -> int:
        return run_node(SoilNode)

A node may have these, all optional:

- `finished`: true when it has nothing more to do; the process ends.
- `stop()`: called once before the node is destroyed, whatever the process ends for.
- `stopping`: true while `stop()` still needs messages; the node is spun on, for 2 s at most.
- `exit_code`: what the process returns when nothing went wrong; 0 without it.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import ok, try_shutdown

from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.dds_profile import use_shipped_profile
from msg_bridge.nodes.ros_parameters import reject_unknown_overrides

__all__ = ["EXIT_BAD_INPUT", "run_node"]

EXIT_BAD_INPUT = 2
"""Exit code when something the user gave is not good; one sentence on stderr tells what."""

_SPIN_TIMEOUT = 0.1  # s; how soon a signal is seen while no message comes
_MAX_STOP_TIME = 2.0  # s
_MAX_DELIVERY_TIME = 0.5  # s; then who does not acknowledge, does not get the last messages
_SIGINT_DEBOUNCE_TIME = 0.5  # s; a terminal and a launcher may both pass on one Ctrl-C


def run_node(make_node: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Make a node, spin it until it has finished or SIGINT or SIGTERM comes, and end cleanly.

    A second SIGINT ends the process at once. To be called from the main thread; from another one
    it works without signals.

    Args:
        make_node: makes the node in the default context, e.g. the node's class.
        args: the command line with the program's name first, `sys.argv` by default.

    Returns:
        The exit code: the node's `exit_code`, or 2 if an `EarthmovingError` came out of
        `make_node` or a callback; it is told in one line on stderr.
    """
    with _signals() as stopped:
        use_shipped_profile()
        try:
            rclpy.init(
                args=None if args is None else list(args),
                signal_handler_options=SignalHandlerOptions.NO,
            )
        except RuntimeError as error:  # whatever rcl finds wrong with the arguments
            return _bad_input(
                _program(args),
                f"the ROS arguments are not good ({error}); correct what follows --ros-args",
            )
        try:
            return _run(make_node, stopped, _program(args))
        finally:
            try_shutdown()


def _run(make_node: Callable[[], Node], stopped: threading.Event, program: str) -> int:
    try:
        node = make_node()
    except EarthmovingError as error:
        return _bad_input(program, error)
    name = node.get_name()
    # All that was made so far, compilers and message types, stays: looking through it for garbage
    # again and again would make ticks late.
    gc.collect()
    gc.freeze()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    code = 0
    try:
        try:
            reject_unknown_overrides(node)
            while not stopped.is_set() and not getattr(node, "finished", False):
                executor.spin_once(timeout_sec=_SPIN_TIMEOUT)
        except ExternalShutdownException:  # somebody called rclpy.shutdown()
            pass
        except EarthmovingError as error:
            code = _bad_input(name, error)
        finally:
            try:
                _stop(node, executor)
            except EarthmovingError as error:
                code = _bad_input(name, error)
        return code or int(getattr(node, "exit_code", 0))
    finally:
        executor.shutdown()
        node.destroy_node()


def _stop(node: Node, executor: SingleThreadedExecutor) -> None:
    stop = getattr(node, "stop", None)
    if stop is not None:
        stop()
    deadline = time.monotonic() + _MAX_STOP_TIME
    while getattr(node, "stopping", False) and ok() and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=_SPIN_TIMEOUT)
    # What was published last, such as a machine's leave, is lost with its publisher.
    deadline = time.monotonic() + _MAX_DELIVERY_TIME
    for publisher in list(node.publishers) if ok() else []:
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))


@contextmanager
def _signals() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set while the block runs; then all is as before.

    Handlers do nothing else, since they run between any two steps of a callback.
    """
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return
    first_interrupt: float | None = None

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal first_interrupt
        stopped.set()
        if number != signal.SIGINT:
            return
        now = time.monotonic()
        if first_interrupt is None:
            first_interrupt = now
        elif now - first_interrupt > _SIGINT_DEBOUNCE_TIME:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            os.kill(os.getpid(), signal.SIGINT)

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _program(args: Sequence[str] | None) -> str:
    """What to call the process before it has a node: `soil_sim` for `python -m soil_sim.node.soil_node`."""
    path = Path((args if args else sys.argv)[0])
    if path.stem in ("node", "__main__"):
        return path.parent.name
    if path.parent.name == "node":
        return path.parent.parent.name
    return path.stem


def _bad_input(name: str, error: EarthmovingError | str) -> int:
    sentence = " ".join(str(error).split())
    print(f"{name}: {sentence}", file=sys.stderr, flush=True)
    return EXIT_BAD_INPUT
