"""Describe what is wrong with damaged bytes of a bag, instead of the text of a library's error."""

from __future__ import annotations

import struct

import yaml
import zstandard
from mcap.exceptions import EndOfFile, UnsupportedCompressionError
from mcap.stream_reader import CRCValidationError

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["describe_damage"]

_MAX_VALUE = 40
"""Maximum length of a damaged value that is shown."""


def describe_damage(error: Exception) -> str:
    """Return what is wrong with a part of a file, as a clause about it.

    Args:
        error: of zstd, lz4, struct, numpy, mcap or yaml, depending on the damage; or a ValueError
            of this package, whose text is such a clause already.
    """
    match error:
        case CRCValidationError():
            return f"its checksum is {error.actual:08x}, but {error.expected:08x} is recorded"
        case UnsupportedCompressionError():
            return f"it names the unknown compression {str(error).split()[-1][:_MAX_VALUE]!r}"
        case zstandard.ZstdError() | RuntimeError():  # the second one of lz4
            return "its compressed data cannot be decompressed"
        case EndOfFile() | struct.error() | IndexError():
            return "a length or an offset in it points behind its end"
        case UnicodeDecodeError():
            return "a text in it is not UTF-8"
        case MemoryError() | OverflowError():
            return "a length in it is impossible"
        case yaml.MarkedYAMLError() if error.problem_mark is not None:
            return f"line {error.problem_mark.line + 1} of it is no YAML"
        case KeyError():
            return f"it has no {str(error.args[0])[:_MAX_VALUE]}"
        case OSError():
            return f"it cannot be read ({error.strerror})"
        case EarthmovingError():
            return str(error)
        case ValueError() if type(error) is ValueError and str(error).startswith("its "):
            return str(error)
    return "its content is not as the format requires"
