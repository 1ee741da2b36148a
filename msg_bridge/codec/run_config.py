"""The configuration of a run as YAML.

`/sim/config` contains all parameters of the soil node, versions, seeds, and the digests of the
files that the node has read, which the recorder adds to the bag: a bag is self-contained. Machines
read from it what they need to take part, so that it is set only once. Viewers read the names and
colours of the soil types, whose ids are in maps and rows.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib import metadata
from typing import Any

import yaml

from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode, ParameterError
from msg_bridge.contract.input_files import InputFile
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.source_digest import source_digest
from msg_bridge.yaml_text import load_yaml

__all__ = [
    "SESSION",
    "RunFacts",
    "SoilKind",
    "parse_input_files",
    "parse_run_facts",
    "parse_section",
    "parse_session",
    "soil_kinds",
    "to_config_yaml",
    "versions",
]

_PACKAGES = ("earthmoving_sim", "numpy", "numba", "pybullet")

_MAX_TEXT_LENGTH = 2**17
"""Maximum length of a configuration: parsing takes about 10 s per million characters."""

_KINDS = "soil_kinds"
"""Name of the section of soil types."""

_INPUT_FILES = "input_files"
"""Name of the list of files that the node has read."""

SESSION = "session"
"""Name of the section with the id of a machine node's first session of the run, `id`: it is another
one after the process has been restarted; and with the revision of the terrain on which the machines
were placed, `terrain_revision`."""


@dataclass(frozen=True)
class RunFacts:
    """Parameters of a run that machines need.

    Attributes:
        run_id: number of the run.
        tick_period: tick period of the soil [s].
        realtime: whether ticks follow the wall clock.
        cell: side length of a column [m].
        soils: parameters of each soil type, by id.
    """

    run_id: int
    tick_period: float
    realtime: bool
    cell: float
    soils: tuple[LooseSoil, ...]


@dataclass(frozen=True)
class SoilKind:
    """Parameters of a soil type for display; its index is the id of the soil type.

    Attributes:
        name: empty for parameters given without a name.
        colour: colour of dry soil: red, green, blue, each 0..1.
        swell: loose volume over bank volume, minus 1.
        density: density of undisturbed soil [kg/m^3].
        repose_angles: angles of repose of loose soil [deg] at 0, 50 and 100 % of saturation.
    """

    name: str
    colour: tuple[float, float, float]
    swell: float
    density: float
    repose_angles: tuple[float, float, float]


def versions() -> dict[str, str]:
    """Return the versions of the software that determines the result of a run, by name.

    `source` is the digest of the source of this software, which changes between releases.
    """
    packages = {name: _version(name) for name in _PACKAGES}
    return {"python": platform.python_version(), **packages, "source": source_digest()}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed as a package"


def to_config_yaml(
    facts: RunFacts,
    sections: Mapping[str, Any],
    kinds: Sequence[SoilKind] = (),
    input_files: Sequence[InputFile] = (),
) -> str:
    """Encode the configuration as YAML.

    Args:
        facts: the section `run`.
        sections: further sections, mappings of plain values by name.
        kinds: soil types by id; the section is left out if there are none.
        input_files: files that the node has read.
    """
    run = {
        "run_id": facts.run_id,
        "tick_period": facts.tick_period,
        "sync": "realtime" if facts.realtime else "lockstep",
        "cell": facts.cell,
        "soils": [_plain(asdict(soil)) for soil in facts.soils],
    }
    soils = {_KINDS: [{"id": n, **_plain(asdict(k))} for n, k in enumerate(kinds)]} if kinds else {}
    files = {_INPUT_FILES: [asdict(each) for each in input_files]}
    content = {"run": run, **_plain(sections), **soils, **files, "versions": versions()}
    return str(yaml.safe_dump(content, sort_keys=False))


def parse_run_facts(text: str) -> RunFacts:
    """Decode the section `run` of a configuration.

    Raises:
        CodecError: JSON: it cannot be parsed; VALUE.
    """
    try:
        run = _load(text)["run"]
        sync = str(run["sync"])
        if sync not in ("realtime", "lockstep"):
            raise CodecError(
                f"sync is {sync!r} in the configuration of the run; give realtime or lockstep",
                ErrorCode.VALUE,
            )
        facts = RunFacts(
            run_id=int(run["run_id"]),
            tick_period=float(run["tick_period"]),
            realtime=sync == "realtime",
            cell=float(run["cell"]),
            soils=tuple(_loose_soil(each) for each in run["soils"]),
        )
    except ParameterError as error:
        raise CodecError(
            f"a soil in the configuration of the run: {error}", ErrorCode.VALUE
        ) from error
    except (yaml.YAMLError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise CodecError(
            f"the configuration of the run cannot be read: {error!r}", ErrorCode.JSON
        ) from error
    for name in ("tick_period", "cell"):
        value = getattr(facts, name)
        if not 0.0 < value < math.inf:
            raise CodecError(
                f"{name} is {value} in the configuration of the run; give a value above 0",
                ErrorCode.VALUE,
            )
    if not facts.soils:
        raise CodecError(
            "there is no soil in the configuration of the run; list all soil types", ErrorCode.VALUE
        )
    return facts


def parse_session(text: str) -> tuple[int, int]:
    """Decode the run and the session of the configuration of a machine node.

    Returns:
        (number of the run, id of the node's first session of the run).

    Raises:
        CodecError: JSON: they cannot be parsed.
    """
    try:
        content = _load(text)
        return int(content["run"]["run_id"]), int(content[SESSION]["id"])
    except (yaml.YAMLError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise CodecError(
            f"the session of the machine cannot be read: {error!r}", ErrorCode.JSON
        ) from error


def parse_input_files(text: str) -> tuple[InputFile, ...]:
    """Decode the files that a node has read; none in configurations of earlier versions.

    Raises:
        CodecError: JSON: they cannot be parsed.
    """
    try:
        return tuple(
            InputFile(
                str(each["parameter"]), str(each["path"]), str(each["sha256"]), int(each["size"])
            )
            for each in _load(text).get(_INPUT_FILES, ())
        )
    except (
        yaml.YAMLError,
        KeyError,
        TypeError,
        AttributeError,
        ValueError,
        OverflowError,
    ) as error:
        raise CodecError(
            f"the input files of a configuration cannot be read: {error!r}", ErrorCode.JSON
        ) from error


def parse_section(text: str, name: str) -> dict[str, Any]:
    """Decode one section of a configuration.

    Raises:
        CodecError: JSON: it cannot be parsed, or is no mapping of names.
    """
    try:
        return {str(key): value for key, value in _load(text)[name].items()}
    except (yaml.YAMLError, KeyError, TypeError, AttributeError, ValueError) as error:
        raise CodecError(
            f"the section {name!r} of a configuration cannot be read: {error!r}", ErrorCode.JSON
        ) from error


@lru_cache(maxsize=32)  # bags repeat configurations, and parsing one takes 15 ms
def _load(text: str) -> Mapping[Any, Any]:
    """Parse YAML from outside.

    Raises:
        ValueError: it is too long, nested too deep, or no mapping of sections.
        yaml.YAMLError: it is not YAML.
    """
    if len(text) > _MAX_TEXT_LENGTH:
        raise ValueError(f"{len(text)} characters are too long; give at most {_MAX_TEXT_LENGTH}")
    try:
        content = load_yaml(text)
    except RecursionError:
        raise ValueError("it is nested too deep") from None
    if not isinstance(content, dict):
        found = "empty" if content is None else f"a {type(content).__name__}"
        raise ValueError(f"it is {found}; give sections by name")
    return content


def _loose_soil(values: Mapping[str, Any]) -> LooseSoil:
    if not isinstance(values, Mapping):
        raise TypeError(f"a soil is {values!r}, not a mapping")
    numbers: dict[str, Any] = {
        name: tuple(map(float, value)) if isinstance(value, list) else float(value)
        for name, value in values.items()
    }
    if "moisture" in numbers:
        numbers["moisture"] = int(values["moisture"])
    return LooseSoil(**numbers)


def soil_kinds(text: str) -> tuple[SoilKind, ...]:
    """Decode the soil types, by id, of the configuration of the soil node.

    Raises:
        CodecError: JSON: they cannot be parsed; VALUE: wrong ids.
    """
    try:
        listed = list(_load(text)[_KINDS])
        kinds = tuple(_kind(each) for each in listed)
        ids = [each["id"] for each in listed]
    except (yaml.YAMLError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise CodecError(
            f"the soil types of the run cannot be read: {error!r}", ErrorCode.JSON
        ) from error
    if not kinds or ids != list(range(len(kinds))):
        raise CodecError(f"the soil types have the ids {ids}; count from 0", ErrorCode.VALUE)
    return kinds


def _kind(values: Mapping[str, Any]) -> SoilKind:
    red, green, blue = map(float, values["colour"])
    dry, damp, wet = map(float, values["repose_angles"])
    kind = SoilKind(
        name=str(values["name"]),
        colour=(red, green, blue),
        swell=float(values["swell"]),
        density=float(values["density"]),
        repose_angles=(dry, damp, wet),
    )
    numbers = (*kind.colour, kind.swell, kind.density, *kind.repose_angles)
    if not all(0.0 <= number < math.inf for number in numbers):
        raise ValueError(f"the parameters {numbers} must be finite and not negative")
    return kind


def _plain(value: Any) -> Any:
    """Return a value as plain YAML has it: tuples become lists."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(each) for each in value]
    return value
