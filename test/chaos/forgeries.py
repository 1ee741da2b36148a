"""Kinds of forged and broken messages.

They are changed copies of messages that the forger has received: with the numbers of the run,
session and tick that the receivers expect, so that nothing but their checks protects them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from chaos.forger import Forger, Forgery

from msg_bridge.contract.messages import (
    JoinRejected,
    MachineHeader,
    RetransmitRequest,
    RowRange,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import MAX_PRESSURE, SweepAction

__all__ = ["KINDS", "Kind"]


@dataclass(frozen=True)
class Kind:
    """A kind of forged or broken message.

    Attributes:
        send: sends one or more; it does nothing if what it changes has not been received yet.
        needs_key: whether only an exchange key protects against it: the message is consistent.
    """

    send: Forgery
    needs_key: bool = False


# Broken bytes on a random topic.


def _no_content(forger: Forger) -> None:
    forger.publish(forger.random_topic(), b"\x00\x01\x00\x00")


def _truncated(forger: Forger) -> None:
    topic = forger.random_topic()
    data = forger.latest(topic)
    forger.publish(topic, data[: int(forger.rng.integers(4, len(data)))])


def _random_bytes(forger: Forger) -> None:
    topic = forger.random_topic()
    size = len(forger.latest(topic)) - 4
    forger.publish(topic, b"\x00\x01\x00\x00" + forger.rng.bytes(size))


def _flipped_bit(forger: Forger) -> None:
    topic = forger.random_topic()
    data = bytearray(forger.latest(topic))
    data[int(forger.rng.integers(4, len(data)))] ^= 1 << int(forger.rng.integers(8))
    forger.publish(topic, bytes(data))


def _overwritten_bytes(forger: Forger) -> None:
    topic = forger.random_topic()
    data = bytearray(forger.latest(topic))
    begin = int(forger.rng.integers(4, max(len(data) - 8, 5)))
    data[begin : begin + 8] = forger.rng.bytes(8)
    forger.publish(topic, bytes(data))


def _repeated(forger: Forger) -> None:
    topic = forger.random_topic()
    forger.publish(topic, forger.latest(topic))


def _sent_again_later(forger: Forger) -> None:
    topic = forger.random_topic()
    forger.publish(topic, forger.earlier(topic))


def _big_endian(forger: Forger) -> None:
    topic = forger.random_topic()
    forger.publish(topic, b"\x00\x00" + forger.latest(topic)[2:])


# Rows with the numbers that are expected next.


def _forged_rows(stream: Stream, change: Callable[[Forger, Any], None]) -> Forgery:
    def send(forger: Forger) -> None:
        chunk = forger.chunk(stream)
        if chunk is None:
            return
        rows = chunk.rows.copy()
        rows["seq"] += np.uint32(forger.rng.integers(1, 3) * rows.size)
        change(forger, rows)
        forger.send_rows(replace(chunk, rows=rows))

    return send


def _long_sweep(forger: Forger, rows: Any) -> None:
    rows["x1"] += 30.0
    rows["z0"] -= 5.0
    rows["z1"] -= 5.0


def _heavy_track(forger: Forger, rows: Any) -> None:
    rows["action"] = SweepAction.COMPACT
    rows["work"], rows["pressure"] = 0.0, MAX_PRESSURE
    rows["z0"] -= 5.0
    rows["z1"] -= 5.0


def _not_finite(forger: Forger, rows: Any) -> None:
    for name in ("x", "z", "fx", "x0"):
        if name in (rows.dtype.names or ()):
            rows[name] = np.nan


def _much_volume(forger: Forger, rows: Any) -> None:
    rows["volume_mm3"] = 2**32 - 1


def _off_map(forger: Forger, rows: Any) -> None:
    rows["row"] = 10**6
    rows["col"] = 10**6


def _far_ahead(forger: Forger, rows: Any) -> None:
    rows["seq"] += np.uint32(10**5)


# Headers and requests.


def _large_totals(forger: Forger) -> None:
    header = forger.machine_header()
    forger.send_header(_next(header, pending_mm3=10**15))


def _many_rows(forger: Forger) -> None:
    header = forger.machine_header()
    span = RowRange(header.sweeps.last + 1, 2**40)
    forger.send_header(_next(header, sweeps=span))


def _unknown_machine(forger: Forger) -> None:
    header = forger.machine_header()
    forger.send_header(MachineHeader(header.run_id, 9, 77, -1, Verb.JOIN))


def _newer_session(forger: Forger) -> None:
    header = forger.machine_header()
    session_id = int(forger.rng.integers(1, 2**32))
    forger.send_header(MachineHeader(header.run_id, header.machine_id, session_id, -1, Verb.JOIN))


def _large_request(forger: Forger) -> None:
    header = forger.machine_header()
    stream = Stream(int(forger.rng.integers(len(Stream))))
    forger.send_header(
        RetransmitRequest(header.run_id, header.machine_id, header.session_id, stream, 0, 2**60)
    )


def _rejection(forger: Forger) -> None:
    header = forger.machine_header()
    rejection = JoinRejected(header.run_id, header.machine_id, header.session_id, "forged")
    forger.send_rejection(rejection)


def _departure(forger: Forger) -> None:
    forger.send_header(_next(forger.machine_header(), verb=Verb.LEAVE))


def _tick_without_rows(forger: Forger) -> None:
    forger.send_header(_next(forger.machine_header()))


def _answer_without_rows(forger: Forger) -> None:
    header = forger.soil_header()
    spans = {
        name: RowRange(getattr(header, name).last + 1)
        for name in ("conversions", "map_updates", "forces")
    }
    receipts = tuple(replace(each, tick=header.tick + 1) for each in header.receipts)
    forger.send_header(replace(header, tick=header.tick + 1, receipts=receipts, **spans))


def _dropped_machine(forger: Forger) -> None:
    header = forger.soil_header()
    forger.send_header(replace(header, tick=header.tick + 1, receipts=()))


# Configuration and terrain.


def _nested_configuration(forger: Forger) -> None:
    forger.send_configuration("run: " + "[" * 20_000)


def _another_run(forger: Forger) -> None:
    header = forger.soil_header()
    run = {
        "run_id": header.run_id + 7, "tick_period": 0.013, "sync": "realtime", "cell": 3.0,
        "soils": [{"swell": 0.2}],
    }  # fmt: skip
    forger.send_configuration(json.dumps({"run": run}))


def _next(header: MachineHeader, **changes: Any) -> MachineHeader:
    """Return a consistent header of the machine's next tick, without rows, with changes."""
    values = {
        "tick": header.tick + 1,
        "previous_tick": header.tick,
        "verb": Verb.STEP,
        "sweeps": RowRange(header.sweeps.last + 1),
        "deposit_requests": RowRange(header.deposit_requests.last + 1),
    }
    return replace(header, **{**values, **changes})


