"""RunMonitor: a run is not started beside another one with the same topics."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions

from earthmoving_sim.multi_process.node_process import NodeProcessError
from earthmoving_sim.multi_process.run_monitor import RunMonitor
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
