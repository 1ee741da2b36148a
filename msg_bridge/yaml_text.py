"""YAML that is read with libyaml, 10 times as fast as with PyYAML's parser in Python.

libyaml calls itself for each level of nesting, and would end the process where a text from outside
has tens of thousands. Such texts are read with the parser in Python, which raises an error.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

__all__ = ["load_yaml"]

# A PyYAML that was built without a C compiler has none.
_FastLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_MAX_NESTING = 2000

_INDENTATION = re.compile(r"[ \t?:-]+")
"""What a line can begin with before its first value; anywhere, as YAML has many line breaks."""


def load_yaml(text: str) -> Any:
    """Return the content of a YAML text: numbers, texts, lists and mappings, as `yaml.safe_load`.

    Raises:
        yaml.YAMLError: it is not YAML.
        RecursionError: it is nested too deep.
        ValueError: it has an invalid date.
    """
    return yaml.load(text, _FastLoader if _max_nesting(text) < _MAX_NESTING else yaml.SafeLoader)


def _max_nesting(text: str) -> int:
    """Return an upper bound of the number of levels: each has a bracket, or an indentation."""
    indentation = max(map(len, _INDENTATION.findall(text)), default=0)
    return text.count("[") + text.count("{") + indentation
