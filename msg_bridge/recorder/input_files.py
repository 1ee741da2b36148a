"""Add the files that the nodes of a run have read to its bag, as attachments.

The configurations of soil and machine nodes name these files with their SHA-256. A file that is not
there, or has been changed since it was read, is missing from the bag.
"""

from __future__ import annotations

from pathlib import Path

from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from msg_bridge.codec.run_config import parse_input_files
from msg_bridge.contract import topics
from msg_bridge.contract.input_files import InputFile
from msg_bridge.raw_topics.received_message import ReceivedMessage
from msg_bridge.recorder.background_writer import BackgroundWriter

__all__ = ["InputFileRecording", "media_type"]

_CONFIG_NAMES = (f"/{topics.SIM_CONFIG}", f"/{topics.MACHINE_CONFIG}")
_TYPE = "std_msgs/msg/String"

_MEDIA_TYPES = {
    ".yaml": "application/yaml",
    ".png": "image/png",
    ".tif": "image/tiff",
    ".asc": "text/plain",
}
_OTHER_MEDIA_TYPE = "application/octet-stream"


class InputFileRecording:
    """The input files of a bag being recorded.

    Attributes:
        attached: names of the attachments so far.
        missing: parameter and path of each file that is missing from the bag.
    """

    def __init__(self, writer: BackgroundWriter) -> None:
        """
        Args:
            writer: the bag.
        """
        self.attached: list[str] = []
        self.missing: dict[str, str] = {}
        self._writer = writer
        self._config_topics: set[str] = set()
        self._examined: set[str] = set()  # names of attachments

    def add_topic(self, topic: str, type_name: str) -> None:
        """Add a topic of the bag."""
        if type_name == _TYPE and topic.endswith(_CONFIG_NAMES):
            self._config_topics.add(topic)

    def add_message(self, message: ReceivedMessage, log_time: int) -> None:
        """Attach the files that a message names, if it is a configuration.

        Args:
            message: a recorded message.
            log_time: its log time [ns].

        Raises:
            BagError: the bag cannot be written.
        """
        if message.topic not in self._config_topics:
            return
        try:
            files = parse_input_files(deserialize_message(message.data, String).data)
        except Exception:  # of another program; RCLError and others, depending on what it is
            return
        for file in files:
            if file.attachment_name not in self._examined:
                self._examined.add(file.attachment_name)
                self._attach(file, log_time)

    def _attach(self, file: InputFile, log_time: int) -> None:
        content = _read(file)
        if content is None:
            self.missing[file.parameter] = file.path
            return
        self._writer.attach(file.attachment_name, media_type(file.path), content, log_time)
        self.attached.append(file.attachment_name)


def media_type(path: str) -> str:
    """Return the media type of an input file by its suffix."""
    return _MEDIA_TYPES.get(Path(path).suffix.lower(), _OTHER_MEDIA_TYPE)


def _read(file: InputFile) -> bytes | None:
    """Return the content of a file; None if it is not there, or another one by now."""
    path = Path(file.path)
    try:
        # Anyone may publish a configuration: do not read a device, nor a file of another size.
        if not path.is_file() or path.stat().st_size != file.size:
            return None
        content = path.read_bytes()
    except OSError:
        return None
    return content if file.has_content(content) else None
