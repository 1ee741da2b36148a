"""Nodes as processes: arguments, signals, errors, exit codes."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import pytest
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

from msg_bridge.codec.qos import STATE
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.parameters import Parameters, parameter
from msg_bridge.nodes.node_usage import NodeUsage
from msg_bridge.nodes.process_main import run_node
from msg_bridge.nodes.ros_parameters import declare_parameters
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros
from msg_bridge.testing.ros_process import RosProcess


@dataclass(frozen=True)
class DiggerParams(Parameters):
    depth: float = parameter(1.0, "how deep", unit="m", low=0.0, high=2.0)
    act: str = parameter("wait", "what to do")


class Digger(Node):
    """Node that ends as its parameter `act` demands; this file is also its executable."""

    exit_code = 0
    finished = False
    stopping = False
    num_subscribers = 0

    def __init__(self) -> None:
        super().__init__("digger")
        self.params = declare_parameters(self, DiggerParams)
        self.texts = self.create_publisher(String, "texts", STATE)
        self.create_timer(0.02, self.act)
        print("ready at", self.params.depth)

    def act(self) -> None:
        act = self.params.act
        if self.stopping:
            self.texts.publish(String(data="bye"))
            self.stopping = act == "never stops"
        elif act == "wait" and self.texts.get_subscription_count() > self.num_subscribers:
            self.num_subscribers += 1
            print("subscribed")
        elif act == "finish":
            self.finished, self.exit_code = True, 3
        elif act.startswith("reject"):
            raise EarthmovingError("the ground\nis frozen; wait for summer")
        elif act == "break":
            raise ZeroDivisionError("a bug")
        elif act == "interrupt twice":
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)
        elif act == "interrupt the handler":
            sys.setprofile(interrupt_handler)
            os.kill(os.getpid(), signal.SIGTERM)
        elif act == "never stops":
            os.kill(os.getpid(), signal.SIGTERM)
        elif act == "hang":
            print("hanging")
            while True:
                time.sleep(0.01)

    def stop(self) -> None:
        print("stopped once")
        if error := sys.exc_info()[0]:
            print("stopped by", error.__name__)
        self.stopping = self.params.act in ("wait", "never stops")
        if self.params.act == "reject twice":
            raise EarthmovingError("the shovel is stuck")


def interrupt_handler(frame: FrameType | None, event: str, arg: object) -> None:
    """Send SIGTERM at each call within the handler of SIGTERM: its steps interrupt one another."""
    handler = getattr(signal.getsignal(signal.SIGTERM), "__code__", None)
    while frame is not None and frame.f_code is not handler:
        frame = frame.f_back
    if handler is not None and frame is not None and event in ("call", "c_return"):
        os.kill(os.getpid(), signal.SIGTERM)


DIGGER = [sys.executable, __file__]


def run_here(*arguments: str, make_node: Callable[[], Node] = Digger) -> int:
    """Run a node in this process, in the test's domain."""
    return run_node(make_node, ["/bin/digger", "--ros-args", *arguments], name="digger")


def lines(process: RosProcess) -> list[str]:
    return process.output.splitlines()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_a_node_cleanly(ros_process: StartProcess, number: int) -> None:
    process = ros_process(DIGGER)
    process.wait_for_output("ready")
    process.stop(number, expect=0)
    assert lines(process) == ["ready at 1.0", "stopped once"]


def test_messages_published_while_stopping_are_delivered(
    ros: Ros, ros_process: StartProcess
) -> None:
    received = ros.collect("texts", String, STATE)
    process = ros_process(DIGGER)
    process.wait_for_output("subscribed")
    process.stop()
    ros.spin_until(lambda: [msg.data for msg in received] == ["bye"])


def test_node_that_never_stops_is_ended(ros_domain: int) -> None:
    assert run_here("-p", "act:=never stops") == 0


def test_finished_node_sets_the_exit_code(
    ros_domain: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_here("-p", "act:=finish") == 3
    assert "stopped once" in capsys.readouterr().out


def test_invalid_parameter_ends_the_process_with_exit_code_2(ros_process: StartProcess) -> None:
    process = ros_process(DIGGER, parameters={"depth": 3})
    process.wait(expect=2)
    assert lines(process) == ["digger: depth is 3.0 m; give a value from 0.0 to 2.0 m (how deep)"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["-p", "depth:=3"], "digger: depth is 3.0 m; give a value from 0.0 to 2.0 m (how deep)"),
        (["-p", "depht:=1.5"], "digger: /digger has no parameter depht (did you mean 'depth'?)"),
        (["-p", "depth:=deep"], "digger: depth is 'deep'; give a finite number (how deep)"),
        (["-p", "depth"], "digger: the ROS arguments are invalid ("),
        (["--params-file", "none.yaml"], "digger: the ROS arguments are invalid ("),
        (["--frobnicate"], "digger: the ROS arguments are invalid (['--frobnicate']); correct"),
        (["-p", "act:=reject"], "digger: the ground is frozen; wait for summer"),
    ],
)
def test_invalid_arguments_give_exit_code_2_and_a_one_line_error(
    ros_domain: int, capfd: pytest.CaptureFixture[str], arguments: list[str], line: str
) -> None:
    assert run_here(*arguments) == 2
    errors = capfd.readouterr().err
    (error,) = [text for text in errors.splitlines() if text.startswith("digger: ")]
    assert error.startswith(line)
    assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("section", "is_used"),
    [("digger", True), ("/**", True), ("diger", False), ("/pit/digger", False)],
)
def test_parameter_file_without_parameters_of_the_node_is_a_warning(
    ros_domain: int,
    capfd: pytest.CaptureFixture[str],
    tmp_path: Path,
    section: str,
    is_used: bool,
) -> None:
    file = tmp_path / "digger.yaml"
    file.write_text(f"{section}:\n  ros__parameters:\n    depth: 1.5\n")
    run_here("--params-file", str(file), "-p", "act:=finish")
    output = "".join(capfd.readouterr())
    assert ("ready at 1.5" in output) == is_used
    assert (f"no parameter in {file} is for this node, /digger" in output) == (not is_used)


