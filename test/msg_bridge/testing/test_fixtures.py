"""The fixtures users get: a domain of one's own, nodes in the test, nodes as processes."""

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from msg_bridge.codec.qos import TRANSIENT_LOCAL
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter
from msg_bridge.dds_profile import PROFILE_VARIABLE
from msg_bridge.nodes.ros_parameters import declare_parameters
from msg_bridge.testing import ros_domain as domain
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import LeakedNodesError, Ros
from msg_bridge.testing.ros_domain import NoFreeDomainError, reserve_domain

# Node executable that publishes its parameter `text` and ends with `exit_code`.
ECHO = """\
import sys
from rclpy.node import Node
from std_msgs.msg import String
from msg_bridge.codec.qos import TRANSIENT_LOCAL
from msg_bridge.nodes.process_main import run_node

class Echo(Node):
    def __init__(self):
        super().__init__("echo")
        self.exit_code = self.declare_parameter("exit_code", 0).value
        text = self.declare_parameter("text", "").value
        self.create_publisher(String, "texts", TRANSIENT_LOCAL).publish(String(data=text))
        print("ready to echo", text)

sys.exit(run_node(Echo, name="echo"))
"""


@pytest.fixture
def echo(tmp_path: Path) -> list[str]:
    script = tmp_path / "echo.py"
    script.write_text(ECHO)
    return [sys.executable, str(script)]


@dataclass(frozen=True)
class HelloParams(Parameters):
    greeting: str = parameter("hello", "what to say")
    times: int = parameter(1, "how often", low=1, high=3)


class Hello(Node):
    """Node of a user of the fixtures."""

    def __init__(self, **kwargs):
        super().__init__("hello", **kwargs)
        self.params = declare_parameters(self, HelloParams)
        publisher = self.create_publisher(String, "texts", TRANSIENT_LOCAL)
        publisher.publish(String(data=self.params.greeting))
        self.create_service(Trigger, "ask", self.answer)

    def answer(self, request, response):
        response.message = self.params.greeting
        return response


def test_environment_puts_subprocesses_into_the_domain(ros_domain: int) -> None:
    assert os.environ["ROS_DOMAIN_ID"] == str(ros_domain)
    assert Path(os.environ[PROFILE_VARIABLE]).name == "fastdds_localhost.xml"


