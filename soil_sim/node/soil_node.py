"""The soil node: owns the terrain, keeps the time and is the barrier of the tick.

`soil_sim.node.soil_run` decides when a tick is due and `soil_sim.endpoint` computes it; callbacks
only pass messages on. Services are in `soil_sim.node.services`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from functools import partial
from typing import Any

from builtin_interfaces.msg import Time

from msg_bridge.codec.exchange_key import ExchangeKey
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.state_hash import StateHash
from msg_bridge.codec.terrain import TERRAIN_CELL
from msg_bridge.contract import topics
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import Message
from msg_bridge.kernels import log_compilation, warn_of_compilation
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.duplicate_node import check_no_other_node
from msg_bridge.nodes.endpoint_monitor import EndpointMonitor
from msg_bridge.nodes.process_main import run_node
from msg_bridge.nodes.ros_parameters import declare_parameters, on_parameter_change
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.subscriber_matching import unmatched_topics
from msg_bridge.nodes.subscription_poller import SubscriptionPoller
from msg_bridge.nodes.wait_log import Wait, WaitLog
from msg_bridge.recovery.config_comparison import find_config_difference
from msg_bridge.recovery.errors import ChangedParametersError, RecoveryError
from msg_bridge.recovery.node_recovery import NodeRecovery
from msg_bridge.recovery.params import RecoveryParams
from msg_bridge.recovery.run_journal import SavedRun
from soil_sim.endpoint import SoilTickResult
from soil_sim.node.imbalance_report import EXIT_IMBALANCE, ImbalanceReport
from soil_sim.node.membership_log import MembershipLog
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.run_config import find_input_files, run_config
from soil_sim.node.services import SoilServices
from soil_sim.node.soil_diagnostics import SoilDiagnostics
from soil_sim.node.soil_journal import ResentTick, SoilJournal, restore
from soil_sim.node.soil_publishers import SoilPublishers
from soil_sim.node.soil_run import SoilRun
from soil_sim.node.soil_transport import SoilTransport
from soil_sim.node.soil_waits import find_soil_waits
from soil_sim.node.terrain_publication import TerrainPublication
from soil_sim.node.usage import USAGE
from soil_sim.site.site import Site, SiteParams, make_site
from soil_sim.slope_failure import surface_tilt
from soil_sim.soils.params import SoilParams
from soil_sim.warm_up import warm_up

__all__ = ["SoilNode", "main"]

_RETRANSMIT_PERIOD = 0.25
"""Wall clock time without a tick after which missing messages are requested again [s]."""

_DISCOVERY_TIME = 0.5
"""Wall time from the start in which the process looks for another soil node [s]."""

_CHANGEABLE = (
    *("machine_timeout", "map_rate", "view_region", "view_decimation", "hash_rate", "save_path"),
)
"""Parameters that may be set while the node runs."""


class SoilNode(SimNode):
    """Node of the terrain, the tick and the ledger.

    Attributes:
        run: the current run of the soil.
        diagnostics: diagnostics of the node.
        membership_log: reports which machines join, leave or are dropped.
    """

    def __init__(self, *, discovery_time: float = 0.0, **kwargs: Any) -> None:
        """
        Args:
            discovery_time: minimum wall time in which another soil node on the same topics is
                looked for [s], the time to load the kernels included; 0: none is looked for.
            kwargs: arguments of `rclpy.node.Node`.

        Raises:
            DuplicateNodeError: another soil node publishes the same topics.
            EarthmovingError: a parameter is invalid, or a terrain file cannot be read.
        """
        super().__init__("soil_sim", **kwargs)
        deadline = time.monotonic() + discovery_time
        self._params = declare_parameters(self, SoilNodeParams, changeable=_CHANGEABLE)
        self._site_params = declare_parameters(self, SiteParams, "site.")
        self._soil_params = declare_parameters(self, SoilParams, "soil.")
        recovery = declare_parameters(self, RecoveryParams, "recovery.")
        self._site = make_site(self._site_params)
        with log_compilation(self.get_logger().info):
            warm_up(self._soil_params)  # compilation in a tick would make it late
        warn_of_compilation(self.get_logger().warning)
        if discovery_time > 0.0:
            remedy = "give each soil node its own namespace or ROS_DOMAIN_ID"
            check_no_other_node(self, [topics.SOIL_TICK], deadline, remedy=remedy)
        self._input_files = find_input_files(self._site_params, self._soil_params)
        key = ExchangeKey.read(self._params.exchange_key_file)  # a failure must not begin a run
        self._recovery = NodeRecovery.of_node(recovery, self)
        self._resent_ticks: list[ResentTick] = []
        saved = self._recovery.saved_run()
        self._is_continued = False
        self.run = self._make_run() if saved is None else self._continued_run(saved)
        required = bool(self._params.required_subscribers)
        self.run.waiting_for_subscribers = required or self._is_continued
        self.diagnostics = Diagnostics(self, "soil_sim", simulation_namespace=self.get_namespace())
        self._recovery.report_to(self.diagnostics)
        self._soil_diagnostics = SoilDiagnostics(self, self.diagnostics, self.run, self._params)
        noisy = self._soil_params.surface_tilt_noise > 0.0
        self._soil_publishers = SoilPublishers(
            self,
            design=self._site.design is not None,
            tilt=surface_tilt(self._soil_params, self._site.grid) if noisy else None,
        )
        self._poller = SubscriptionPoller(self, self.advance)
        self._transport = SoilTransport(
            self,
            self._poller,
            self._receive,
            self._send_terrain,
            self.diagnostics.reject,
            key,
        )
        self._missing_subscribers: list[str] = []
        self._imbalance_report = ImbalanceReport(self.get_logger(), self.diagnostics)
        self.membership_log = MembershipLog(
            self.get_logger(), self.diagnostics, self._transport.machines
        )
        self._terrain = TerrainPublication(self, self._soil_publishers, self.run)
        self._last_tick_time = time.monotonic()
        self.publish_run_start(is_continued=self._is_continued)
        if self._params.sync == "realtime":
            self._timer = self.create_timer(self._params.tick_period, self._on_timer)
        self.create_timer(_RETRANSMIT_PERIOD, self._check_progress)
        on_parameter_change(self, SoilNodeParams, "", _CHANGEABLE, self._set_params)
        self._soil_services = SoilServices(self)
        WaitLog(self, self.diagnostics, self._find_waits)
        EndpointMonitor(self, self.diagnostics)

    def _make_run(self, run_id: int | None = None) -> SoilRun:
        """Return a run on the initial terrain.

        Args:
            run_id: its number; None: a higher one than those of earlier runs.
        """
        if run_id is None:
            found = self._recovery.found
            run_id = max(int(time.time()), 0 if found is None else found.begin.run_id + 1)
        journal = SoilJournal(self._recovery.journal)
        return SoilRun(
            self._site,
            self._soil_params,
            self._params,
            run_id=run_id,
            journal=journal,
            terrain_by_transport=True,
        )

    def _continued_run(self, saved: SavedRun) -> SoilRun:
        """Return a saved run as it was when its process ended, or a new one if that fails.

        Raises:
            ChangedParametersError: the node has other parameters than the run.
        """
        run = self._make_run(saved.begin.run_id)
        ignored = {f"soil_sim.{name}" for name in _CHANGEABLE}
        difference = find_config_difference(saved.begin.config, self._config(run), ignored=ignored)
        if difference:
            raise ChangedParametersError(difference)
        try:
            restored = restore(saved, run.endpoint, run.time_control)
        except RecoveryError as error:
            self._recovery.reject(str(error))
            return self._make_run()
        run.resume(restored)
        self._is_continued = True
        self._resent_ticks = restored.last_ticks
        self._recovery.resume(saved, f"run {saved.begin.run_id} at tick {run.tick}")
        return run

    def _config(self, run: SoilRun) -> str:
        """Return the configuration of a run [YAML]."""
        params = self._params, self._site_params, self._soil_params
        return run_config(run.endpoint, self._site, *params, self._input_files)

    def stop(self) -> None:
        """End the run: a node that is started later does not continue it."""
        self._recovery.end()

    def destroy_node(self) -> None:
        """Destroy the node and close its journal."""
        recovery = getattr(self, "_recovery", None)  # missing if a parameter was invalid
        if recovery is not None:
            recovery.close()
        super().destroy_node()

    @property
    def site(self) -> Site:
        """Initial terrain of every run."""
        return self._site

    @property
    def exit_code(self) -> int:
        """Exit code of the process: `EXIT_IMBALANCE` if soil was lost or created, else 0."""
        return EXIT_IMBALANCE if self._imbalance_report.has_occurred else 0

    @property
    def params(self) -> SoilNodeParams:
        """Current parameters of the node."""
        return self._params

    @property
    def num_pending_steps(self) -> int:
        """Number of requested single steps that wait for their tick."""
        return self._soil_services.num_pending_steps

    def last_message_times(self) -> dict[int, float]:
        """Return the monotonic time [s] of the last message of each machine, by machine id."""
        return self._transport.last_message_times

    def _set_params(self, params: SoilNodeParams) -> None:
        self._params = self.run.params = params

    def reset(self, *, after: int = 0) -> None:
        """Begin the next run; see `SoilRun.reset`."""
        self._soil_services.cancel_steps()
        self.run.reset(after=after)
        self.diagnostics.clear()
        self.publish_run_start()

    # Ticks.

    def _receive(self, message: Message) -> bool:
        if self.run.is_number_taken(message):
            self.get_logger().info(
                f"a machine takes part in run {message.run_id} of an earlier soil: the next begins"
            )
            self.reset(after=message.run_id)
        return self.run.endpoint.receive(message)

    def _on_timer(self) -> None:
        until_next = 1e-9 * self._timer.time_until_next_call()
        self.run.on_timer(time.monotonic() + until_next - self._params.tick_period)
        self.advance()

    def advance(self) -> None:
        """Compute all ticks that are due and complete, and send the waiting messages."""
        start = time.monotonic()
        try:
            while (done := self.run.advance(start)) is not None:
                self._publish(done)
                end = time.monotonic()
                self._soil_diagnostics.record_tick(end - start, done.step.map_updates)
                start = end
        except ExchangeError as error:
            if error.code not in (ErrorCode.ROW_DIGEST, ErrorCode.DEPOSIT_VOLUME):
                raise
            self.diagnostics.reject(topics.SOIL_TOOL_SWEEPS, error.coded_message)
        self._poller.set_polling(self.run.endpoint.exchange.is_missing_rows)
        self._transport.send(self.run.endpoint.drain_outbox(), self._stamp())

    def _publish(self, done: SoilTickResult) -> None:
        tick, stamp = done.ledger.tick, self._stamp()
        self._last_tick_time = time.monotonic()
        self._transport.send(self.run.endpoint.drain_outbox(), stamp)
        self._soil_publishers.tick(done.ledger, stamp)
        exchange = self.run.endpoint.exchange
        self.membership_log.update(exchange.joined, tick, exchange.accounts.ended_volumes)
        self._terrain.update(tick, done.step.map_updates, stamp)
        if tick % max(1, round(1.0 / (self._params.hash_rate * self._params.tick_period))) == 0:
            self._publish_state_hash()
        for reason in done.step.rejected_tools:
            self.diagnostics.reject(topics.SOIL_TOOL_SWEEPS, reason)
        self._imbalance_report.check(done.ledger)
        self._soil_services.on_tick(tick)
        self.run.checkpoint_if_due()

    def _publish_state_hash(self) -> None:
        run_id, tick = self.run.endpoint.exchange.run_id, self.run.tick
        digest = self.run.endpoint.soil.state_hash()
        self._soil_publishers.state_hash(StateHash(run_id, tick, self._stamp(), digest))

    def _stamp(self) -> Time:
        return stamp_from_tick(max(self.run.tick, 0), self._params.tick_period)

    # Published topics.

    def publish_run_start(self, *, is_continued: bool = False) -> None:
        """Publish configuration and terrain of a run.

        Args:
            is_continued: whether another process has begun it; else its journal begins.
        """
        exchange, grid = self.run.endpoint.exchange, self.run.endpoint.soil.grid
        self._last_tick_time = time.monotonic()
        self._soil_diagnostics.start_run()
        self.membership_log.start_run(exchange.joined, exchange.accounts.ended_volumes)
        self._imbalance_report.start_run()
        config = self._config(self.run)
        if not is_continued:
            self.get_logger().info(
                f"run {exchange.run_id} started: terrain of {grid.rows} x {grid.cols} columns of"
                f" {grid.cell:g} m, {self._params.sync}"
            )
            self.run.journal.begin(exchange.run_id, config)
        self._soil_publishers.begin(grid, config, self._stamp())
        self._terrain.begin(self._stamp())
        self.publish_paused()

    def publish_paused(self) -> None:
        """Publish whether time stands still."""
        self._soil_publishers.paused(self.run.paused)

    def _send_terrain(self) -> None:
        """Publish the terrain for a machine that joins."""
        self._terrain.send_all(self._stamp())
        grid = self.run.endpoint.soil.grid
        num_bytes = grid.rows * grid.cols * TERRAIN_CELL.itemsize
        self.run.expect_keyframe(time.monotonic(), num_bytes)

    # Missing messages and silent machines.

    def _check_progress(self) -> None:
        """Request missing messages again and drop silent machines."""
        now = time.monotonic()
        self._terrain.update_for_new_subscribers(self._stamp())
        if self.run.waiting_for_subscribers:
            missing = unmatched_topics(self, self._params.required_subscribers)
            self._missing_subscribers = missing
            self.run.waiting_for_subscribers = bool(missing) or self._recovery.is_settling
            if not self.run.waiting_for_subscribers:
                self._resend_last_ticks()
        elif self.run.tick >= 0 and now - self._last_tick_time >= _RETRANSMIT_PERIOD:
            self._republish_state()
        elif self.run.realtime and self.run.endpoint.exchange.late:
            self.run.endpoint.exchange.request_missing()  # ticks continue without a late machine
        for silent in self.run.check_silent_machines(now, self.last_message_times()):
            if silent.is_dropped:
                self.membership_log.drop(silent, self.run.tick)
        self.advance()

    def _resend_last_ticks(self) -> None:
        """Publish again what the process before may not have sent before it died."""
        for ledger, messages in self._resent_ticks:
            stamp = stamp_from_tick(ledger.tick, self._params.tick_period)
            self._transport.send(messages, stamp)
            self._soil_publishers.tick(ledger, stamp)
        self._resent_ticks.clear()

    def _republish_state(self) -> None:
        """Publish the state again for subscribers that appeared while time stands still."""
        endpoint = self.run.endpoint
        endpoint.exchange.request_missing()
        if endpoint.exchange.ledger is not None:
            self._soil_publishers.tick(endpoint.exchange.ledger, self._stamp())
            self._publish_state_hash()
        self._terrain.publish_if_changed(self._stamp())

    def _find_waits(self) -> Iterable[Wait]:
        return find_soil_waits(
            self.run, self._missing_subscribers, self._transport.machines, self.last_message_times()
        )


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    make_node = partial(SoilNode, discovery_time=_DISCOVERY_TIME)
    return run_node(make_node, args, name="soil_sim", usage=USAGE)


if __name__ == "__main__":
    sys.exit(main())
