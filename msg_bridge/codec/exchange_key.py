"""A key that soil and machines share, with which they authenticate the messages of the exchange.

Headers, requests, rejections and chunks of rows then end with an authentication code: HMAC-SHA-256
(RFC 2104) of the message's kind and content, cut to 128 bits. Whoever lacks the key can read the
messages but not forge or change them. Messages that are sent again change nothing, because the
exchange drops them by their numbers; the most recent ones only keep their sender from being
dropped.
"""

from __future__ import annotations

import hmac
import os
from pathlib import Path
from typing import NamedTuple

from msg_bridge.contract.errors import ParameterError

__all__ = ["AuthenticationCode", "ExchangeKey"]

_MIN_LENGTH = 16
"""Minimum length of a key [bytes]."""

_MAX_LENGTH = 4096
"""Maximum length of a key file [bytes]: a larger one is another file."""


class AuthenticationCode(NamedTuple):
    """128 bits that authenticate a message, as two int64."""

    first: int
    second: int


class ExchangeKey:
    """Secret bytes."""

    def __init__(self, secret: bytes) -> None:
        """
        Args:
            secret: the key, 16 bytes or more.

        Raises:
            ParameterError: it is too short.
        """
        if len(secret) < _MIN_LENGTH:
            raise ParameterError(
                f"the exchange key has {len(secret)} bytes; give {_MIN_LENGTH} random bytes or more"
            )
        self._secret = secret

    @classmethod
    def read(cls, path: str) -> ExchangeKey | None:
        """Return the key in a file; None if the path is empty.

        Raises:
            ParameterError: it cannot be read, is too short or too long, or others may read it.
        """
        if not path:
            return None
        file = Path(path).expanduser()
        try:
            with file.open("rb") as stream:
                permissions = os.fstat(stream.fileno()).st_mode & 0o077
                secret = stream.read(_MAX_LENGTH + 1)
        except OSError as error:
            raise ParameterError(
                f"exchange_key_file {path!r} cannot be read ({error.strerror}); create one with"
                f" `head -c 32 /dev/urandom > {path}; chmod 600 {path}`"
            ) from error
        if permissions:
            raise ParameterError(
                f"exchange_key_file {path!r} can be read by other users; run `chmod 600 {path}`"
            )
        if len(secret) > _MAX_LENGTH:
            raise ParameterError(
                f"exchange_key_file {path!r} has more than {_MAX_LENGTH} bytes; give a key file"
            )
        return cls(secret)

    def code(self, kind: str, content: bytes) -> AuthenticationCode:
        """Return the authentication code of a message.

        Args:
            kind: kind of the message; messages of two kinds never have the same code.
            content: everything that the receiver reads from it.
        """
        digest = hmac.digest(self._secret, kind.encode() + b"\0" + content, "sha256")
        return AuthenticationCode(
            int.from_bytes(digest[:8], "little", signed=True),
            int.from_bytes(digest[8:16], "little", signed=True),
        )
