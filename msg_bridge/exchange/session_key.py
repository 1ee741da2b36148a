"""The numbers that identify one session of one machine in one run."""

from __future__ import annotations

import secrets
from typing import NamedTuple

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import (
    JoinRejected,
    MachineHeader,
    MachineReceipt,
    RetransmitRequest,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
)

__all__ = ["MAX_MACHINE_ID", "MAX_SESSION_ID", "SessionKey", "random_session_id"]

MAX_MACHINE_ID = 2**16 - 1
"""Largest machine id; rows carry it as uint16."""

MAX_SESSION_ID = 2**32 - 1
"""Largest session id; rows carry it as uint32."""


def random_session_id() -> int:
    """Return a session id that no other session has: random, so that no clock needs to be right."""
    return 1 + secrets.randbelow(MAX_SESSION_ID)


class SessionKey(NamedTuple):
    """A session of a machine.

    Attributes:
        run_id: number of the run.
        machine_id: number of the machine, from 1.
        session_id: number of the session, another in each join of this machine.
    """

    run_id: int
    machine_id: int
    session_id: int

    def check(self) -> None:
        """Check that the ids fit the fields of rows.

        Raises:
            ExchangeError: ID_RANGE.
        """
        if not (1 <= self.machine_id <= MAX_MACHINE_ID and 1 <= self.session_id <= MAX_SESSION_ID):
            raise ExchangeError(
                f"machine {self.machine_id} requests to join in session {self.session_id}; give a"
                f" machine id from 1 to {MAX_MACHINE_ID} and a session id from 1 to"
                f" {MAX_SESSION_ID}",
                ErrorCode.ID_RANGE,
            )

    def matches(
        self, message: MachineHeader | MachineReceipt | RowChunk | RetransmitRequest | JoinRejected
    ) -> bool:
        """Return whether a message of this run is of this machine and session."""
        return message.machine_id == self.machine_id and message.session_id == self.session_id

    def receipt(self, header: SoilHeader) -> MachineReceipt | None:
        """Return the receipt of this session in a soil header, None if there is none."""
        for receipt in header.receipts:
            if self.matches(receipt):
                return receipt
        return None

    def request(self, stream: Stream, span: RowRange) -> RetransmitRequest:
        """Return a request for rows of this session, or for headers from tick `span.first` on."""
        return RetransmitRequest(*self, stream, span.first, span.count)
