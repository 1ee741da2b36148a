"""Handlers of the topics of the soil and of all nodes."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from earthmoving_sim.run_report.run_data import (
    Handler,
    TopicHandlers,
    labelled,
    parse_config,
)
from msg_bridge.codec.row_chunks import from_chunk_cloud
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract import topics
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import ConversionKind

__all__ = ["SoilHandlers"]

_NANO = 1e-9
_MM3 = 1e-9
_ACCOUNTS = ("in_flight", "pending", "particles", "absent", "outside")
_NO_PROBLEM = ("ok", "")


class SoilHandlers(TopicHandlers):
    """Handlers of the topics of the soil and of all nodes."""

    def find(self, topic: str, kind: str) -> Handler | None:
        """Return the handler of a topic; see `TopicHandlers`."""
        handlers: dict[tuple[str, str], Handler] = {
            (topics.SIM_CONFIG, "String"): self.on_config(topic),
            (topics.TERRAIN_MAP, "PointCloud2"): self._on_map,
            (topics.TERRAIN_MAP_UPDATES, "PointCloud2"): self._on_map_updates,
            (topics.SOIL_CONVERSIONS, "PointCloud2"): self._on_conversions,
            (topics.SOIL_LEDGER, "Int64MultiArray"): self._on_ledger,
            (topics.SOIL_CUT_FILL, "Float64MultiArray"): self._on_cut_fill,
            (topics.SOIL_JOIN_REJECTIONS, "String"): self._on_rejection,
            (topics.SIM_PAUSED, "Bool"): self._on_paused,
            (topics.DIAGNOSTICS, "DiagnosticArray"): self._on_diagnostics,
        }
        return handlers.get((topic.removeprefix("/"), kind))

    def on_config(self, topic: str) -> Handler:
        """Return the handler of the configuration of a node."""

        def handle(message: Any, log_time: int) -> None:
            self._reading.run.configs[topic.rpartition("/")[0]] = parse_config(message.data)

        return handle

    def _on_map(self, message: Any, log_time: int) -> None:
        terrain = from_terrain_cloud(message)
        if self._reading.run.run_id in (None, terrain.keyframe.run_id):
            stamp = message.header.stamp
            self._reading.run.terrain.add_map(terrain, stamp.sec + _NANO * stamp.nanosec)

    def _on_map_updates(self, message: Any, log_time: int) -> None:
        chunk = from_chunk_cloud(message, Stream.MAP_UPDATE)
        if self._reading.run.run_id in (None, chunk.run_id):
            self._reading.run.terrain.add_updates(chunk.rows)

    def _on_conversions(self, message: Any, log_time: int) -> None:
        chunk = from_chunk_cloud(message, Stream.CONVERSION)
        if self._reading.run.run_id not in (None, chunk.run_id):
            return
        received = self._reading.run.volumes.received
        rows = chunk.rows[received.add(chunk.rows["seq"].astype(np.int64))]
        if not rows.size:
            return  # sent again
        time = self._reading.time(message.header.stamp, log_time)
        for kind, totals in (
            (ConversionKind.EXCAVATE, self._reading.run.excavated),
            (ConversionKind.DEPOSIT, self._reading.run.deposited),
        ):
            of_kind = rows[rows["kind"] == kind]
            for machine_id in np.unique(of_kind["machine_id"]).tolist():
                volumes = of_kind["volume_mm3"][of_kind["machine_id"] == machine_id]
                self._reading.run.volumes.add(
                    totals, machine_id, time, int(volumes.sum(dtype=np.int64))
                )

    def _on_ledger(self, message: Any, log_time: int) -> None:
        values = labelled(message)
        if self._reading.run.run_id not in (None, int(values["run_id"])):
            return
        time = values["stamp_sec"] + _NANO * values["stamp_nanosec"]
        self._reading.run.note_time(time)
        self._reading.run.present_time = time
        if self._reading.run.first_tick is None:
            self._reading.run.first_tick = int(values["tick"])
        self._reading.run.clock.add(self._reading.seconds(log_time), time)
        for name in _ACCOUNTS:
            self._reading.run.accounts[name].add(time, values.get(name, 0.0) * _MM3)
        self._reading.run.accounts["terrain"].add(
            time, (values["terrain"] - values["start"]) * _MM3
        )
        self._reading.run.imbalance.add(time, values["imbalance"])

    def _on_cut_fill(self, message: Any, log_time: int) -> None:
        values = labelled(message)
        for name, value in values.items():
            if name != "time_s":
                self._reading.run.design[name].add(
                    values.get("time_s", self._reading.seconds(log_time)), value
                )

    def _on_rejection(self, message: Any, log_time: int) -> None:
        self._reading.run.rejections.append(str(json.loads(message.data)["reason"]))

    def _on_paused(self, message: Any, log_time: int) -> None:
        if not self._reading.run.paused or self._reading.run.paused[-1][1] != message.data:
            self._reading.run.paused.append((self._reading.seconds(log_time), bool(message.data)))

    def _on_diagnostics(self, message: Any, log_time: int) -> None:
        for status in message.status:
            name = status.name.partition(":")[0]
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            if level and status.message not in _NO_PROBLEM:
                seconds = self._reading.seconds(log_time)
                self._reading.run.problems.add(name, level, status.message, seconds)
            values = {each.key: each.value for each in status.values}
            self._reading.run.diagnostics[name] = values
            if "late_ticks" in values and "imbalance_mm3" in values:
                seconds = self._reading.seconds(log_time)
                self._reading.run.late_ticks.add(seconds, float(values["late_ticks"]))
                self._reading.run.real_time_factor.add(seconds, float(values["real_time_factor"]))