KINDS: dict[str, Kind] = {
    "no content": Kind(_no_content),
    "truncated": Kind(_truncated),
    "random bytes": Kind(_random_bytes),
    "flipped bit": Kind(_flipped_bit, needs_key=True),
    "overwritten bytes": Kind(_overwritten_bytes, needs_key=True),
    "repeated": Kind(_repeated),
    "sent again later": Kind(_sent_again_later),
    "big-endian": Kind(_big_endian),
    "long sweep": Kind(_forged_rows(Stream.SWEEP, _long_sweep)),
    "heavy track": Kind(_forged_rows(Stream.SWEEP, _heavy_track)),
    "sweep that is not finite": Kind(_forged_rows(Stream.SWEEP, _not_finite)),
    "large deposit": Kind(_forged_rows(Stream.DEPOSIT_REQUEST, _much_volume)),
    "deposit far ahead": Kind(_forged_rows(Stream.DEPOSIT_REQUEST, _far_ahead)),
    "large parcel": Kind(_forged_rows(Stream.CONVERSION, _much_volume)),
    "parcel off the map": Kind(_forged_rows(Stream.CONVERSION, _off_map)),
    "update off the map": Kind(_forged_rows(Stream.MAP_UPDATE, _off_map)),
    "update that is not finite": Kind(_forged_rows(Stream.MAP_UPDATE, _not_finite)),
    "force that is not finite": Kind(_forged_rows(Stream.FORCE, _not_finite)),
    "large totals": Kind(_large_totals),
    "many rows": Kind(_many_rows),
    "unknown machine": Kind(_unknown_machine),
    "newer session": Kind(_newer_session),
    "large request": Kind(_large_request),
    "rejection": Kind(_rejection),
    "nested configuration": Kind(_nested_configuration),
    "another run": Kind(_another_run),
    "departure": Kind(_departure, needs_key=True),
    "tick without rows": Kind(_tick_without_rows, needs_key=True),
    "answer without rows": Kind(_answer_without_rows, needs_key=True),
    "dropped machine": Kind(_dropped_machine, needs_key=True),
}
"""All kinds by name."""