def test_processes_at_once_get_different_domains(tmp_path: Path, ros_domain: int) -> None:
    # The domain that a process tries first follows from its pid. With the same pid, both try the
    # domain of this test first, so only the locks separate them.
    (tmp_path / "conftest.py").write_text(
        "from unittest import mock\n"
        f"with mock.patch('os.getpid', return_value={ros_domain - 1}):\n"
        "    import msg_bridge.testing.ros_domain\n"
        'pytest_plugins = ["msg_bridge.testing.fixtures"]\n'
    )
    # Keeps its domain until the other process has one.
    (tmp_path / "test_domain.py").write_text(
        "import time\n"
        "from pathlib import Path\n"
        "def test_domain(ros_domain):\n"
        "    here = Path(__file__).parent\n"
        "    (here / f'has_{ros_domain}').touch()\n"
        "    deadline = time.monotonic() + 20\n"
        "    while len(list(here.glob('has_*'))) < 2:\n"
        "        assert time.monotonic() < deadline, 'both have the same domain'\n"
        "        time.sleep(0.02)\n"
    )
    root = str(Path(__file__).parents[3])
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    both = [
        subprocess.Popen(
            [*command, f"--basetemp={tmp_path / name}"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": root},
            stdout=subprocess.PIPE,
            text=True,
        )
        for name in "ab"
    ]
    for process in both:
        output, _ = process.communicate(timeout=60)
        assert process.returncode == 0, output
    taken = {path.name for path in tmp_path.glob("has_*")}
    assert f"has_{ros_domain}" not in taken


def test_domain_is_released_at_the_end_of_its_test(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with reserve_domain() as one, reserve_domain() as other:  # no other test uses them meanwhile
        monkeypatch.setattr(domain, "TEST_DOMAIN_IDS", (one, other))
        with reserve_domain(tmp_path) as first, reserve_domain(tmp_path) as second:
            assert {first, second} == {one, other}
            with pytest.raises(NoFreeDomainError), reserve_domain(tmp_path):
                pass
        with reserve_domain(tmp_path) as again:
            assert again in (one, other)


def test_domain_in_which_a_node_runs_is_not_taken(
    ros: Ros, ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(domain, "TEST_DOMAIN_IDS", (ros_domain,))
    ros.add(Hello)
    with pytest.raises(NoFreeDomainError), reserve_domain(tmp_path):
        pass


def test_node_gets_parameters_and_namespace(ros: Ros) -> None:
    node = ros.add(Hello, parameters={"greeting": "good day"}, namespace="/site")
    assert node.params == HelloParams(greeting="good day")
    assert node.get_fully_qualified_name() == "/site/hello"


def test_unknown_parameter_is_an_error(ros: Ros) -> None:
    with pytest.raises(ParameterError, match=r"no parameter greting \(did you mean 'greeting'\?\)"):
        ros.add(Hello, parameters={"greting": "good day"})


def test_node_whose_constructor_fails_is_removed_from_the_graph(ros: Ros) -> None:
    with pytest.raises(ParameterError, match="from 1 to 3") as caught:
        ros.add(Hello, parameters={"times": 4})
    assert "/hello" not in ros.node_names()
    assert caught.tb is not None  # the traceback keeps the node alive


def test_transient_local_messages_from_before_are_collected(ros: Ros) -> None:
    ros.add(Hello)
    received = ros.collect("texts", String, TRANSIENT_LOCAL)
    ros.spin_until(lambda: received)
    assert [msg.data for msg in received] == ["hello"]


def test_publisher_waits_for_its_subscriptions(ros: Ros) -> None:
    received = ros.collect("orders", String)
    ros.publisher("orders", String, subscriptions=1).publish(String(data="dig"))
    ros.spin_until(lambda: len(received) == 1)


def test_service_can_be_called(ros: Ros) -> None:
    ros.add(Hello)
    assert ros.call(Trigger, "ask", Trigger.Request()).message == "hello"


def test_error_names_a_missing_service(ros: Ros) -> None:
    with pytest.raises(AssertionError, match="waiting for: the service ask"):
        ros.call(Trigger, "ask", Trigger.Request(), timeout=0.1)


def test_error_names_the_condition_that_was_not_met(ros: Ros) -> None:
    received = []
    with pytest.raises(
        AssertionError, match=r"0\.1 s passed while waiting for: .*len\(received\) > 3"
    ):
        ros.spin_until(lambda: len(received) > 3, timeout=0.1)
    with pytest.raises(AssertionError, match="waiting for: the bucket is full"):
        ros.spin_until(lambda: False, timeout=0.1, what="the bucket is full")


def test_exception_in_a_callback_reaches_the_test(ros: Ros) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    ros.node().create_timer(0.001, fail)
    with pytest.raises(ZeroDivisionError):
        ros.spin_until(lambda: False, timeout=5.0)


def test_removed_node_leaves_the_graph(ros: Ros) -> None:
    node = ros.add(Hello)
    ros.spin_until(lambda: "/hello" in ros.node_names())
    ros.remove(node)
    ros.spin_until(lambda: "/hello" not in ros.node_names())


def test_leaked_nodes_are_reported(ros_domain: int) -> None:
    made = Ros(ros_domain)
    made.node("known")
    done = Node("destroyed", context=made.context)
    done.destroy_node()
    left = Node("left", context=made.context)
    with pytest.raises(LeakedNodesError, match="did not destroy the nodes /left;"):
        made.close()
    assert next(left.publishers, None) is None  # it has been destroyed


def test_process_gets_parameters_and_names(
    ros: Ros, ros_process: StartProcess, echo: list[str]
) -> None:
    process = ros_process(echo, parameters={"text": "1.0"}, namespace="/site", name="parrot")
    received = ros.collect("/site/texts", String, TRANSIENT_LOCAL)
    ros.spin_until(lambda: received and "/site/parrot" in ros.node_names())
    assert received[0].data == "1.0"
    assert process.wait_for_output("ready to echo (.*)")[1] == "1.0"
    assert process.stop() == 0
    assert not process.running


def test_unexpected_exit_code_is_an_error_with_the_output(
    ros_process: StartProcess, echo: list[str]
) -> None:
    process = ros_process(echo, parameters={"exit_code": 3})
    process.wait_for_output("ready")
    with pytest.raises(AssertionError, match=r"ended with 0; its exit code is 3(.|\n)*ready to"):
        process.stop(signal.SIGTERM)


def test_waiting_ends_when_a_process_does(ros: Ros, ros_process: StartProcess) -> None:
    ros_process([sys.executable, "-c", "print('no licence'); raise SystemExit(4)"])
    with pytest.raises(AssertionError, match=r"exit code is 4(.|\n)*no licence(.|\n)*the soil"):
        ros.spin_until(lambda: False, what="the soil")


def test_waiting_for_output_ends_when_the_process_does(ros_process: StartProcess) -> None:
    process = ros_process([sys.executable, "-c", "print('no licence')"])
    with pytest.raises(AssertionError, match=r"ended without writing 'ready'(.|\n)*no licence"):
        process.wait_for_output("ready")


def run_test(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    """Run the tests of a text by pytest in a process of its own."""
    (folder / "conftest.py").write_text('pytest_plugins = ["msg_bridge.testing.fixtures"]\n')
    (folder / "test_inner.py").write_text(text)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(folder)]
    return subprocess.run(
        [*command, f"--basetemp={folder / 'base'}"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_process_left_running_is_killed_and_its_output_shown(
    tmp_path: Path, ros_domain: int
) -> None:
    done = run_test(
        tmp_path,
        "import sys\n"
        "CODE = 'import os, time; print(\"pid\", os.getpid()); time.sleep(600)'\n"
        "def test_left(ros_process):\n"
        "    ros_process([sys.executable, '-c', CODE]).wait_for_output('pid')\n"
        "    assert False\n",
    )
    assert done.returncode == 1, done.stdout
    after = done.stdout.split("--- output of ")[1]
    pid = int(after.split("\npid ")[1].split()[0])
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_process_that_crashed_unseen_fails_its_test(tmp_path: Path, ros_domain: int) -> None:
    done = run_test(
        tmp_path,
        "import sys\n"
        "def run(ros_process, code):\n"
        "    process = ros_process([sys.executable, '-c', f'print(1 / {code}); exit({code})'])\n"
        "    while process.running:\n"
        "        pass\n"
        "    return process\n"
        "def test_crash(ros_process):\n"
        "    run(ros_process, 0)\n"
        "def test_waited_for(ros_process):\n"
        "    run(ros_process, 3).wait(expect=3)\n",
    )
    assert done.returncode == 1, done.stdout
    assert "2 passed, 1 error" in done.stdout
    assert "has ended unexpectedly; its exit code is 1" in done.stdout
    assert "ZeroDivisionError" in done.stdout
