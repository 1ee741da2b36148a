"""The soil's node: keeps time, does a tick of the soil when it is due, and tells everybody.

It owns the terrain and is the barrier of the tick. When a tick is due is told by `soil_sim.node.soil_run`,
what the soil does in it by `soil_sim.endpoint`; callbacks here only hand over.
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from msg_bridge.codec.cut_fill import CutFillState
from msg_bridge.codec.run_config import RunFacts, SoilKind, to_config_yaml
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.state_hash import StateHash
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Keyframe, Message
from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.process_main import run_node
from msg_bridge.nodes.ros_parameters import declare_parameters, on_parameter_change
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.subscriber_matching import unmatched_topics
from msg_bridge.nodes.subscription_poller import SubscriptionPoller
from soil_sim.endpoint import SoilTickResult
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_publishers import SoilPublishers
from soil_sim.node.soil_run import SilentMachine, SoilRun
from soil_sim.node.soil_transport import SoilTransport
from soil_sim.node.usage import USAGE
from soil_sim.site.site import SiteParams, make_site
from soil_sim.slope_failure import surface_tilt
from soil_sim.soils.params import SoilParams
from soil_sim.terrain import HeightMap, Layers, save_terrain
from soil_sim.warm_up import warm_up

__all__ = ["SoilNode", "main"]

_RETRANSMIT_PERIOD = 0.25
"""Wall time without a tick after which what is missing is asked for again [s]."""

_MAX_CELLS_AT_FULL_RATE = 513 * 513
"""Cells above which terrain maps are published less often."""


_CHANGEABLE = ("machine_timeout", "map_period", "hash_period", "save_path")
"""Parameters that may be set while the node runs."""


class SoilNode(SimNode):
    """Terrain, tick, ledger.

    Attributes:
        run: the soil in time.
        diagnostics: what `/diagnostics` says of it.
    """

    def __init__(self, **kwargs: Any) -> None:
        """
        Args:
            kwargs: for `rclpy.node.Node`.

        Raises:
            EarthmovingError: a bad parameter, or ground that cannot be read.
        """
        super().__init__("soil_sim", **kwargs)
        self._params = declare_parameters(self, SoilNodeParams, changeable=_CHANGEABLE)
        self._site_params = declare_parameters(self, SiteParams, "site.")
        self._soil_params = declare_parameters(self, SoilParams, "soil.")
        self._site = make_site(self._site_params)
        warm_up(self._soil_params)  # a tick that compiles would be late
        # Seconds since 1970: a soil that is started again begins a new run, not an old one.
        self.run = SoilRun(self._site, self._soil_params, self._params, run_id=int(time.time()))
        self.run.waiting_for_subscribers = bool(self._params.required_subscribers)
        self._pending_steps: list[tuple[int, Future]] = []  # answers owed to /sim/step
        self.diagnostics = Diagnostics(self, "soil_sim", simulation_namespace=self.get_namespace())
        self.diagnostics.add_task(self._diagnose)
        noisy = self._soil_params.surface_tilt_noise > 0.0
        self._soil_publishers = SoilPublishers(
            self,
            design=self._site.design is not None,
            tilt=surface_tilt(self._soil_params, self._site.grid) if noisy else None,
        )
        self._poller = SubscriptionPoller(self, self._advance)
        self._transport = SoilTransport(
            self,
            self._poller,
            self._receive,
            self._send_keyframe,
            self.diagnostics.reject,
        )
        self._next_map_tick = self._map_revision = 0
        self._last_tick_time = time.monotonic()
        self._publish_run_start()
        if self._params.sync == "realtime":
            self._timer = self.create_timer(self._params.tick_period, self._on_timer)
        self.create_timer(_RETRANSMIT_PERIOD, self._check_progress)
        on_parameter_change(self, SoilNodeParams, "", _CHANGEABLE, self._set_params)
        self.create_service(Trigger, topics.RESET_SERVICE, self._reset)
        self.create_service(SetBool, topics.PAUSE_SERVICE, self._pause)
        # A group of its own: others must be heard while it waits for its tick.
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, topics.STEP_SERVICE, self._step, callback_group=group)
        self.create_service(Trigger, topics.VERIFY_SERVICE, self._verify)
        self.create_service(Trigger, topics.SAVE_SERVICE, self._save)
        self.create_service(Trigger, topics.RELEASE_SERVICE, self._release)

    def _set_params(self, params: SoilNodeParams) -> None:
        self._params = self.run.params = params

    # The tick.

    def _receive(self, message: Message) -> None:
        self.run.endpoint.receive(message)

    def _on_timer(self) -> None:
        until_next = 1e-9 * self._timer.time_until_next_call()
        self.run.on_timer(time.monotonic() + until_next - self._params.tick_period)
        self._advance()

    def _advance(self) -> None:
        """Do all ticks that can be done now, and send what there is to say."""
        while (done := self.run.advance(time.monotonic())) is not None:
            self._publish(done)
        self._poller.set_polling(self.run.endpoint.exchange.is_missing_rows)
        self._transport.send(self.run.endpoint.drain_outbox(), self._stamp())

    def _publish(self, done: SoilTickResult) -> None:
        tick, stamp, soil = done.ledger.tick, self._stamp(), self.run.endpoint.soil
        self._last_tick_time = time.monotonic()
        self._transport.send(self.run.endpoint.drain_outbox(), stamp)
        self._soil_publishers.tick(done.ledger, stamp)
        if tick >= self._next_map_tick:
            self._next_map_tick = tick + self._period_in_ticks(self._map_period)
            if soil.revision != self._map_revision:
                self._publish_terrain(stamp)
        if tick % self._period_in_ticks(self._params.hash_period) == 0:
            self._publish_state_hash()
        for reason in done.step.rejected_tools:
            self.diagnostics.reject(topics.SOIL_TOOL_SWEEPS, reason)
        if done.ledger.imbalance:
            text = f"{done.ledger.imbalance} mm3 out of balance at tick {tick}"
            self.diagnostics.problem(text, Level.ERROR)
        while self._pending_steps and self._pending_steps[0][0] <= tick:
            self._pending_steps.pop(0)[1].set_result(tick)

    @property
    def _map_period(self) -> float:
        grid = self.run.endpoint.soil.grid
        return self._params.map_period * max(1.0, grid.rows * grid.cols / _MAX_CELLS_AT_FULL_RATE)

    def _period_in_ticks(self, period: float) -> int:
        return max(1, round(period / self._params.tick_period))

    def _publish_state_hash(self) -> None:
        run_id, tick = self.run.endpoint.exchange.run_id, self.run.tick
        digest = self.run.endpoint.soil.state_hash()
        self._soil_publishers.state_hash(StateHash(run_id, tick, self._stamp(), digest))

    def _stamp(self) -> Time:
        return stamp_from_tick(max(self.run.tick, 0), self._params.tick_period)

    # What is published.

    def _publish_run_start(self) -> None:
        """Tell what the run begins with."""
        self._next_map_tick = self._map_revision = 0
        self._last_tick_time = time.monotonic()
        self._last_rate_sample = (0, self._last_tick_time)
        self._soil_publishers.begin(self._terrain(), self._run_config(), self._stamp())
        self._publish_cut_fill()
        self._soil_publishers.paused(self.run.paused)

    def _publish_terrain(self, stamp: Time) -> None:
        self._map_revision = self.run.endpoint.soil.revision
        self._soil_publishers.terrain(self._terrain(), stamp)
        self._publish_cut_fill()

    def _publish_cut_fill(self) -> None:
        now = self.run.cut_fill
        if now is not None:
            seconds = max(self.run.tick, 0) * self._params.tick_period
            self._soil_publishers.cut_fill(
                CutFillState(seconds, now.cut, now.fill, now.remaining, now.within_tolerance)
            )

    def _terrain(self) -> TerrainMap:
        soil, run_id = self.run.endpoint.soil, self.run.endpoint.exchange.run_id
        surface = (soil.grid, soil.columns.height, *soil.layers)
        return self._with_layers(Keyframe(run_id, soil.revision, *surface))

    def _send_keyframe(self, keyframe: Keyframe) -> None:
        self._soil_publishers.terrain(self._with_layers(keyframe), self._stamp())

    def _with_layers(self, keyframe: Keyframe) -> TerrainMap:
        """A keyframe with the layers of the columns, which are as they were when it was made."""
        columns, cut_fill = self.run.endpoint.soil.columns, self.run.cut_fill
        layers = {} if cut_fill is None else {"design_difference": cut_fill.difference}
        return TerrainMap(
            keyframe,
            columns.loose_depth,
            columns.material,
            **layers,
        )

    def _run_config(self) -> str:
        endpoint, georeference = self.run.endpoint, self._site.georeference
        facts = RunFacts(
            run_id=endpoint.exchange.run_id,
            tick_period=self._params.tick_period,
            realtime=self._params.sync == "realtime",
            cell=endpoint.soil.grid.cell,
            soils=endpoint.soil.loose_soils,
        )
        columns = endpoint.soil.columns
        sections = {
            "grid": {"rows": columns.grid.rows, "cols": columns.grid.cols, "floor": columns.floor},
            "georeference": None if georeference is None else str(georeference),
            "soil_sim": asdict(self._params),
            "site": asdict(self._site_params),
            "soil": asdict(self._soil_params),
        }
        return to_config_yaml(facts, sections, self._soil_types())

    def _soil_types(self) -> list[SoilKind]:
        """The kinds of soil as a viewer knows them."""
        names = (self._soil_params.soil, *self._soil_params.additional_soils)
        return [
            SoilKind(
                name=name,
                colour=(kind.colour[0], kind.colour[1], kind.colour[2]),
                swell=kind.swell,
                density=kind.density,
                repose_angles=(kind.repose_angle, kind.repose_angle_damp, kind.repose_angle_wet),
            )
            for name, kind in zip(names, self.run.endpoint.soil.soil_types, strict=True)
        ]

    def _diagnose(self) -> None:
        now, tick, exchange = time.monotonic(), max(self.run.tick, 0), self.run.endpoint.exchange
        before, since = self._last_rate_sample
        self._last_rate_sample = (tick, now)
        rate = (tick - before) * self._params.tick_period / max(now - since, 1e-9)
        for key, value in {
            "tick": tick,
            "run_id": exchange.run_id,
            "sync": self._params.sync,
            "paused": self.run.paused,
            "real_time_factor": f"{rate:.3f}",
            "late_ticks": self.run.scheduler.num_late_ticks,
            "reschedules": self.run.scheduler.num_reschedules,
            "machines": ", ".join(map(str, exchange.joined)) or "none",
            "imbalance_mm3": exchange.ledger.imbalance if exchange.ledger else 0,
        }.items():
            self.diagnostics.set(key, value)
        if self.count_publishers(topics.SOIL_TICK) > 1:
            topic = self.resolve_topic_name(topics.SOIL_TICK)
            text = (
                f"another soil node publishes {topic}; give each its own namespace or ROS_DOMAIN_ID"
            )
            self.diagnostics.problem(text, Level.ERROR)
            self.get_logger().error(text, throttle_duration_sec=5.0)

    # SilentMachine.

    def _check_progress(self) -> None:
        """Ask again for what has not come, and say who keeps the soil waiting."""
        now = time.monotonic()
        if self.run.waiting_for_subscribers:
            missing = unmatched_topics(self, self._params.required_subscribers)
            self.run.waiting_for_subscribers = bool(missing)
            if missing:
                self._log_waiting(f"listeners of {', '.join(missing)}")
        elif self.run.tick < 0:
            sources = ", ".join(map(str, self._params.expected_machines))
            self._log_waiting(f"the machines with source {sources} to join")
        elif now - self._last_tick_time >= _RETRANSMIT_PERIOD:
            self._republish_state()
        for silence in self.run.find_silent_machines(now, self._transport.last_message_times):
            self._log_silent_machine(silence)
        self._advance()

    def _republish_state(self) -> None:
        """Tell those who have come while time stands still where the run stands."""
        endpoint = self.run.endpoint
        endpoint.exchange.request_missing()
        if endpoint.exchange.ledger is not None:
            self._soil_publishers.tick(endpoint.exchange.ledger, self._stamp())
            self._publish_state_hash()
        if endpoint.soil.revision != self._map_revision:
            self._publish_terrain(self._stamp())

    def _log_waiting(self, what: str) -> None:
        self.get_logger().info(f"waiting for {what}", throttle_duration_sec=2.0)

    def _log_silent_machine(self, silence: SilentMachine) -> None:
        name = self._transport.machines.get(silence.machine_id, "a machine")
        who = f"{name} (source {silence.machine_id}) has been silent for {silence.seconds:.1f} s"
        if silence.dropped:
            self.diagnostics.count("machines_dropped")
            self.get_logger().warning(
                f"{who}: the soil goes on without it; what it holds is absent until it is back"
            )
        else:
            text = f"{who}: the soil waits; start it again, or go on without it by /soil/release"
            self.get_logger().warning(text, throttle_duration_sec=1.0)

    # Services.

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.run.pause(bool(request.data))
        self._soil_publishers.paused(self.run.paused)
        state = "paused" if self.run.paused else "running"
        response.success, response.message = True, f"{state} at tick {self.run.tick}"
        self._advance()
        return response

    async def _step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.run.paused or self.run.tick < 0:
            response.success = False
            response.message = (
                "the run has not begun: a machine it expects has not joined"
                if self.run.paused
                else "time does not stand still; pause it by /sim/pause first"
            )
            return response
        future: Future = Future()
        self._pending_steps.append((self.run.step(), future))
        self._advance()
        tick = await future
        response.success = tick is not None
        response.message = f"tick {tick} done" if response.success else "there was a reset"
        return response

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for _, future in self._pending_steps:
            future.set_result(None)
        self._pending_steps.clear()
        self.run.reset()
        self.diagnostics.clear()
        self._publish_run_start()
        run_id = self.run.endpoint.exchange.run_id
        response.success, response.message = True, f"epoch {run_id} begins on the untouched site"
        self.get_logger().info(response.message)
        return response

    def _verify(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        soil, ledger = self.run.endpoint.soil, self.run.endpoint.exchange.ledger
        imbalance = ledger.imbalance if ledger else 0
        response.success = soil.verify_volume() and imbalance == 0
        response.message = (
            f"tick {self.run.tick}: columns hold {soil.columns.total_mm3} mm3, the running count"
            f" is {soil.total_mm3} mm3; imbalance {imbalance} mm3"
        )
        return response

    def _save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        columns, path = self.run.endpoint.soil.columns, self._params.save_path
        # What lies at the surface, as the map shows it; other formats hold heights alone.
        whole = Path(path).suffix.lower() == ".npz"
        layers = Layers(columns.top_soil, columns.top_moisture) if whole else None
        try:
            ground = HeightMap(columns.grid, columns.height, self._site.georeference)
            save_terrain(path, ground, layers=layers)
        except EarthmovingError as error:
            response.success, response.message = False, str(error)
        else:
            response.success = True
            what = "" if whole else ", heights alone: soil and moisture go into .npz only"
            response.message = f"terrain of tick {self.run.tick} written to {path}{what}"
        return response

    def _release(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        given_up = self.run.drop_silent_machines(
            time.monotonic(), self._transport.last_message_times
        )
        released = self.run.endpoint.release_absent_soil()
        said = []
        if given_up:
            said.append(f"the run goes on without machines {', '.join(map(str, given_up))}")
        if released:
            sources = ", ".join(map(str, released))
            said.append(f"what machines {sources} held becomes terrain in the next tick")
        response.success = bool(said)
        response.message = "; ".join(said) or "no machine has left any soil behind"
        self._advance()
        return response


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    return run_node(SoilNode, args, name="soil_sim", usage=USAGE)


if __name__ == "__main__":
    sys.exit(main())
