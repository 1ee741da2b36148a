"""The configuration of a run as YAML: everything for the record, a few facts for machines.

`/sim/config` holds all parameters of the soil's node, versions and seeds, so that a bag explains
itself. What a machine must know to take part is read back from it, so that it is set once.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import yaml

from msg_bridge.codec.errors import CodecError

__all__ = ["RunFacts", "config_text", "run_facts", "versions"]

_PACKAGES = ("earthmoving_sim", "numpy", "numba", "pybullet")


@dataclass(frozen=True)
class RunFacts:
    """What a machine must know of the run it takes part in.

    Attributes:
        epoch: number of the run.
        tick: length of a soil tick [s].
        realtime: whether ticks follow the wall clock.
        cell: side length of a column [m].
        swell: part by which bank soil grows when it is loosened.
    """

    epoch: int
    tick: float
    realtime: bool
    cell: float
    swell: float


def versions() -> dict[str, str]:
    """Versions of what makes a run what it is, by name."""
    return {"python": platform.python_version(), **{name: _version(name) for name in _PACKAGES}}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed as a package"


def config_text(facts: RunFacts, sections: Mapping[str, Any]) -> str:
    """The configuration as YAML.

    Args:
        facts: of the run.
        sections: everything else, mappings of plain values by name.
    """
    run = {
        "epoch": facts.epoch,
        "tick": facts.tick,
        "sync": "realtime" if facts.realtime else "lockstep",
        "cell": facts.cell,
        "swell": facts.swell,
    }
    content = {"run": run, **_plain(sections), "versions": versions()}
    return str(yaml.safe_dump(content, sort_keys=False))


def run_facts(text: str) -> RunFacts:
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
            epoch=int(run["epoch"]),
            tick=float(run["tick"]),
            realtime=sync == "realtime",
            cell=float(run["cell"]),
            swell=float(run["swell"]),
        )
    except (yaml.YAMLError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise CodecError(f"the configuration of the run cannot be read: {error!r}") from error
    for name in ("tick", "cell"):
        value = getattr(facts, name)
        if not 0.0 < value < math.inf:
            raise CodecError(
                f"{name} is {value} in the configuration of the run; it must be above 0"
            )
    if not 0.0 <= facts.swell < math.inf:
        raise CodecError(f"swell is {facts.swell} in the configuration of the run")
    return facts


def _plain(value: Any) -> Any:
    """A value as YAML writes it: tuples are lists."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(each) for each in value]
    return value
