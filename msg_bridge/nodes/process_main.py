"""Run one node as a process: help, arguments, signals, spinning, a clean end, and the exit code.

    def main() -> int:
        return run_node(SoilNode, name="soil_sim", usage=USAGE)

A node may have these attributes, all optional:

- `finished`: true when the node has completed its work; the process ends.
- `stop()`: called once before the node is destroyed, for any reason; while an exception ends the
  node, `sys.exc_info()` has it.
- `stopping`: true while `stop()` still needs messages; the node is spun for 2 s at most.
- `exit_code`: exit code of the process if no error occurred; 0 without it.
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
from functools import partial
from types import FrameType

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import ok, remove_ros_args, try_shutdown

from msg_bridge.allocator import keep_freed_memory, return_freed_memory
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.dds_profile import use_shipped_profile
from msg_bridge.nodes.node_usage import NodeUsage
from msg_bridge.nodes.parameter_files import describe_unused_files
from msg_bridge.nodes.ros_parameters import reject_unknown_overrides
from msg_bridge.processes.broken_pipe import end_on_broken_pipe

__all__ = ["EXIT_BAD_INPUT", "run_background_node", "run_node"]

EXIT_BAD_INPUT = 2
"""Exit code for invalid input of the user; one line on stderr gives the reason."""

_SPIN_TIMEOUT = 0.1
"""Maximum delay of a signal while no message arrives [s]."""
_MAX_STOP_TIME = 2.0
"""Maximum time for which a node is spun after `stop()` [s]."""
_MAX_DELIVERY_TIME = 0.5
"""Maximum wait for acknowledgements of the last messages [s]."""
_SIGINT_DEBOUNCE_TIME = 0.5
"""Time within which a second SIGINT is ignored [s]: terminal and launcher may both forward one
Ctrl-C."""


def run_node(
    make_node: Callable[[], Node],
    args: Sequence[str] | None = None,
    *,
    name: str,
    usage: NodeUsage | None = None,
) -> int:
    """Make a node, spin it until it has finished or SIGINT or SIGTERM arrives, and end cleanly.

    A second SIGINT ends the process at once. Signals are handled only in the main thread.
    `-h` or `--help` prints the usage and exits without starting ROS.

    Args:
        make_node: makes the node in the default context, e.g. the node's class.
        args: command line with the program's name first, `sys.argv` by default.
        name: name of the executable, for messages until there is a node.
        usage: contents of the help text.

    Returns:
        The exit code: the node's `exit_code`, or 2 for an unknown argument and for an
        `EarthmovingError` of `make_node` or a callback; its message is one line on stderr.
    """
    extra = _non_ros_arguments(sys.argv if args is None else args)
    if usage is not None and {"-h", "--help"} & set(extra):
        return end_on_broken_pipe(partial(_print_usage, usage, name))
    if extra:
        return _bad_input(
            name,
            f"unknown argument {extra[0]!r}; give parameters after --ros-args, see {name} --help",
        )
    keep_freed_memory()
    with _signals() as stopped:
        use_shipped_profile()
        try:
            rclpy.init(
                args=None if args is None else list(args),
                signal_handler_options=SignalHandlerOptions.NO,
            )
        except RuntimeError as error:  # rcl rejects the arguments
            return _bad_input(
                name,
                f"the ROS arguments are invalid ({error}); correct what follows --ros-args",
            )
        try:
            return _run(make_node, stopped, name, sys.argv if args is None else args)
        finally:
            try_shutdown()


def run_background_node(
    make_node: Callable[[], Node], args: Sequence[str] | None, *, name: str, usage: NodeUsage
) -> int:
    """Run a node as `run_node` does, with the niceness of its parameter `niceness`.

    The niceness applies to the whole process, which therefore must have no other nodes.

    Args:
        make_node: makes the node, as in `run_node`.
        args: command line with the program's name first; None: `sys.argv`.
        name: name of the executable.
        usage: contents of the help text.

    Returns:
        The exit code, as of `run_node`.
    """

    def make_nice_node() -> Node:
        node = make_node()
        os.nice(int(node.get_parameter("niceness").value))
        return node

    return run_node(make_nice_node, args, name=name, usage=usage)


def _print_usage(usage: NodeUsage, name: str) -> int:
    print(usage.text(name))
    return 0


def _run(
    make_node: Callable[[], Node], stopped: _StopFlag, program: str, args: Sequence[str]
) -> int:
    try:
        node = make_node()
    except EarthmovingError as error:
        return _bad_input(program, error)
    name = node.get_name()
    # Compilers and message types made so far stay for good: collecting garbage among them would
    # delay ticks.
    gc.collect()
    gc.freeze()
    return_freed_memory()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        try:
            reject_unknown_overrides(node)
            for sentence in describe_unused_files(node, args):
                node.get_logger().warning(sentence)
            while not stopped.is_set and not getattr(node, "finished", False):
                executor.spin_once(timeout_sec=_SPIN_TIMEOUT)
        except ExternalShutdownException:  # rclpy.shutdown() was called
            pass
        finally:
            # Errors are handled after it: `stop()` must be able to see that one ends the node.
            _stop(node, executor)
        return int(getattr(node, "exit_code", 0))
    except EarthmovingError as error:
        if isinstance(error.__context__, EarthmovingError):  # `stop()` failed after an error
            _bad_input(name, error.__context__)
        return _bad_input(name, error)
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
    # The last messages, such as a machine's LEAVE, would be lost with their publisher.
    deadline = time.monotonic() + _MAX_DELIVERY_TIME
    for publisher in list(node.publishers) if ok() else []:
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))


class _StopFlag:
    """Whether the process has been asked to end.

    Not a `threading.Event`: it takes a lock, and a handler that a second signal interrupts while it
    holds the lock would wait for itself.
    """

    is_set = False


@contextmanager
def _signals() -> Iterator[_StopFlag]:
    """Yield a flag that SIGINT and SIGTERM set; restore the signal handlers afterwards.

    The handlers do nothing else: they run between any two steps of a callback, and of one another.
    """
    stopped = _StopFlag()
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return
    first_interrupt: float | None = None

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal first_interrupt
        stopped.is_set = True
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


def _non_ros_arguments(args: Sequence[str]) -> list[str]:
    """Return the arguments that are not for ROS, without the program's name.

    Malformed ROS arguments give none: `rclpy.init` rejects them with a better message.
    """
    try:
        return list(remove_ros_args(list(args)))[1:]
    except RuntimeError:
        return []


def _bad_input(name: str, error: EarthmovingError | str) -> int:
    """Print an error as one line on stderr, and return the exit code."""
    sentence = " ".join(str(error).split())
    print(f"{name}: {sentence}", file=sys.stderr, flush=True)
    return EXIT_BAD_INPUT
