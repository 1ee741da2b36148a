"""SceneEncoder: the parts of messages that are the same for all clients of a scene, packed once."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from viewer.scene.machine_model import JointModel, MachineModel, TrackModel, Visual
from viewer.scene.machine_view import MachineView
from viewer.scene.particle_cloud import encode_particles
from viewer.scene.scene import Scene
from viewer.scene.terrain_tiles import TILE_SIZE
from viewer.server.packing import pack, pack_map

__all__ = ["SceneEncoder"]


class SceneEncoder:
    """Packs parts of a scene, again only after they have changed.

    All methods are called with the lock of the scene held, in one thread.

    Attributes:
        scene: the scene.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._particles = (-1, b"", 0)  # version, packed, size
        self._machines = (-1, b"")
        self._site: tuple[Any, bytes] = (None, b"")
        self._models: dict[str, tuple[int, bytes]] = {}

    @property
    def site_version(self) -> tuple[int, int]:
        """Value that changes with the grid, the run or the soil types."""
        return self.scene.terrain.version, self.scene.soils_version

    def site(self) -> bytes | None:
        """Return the message `site`; None before the first map."""
        terrain = self.scene.terrain
        if terrain.tiles is None or terrain.reference is None:
            return None
        if self._site[0] != self.site_version:
            grid = terrain.tiles.grid
            message = {
                "type": "site",
                "run_id": self.scene.run_id,
                "rows": grid.rows,
                "cols": grid.cols,
                "cell": grid.cell,
                "tile": TILE_SIZE,
                "reference": _floats(terrain.reference),
                "design": None if terrain.design is None else _floats(terrain.design),
                "soils": [
                    {"id": number, "name": soil.name, "color": soil.color}
                    for number, soil in enumerate(self.scene.soils)
                ],
            }
            self._site = (self.site_version, pack(message))
        return self._site[1]

    def machine(self, namespace: str) -> bytes:
        """Return the message `machine` of a machine that has a model."""
        view = self.scene.machines[namespace]
        assert view.model is not None
        version, packed = self._models.get(namespace, (-1, b""))
        if version != view.model_version:
            message = {
                "type": "machine",
                "id": namespace,
                "namespace": namespace,
                "model": _model(view.model),
                "levers": view.levers,
                "pattern": view.pattern,
            }
            packed = pack(message)
            self._models[namespace] = (view.model_version, packed)
        return packed

    def particles(self) -> tuple[bytes, int]:
        """Return the particles as packed value of a frame, and the size of their data [bytes]."""
        if self._particles[0] != self.scene.particles_version:
            clouds = [self.scene.clouds[name] for name in sorted(self.scene.clouds)]
            block = encode_particles(clouds)
            packed = pack(
                {
                    "count": block.count,
                    "origin": block.origin,
                    "scale": block.scale,
                    "data": block.data,
                }
            )
            self._particles = (self.scene.particles_version, packed, len(block.data))
        return self._particles[1], self._particles[2]

    def machines(self) -> bytes:
        """Return the states of all machines that have a model, as packed value of a frame."""
        if self._machines[0] != self.scene.machines_version:
            states = [
                _machine_state(view)
                for view in self.scene.machines.values()
                if view.model is not None
            ]
            self._machines = (self.scene.machines_version, pack(states))
        return self._machines[1]

    def tiles(self, numbers: NDArray[np.intp]) -> bytes:
        """Return some tiles as packed value of a frame."""
        tiles = self.scene.terrain.tiles
        data = b"" if tiles is None or numbers.size == 0 else tiles.encode(numbers)
        index = numbers.astype("<u4").tobytes()
        return pack({"count": int(numbers.size), "index": index, "data": data})

    def common(self) -> dict[str, bytes]:
        """Return further packed values of a frame."""
        scene, ledger = self.scene, self.scene.ledger
        accounts: dict[str, int] = {}
        if ledger is not None:
            names = ("terrain", "in_flight", "pending", "particles", "absent", "outside", "start")
            accounts = {name: getattr(ledger, name) for name in names}
            accounts |= {"total": ledger.total, "imbalance": ledger.imbalance}
        return {
            "run_id": pack(scene.run_id),
            "tick": pack(scene.tick),
            "time": pack(scene.known_time),
            "paused": pack(scene.is_paused),
            "rtf": pack(scene.real_time_factor),
            "machines": self.machines(),
            "ledger": pack(accounts),
            "status": pack(scene.status),
        }

    def error(self, code: str, message: str) -> bytes:
        """Return the message `error`."""
        return pack_map({"type": pack("error"), "code": pack(code), "message": pack(message)})


def _machine_state(view: MachineView) -> dict[str, Any]:
    assert view.model is not None
    positions, velocities = view.joint_values()
    return {
        "id": view.namespace,
        "time": view.time,
        "positions": _floats(positions),
        "velocities": _floats(velocities),
        "base": None if view.model.has_virtual_base else view.base,
        "load": view.load,
        "gauges": view.gauges(),
    }


def _model(model: MachineModel) -> dict[str, Any]:
    return {
        "name": model.name,
        "links": [
            {"name": name, "visuals": [_set_fields(each) for each in visuals]}
            for name, visuals in model.links.items()
        ],
        "joints": [_joint(each) for each in model.joints],
        "tracks": [_set_fields(each) for each in model.tracks],
        "shoe": model.shoe,
        "engine": None if model.rated_power is None else {"rated_power": model.rated_power},
        "hydraulics": None if model.hydraulics is None else asdict(model.hydraulics),
    }


def _joint(joint: JointModel) -> dict[str, Any]:
    limits = {"lower": _finite(joint.lower), "upper": _finite(joint.upper)}
    return {**_set_fields(joint), **limits}


def _set_fields(part: Visual | JointModel | TrackModel) -> dict[str, Any]:
    """Return the fields of a part that are not None; the page has the same names."""
    return {name: value for name, value in asdict(part).items() if value is not None}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _floats(values: NDArray[np.floating[Any]]) -> bytes:
    return values.astype("<f4").tobytes()
