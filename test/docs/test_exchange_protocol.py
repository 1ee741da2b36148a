"""The field tables of docs/concepts/exchange_protocol.md are those of the code."""

from __future__ import annotations

import re
from enum import IntEnum
from pathlib import Path

import numpy as np
import pytest

from msg_bridge.codec.array_labels import known_labels
from msg_bridge.codec.terrain import TERRAIN_CELL
from msg_bridge.codec.tick_headers import ArrayKind
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import (
    STREAM_DTYPE,
    MachineHeader,
    RetransmitRequest,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import ConversionKind, SoilReaction, SweepAction
from msg_bridge.exchange.join_state import JoinState

TEXT = (Path(__file__).parents[2] / "docs/concepts/exchange_protocol.md").read_text()

ROWS = {
    **{
        stream.name: dtype for stream, dtype in STREAM_DTYPE.items() if stream is not Stream.BACKLOG
    },
    "TERRAIN_CELL": TERRAIN_CELL,
}
ARRAYS: dict[ArrayKind, tuple[type, int]] = {
    ArrayKind.MACHINE_HEADER: (MachineHeader, 0),
    ArrayKind.SOIL_HEADER: (SoilHeader, 1),
    ArrayKind.RETRANSMIT_REQUEST: (RetransmitRequest, 0),
    ArrayKind.LEDGER: (Ledger, 0),
}
UNITS = {"_mm3": "mm³", "moisture": "%", "_sec": "s", "_nanosec": "ns"}


def table(name: str) -> list[tuple[list[str], list[str]]]:
    """Return (names of the first cell, all cells) of each row of a section's table."""
    section = re.search(rf"^### {name}\n(.*?)(?=^##|\Z)", TEXT, flags=re.M | re.S)
    assert section, name
    lines = [line for line in section[1].splitlines() if line.startswith("| `")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [(re.findall(r"`([^`]+)`", each[0]), each) for each in cells]


@pytest.mark.parametrize("name", ROWS)
def test_fields_of_rows(name: str) -> None:
    documented = [(field, cells[1]) for fields, cells in table(name) for field in fields]
    dtype = ROWS[name]
    assert documented == [(field, dtype[field].name) for field in dtype.names or ()]


@pytest.mark.parametrize("kind", ARRAYS)
def test_labels_of_arrays(kind: ArrayKind) -> None:
    message_type, num_items = ARRAYS[kind]
    rows = table(kind.name)
    documented = {label for labels, _ in rows for label in labels}
    known = known_labels(message_type, num_items)
    assert documented == set(known)
    assert [label for labels, _ in rows for label in labels if "." not in label] == [
        label for label in known if "." not in label
    ]
    assert rows[0][1][-1] == str(kind.value)


@pytest.mark.parametrize("name", [*ROWS, *(kind.name for kind in ARRAYS)])
def test_units_of_volumes_and_moistures(name: str) -> None:
    for names, cells in table(name):
        for each in names:
            unit = next((unit for end, unit in UNITS.items() if each.endswith(end)), None)
            if unit is not None:
                assert cells[-2] == unit, each


@pytest.mark.parametrize(
    ("section", "name", "members"),
    [
        ("SWEEP", "action", SweepAction),
        ("CONVERSION", "kind", ConversionKind),
        ("FORCE", "reaction", SoilReaction),
        ("MACHINE_HEADER", "verb", Verb),
        ("RETRANSMIT_REQUEST", "stream", Stream),
    ],
)
def test_values_of_enumerations(section: str, name: str, members: type[IntEnum]) -> None:
    (cells,) = [cells for names, cells in table(section) if names == [name]]
    documented = {
        (int(value), member) for value, member in re.findall(r"(\d) ([A-Z_]+)", cells[-1])
    }
    assert documented == {(member.value, member.name) for member in members}


def test_error_codes() -> None:
    section = TEXT.partition("## Error codes\n")[2].partition("\n## ")[0]
    assert re.findall(r"^\| `(\w+)` \|", section, flags=re.M) == list(ErrorCode)


def test_states_of_a_machine() -> None:
    diagram = TEXT.partition("stateDiagram-v2")[2].partition("```")[0]
    states = set(re.findall(r"[A-Z]{3,}(?= -->|:)", diagram)) | set(
        re.findall(r"--> ([A-Z]{3,})", diagram)
    )
    assert states == {state.name for state in JoinState}


def test_points_are_packed() -> None:
    for dtype in ROWS.values():
        assert dtype.itemsize == sum(np.dtype(dtype[name]).itemsize for name in dtype.names or ())
