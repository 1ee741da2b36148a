"""The files that the nodes of a run have read, taken from the attachments of its bag."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from earthmoving_sim.replay.errors import RecordedFileError
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.run_config import parse_input_files
from msg_bridge.contract.input_files import InputFile

__all__ = ["restore_files"]


def restore_files(reader: BagReader, config: str, folder: Path) -> Mapping[str, Path]:
    """Write the files that a node has read into a folder.

    Files keep their places relative to one another, because a machine file names its shapes by a
    relative path. A file that is not attached is read where it was, if it is still the same.

    Args:
        reader: the bag.
        config: configuration of the node [YAML].
        folder: an empty folder.

    Returns:
        Path of each file by the name of its parameter.

    Raises:
        RecordedFileError: a file is missing.
        CodecError: the configuration cannot be read.
        BagReadError: the bag is damaged.
    """
    files = parse_input_files(config)
    if not files:
        return {}
    common = Path(os.path.commonpath([str(Path(file.path).parent) for file in files]))
    paths = {}
    for file in files:
        path = folder / Path(file.path).relative_to(common)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_content(reader, file))
        paths[file.parameter] = path
    return paths


def _content(reader: BagReader, file: InputFile) -> bytes:
    if file.attachment_name in reader.attachment_names:
        content = reader.read_attachment(file.attachment_name)
        if not file.has_content(content):
            raise RecordedFileError(
                f"the attachment {file.attachment_name} of {reader.path} is damaged: its SHA-256 is"
                " another one; copy the bag again"
            )
        return content
    try:
        content = Path(file.path).read_bytes()
    except OSError:
        content = b""
    if not file.has_content(content):
        raise RecordedFileError(
            f"{reader.path} lacks the file of {file.parameter}, and {file.path} is missing or"
            " another one by now; copy the file with the SHA-256 that starts with"
            f" {file.sha256[:12]} there"
        )
    return content
