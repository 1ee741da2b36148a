"""A machine is driven from a terminal."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import termios
from collections.abc import Callable, Sequence
from contextlib import suppress

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool
from support.node_scenes import Scene

from msg_bridge.testing.ros_context import Ros
from teleop.node import TeleopNode
from teleop.terminal_keys import END_SEQUENCE, QUERY, START_SEQUENCE

COMMAND = [sys.executable, "-m", "earthmoving_sim", "teleop"]


class FakeScreen:
    """A terminal that reports releases.

    Attributes:
        keys: the bytes that it sends next; None if it is closed.
        num_empty_reads: number of reads since the last byte.
        answers: whether it answers queries.
        lines: what it shows.
    """

    def __init__(self) -> None:
        self.keys: bytes | None = b"\x1b[?11u"
        self.num_empty_reads = 0
        self.answers = True
        self.lines: Sequence[str] = ()

    def read(self) -> bytes | None:
        keys, self.keys = self.keys, b"" if self.keys is not None else None
        self.num_empty_reads = 0 if keys else self.num_empty_reads + 1
        return keys

    def show(self, lines: Sequence[str]) -> None:
        self.lines = lines

    def write(self, sequence: bytes) -> None:
        assert sequence == QUERY
        if self.answers and self.keys is not None:
            self.keys += b"\x1b[?11u"

    @property
    def text(self) -> str:
        return "\n".join(self.lines)


@pytest.fixture
def swing_velocity(ros: Ros) -> Callable[[], float]:
    """Return a function of the velocity of the swing, which no limit of its angle ends."""
    states = ros.collect("/excavator/joint_states", JointState)

    def newest() -> float:
        ros.spin_until(lambda: states)
        return float(states[-1].velocity[states[-1].name.index("swing")])

    return newest


def test_held_key_moves_a_joint_until_it_is_released(
    ros: Ros, swing_velocity: Callable[[], float]
) -> None:
    scene = Scene(ros, sync="realtime")
    scene.machine()
    screen = FakeScreen()
    teleop = ros.add(TeleopNode, screen)
    ros.spin_until(lambda: "driving" in screen.text and "swing" in screen.text)
    screen.keys = b"\x1b[97u"  # left lever to the left
    ros.spin_until(lambda: swing_velocity() > 0.1)
    ros.spin_until(lambda: "[..........|##########]  swing" in screen.text)
    screen.keys = b"\x1b[97;1:3u"
    ros.spin_until(lambda: abs(swing_velocity()) < 0.01)
    screen.keys = b"\x1b[97u"
    ros.spin_until(lambda: swing_velocity() > 0.1)
    screen.keys = b" "
    ros.spin_until(lambda: abs(swing_velocity()) < 0.01 and "EMERGENCY STOP - " in screen.text)
    screen.keys = b"\x1b[97u"
    ros.spin_until(lambda: "emergency stop" in screen.text)  # of the machine's diagnostics
    assert abs(swing_velocity()) < 0.01
    screen.keys = b"\x1b[97;1:3ux"
    ros.spin_until(lambda: "driving" in screen.text)
    screen.keys = b"\x1b[97u"
    ros.spin_until(lambda: swing_velocity() > 0.1)
    ros.remove(teleop)  # its process has ended
    ros.spin_until(lambda: abs(swing_velocity()) < 0.01)


@pytest.mark.parametrize(
    ("start", "repetition"),
    [
        pytest.param(b"", b"k", id="terminal without releases"),
        pytest.param(b"\x1b[?11u\x1b[107u", b"\x1b[107;1:2u", id="terminal with releases"),
    ],
)
def test_key_held_through_a_stop_of_another_program_moves_nothing(
    ros: Ros, start: bytes, repetition: bytes
) -> None:
    messages = ros.collect("/excavator/joy", Joy)
    screen = FakeScreen()
    screen.keys = start
    ros.add(TeleopNode, screen)
    stop = ros.publisher("/excavator/emergency_stop", Bool, subscriptions=1)

    def hold_until(condition: Callable[[], bool]) -> None:
        def hold() -> bool:
            if screen.num_empty_reads >= 2:  # terminals repeat a key less often than it is read
                screen.keys = repetition
            return condition()

        ros.spin_until(hold)

    hold_until(lambda: bool(messages) and any(messages[-1].axes))
    stop.publish(Bool(data=True))
    hold_until(lambda: "EMERGENCY STOP - " in screen.text and not any(messages[-1].axes))
    count = len(messages)
    stop.publish(Bool(data=False))
    hold_until(lambda: "EMERGENCY STOP - " not in screen.text)
    num_released = len(messages)
    hold_until(lambda: len(messages) > num_released + 20)
    assert not any(any(message.axes) for message in messages[count:])


def test_held_key_is_released_when_the_terminal_no_longer_answers(ros: Ros) -> None:
    messages = ros.collect("/excavator/joy", Joy)
    screen = FakeScreen()
    screen.keys = b"\x1b[?11u\x1b[107u"
    ros.add(TeleopNode, screen)
    ros.spin_until(lambda: bool(messages) and any(messages[-1].axes))
    count = len(messages)
    ros.spin_until(lambda: len(messages) > count + 50)  # a second
    assert any(messages[-1].axes)
    screen.answers = False
    ros.spin_until(lambda: not any(messages[-1].axes))


@pytest.mark.parametrize(
    ("node", "key"),
    [
        ("site/digger/machine_sim", "emergency_stop"),
        ("site/machine_sim", "digger/emergency_stop"),
    ],
)
def test_emergency_stop_that_was_pressed_before_the_start_is_shown(
    ros: Ros, node: str, key: str
) -> None:
    screen = FakeScreen()
    ros.add(TeleopNode, screen, namespace="/site/digger")
    publisher = ros.publisher("/site/diagnostics", DiagnosticArray, subscriptions=1)

    def report(*values: KeyValue) -> None:
        status = DiagnosticStatus(name=f"{node}: run", values=values)
        publisher.publish(DiagnosticArray(status=[status]))

    report(KeyValue(key=key, value="True"), KeyValue(key="truck/emergency_stop", value="False"))
    ros.spin_until(lambda: "EMERGENCY STOP - " in screen.text)
    report(KeyValue(key=key, value="False"), KeyValue(key="truck/emergency_stop", value="True"))
    ros.spin_until(lambda: "EMERGENCY STOP - " not in screen.text)


@pytest.mark.parametrize(
    ("node", "is_own"),
    [
        ("site/digger/machine_sim", True),
        ("site/machine_sim", True),  # of several machines
        ("site/dig/machine_sim", False),
        ("site/digger_2/machine_sim", False),
        ("si/machine_sim", False),
        ("site/digger/viewer", False),
    ],
)
def test_only_diagnostics_of_its_machine_are_shown(ros: Ros, node: str, is_own: bool) -> None:
    screen = FakeScreen()
    ros.add(TeleopNode, screen, namespace="/site/digger")
    publisher = ros.publisher("/site/diagnostics", DiagnosticArray, subscriptions=1)
    last = DiagnosticStatus(name="site/digger/machine_sim: run", message="last")
    status = DiagnosticStatus(name=f"{node}: run", level=b"\x01", message="this one")
    publisher.publish(DiagnosticArray(status=[status]))
    if is_own:
        ros.spin_until(lambda: "WARN: this one" in screen.text)
    else:
        publisher.publish(DiagnosticArray(status=[last, status]))
        ros.spin_until(lambda: "  OK" in screen.text)


def test_machines_are_listed_while_there_is_none_of_the_name(ros: Ros) -> None:
    for machine in ("excavator", "site/truck"):
        ros.node("machine_sim", namespace=machine).create_publisher(
            JointState, f"/{machine}/applied_commands", 10
        )
    screen = FakeScreen()
    ros.add(TeleopNode, screen, namespace="/excvator")
    ros.spin_until(lambda: "--machine may be /excavator, /site/truck" in screen.text)
    states = ros.publisher("/excvator/joint_states", JointState, subscriptions=1)
    states.publish(JointState())
    ros.spin_until(lambda: "driving" in screen.text)


def test_axes_are_those_of_the_machine(ros: Ros) -> None:
    scene = Scene(ros)
    scene.machine(**{"commands.joy_pattern": "sae", "commands.joy_right_y": 8})
    messages = ros.collect("/excavator/joy", Joy)
    screen = FakeScreen()
    ros.add(TeleopNode, screen)
    ros.spin_until(lambda: "left lever, forward   [..........|..........]  boom" in screen.text)
    screen.keys = b"\x1b[105u"
    ros.spin_until(lambda: messages and messages[-1].axes[-1] == 1.0)
    assert len(messages[-1].axes) == 9


def test_closed_terminal_ends_the_node(ros: Ros) -> None:
    screen = FakeScreen()
    teleop = ros.add(TeleopNode, screen)
    screen.keys = None
    ros.spin_until(lambda: teleop.finished)


def test_command_drives_from_a_terminal_and_restores_it_also_while_suspended(ros: Ros) -> None:
    messages = ros.collect("/dumper/joy", Joy)
    master, terminal = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, "--machine", "dumper", "--speed", "50"],
        stdin=terminal,
        stdout=terminal,
        stderr=subprocess.PIPE,
        env={**os.environ, "TERM": "xterm"},
    )
    shown = b""
    initial_mode = termios.tcgetattr(terminal)

    def read() -> bytes:
        nonlocal shown
        with suppress(OSError):  # the program has closed its side
            while select.select([master], [], [], 0.0)[0]:
                shown += os.read(master, 4096)
        return shown

    try:
        ros.spin_until(lambda: START_SEQUENCE in read() and b"/dumper" in read() and messages)
        os.write(master, b"\x13w")  # Ctrl-S stops no output
        ros.spin_until(lambda: messages[-1].axes[1] == pytest.approx(0.55))  # beyond the deadzone
        ros.spin_until(lambda: messages[-1].axes[1] == 0.0)
        shown = b""
        process.send_signal(signal.SIGTSTP)
        ros.spin_until(lambda: END_SEQUENCE in read())
        os.waitid(os.P_PID, process.pid, os.WSTOPPED)
        assert termios.tcgetattr(terminal) == initial_mode
        process.send_signal(signal.SIGCONT)
        ros.spin_until(lambda: START_SEQUENCE in read() and b"/dumper" in read())
        os.write(master, b"\x13w")
        ros.spin_until(lambda: messages[-1].axes[1] == pytest.approx(0.55))
        shown = b""
        os.write(master, b"q")
        ros.spin_until(lambda: read() and process.poll() is not None)
        assert termios.tcgetattr(terminal) == initial_mode
    finally:
        process.kill()
        os.close(terminal)
        os.close(master)
        _, errors = process.communicate()
    assert (process.returncode, errors) == (0, b"")
    assert END_SEQUENCE in shown


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [([], "are no terminal"), (["--machine", "a b"], "--machine a b: Invalid namespace")],
)
def test_invalid_use_is_explained(arguments: list[str], reason: str) -> None:
    done = subprocess.run(
        [*COMMAND, *arguments], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert reason in done.stderr
