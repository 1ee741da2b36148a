"""The soil's node: keeps time, does a tick of the soil when it is due, and tells everybody.

It owns the terrain and is the barrier of the tick. When a tick is due is told by `soil_sim.run`,
what the soil does in it by `soil_sim.side`; callbacks here only hand over.
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
from msg_bridge.codec.sim_config import RunFacts, SoilKind, config_text
from msg_bridge.codec.stamps import stamp_of_tick
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Keyframe, Message
from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.inbox import Inbox
from msg_bridge.nodes.lean_node import LeanNode
from msg_bridge.nodes.listeners import unheard_topics
from msg_bridge.nodes.parameters import declare_parameters, on_change
from msg_bridge.nodes.runtime import run_node
from msg_bridge.nodes.soil_carrier import SoilCarrier
from msg_bridge.nodes.soil_topics import SoilTopics
from msg_bridge.nodes.topics import TICK_TOPIC
from soil_sim.node_params import SoilNodeParams
from soil_sim.params import SoilParams
from soil_sim.run import Silence, SoilRun
from soil_sim.side import SoilTick
from soil_sim.site import SiteParams, make_site
from soil_sim.slip.noise import surface_tilt
from soil_sim.terrain import HeightMap, Layers, save_terrain
from soil_sim.warm import warm_up

__all__ = ["SoilNode", "main"]

_REMIND_PERIOD = 0.25
"""Wall time without a tick after which what is missing is asked for again [s]."""

_LARGE_MAP = 513 * 513
"""Cells above which terrain maps are published less often."""


_CHANGEABLE = ("machine_timeout", "map_period", "hash_period", "save_path")
"""Parameters that may be set while the node runs."""


class SoilNode(LeanNode):
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
        self.run = SoilRun(self._site, self._soil_params, self._params, epoch=int(time.time()))
        self.run.held = bool(self._params.await_listeners)
        self._steps: list[tuple[int, Future]] = []  # answers owed to /sim/step
        self.diagnostics = Diagnostics(self, "soil_sim")
        self.diagnostics.add_task(self._diagnose)
        noisy = self._soil_params.normal_noise > 0.0
        self._topics = SoilTopics(
            self,
            design=self._site.design is not None,
            tilt=surface_tilt(self._soil_params, self._site.grid) if noisy else None,
        )
        self._inbox = Inbox(self, self._advance)
        self._carrier = SoilCarrier(
            self,
            self._inbox,
            self._receive,
            self._send_keyframe,
            self.diagnostics.refuse,
        )
        self._next_map = self._map_revision = 0
        self._last_tick = time.monotonic()
        self._announce()
        if self._params.sync == "realtime":
            self._timer = self.create_timer(self._params.tick, self._on_time)
        self.create_timer(_REMIND_PERIOD, self._on_silence)
        on_change(self, SoilNodeParams, "", _CHANGEABLE, self._take_params)
        self.create_service(Trigger, "/sim/reset", self._reset)
        self.create_service(SetBool, "/sim/pause", self._pause)
        # A group of its own: others must be heard while it waits for its tick.
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, "/sim/step", self._step, callback_group=group)
        self.create_service(Trigger, "/soil/verify", self._verify)
        self.create_service(Trigger, "/soil/save", self._save)
        self.create_service(Trigger, "/soil/release", self._release)

    def _take_params(self, params: SoilNodeParams) -> None:
        self._params = self.run.params = params

    # The tick.

    def _receive(self, message: Message) -> None:
        self.run.side.receive(message)

    def _on_time(self) -> None:
        until_next = 1e-9 * self._timer.time_until_next_call()
        self.run.on_time(time.monotonic() + until_next - self._params.tick)
        self._advance()

    def _advance(self) -> None:
        """Do all ticks that can be done now, and send what there is to say."""
        while (done := self.run.advance(time.monotonic())) is not None:
            self._publish(done)
        self._inbox.look_again(self.run.side.exchange.lacks_rows)
        self._carrier.send(self.run.side.take_outbox(), self._stamp())

    def _publish(self, done: SoilTick) -> None:
        tick, stamp, soil = done.ledger.tick, self._stamp(), self.run.side.soil
        self._last_tick = time.monotonic()
        self._carrier.send(self.run.side.take_outbox(), stamp)
        self._topics.tick(done.ledger, stamp)
        if tick >= self._next_map:
            self._next_map = tick + self._ticks(self._map_period)
            if soil.revision != self._map_revision:
                self._tell_terrain(stamp)
        if tick % self._ticks(self._params.hash_period) == 0:
            self._topics.state_hash(tick, soil.state_hash())
        for reason in done.step.refused:
            self.diagnostics.refuse("/soil/tool_sweeps", reason)
        if done.ledger.imbalance:
            text = f"{done.ledger.imbalance} mm3 out of balance at tick {tick}"
            self.diagnostics.problem(text, Level.ERROR)
        while self._steps and self._steps[0][0] <= tick:
            self._steps.pop(0)[1].set_result(tick)

    @property
    def _map_period(self) -> float:
        grid = self.run.side.soil.grid
        return self._params.map_period * max(1.0, grid.rows * grid.cols / _LARGE_MAP)

    def _ticks(self, period: float) -> int:
        return max(1, round(period / self._params.tick))

    def _stamp(self) -> Time:
        return stamp_of_tick(max(self.run.tick, 0), self._params.tick)

    # What is published.

    def _announce(self) -> None:
        """Tell what the run begins with."""
        self._next_map = self._map_revision = 0
        self._last_tick = time.monotonic()
        self._counted = (0, self._last_tick)
        self._topics.begin(self._terrain(), self._config(), self._stamp())
        self._tell_cut_fill()
        self._topics.paused(self.run.paused)

    def _tell_terrain(self, stamp: Time) -> None:
        self._map_revision = self.run.side.soil.revision
        self._topics.terrain(self._terrain(), stamp)
        self._tell_cut_fill()

    def _tell_cut_fill(self) -> None:
        now = self.run.cut_fill
        if now is not None:
            seconds = max(self.run.tick, 0) * self._params.tick
            self._topics.cut_fill(
                CutFillState(seconds, now.cut, now.fill, now.remaining, now.within_tolerance)
            )

    def _terrain(self) -> TerrainMap:
        soil, epoch = self.run.side.soil, self.run.side.exchange.epoch
        surface = (soil.grid, soil.columns.height, *soil.layers)
        return self._with_layers(Keyframe(epoch, soil.revision, *surface))

    def _send_keyframe(self, keyframe: Keyframe) -> None:
        self._topics.terrain(self._with_layers(keyframe), self._stamp())

    def _with_layers(self, keyframe: Keyframe) -> TerrainMap:
        """A keyframe with the layers of the columns, which are as they were when it was made."""
        columns, cut_fill = self.run.side.soil.columns, self.run.cut_fill
        layers = {} if cut_fill is None else {"design_difference": cut_fill.difference}
        return TerrainMap(
            keyframe,
            columns.loose_depth,
            columns.material,
            **layers,
        )

    def _config(self) -> str:
        side, georeference = self.run.side, self._site.georeference
        facts = RunFacts(
            epoch=side.exchange.epoch,
            tick=self._params.tick,
            realtime=self._params.sync == "realtime",
            cell=side.soil.grid.cell,
            soils=side.soil.loose_soils,
        )
        columns = side.soil.columns
        sections = {
            "grid": {"rows": columns.grid.rows, "cols": columns.grid.cols, "floor": columns.floor},
            "georeference": None if georeference is None else str(georeference),
            "soil_sim": asdict(self._params),
            "site": asdict(self._site_params),
            "soil": asdict(self._soil_params),
        }
        return config_text(facts, sections, self._kinds())

    def _kinds(self) -> list[SoilKind]:
        """The kinds of soil as a viewer knows them."""
        names = (self._soil_params.soil, *self._soil_params.other_soils)
        return [
            SoilKind(
                name=name,
                colour=(kind.colour[0], kind.colour[1], kind.colour[2]),
                swell=kind.swell,
                density=kind.density,
                repose_angles=(kind.repose_angle, kind.repose_angle_damp, kind.repose_angle_wet),
            )
            for name, kind in zip(names, self.run.side.soil.kinds, strict=True)
        ]

    def _diagnose(self) -> None:
        now, tick, exchange = time.monotonic(), max(self.run.tick, 0), self.run.side.exchange
        before, since = self._counted
        self._counted = (tick, now)
        rate = (tick - before) * self._params.tick / max(now - since, 1e-9)
        for key, value in {
            "tick": tick,
            "epoch": exchange.epoch,
            "sync": self._params.sync,
            "paused": self.run.paused,
            "real_time_factor": f"{rate:.3f}",
            "late_ticks": self.run.pace.late,
            "schedule_slips": self.run.pace.slips,
            "machines": ", ".join(map(str, exchange.joined)) or "none",
            "imbalance_mm3": exchange.ledger.imbalance if exchange.ledger else 0,
        }.items():
            self.diagnostics.set(key, value)
        if self.count_publishers(TICK_TOPIC) > 1:
            text = f"another soil publishes {TICK_TOPIC}, too; give each its own ROS_DOMAIN_ID"
            self.diagnostics.problem(text, Level.ERROR)
            self.get_logger().error(text, throttle_duration_sec=5.0)

    # Silence.

    def _on_silence(self) -> None:
        """Ask again for what has not come, and say who keeps the soil waiting."""
        now = time.monotonic()
        if self.run.held:
            missing = unheard_topics(self, self._params.await_listeners)
            self.run.held = bool(missing)
            if missing:
                self._say_waiting(f"listeners of {', '.join(missing)}")
        elif self.run.tick < 0:
            sources = ", ".join(map(str, self._params.expected_machines))
            self._say_waiting(f"the machines with source {sources} to join")
        elif now - self._last_tick >= _REMIND_PERIOD:
            self._say_again()
        for silence in self.run.silent(now, self._carrier.heard):
            self._report(silence)
        self._advance()

    def _say_again(self) -> None:
        """Tell those who have come while time stands still where the run stands."""
        side = self.run.side
        side.exchange.remind()
        if side.exchange.ledger is not None:
            self._topics.tick(side.exchange.ledger, self._stamp())
            self._topics.state_hash(side.tick, side.soil.state_hash())
        if side.soil.revision != self._map_revision:
            self._tell_terrain(self._stamp())

    def _say_waiting(self, what: str) -> None:
        self.get_logger().info(f"waiting for {what}", throttle_duration_sec=2.0)

    def _report(self, silence: Silence) -> None:
        name = self._carrier.machines.get(silence.source, "a machine")
        who = f"{name} (source {silence.source}) has been silent for {silence.seconds:.1f} s"
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
        self._topics.paused(self.run.paused)
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
        self._steps.append((self.run.step(), future))
        self._advance()
        tick = await future
        response.success = tick is not None
        response.message = f"tick {tick} done" if response.success else "there was a reset"
        return response

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for _, future in self._steps:
            future.set_result(None)
        self._steps.clear()
        self.run.reset()
        self.diagnostics.clear()
        self._announce()
        epoch = self.run.side.exchange.epoch
        response.success, response.message = True, f"epoch {epoch} begins on the untouched site"
        self.get_logger().info(response.message)
        return response

    def _verify(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        soil, ledger = self.run.side.soil, self.run.side.exchange.ledger
        imbalance = ledger.imbalance if ledger else 0
        response.success = soil.verify() and imbalance == 0
        response.message = (
            f"tick {self.run.tick}: columns hold {soil.columns.total_mm3} mm3, the running count"
            f" is {soil.total_mm3} mm3; imbalance {imbalance} mm3"
        )
        return response

    def _save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        columns, path = self.run.side.soil.columns, self._params.save_path
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
        given_up = self.run.give_up_silent(time.monotonic(), self._carrier.heard)
        released = self.run.side.release_absent()
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
    return run_node(SoilNode, args)


if __name__ == "__main__":
    sys.exit(main())
