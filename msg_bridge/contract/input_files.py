"""Files that the result of a run depends on: terrain, design, maps, soils, machines."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

__all__ = ["InputFile", "read_input_file"]


@dataclass(frozen=True)
class InputFile:
    """A file that a node has read.

    Attributes:
        parameter: name of the parameter that names the file, such as `site.terrain`; that of a file
            that another one names ends with its key there, as `machine.shapes`.
        path: absolute path of the file.
        sha256: digest of its content, 64 lower-case hexadecimal digits.
        size: size of its content [bytes].
    """

    parameter: str
    path: str
    sha256: str
    size: int

    @property
    def attachment_name(self) -> str:
        """Name of the file as an attachment of a bag; files with the same content share it only
        if they have the same name."""
        return f"{self.sha256}/{Path(self.path).name}"

    def has_content(self, content: bytes) -> bool:
        """Return whether a content is that of the file."""
        return hashlib.sha256(content).hexdigest() == self.sha256


def read_input_file(parameter: str, path: str | Path) -> InputFile:
    """Return the description of a file.

    Args:
        parameter: name of the parameter that names the file.
        path: the file, relative to the working folder if it is not absolute.

    Raises:
        OSError: the file cannot be read.
    """
    absolute = Path(path).expanduser().absolute()
    content = absolute.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    return InputFile(parameter, str(absolute), digest, len(content))
