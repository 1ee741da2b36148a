"""Error classes of the package. Each message states what is wrong and what to change."""

from enum import StrEnum

__all__ = ["EarthmovingError", "ErrorCode", "ExchangeError", "ParameterError"]


class EarthmovingError(ValueError):
    """Base class of every error that this package raises on bad input."""


class ParameterError(EarthmovingError):
    """A parameter is missing, unknown, of the wrong type or outside its range."""


class ErrorCode(StrEnum):
    """Reason of an `ExchangeError`, for programs; the message is for people.

    docs/concepts/exchange_protocol.md lists the codes.
    """

    # Protocol: a well-formed message, or a call, at odds with the state of the exchange.
    ID_RANGE = "id_range"
    """A machine id or session id is outside the range of its field."""
    ROW_RANGE = "row_range"
    """A header counts too many rows, or rows that do not continue its stream."""
    VOLUME_RANGE = "volume_range"
    """A reported volume is negative or too large."""
    VOLUME_MISMATCH = "volume_mismatch"
    """A machine reports another volume than follows from the conversion rows it acknowledges."""
    DEPOSIT_VOLUME = "deposit_volume"
    """A machine requests to deposit more soil than it holds, or a particle twice."""
    ACKNOWLEDGEMENT = "acknowledgement"
    """A machine acknowledges conversion rows that it cannot have applied."""
    STREAM_DIRECTION = "stream_direction"
    """Rows, or a message, of a kind that this sender does not send."""
    ROW_TYPE = "row_type"
    """Rows of another dtype or shape than those of their stream."""
    SEQUENCE_NUMBER = "sequence_number"
    """A row is numbered far beyond all rows received."""
    SENDER_MISMATCH = "sender_mismatch"
    """Rows of more than one machine, run or session, or of another than the message states."""
    ROW_DIGEST = "row_digest"
    """Rows do not match the digest in the header that counts them."""
    MISSING_ROWS = "missing_rows"
    """Rows were requested from a buffer that does not have them."""
    JOIN_STATE = "join_state"
    """A call is not allowed in the present join state."""
    NOT_JOINED = "not_joined"
    """A machine does not take part."""
    STILL_JOINED = "still_joined"
    """A machine takes part, or is about to."""
    RELEASE = "release"
    """Released soil was not deposited in full."""
    REJOIN_VOLUME = "rejoin_volume"
    """A machine rejoins with another volume of soil than it left with."""
    OFF_MAP = "off_map"
    """A row names a column outside the grid."""
    PARTICLE = "particle"
    """A conversion answers a deposit request that was not made."""
    EXCAVATION = "excavation"
    """A conversion credits soil that the machine's tools cannot have cut."""
    MACHINE_ID_TAKEN = "machine_id_taken"
    """A machine node uses the machine id of another one that is running."""
    LOST_MESSAGE = "lost_message"
    """A transport that loses no messages has lost one."""

    # Encoding: a message that cannot be decoded, or a value that cannot be encoded.
    AUTHENTICATION = "authentication"
    """A message lacks the code of the exchange key, or has another."""
    SERIALIZATION = "serialization"
    """Bytes that are truncated, or a message of another type."""
    LAYOUT = "layout"
    """Sizes of a message contradict one another."""
    MESSAGE_KIND = "message_kind"
    """The first value of an array is not a known kind of message."""
    LABELS = "labels"
    """A known label of an array is missing, repeated or in the wrong place."""
    FIELDS = "fields"
    """A known field of a cloud is missing, repeated or of another offset, type or count."""
    BYTE_ORDER = "byte_order"
    """A big-endian message."""
    VALUE = "value"
    """A value is outside its range."""
    JSON = "json"
    """A text is not the JSON or YAML document expected."""
    EMPTY = "empty"
    """A chunk without rows."""
    SHAPE = "shape"
    """An array has the wrong shape."""
    FRAME = "frame"
    """A message is of another coordinate frame."""
    DTYPE = "dtype"
    """A dtype that no message can carry."""
    GRID = "grid"
    """Points that are not the cell centres of a grid around the origin."""
    STAMP = "stamp"
    """A time that no stamp can carry, or that is not the end of a tick."""


class ExchangeError(EarthmovingError):
    """A message or a call violates the exchange protocol. No state was changed.

    Attributes:
        code: the reason.
    """

    def __init__(self, message: str, code: ErrorCode) -> None:
        super().__init__(message)
        self.code = code

    @property
    def coded_message(self) -> str:
        """The code and the message, for logs and diagnostics."""
        return f"{self.code}: {self}"
