"""State hashes are transmitted as JSON; malformed ones are rejected."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from std_msgs.msg import String
from support.wire import over_the_wire, raises

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.state_hash import StateHash, from_state_hash_string, to_state_hash_string
from msg_bridge.contract.errors import ErrorCode

DIGEST = hashlib.sha256(b"soil").hexdigest()
STATE_HASH = StateHash(1_795_247_584, 100, Time(sec=1, nanosec=20), DIGEST)
OBJECT: dict[str, Any] = {
    "run_id": 1_795_247_584,
    "tick": 100,
    "stamp": {"sec": 1, "nanosec": 20},
    "sha256": DIGEST,
}


def test_state_hash_is_transmitted() -> None:
    assert from_state_hash_string(over_the_wire(to_state_hash_string(STATE_HASH))) == STATE_HASH


def test_state_hash_is_a_json_object() -> None:
    assert json.loads(to_state_hash_string(STATE_HASH).data) == OBJECT


def test_names_of_a_later_version_are_left_out() -> None:
    text = json.dumps({**OBJECT, "new": None})
    assert from_state_hash_string(String(data=text)) == STATE_HASH


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"tick": "100"}, ErrorCode.JSON),
        ({"run_id": None}, ErrorCode.JSON),
        ({"stamp": 1.0}, ErrorCode.JSON),
        ({"stamp": {"sec": 1}}, ErrorCode.JSON),
        ({"stamp": {"sec": -1, "nanosec": 0}}, ErrorCode.VALUE),
        ({"stamp": {"sec": 1, "nanosec": 10**9}}, ErrorCode.VALUE),
        ({"tick": -1}, ErrorCode.VALUE),
        ({"sha256": DIGEST[1:]}, ErrorCode.VALUE),
        ({"sha256": DIGEST.upper()}, ErrorCode.VALUE),
    ],
)
def test_malformed_state_hash_is_rejected(change: dict[str, Any], code: ErrorCode) -> None:
    with raises(code, CodecError):
        from_state_hash_string(String(data=json.dumps({**OBJECT, **change})))


@pytest.mark.parametrize("text", ["", "100 abc", "[]", "null"])
def test_other_text_is_rejected(text: str) -> None:
    with raises(ErrorCode.JSON, CodecError):
        from_state_hash_string(String(data=text))
