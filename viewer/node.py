"""The viewer as a ROS 2 node: subscribes to public topics and serves the live page.

The ROS executor runs in the main thread and the web server in a second one. They share the scene,
which has a lock; requests of pages reach the ROS thread through `RosBackend`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

from msg_bridge.contract import topics
from msg_bridge.contract.loopback import is_loopback
from msg_bridge.contract.topics import resolve
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.process_main import run_node
from msg_bridge.nodes.ros_parameters import declare_parameters
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.wait_log import Wait, WaitLog
from viewer.address import page_address
from viewer.params import ViewerParams
from viewer.recording import RecorderProcess
from viewer.ros_backend import RosBackend
from viewer.scene.scene import Scene
from viewer.server.access import AccessPolicy, make_token
from viewer.server.backend import Permissions, Source
from viewer.server.encoding import SceneEncoder
from viewer.server.hub import Hub
from viewer.server.web_server import WebServer
from viewer.sources.bag_folder import BagFolder
from viewer.sources.live import LiveSource
from viewer.usage import USAGE

__all__ = ["ViewerNode", "main"]


class ViewerNode(SimNode):
    """Shows a simulation on a page.

    Attributes:
        scene: what is shown.
        server: the web server.
        address: address of the page, with its token.
        diagnostics: the node's part of `/diagnostics`.
    """

    def __init__(self, **kwargs: Any) -> None:
        """
        Args:
            kwargs: arguments of `rclpy.node.Node`; the namespace is that of the simulation.

        Raises:
            EarthmovingError: a parameter is not valid, or the server cannot listen.
        """
        super().__init__("viewer", **kwargs)
        params = declare_parameters(self, ViewerParams)
        simulation = params.simulation_namespace or self.get_namespace()
        self.diagnostics = Diagnostics(self, simulation_namespace=simulation)
        self._num_rejected = 0
        self.scene = Scene()
        self._recorder = None
        if params.bags is not None and params.allow_recording:
            self._recorder = RecorderProcess(params.bags, simulation)
        self._live = LiveSource(
            self,
            self.scene,
            self.diagnostics.reject,
            simulation_namespace=simulation,
            on_machine=self._on_machine,
        )
        self._backend = RosBackend(
            self, self._live.writer, simulation_namespace=simulation, recorder=self._recorder
        )
        for machine in self._live.machines:
            self._backend.add_machine(machine)
        token = params.token or ("" if is_loopback(params.address) else make_token())
        self._hub = Hub(
            AccessPolicy(params.address, token, params.allowed_origins),
            server_name="earthmoving_sim viewer",
            frame_rate=params.frame_rate,
            max_clients=params.max_clients,
            permissions=Permissions(
                params.allow_driving, params.allow_simulation_control, params.allow_recording
            ),
            live=Source(SceneEncoder(self.scene), f"simulation {simulation}"),
            backend=self._backend,
            library=None if params.bags is None else BagFolder(params.bags, params.max_bag_players),
        )
        self.diagnostics.add_task(self._update_diagnostics)
        self._config_topic = resolve(topics.SIM_CONFIG, simulation)
        WaitLog(self, self.diagnostics, self._find_waits)
        self.server = WebServer(self._hub, params.address, params.port)
        self.address = page_address(params.address, self.server.port, token)
        print(f"viewer: open {self.address}", flush=True)

    def stop(self) -> None:
        """Release all levers, close the server and end a recording."""
        self.server.stop()
        self._backend.run_queue()
        if self._recorder is not None:
            self._recorder.close()

    def destroy_node(self) -> None:
        """Stop the server with the node."""
        server = getattr(self, "server", None)
        if server is not None:
            server.stop()
        super().destroy_node()

    def _on_machine(self, machine: str) -> None:
        backend = getattr(self, "_backend", None)  # machines found first are added later
        if backend is not None:
            backend.add_machine(machine)

    def _find_waits(self) -> Iterator[Wait]:
        """Yield what the node waits for now."""
        if self.scene.terrain.tiles is None:
            yield Wait(f"{self._config_topic} and the terrain map", "is a soil_sim running?")

    def _update_diagnostics(self) -> None:
        """Set the counters of the server, and warn of rejected messages and losses."""
        statistics = self._hub.statistics
        clients = statistics.clients()
        self.diagnostics.set("clients", len(clients))
        self.diagnostics.set("max_latency_ms", round(1e3 * max(clients.values(), default=0.0), 1))
        drivers = (f"{machine}: viewer {n}" for machine, n in statistics.drivers.items())
        self.diagnostics.set("drivers", ", ".join(drivers) or "none")
        self.diagnostics.set("terrain_gaps", self.scene.terrain.gaps)
        rejections, last = statistics.rejections()
        for code, count in rejections.items():
            self.diagnostics.set(f"rejected {code}", count)
        total = sum(rejections.values())
        if total > self._num_rejected:
            self._num_rejected = total
            self.diagnostics.reject("the page", last)
        if self._recorder is not None:
            self._recorder.update()
            failure = self._recorder.state.failure
            if failure:  # until the next recording starts
                self.diagnostics.problem(failure, condition="recording")
            else:
                self.diagnostics.clear("recording")


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    return run_node(ViewerNode, args, name="viewer", usage=USAGE)


if __name__ == "__main__":
    sys.exit(main())
