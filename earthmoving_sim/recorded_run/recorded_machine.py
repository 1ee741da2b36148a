"""Derive the machine of a recorded run, the path of its cutting lip and the poses of its shoes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from earthmoving_sim.dig_outcome import PATH_INTERVAL_TICKS
from earthmoving_sim.recorded_run.run_record import MachineState, OperatorPhase
from earthmoving_sim.recorded_run.topic_decoders import (
    MACHINE_CONFIG_SUFFIX,
    Namespaces,
    RecordedRunError,
    machine_config_section,
)
from machine_sim.machine import (
    MachineSpec,
    load_machine_spec,
    rotation_matrix,
    tool_pose,
    with_track_model,
)
from msg_bridge.config_files import ConfigError, find_config
from msg_bridge.yaml_text import load_yaml

__all__ = ["LipPath", "lip_path", "load_recorded_machine", "shoe_poses"]

_TRACKS_SUFFIX = "/tracks"  # end of the namespace of the tracks' markers


class LipPath(NamedTuple):
    """Path of the cutting lip.

    Attributes:
        points: lip positions [m] in the map frame, shape (n, 3).
        cycle: the operator's cycle at each point, shape (n,).
        phase: the operator's phase at each point, shape (n,).
    """

    points: NDArray[np.float64]
    cycle: NDArray[np.int64]
    phase: NDArray[np.str_]


def load_recorded_machine(text: str, namespaces: Namespaces) -> MachineSpec:
    """Load the machine that the configuration of its node names.

    Args:
        text: the configuration [YAML].
        namespaces: those of the machine.

    Raises:
        RecordedRunError: it names no machine file, or one that does not exist here.
        MachineError: the file is not valid.
    """
    topic = namespaces.node + MACHINE_CONFIG_SUFFIX
    try:
        name = str(machine_config_section(text, namespaces)["machine"])
        # The first recordings of format 1 do not name the model of the tracks.
        tracks = load_yaml(text).get("stepping", {}).get("track_model", "kinematic")
    except (yaml.YAMLError, KeyError, TypeError) as error:
        raise RecordedRunError(
            f"the configuration on {topic} names no machine file: {error!r}; it must have"
            " `machine` in a section machine_sim, or of the machine's name in a section machines"
        ) from error
    try:
        return with_track_model(load_machine_spec(find_config(name)), tracks)
    except ConfigError as error:
        raise RecordedRunError(
            f"the machine of the run is described in {name!r} ({topic}), which does not exist here;"
            f" copy it there. {error}"
        ) from error


def lip_path(
    spec: MachineSpec, states: Sequence[MachineState], phases: Sequence[OperatorPhase]
) -> LipPath:
    """Return the path of the middle of the cutting lip.

    It has a point every `PATH_INTERVAL_TICKS` ticks, or as often as the machine's state was
    recorded. The phase of a point is the last one that the operator published before its tick.
    """
    phase_ticks = np.array([phase.tick for phase in phases])
    points: list[NDArray[np.float64]] = []
    point_phases: list[OperatorPhase] = []
    next_tick = PATH_INTERVAL_TICKS
    for state in states:
        if state.tick < next_tick:
            continue
        next_tick = (state.tick // PATH_INTERVAL_TICKS + 1) * PATH_INTERVAL_TICKS
        base_rotation = rotation_matrix(state.base.quaternion)
        rotation, pin = tool_pose(spec, state.base.position, base_rotation, state.joints)
        points.append(rotation[:, 0] * spec.bucket.tip_radius + pin)
        newest = int(np.searchsorted(phase_ticks, state.tick)) - 1
        point_phases.append(phases[max(newest, 0)])
    return LipPath(
        np.array(points).reshape(-1, 3),
        np.array([phase.cycle for phase in point_phases], dtype=np.int64),
        np.array([phase.phase for phase in point_phases], dtype=np.str_),
    )


def shoe_poses(markers: Any, shoe_count: int) -> NDArray[np.float64] | None:
    """Return the poses of the shoes of both tracks, read back from the markers of `codec.markers`.

    Args:
        markers: a `visualization_msgs/MarkerArray`.
        shoe_count: number of shoes of one track.

    Returns:
        x, z [m] and pitch [rad] of each shoe in the base frame, left track first, shape
        (2, shoe_count, 3); None if there are no such tracks among the markers.
    """
    sides = {each.id: each for each in markers.markers if each.ns.endswith(_TRACKS_SUFFIX)}
    if set(sides) != {0, 1}:
        return None
    poses = np.zeros((2, shoe_count, 3))
    for side in (0, 1):
        points = np.array([(point.x, point.z) for point in sides[side].points])
        # A shoe is drawn as a row of bars; its pitch needs at least two of them.
        if points.size == 0 or len(points) % shoe_count or len(points) < 2 * shoe_count:
            return None
        bars = points.reshape(shoe_count, -1, 2)
        along = bars[:, -1] - bars[:, 0]
        poses[side, :, :2] = bars.mean(axis=1)
        poses[side, :, 2] = np.arctan2(-along[:, 1], along[:, 0])
    return poses
