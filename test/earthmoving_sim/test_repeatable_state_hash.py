"""A run over topics ends in the same states as in one process, to the last bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from support.machine_scenes import COMMAND_NAMES, loose_soil_options
from support.node_scenes import (
    SITE,
    TICK,
    Scene,
    drag_velocities,
    joint_command,
    machine_file,
    ready_to_dig,
)

from earthmoving_sim.world import World
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
GROUND = {"flat": SITE, "rough": {**SITE, "site.terrain": "rough", "site.roughness": 0.02}}


class Run(NamedTuple):
    """A run by tick: hashes of every tenth tick, applied commands and ledgers of all."""

    soil: dict[int, str]
    machine: dict[int, str]
    commands: dict[int, list[float]]
    ledgers: dict[int, Ledger]


def over_topics(ros: Ros, machine_path: str, ground: dict[str, object]) -> Run:
    """Run with nodes; each command answers a state, and the machine waits for it."""
    soil_hashes = ros.collect("/soil/state_hash", String)
    machine_hashes = ros.collect("/excavator/state_hash", String)
    applied = ros.collect("/excavator/applied_commands", JointState)
    scene = Scene(ros, hash_rate=1.0 / (EVERY * TICK), **{"soil.swell": 0.2}, **ground)
    spec = ready_to_dig()
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
            commands.publish(joint_command(tick, drag_velocities(spec, tick, TICKS)))

    ros.helper.create_subscription(JointState, "/excavator/joint_states", answer, 10)
    scene.until_tick(TICKS)
    ros.spin_until(lambda: machine_hashes and newest(machine_hashes) >= TICKS)
    ros.spin_until(lambda: soil_hashes and newest(soil_hashes) >= TICKS)
    return Run(
        by_tick(soil_hashes),
        by_tick(machine_hashes),
        {
            tick_from_stamp(m.header.stamp, TICK): from_command_state(m, COMMAND_NAMES).tolist()
            for m in applied
        },
        {ledger.tick: ledger for ledger in scene.ledgers},
    )


def in_one_process(commands: dict[int, list[float]], ground: dict[str, object]) -> Run:
    """Run without topics, with the commands that were applied in another run."""
    site = make_site(SiteParams(**{k.removeprefix("site."): v for k, v in ground.items()}))
    soil = Soil(site.grid, site.heights, SoilParams(swell=0.2))
    machine = MachineSim(
        [Placement(ready_to_dig())], soil.grid, soil.columns.height, **loose_soil_options(soil)
    )
    world = World(soil, {1: machine})
    run = Run({}, {}, commands, {0: world.ledger})
    for tick in range(1, TICKS + 1):
        machine.command(np.array(commands[tick][:4]), np.array(commands[tick][4:]))
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


@pytest.mark.parametrize("ground", ["rough", pytest.param("flat", marks=pytest.mark.slow)])
def test_runs_over_topics_are_identical_to_each_other_and_to_one_process(
    ros_domain: int, tmp_path: Path, ground: str
) -> None:
    path = machine_file(tmp_path, ready_to_dig())
    runs = []
    for _ in range(2):
        ros = Ros(ros_domain)
        try:
            runs.append(over_topics(ros, path, GROUND[ground]))
        finally:
            ros.close()
    first, again = runs
    alone = in_one_process(first.commands, GROUND[ground])
    hashed = list(range(EVERY, TICKS + 1, EVERY))
    for run in (first, again, alone):
        assert list(run.soil) == list(run.machine) == hashed
    # The runs could differ: soil was cut and carried, and the terrain changed.
    assert len(set(alone.soil.values())) > 10
    assert alone.ledgers[TICKS].particles > 10**8
    assert len({tuple(command) for command in first.commands.values()}) > 200
    for run in (first, again):
        assert run.commands == first.commands
        assert run.soil == alone.soil
        assert run.machine == alone.machine
        ledgers = {t: replace(run.ledgers[t], run_id=1) for t in range(TICKS + 1)}
        assert ledgers == alone.ledgers
