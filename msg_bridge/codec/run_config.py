"""The configuration of a run as YAML: everything for the record, a few facts for machines.

`/sim/config` holds all parameters of the soil's node, versions and seeds, so that a bag explains
itself. What a machine must know to take part is read back from it, so that it is set once; and
what the ids of soils in maps and rows mean, so that a viewer can name and colour them.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Any

import yaml

from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["RunFacts", "SoilKind", "parse_run_facts", "soil_kinds", "to_config_yaml", "versions"]

_PACKAGES = ("earthmoving_sim", "numpy", "numba", "pybullet")

_KINDS = "soil_kinds"
"""Section of the kinds of soil."""


@dataclass(frozen=True)
class RunFacts:
    """What a machine must know of the run it takes part in.

    Attributes:
        epoch: number of the run.
        tick_period: length of a soil tick [s].
        realtime: whether ticks follow the wall clock.
        cell: side length of a column [m].
        soils: what each is like when it is loose, by id.
    """

    run_id: int
    tick_period: float
    realtime: bool
    cell: float
    soils: tuple[LooseSoil, ...]


@dataclass(frozen=True)
class SoilKind:
    """What a viewer must know of a kind of soil; its place among all kinds is its id.

    Attributes:
        name: empty for one whose figures were given without a name.
        colour: of dry soil: red, green, blue, each 0..1.
        swell: part by which it grows when loosened.
        density: of undisturbed soil [kg/m^3].
        repose_angles: slope beyond which it slips when loose [deg], at 0, 50 and 100 % of
            saturation.
    """

    name: str
    colour: tuple[float, float, float]
    swell: float
    density: float
    repose_angles: tuple[float, float, float]


def versions() -> dict[str, str]:
    """Versions of what makes a run what it is, by name."""
    return {"python": platform.python_version(), **{name: _version(name) for name in _PACKAGES}}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed as a package"


def to_config_yaml(
    facts: RunFacts, sections: Mapping[str, Any], kinds: Sequence[SoilKind] = ()
) -> str:
    """The configuration as YAML.

    Args:
        facts: of the run.
        sections: everything else, mappings of plain values by name.
        kinds: of soil, by id; left out if there are none.
    """
    run = {
        "run_id": facts.run_id,
        "tick_period": facts.tick_period,
        "sync": "realtime" if facts.realtime else "lockstep",
        "cell": facts.cell,
        "soils": [_plain(asdict(soil)) for soil in facts.soils],
    }
    soils = {_KINDS: [{"id": n, **_plain(asdict(k))} for n, k in enumerate(kinds)]} if kinds else {}
    content = {"run": run, **_plain(sections), **soils, "versions": versions()}
    return str(yaml.safe_dump(content, sort_keys=False))


def parse_run_facts(text: str) -> RunFacts:
    """What a machine must know, from the configuration.

    Raises:
        CodecError: not such a configuration; says what is missing.
    """
    try:
        run = yaml.safe_load(text)["run"]
        sync = str(run["sync"])
        if sync not in ("realtime", "lockstep"):
            raise CodecError(f"sync is {sync!r} in the configuration of the run")
        facts = RunFacts(
            run_id=int(run["run_id"]),
            tick_period=float(run["tick_period"]),
            realtime=sync == "realtime",
            cell=float(run["cell"]),
            soils=tuple(_loose_soil(each) for each in run["soils"]),
        )
    except ParameterError as error:
        raise CodecError(f"a soil in the configuration of the run: {error}") from error
    except (yaml.YAMLError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise CodecError(f"the configuration of the run cannot be read: {error!r}") from error
    for name in ("tick_period", "cell"):
        value = getattr(facts, name)
        if not 0.0 < value < math.inf:
            raise CodecError(
                f"{name} is {value} in the configuration of the run; it must be above 0"
            )
    if not facts.soils:
        raise CodecError("there is no soil in the configuration of the run; it must list them all")
    return facts


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
    """The kinds of soil by id, from the configuration of the soil's node.

    Raises:
        CodecError: not such a configuration; says what is wrong.
    """
    try:
        listed = list(yaml.safe_load(text)[_KINDS])
        kinds = tuple(_kind(each) for each in listed)
        ids = [each["id"] for each in listed]
    except (yaml.YAMLError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise CodecError(f"the kinds of soil of the run cannot be read: {error!r}") from error
    if not kinds or ids != list(range(len(kinds))):
        raise CodecError(f"the kinds of soil have the ids {ids}; they must count from 0")
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
        raise ValueError(f"a soil cannot have the figures {numbers}")
    return kind


def _plain(value: Any) -> Any:
    """A value as YAML writes it: tuples are lists."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(each) for each in value]
    return value
