"""The MCAP files of a bag."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from msg_bridge.bag.damage_text import describe_damage
from msg_bridge.bag.mcap_index import BagReadError
from msg_bridge.yaml_text import load_yaml

__all__ = ["bag_files_in", "bag_name", "find_bag_files"]

_SUFFIX = ".mcap"
_COMPRESSED = (".zstd", ".zst")
"""What follows `.mcap` in the name of a file that was compressed as a whole."""


def bag_name(path: Path) -> str:
    """Return the name of a bag: that of its folder, dots included, or of its file without `.mcap`.

    Args:
        path: the folder or the file.
    """
    name = path.resolve().name
    for suffix in (_SUFFIX, *(_SUFFIX + each for each in _COMPRESSED)):
        name = name.removesuffix(suffix)
    return name


def bag_files_in(folder: Path) -> list[Path]:
    """Return the MCAP files in a folder, those compressed as a whole included, in natural order.

    A file of which there is a compressed one, too, was being compressed: that one is left out.
    """
    files = list(folder.glob(f"*{_SUFFIX}"))
    for suffix in _COMPRESSED:
        found = folder.glob(f"*{_SUFFIX}{suffix}")
        files += [each for each in found if each.with_suffix("") not in files]
    return sorted(files, key=_natural_sort_key)


def find_bag_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag, in the order they were written.

    Args:
        path: folder of the bag, with or without metadata.yaml, or a file.

    Raises:
        BagReadError: there are none, or metadata.yaml is not readable or names others.
    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise BagReadError(
            f"there is no bag {path}; give an .mcap file or a folder that contains one"
        )
    metadata = path / "metadata.yaml"
    if not metadata.is_file():  # it is written last, so not by a recorder that was killed
        files = bag_files_in(path)
        if not files:
            raise BagReadError(f"{path} has neither metadata.yaml nor an .mcap file")
        return files
    try:
        information = load_yaml(metadata.read_text())["rosbag2_bagfile_information"]
        storage = information["storage_identifier"]
        names = list(information["relative_file_paths"])
    except (OSError, yaml.YAMLError, KeyError, TypeError, UnicodeDecodeError) as error:
        raise BagReadError(
            f"{metadata} is not the metadata of a bag: {describe_damage(error)}; give the .mcap"
            " file, or make a bag of the .mcap files by `earthmoving recover`"
        ) from error
    if storage != "mcap":
        raise BagReadError(f"{path} is stored as {storage}; convert it to mcap (ros2 bag convert)")
    files = [path / str(name) for name in names]
    missing = [file.name for file in files if not file.is_file()]
    if missing or not files:
        raise BagReadError(
            f"{path} lacks {', '.join(missing) or 'any file'}, which its metadata.yaml names;"
            " give one file, or make a bag of the files that exist by `earthmoving recover`"
        )
    return files


def _natural_sort_key(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts bag_10 after bag_9."""
    return [
        (int(part or 0), "") if part.isdigit() else (0, part)
        for part in re.split(r"(\d+)", path.name)
    ]
