"""Write a bag from a thread of its own, so that compression and a slow disk delay no reception."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from queue import SimpleQueue
from typing import NamedTuple

from msg_bridge.bag.message_schemas import schema_text, type_hash
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.writer import BagError, BagWriter

__all__ = ["BackgroundWriter"]

_LOGGER = logging.getLogger(__name__)


class _Job(NamedTuple):
    """A call of the bag writer.

    Attributes:
        call: the call.
        size: number of bytes that it holds until then.
        is_signal: whether it is done after an error, too.
    """

    call: Callable[[], None]
    size: int = 0
    is_signal: bool = False


class BackgroundWriter:
    """A bag whose messages are queued in memory and written in their order by a thread.

    Methods are called by one thread. An error of the bag is raised by the next method that can
    raise it; what is queued then is not written.
    """

    def __init__(self, writer: BagWriter, max_queue_size: int) -> None:
        """Start the thread.

        Args:
            writer: the bag, used only by the thread from now on.
            max_queue_size: maximum size of the queued messages [bytes].
        """
        self._writer = writer
        self._max_queue_size = max_queue_size
        self._jobs: SimpleQueue[_Job | None] = SimpleQueue()
        # Each of these is changed by one thread and read by the other.
        self._num_bytes_queued = 0  # since the begin
        self._num_bytes_done = 0
        self._num_splits_queued = 0
        self._num_splits_done = 0
        self._error: BagError | None = None
        self._is_error_raised = False
        self._closed = False
        self._topics: list[str] = []
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    @property
    def path(self) -> str:
        """Folder of the bag."""
        return str(self._writer.folder)

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of the topics, in the order they were added."""
        return tuple(self._topics)

    @property
    def size(self) -> int:
        """Size of the bag's files [bytes], without what is queued."""
        return self._writer.size

    @property
    def file_size(self) -> int:
        """Size of the current file [bytes]; 0 while the next one has not been begun."""
        is_splitting = self._num_splits_queued > self._num_splits_done
        return 0 if is_splitting else self._writer.file_size

    @property
    def queue_size(self) -> int:
        """Size of the queued messages [bytes]."""
        return self._num_bytes_queued - self._num_bytes_done

    @property
    def num_files(self) -> int:
        """Number of the bag's files."""
        return self._writer.num_files

    @property
    def has_failed(self) -> bool:
        """Whether a write failed; nothing more is written then."""
        return self._error is not None

    def add_topic(
        self, topic: str, type_name: str, offered: Sequence[OfferedQos], advertised_hash: str | None
    ) -> None:
        """Add a topic; arguments are those of `BagWriter.add_topic`.

        Raises:
            SchemaError: the type is not installed.
        """
        schema_text(type_name)  # cached; an unknown type is an error here and not in the thread
        advertised = advertised_hash or type_hash(type_name)
        self._topics.append(topic)
        self._put(lambda: self._writer.add_topic(topic, type_name, offered, advertised))

    def write(
        self, topic: str, data: bytes, log_time: int, publish_time: int, sequence: int
    ) -> bool:
        """Queue a message; arguments are those of `BagWriter.write`.

        Returns:
            False if the queue is full, and the message is not written.

        Raises:
            BagError: the bag cannot be written.
        """
        self._raise_error()
        size = len(data)
        if self.queue_size + size > self._max_queue_size and self.queue_size:
            return False
        self._put(lambda: self._writer.write(topic, data, log_time, publish_time, sequence), size)
        return True

    def attach(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """Queue an attachment; arguments are those of `BagWriter.attach`.

        Raises:
            BagError: the bag cannot be written.
        """
        self._raise_error()
        self._put(lambda: self._writer.attach(name, media_type, data, time), len(data))

    def flush(self, when_done: Callable[[], None] = lambda: None) -> None:
        """Have the queued messages moved to the file.

        Args:
            when_done: is called by the thread when they are in the file.

        Raises:
            BagError: the bag cannot be written.
        """
        self._raise_error()

        def flush() -> None:
            self._writer.flush()
            when_done()

        self._put(flush)

    def split(self) -> None:
        """Have the next messages written to another file.

        Raises:
            BagError: the bag cannot be written.
        """
        self._raise_error()
        self._num_splits_queued += 1
        self._put(self._split)

    def wait(self) -> None:
        """Wait until all that is queued has been written.

        Raises:
            BagError: the bag cannot be written.
        """
        written = threading.Event()
        self._jobs.put(_Job(written.set, is_signal=True))
        written.wait()
        self._raise_error()

    def close(self, custom: Mapping[str, str]) -> None:
        """Write all that is queued, finish the bag and end the thread; a second call does nothing.

        Args:
            custom: custom data of metadata.yaml, by name.

        Raises:
            BagError: the bag cannot be written, and this was not raised before.
        """
        if self._closed:
            return
        self._closed = True
        self._jobs.put(None)
        self._thread.join()
        self._close(custom)
        if not self._is_error_raised:
            self._raise_error()

    def _close(self, custom: Mapping[str, str]) -> None:
        try:
            self._writer.close(custom)
        except BagError as error:
            self._error = self._error or error

    def _put(self, call: Callable[[], None], size: int = 0) -> None:
        self._num_bytes_queued += size
        self._jobs.put(_Job(call, size))

    def _raise_error(self) -> None:
        if self._error is not None:
            self._is_error_raised = True
            raise self._error

    def _split(self) -> None:
        self._writer.split()
        self._num_splits_done += 1

    def _run(self) -> None:
        """Do the queued jobs; after an error, only signals."""
        for job in iter(self._jobs.get, None):
            try:
                if self._error is None or job.is_signal:
                    job.call()
            except BagError as error:
                self._error = self._error or error
            except Exception as error:  # else the thread would end, and nothing be reported
                text = (
                    f"{self.path} cannot be continued because of an error of the recorder ({error})"
                )
                self._error = self._error or BagError(text)
                _LOGGER.error("the recorder has failed", exc_info=error)
            self._num_bytes_done += job.size
