"""Services of the soil node: pause, step, reset, verify, save, release."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from std_srvs.srv import SetBool, Trigger

from msg_bridge.codec import qos
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from soil_sim.errors import SoilError
from soil_sim.node.step_service import StepService
from soil_sim.terrain import HeightMap, Layers, save_terrain

if TYPE_CHECKING:
    from soil_sim.node.soil_node import SoilNode

__all__ = ["SoilServices"]

_MIN_SILENCE = 0.5
"""Wall time without a message from which on a machine is not merely computing its tick [s]."""


class SoilServices:
    """Service servers of a soil node."""

    def __init__(self, node: SoilNode) -> None:
        self._node = node
        self._step_service = StepService(node, self._request_step)

        def serve(kind: Any, name: str, respond: Any) -> None:
            node.create_service(kind, name, respond, qos_profile=qos.SERVICES)

        serve(Trigger, topics.RESET_SERVICE, self._reset)
        serve(SetBool, topics.PAUSE_SERVICE, self._pause)
        serve(Trigger, topics.VERIFY_SERVICE, self._verify)
        serve(Trigger, topics.SAVE_SERVICE, self._save)
        serve(Trigger, topics.RELEASE_SERVICE, self._release)

    @property
    def num_pending_steps(self) -> int:
        """Number of steps that wait for their tick."""
        return self._step_service.num_pending

    def on_tick(self, tick: int) -> None:
        """Respond to the steps that a completed tick fulfils."""
        self._step_service.on_tick(tick)

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        run = self._node.run
        run.pause(bool(request.data))
        self._node.publish_paused()
        state = "paused" if run.paused else "running"
        response.success, response.message = True, f"{state} {_time_of(run.tick)}"
        self._node.advance()
        return response

    def _request_step(self) -> int:
        """Request one more tick and return its number.

        Raises:
            SoilError: the run is not paused, or has not started.
        """
        run = self._node.run
        if not run.paused:
            raise SoilError("the simulation is not paused; call /sim/pause first")
        if run.tick < 0:
            raise SoilError("the run has not started: an expected machine has not joined")
        tick = run.step()
        self._node.advance()
        return tick

    def cancel_steps(self) -> None:
        """Let the requested single steps fail: the run ends."""
        self._step_service.cancel()

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        node = self._node
        node.reset()
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
            f"{_time_of(endpoint.tick)}: columns hold {soil.columns.total_mm3} mm3, the running"
            f" total is {soil.total_mm3} mm3; imbalance {imbalance} mm3"
        )
        return response

    def _save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        run, path = self._node.run, Path(self._node.params.save_path).absolute()
        columns = run.endpoint.soil.columns
        # Layers of the surface, as in the map; only this format has room for them.
        has_layers = path.suffix.lower() == ".npz"
        layers = Layers(columns.top_soil, columns.top_moisture) if has_layers else None
        with suppress(OSError):  # save_terrain reports a folder that is missing
            path.parent.mkdir(exist_ok=True)
        try:
            height_map = HeightMap(columns.grid, columns.height, self._node.site.georeference)
            save_terrain(path, height_map, layers=layers)
        except EarthmovingError as error:
            response.success, response.message = False, str(error)
        else:
            response.success = True
            note = "" if has_layers else ", heights only: soil and moisture need .npz"
            response.message = f"terrain {_time_of(run.tick)} written to {path}{note}"
        return response

    def _release(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        run = self._node.run
        dropped = run.drop_silent_machines(time.monotonic(), self._node.last_message_times())
        released = run.release_absent_soil()
        self._node.membership_log.release()
        effects = []
        if dropped:
            effects.append(f"the run continues without machines {', '.join(map(str, dropped))}")
        if released:
            ids = ", ".join(map(str, released))
            effects.append(f"soil left behind by machines {ids} becomes terrain in the next tick")
        response.success = bool(effects)
        effects = effects or ["no machine has left soil behind"]
        awaited = ", ".join(map(str, self._silent_machines()))
        if awaited and not (run.paused or run.realtime):
            effects.append(
                f"the next tick waits for machines {awaited}, silent for less than machine_timeout"
                f" ({run.params.machine_timeout:g} s): call again when it is over"
            )
        response.message = "; ".join(effects)
        self._node.advance()
        return response

    def _silent_machines(self) -> list[int]:
        """Return the machines that the next tick waits for and that do not merely compute."""
        times, now = self._node.last_message_times(), time.monotonic()
        late = self._node.run.endpoint.exchange.late
        return [n for n in late if now - times.get(n, now) > _MIN_SILENCE]


def _time_of(tick: int) -> str:
    """Return when a tick was, in words; -1 is the number before the first one."""
    return f"at tick {tick}" if tick >= 0 else "before the first tick"
