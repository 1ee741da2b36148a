"""RunMonitor: lines of progress; a run is not started beside another one on the same topics."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.signals import SignalHandlerOptions

from earthmoving_sim.multi_process.node_process import NodeProcessError
from earthmoving_sim.multi_process.run_monitor import RunMonitor, startup_line
from msg_bridge.testing.ros_context import Ros


@pytest.fixture
def monitor(ros: Ros) -> Iterator[RunMonitor]:
    """Return a monitor in the domain of the test, and in the default context."""
    rclpy.init(args=[], domain_id=ros.domain, signal_handler_options=SignalHandlerOptions.NO)
    monitor = RunMonitor(1, 0.01, realtime=False)
    yield monitor
    monitor.close()
    rclpy.shutdown()


def test_soil_node_in_the_same_namespace_is_an_error(ros: Ros, monitor: RunMonitor) -> None:
    ros.node("soil_sim")
    with pytest.raises(NodeProcessError, match="soil_sim"):
        monitor.check_no_other_simulation()


def test_soil_node_in_another_namespace_is_no_error(ros: Ros, monitor: RunMonitor) -> None:
    ros.node("soil_sim", namespace="/site_a")
    monitor.check_no_other_simulation()


def test_line_of_progress_has_the_size_of_the_bag_and_what_an_operator_waits_for(
    ros: Ros, monitor: RunMonitor, capsys: pytest.CaptureFixture[str]
) -> None:
    values = {"bytes": "338000000", "bytes_on_disk": "87000000"}
    statuses = {
        "soil_sim": {"tick": "100"},
        "exchange_recorder": values,
        "dig_operator": {"waiting_for": "the truck"},
    }
    message = DiagnosticArray(
        status=[
            DiagnosticStatus(
                name=f"{node}: {node}", values=[KeyValue(key=k, value=v) for k, v in each.items()]
            )
            for node, each in statuses.items()
        ]
    )
    publisher = ros.publisher("/diagnostics", DiagnosticArray, 10, subscriptions=1)
    publisher.publish(message)
    output = ""
    while not output:
        monitor.spin([])
        output = capsys.readouterr().out
    assert output.endswith("bag    87 MB  excavator waits for the truck\n")


def test_duration_of_compilation_is_stated_only_while_a_node_compiles() -> None:
    waiting = startup_line(15.0, "soil_sim is waiting for a machine")
    assert waiting == "starting, 15 s: soil_sim is waiting for a machine"
    assert "minutes" in startup_line(5.0, "soil_sim is compiling kernels: 3 of 90, 2 s")
