"""A run over topics ends in the same states as in one process, to the last bit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from support.machine_scenes import loose_soil_options
from support.node_scenes import (
    SITE,
    TICK,
    Scene,
    drag_velocities,
    joint_command,
    machine_file,
    milling_velocities,
    ready_to_dig,
    ready_to_mill,
)

from earthmoving_sim.world import World
from machine_sim.commands import TRACK_NAMES
from machine_sim.machine import MachineSpec
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.codec.machine_state import from_command_state
from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.codec.state_hash import from_state_hash_string
from msg_bridge.contract.ledger import Ledger
from msg_bridge.testing.ros_context import Ros
from soil_sim.site.site import SiteParams, make_site
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

TICKS = 300
EVERY = 10


class Work(NamedTuple):
    """A machine at work.

    Attributes:
        spec: the machine.
        velocities: command of the tick after a tick, by machine, tick and number of ticks.
        site: parameters of the site.
        soil: parameters of the soil.
        min_particles: minimum volume of the particles at the end [mm^3].
    """

    spec: MachineSpec
    velocities: Callable[[MachineSpec, int, int], NDArray[np.float64]]
    site: dict[str, object]
    soil: dict[str, object]
    min_particles: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all commands of the machine."""
        return (*self.spec.joint_names, *TRACK_NAMES)


ROUGH = {**SITE, "site.terrain": "rough", "site.roughness": 0.02}
WORK = {
    "dig rough ground": Work(ready_to_dig(), drag_velocities, ROUGH, {"swell": 0.2}, 10**8),
    "dig flat ground": Work(ready_to_dig(), drag_velocities, SITE, {"swell": 0.2}, 10**8),
    "mill rock": Work(ready_to_mill(), milling_velocities, SITE, {"soil": "rock"}, 10**6),
}


class Run(NamedTuple):
    """A run by tick: hashes of every tenth tick, applied commands and ledgers of all."""

    soil: dict[int, str]
    machine: dict[int, str]
    commands: dict[int, list[float]]
    ledgers: dict[int, Ledger]


def over_topics(ros: Ros, machine_path: str, work: Work) -> Run:
    """Run with nodes; each command answers a state, and the machine waits for it."""
    soil_hashes = ros.collect("/soil/state_hash", String)
    machine_hashes = ros.collect("/excavator/state_hash", String)
    applied = ros.collect("/excavator/applied_commands", JointState)
    soil = {f"soil.{name}": value for name, value in work.soil.items()}
    scene = Scene(ros, hash_rate=1.0 / (EVERY * TICK), **soil, **work.site)
    scene.machine(
        machine=machine_path,
        command_wait_period=1,
        hash_rate=1.0 / (EVERY * TICK),
        state_rate=1.0 / TICK,
    )
    commands = ros.publisher("/excavator/joint_commands", JointState, subscriptions=1)

    def answer(state: JointState) -> None:
        tick = tick_from_stamp(state.header.stamp, TICK)
        if tick < TICKS:
            velocities = work.velocities(work.spec, tick, TICKS)
            commands.publish(joint_command(tick, velocities, work.names))

    ros.helper.create_subscription(JointState, "/excavator/joint_states", answer, 10)
    for tick in range(100, TICKS + 1, 100):
        scene.until_tick(tick)
    ros.spin_until(lambda: machine_hashes and newest(machine_hashes) >= TICKS)
    ros.spin_until(lambda: soil_hashes and newest(soil_hashes) >= TICKS)
    return Run(
        by_tick(soil_hashes),
        by_tick(machine_hashes),
        {
            tick_from_stamp(m.header.stamp, TICK): from_command_state(m, work.names).tolist()
            for m in applied
        },
        {ledger.tick: ledger for ledger in scene.ledgers},
    )


def in_one_process(commands: dict[int, list[float]], work: Work) -> Run:
    """Run without topics, with the commands that were applied in another run."""
    site = make_site(SiteParams(**{k.removeprefix("site."): v for k, v in work.site.items()}))
    soil = Soil(site.grid, site.heights, SoilParams(**work.soil))
    machine = MachineSim(
        [Placement(work.spec)], soil.grid, soil.columns.height, **loose_soil_options(soil)
    )
    num_joints = len(work.spec.joint_names)
    world = World(soil, {1: machine})
    run = Run({}, {}, commands, {0: world.ledger})
    for tick in range(1, TICKS + 1):
        command = np.array(commands[tick])
        machine.command(command[:num_joints], command[num_joints:])
        run.ledgers[tick] = world.step()
        if tick % EVERY == 0:
            run.soil[tick], run.machine[tick] = world.state_hash(), machine.state_hash()
    world.close()
    return run


def by_tick(messages: list[String]) -> dict[int, str]:
    """Return the hashes of every tenth tick; more are published while time stands still."""
    hashes = map(from_state_hash_string, messages)
    return {h.tick: h.sha256 for h in hashes if h.tick % EVERY == 0 and 0 < h.tick <= TICKS}


def newest(messages: list[String]) -> int:
    return from_state_hash_string(messages[-1]).tick


@pytest.mark.parametrize(
    "name",
    [
        "dig rough ground",
        pytest.param("dig flat ground", marks=[pytest.mark.slow, pytest.mark.independent]),
        "mill rock",
    ],
)
def test_runs_over_topics_are_identical_to_each_other_and_to_one_process(
    ros_domain: int, tmp_path: Path, name: str
) -> None:
    work = WORK[name]
    path = machine_file(tmp_path, work.spec)
    runs = []
    for _ in range(2):
        ros = Ros(ros_domain)
        try:
            runs.append(over_topics(ros, path, work))
        finally:
            ros.close()
    first, again = runs
    alone = in_one_process(first.commands, work)
    hashed = list(range(EVERY, TICKS + 1, EVERY))
    for run in (first, again, alone):
        assert list(run.soil) == list(run.machine) == hashed
    # The runs could differ: soil was cut and carried, and the terrain changed.
    assert len(set(alone.soil.values())) > 10
    assert alone.ledgers[TICKS].particles > work.min_particles
    assert len({tuple(command) for command in first.commands.values()}) > 200
    for run in (first, again):
        assert run.commands == first.commands
        assert run.soil == alone.soil
        assert run.machine == alone.machine
        ledgers = {t: replace(run.ledgers[t], run_id=1) for t in range(TICKS + 1)}
        assert ledgers == alone.ledgers
