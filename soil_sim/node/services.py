"""Services of the soil node: pause, step, reset, verify, save, release."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from soil_sim.terrain import HeightMap, Layers, save_terrain

if TYPE_CHECKING:
    from soil_sim.node.soil_node import SoilNode

__all__ = ["SoilServices"]


class SoilServices:
    """Service servers of a soil node."""

    def __init__(self, node: SoilNode) -> None:
        self._node = node
        self._pending_steps: list[tuple[int, Future]] = []  # (tick, response), ascending
        node.create_service(Trigger, topics.RESET_SERVICE, self._reset)
        node.create_service(SetBool, topics.PAUSE_SERVICE, self._pause)
        # Other callbacks must run while a step waits for its tick.
        group = ReentrantCallbackGroup()
        node.create_service(Trigger, topics.STEP_SERVICE, self._step, callback_group=group)
        node.create_service(Trigger, topics.VERIFY_SERVICE, self._verify)
        node.create_service(Trigger, topics.SAVE_SERVICE, self._save)
        node.create_service(Trigger, topics.RELEASE_SERVICE, self._release)

    @property
    def num_pending_steps(self) -> int:
        """Number of steps that wait for their tick."""
        return len(self._pending_steps)

    def on_tick(self, tick: int) -> None:
        """Respond to the steps that a completed tick fulfils."""
        while self._pending_steps and self._pending_steps[0][0] <= tick:
            self._pending_steps.pop(0)[1].set_result(tick)

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        run = self._node.run
        run.pause(bool(request.data))
        self._node.publish_paused()
        state = "paused" if run.paused else "running"
        response.success, response.message = True, f"{state} at tick {run.tick}"
        self._node.advance()
        return response

    async def _step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        run = self._node.run
        if not run.paused or run.tick < 0:
            response.success = False
            response.message = (
                "the run has not started: an expected machine has not joined"
                if run.paused
                else "the simulation is not paused; call /sim/pause first"
            )
            return response
        future: Future = Future()
        self._pending_steps.append((run.step(), future))
        self._node.advance()
        tick = await future
        response.success = tick is not None
        response.message = f"tick {tick} completed" if response.success else "the run was reset"
        return response

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        node = self._node
        for _, future in self._pending_steps:
            future.set_result(None)
        self._pending_steps.clear()
        node.run.reset()
        node.diagnostics.clear()
        node.publish_run_start()
        run_id = node.run.endpoint.exchange.run_id
        response.success, response.message = True, f"run {run_id} starts on the initial terrain"
        node.get_logger().info(response.message)
        return response

    def _verify(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        endpoint = self._node.run.endpoint
        soil, ledger = endpoint.soil, endpoint.exchange.ledger
        imbalance = ledger.imbalance if ledger else 0
        response.success = soil.verify_volume() and imbalance == 0
        response.message = (
            f"tick {endpoint.tick}: columns hold {soil.columns.total_mm3} mm3, the running total"
            f" is {soil.total_mm3} mm3; imbalance {imbalance} mm3"
        )
        return response

    def _save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        run, path = self._node.run, self._node.params.save_path
        columns = run.endpoint.soil.columns
        # Layers of the surface, as in the map; only this format has room for them.
        has_layers = Path(path).suffix.lower() == ".npz"
        layers = Layers(columns.top_soil, columns.top_moisture) if has_layers else None
        try:
            height_map = HeightMap(columns.grid, columns.height, self._node.site.georeference)
            save_terrain(path, height_map, layers=layers)
        except EarthmovingError as error:
            response.success, response.message = False, str(error)
        else:
            response.success = True
            note = "" if has_layers else ", heights only: soil and moisture need .npz"
            response.message = f"terrain of tick {run.tick} written to {path}{note}"
        return response

    def _release(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        run = self._node.run
        dropped = run.drop_silent_machines(time.monotonic(), self._node.silent_since())
        released = run.endpoint.release_absent_soil()
        effects = []
        if dropped:
            effects.append(f"the run continues without machines {', '.join(map(str, dropped))}")
        if released:
            ids = ", ".join(map(str, released))
            effects.append(f"soil held by machines {ids} becomes terrain in the next tick")
        response.success = bool(effects)
        response.message = "; ".join(effects) or "no machine has left soil behind"
        self._node.advance()
        return response