def test_integer_is_accepted_for_a_double_parameter(
    ros_domain: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_here("-p", "depth:=2", "-p", "act:=finish") == 3
    assert "ready at 2.0\n" in capsys.readouterr().out


def test_exception_in_a_callback_propagates_after_stop(
    ros_domain: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ZeroDivisionError, match="a bug"):
        run_here("-p", "act:=break")
    assert "stopped once\nstopped by ZeroDivisionError\n" in capsys.readouterr().out
    assert not rclpy.ok()


def test_error_of_stop_does_not_hide_the_one_before(
    ros_domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_here("-p", "act:=reject twice") == 2
    errors = [line for line in capfd.readouterr().err.splitlines() if line.startswith("digger: ")]
    assert errors == [
        "digger: the ground is frozen; wait for summer",
        "digger: the shovel is stuck",
    ]


def test_stop_can_see_the_error_that_ends_the_node(
    ros_domain: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_here("-p", "act:=reject") == 2
    assert "stopped once\nstopped by EarthmovingError\n" in capsys.readouterr().out


def test_repeated_interrupt_kills_a_hanging_node(ros_process: StartProcess) -> None:
    process = ros_process(DIGGER, parameters={"act": "hang"})
    process.wait_for_output("hanging")
    deadline = time.monotonic() + 20.0
    while process.running and time.monotonic() < deadline:
        process.interrupt()
        time.sleep(0.2)
    process.wait(expect=-signal.SIGINT)


def test_two_interrupts_at_once_count_as_one(ros_domain: int) -> None:
    assert run_here("-p", "act:=interrupt twice") == 0


def test_handlers_that_interrupt_one_another_end_the_node(ros_process: StartProcess) -> None:
    process = ros_process(DIGGER, parameters={"act": "interrupt the handler"})
    process.wait(expect=0)


def reject() -> Node:
    raise EarthmovingError("no")


def test_signal_handlers_are_restored(ros_domain: int) -> None:
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    assert run_here(make_node=reject) == 2
    assert [signal.getsignal(number) for number in numbers] == before
    assert not rclpy.ok()


def test_node_runs_outside_the_main_thread(ros_domain: int) -> None:
    codes = []
    thread = threading.Thread(target=lambda: codes.append(run_here("-p", "act:=finish")))
    thread.start()
    thread.join(20.0)
    assert codes == [3]


USAGE = NodeUsage("Dig a hole.", {"": DiggerParams})


def must_not_start() -> Node:
    raise AssertionError("the node was started")


@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_help_lists_parameters_and_topics_without_starting_ros(
    capsys: pytest.CaptureFixture[str], flag: str
) -> None:
    assert run_node(must_not_start, ["/bin/digger", flag], name="digger", usage=USAGE) == 0
    text = capsys.readouterr().out
    assert text.startswith("usage: digger ")
    assert "depth: float [m], 0 to 2, default 1.0\n      how deep\n" in text
    assert "Dig a hole." in text


def test_help_lists_the_endpoints_of_the_executable(capsys: pytest.CaptureFixture[str]) -> None:
    run_node(must_not_start, ["soil_sim", "--help"], name="soil_sim", usage=USAGE)
    text = capsys.readouterr().out
    assert "Subscribed topics:\n  <n>/soil_tick\n" in text
    assert "Services:\n  /sim/pause\n      std_srvs/srv/SetBool: pause" in text


@pytest.mark.parametrize("argument", ["--depth", "depth:=1", "file.yaml"])
def test_unknown_argument_gives_exit_code_2(
    capsys: pytest.CaptureFixture[str], argument: str
) -> None:
    assert run_node(must_not_start, ["/bin/digger", argument], name="digger", usage=USAGE) == 2
    assert capsys.readouterr().err.startswith(f"digger: unknown argument {argument!r}; ")


if __name__ == "__main__":
    sys.exit(run_node(Digger, name="digger"))
