"""The hash of a node's state after a tick, as JSON in a String.

`/soil/state_hash` covers the terrain, `<m>/state_hash` the machines and particles of one node::

    {"run_id": 1, "tick": 100, "stamp": {"sec": 1, "nanosec": 0}, "sha256": "9f86d0..."}

Two runs are identical if their hashes are equal at each tick.
"""

from __future__ import annotations

import json
import string
from dataclasses import dataclass

from builtin_interfaces.msg import Time
from std_msgs.msg import String

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.json_object import parse_json_object
from msg_bridge.contract.errors import ErrorCode

__all__ = ["StateHash", "from_state_hash_string", "to_state_hash_string"]

_TYPES = {"run_id": int, "tick": int, "stamp": dict, "sha256": str}
_STAMP_TYPES = {"sec": int, "nanosec": int}
_DIGEST_LENGTH = 64


@dataclass(frozen=True)
class StateHash:
    """The hash of a state.

    Attributes:
        run_id: number of the run.
        tick: the tick after which the state was hashed.
        stamp: simulation time at the end of the tick.
        sha256: the digest, 64 lower-case hexadecimal digits.
    """

    run_id: int
    tick: int
    stamp: Time
    sha256: str


def to_state_hash_string(state_hash: StateHash) -> String:
    """Encode a state hash."""
    stamp = {"sec": state_hash.stamp.sec, "nanosec": state_hash.stamp.nanosec}
    values = (state_hash.run_id, state_hash.tick, stamp, state_hash.sha256)
    return String(data=json.dumps(dict(zip(_TYPES, values, strict=True))))


def from_state_hash_string(msg: String) -> StateHash:
    """Decode a state hash.

    Raises:
        CodecError: JSON; VALUE: a negative tick, a stamp out of range or another kind of digest.
    """
    values = parse_json_object(msg.data, _TYPES, "a state hash")
    stamp = parse_json_object(json.dumps(values["stamp"]), _STAMP_TYPES, "the stamp of a hash")
    digest = values["sha256"]
    is_digest = len(digest) == _DIGEST_LENGTH and set(digest) <= set(string.hexdigits.lower())
    is_stamp = 0 <= stamp["sec"] < 2**31 and 0 <= stamp["nanosec"] < 10**9
    if values["tick"] < 0 or not is_digest or not is_stamp:
        raise CodecError(
            f"{msg.data!r} is not a state hash; give a tick from 0, a stamp and a SHA-256",
            ErrorCode.VALUE,
        )
    return StateHash(values["run_id"], values["tick"], Time(**stamp), digest)
