"""Forged and broken messages on every topic of the exchange do not change a run.

A machine digs in lockstep, with commands that depend on the tick only. Meanwhile a forger sends
messages of random kinds at random times. The states after each tick are those of a run without it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest
from chaos.forger import Forger
from chaos.forgeries import KINDS
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from support.node_scenes import (
    TICK,
    Scene,
    drag_velocities,
    joint_command,
    machine_file,
    ready_to_dig,
)

from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.codec.state_hash import from_state_hash_string
from msg_bridge.testing.fixtures import limit_discovery_to_this_host
from msg_bridge.testing.ros_context import Ros
from msg_bridge.testing.ros_domain import reserve_domain

pytestmark = pytest.mark.slow

NUM_TICKS = 300
TIMEOUT = 250.0  # s of wall time
FIRST_ANSWERED_TICK = 2
"""Tick of the first machine state in which an answer of the soil is applied. Hashes of states
before it are published only when the machine has to wait for the soil."""


class Run(NamedTuple):
    """Hashes of soil and machine by tick, and the largest imbalance [mm^3]."""

    soil: dict[int, str]
    machine: dict[int, str]
    imbalance: int


class Dig:
    """A machine that digs with commands that depend on the tick only, and a forger.

    Attributes:
        scene: the nodes.
        machine: the machine node.
    """

    def __init__(
        self,
        ros: Ros,
        folder: Path,
        *,
        key_file: str = "",
        forger: Forger | None = None,
        kinds: Sequence[str] = (),
        rounds: int = 0,
    ) -> None:
        """
        Args:
            ros: context of the nodes.
            folder: folder for the machine file.
            key_file: file of the exchange key; empty: none.
            forger: sends messages.
            kinds: kinds of messages.
            rounds: number of messages, at random ticks.
        """
        self._ros, self._forger, self._kinds = ros, forger, kinds
        self._soil = ros.collect("/soil/state_hash", String)
        self._machine = ros.collect("/excavator/state_hash", String)
        self.scene = Scene(ros, hash_rate=1.0 / TICK, exchange_key_file=key_file)
        self.machine = self.scene.machine(
            machine=machine_file(folder, ready_to_dig()),
            command_wait_period=1,
            hash_rate=1.0 / TICK,
            state_rate=1.0 / TICK,
            exchange_key_file=key_file,
        )
        self._commands = ros.publisher("/excavator/joint_commands", JointState, subscriptions=1)
        self._spec = ready_to_dig()
        ticks = () if forger is None else forger.rng.integers(5, NUM_TICKS - 5, rounds)
        self._ticks_of_rounds = sorted(map(int, ticks))
        ros.helper.create_subscription(JointState, "/excavator/joint_states", self._answer, 10)

    @property
    def run(self) -> Run:
        """The run so far."""
        imbalances = [abs(ledger.imbalance) for ledger in self.scene.ledgers]
        soil, machine = by_tick(self._soil, 1), by_tick(self._machine, FIRST_ANSWERED_TICK)
        return Run(soil, machine, max(imbalances))

    def finish(self) -> Run:
        """Dig to the end; return the run."""
        self._ros.spin_until(
            lambda: min(newest(self._soil), newest(self._machine)) >= NUM_TICKS,
            TIMEOUT,
            "the end of the dig",
        )
        assert not self._ticks_of_rounds
        assert self.scene.joined == (1,)
        assert self.machine.run is not None
        assert self.machine.run.endpoint.exchange.joined
        return self.run

    def _answer(self, state: JointState) -> None:
        tick = tick_from_stamp(state.header.stamp, TICK)
        forger = self._forger
        while forger is not None and self._ticks_of_rounds and self._ticks_of_rounds[0] <= tick:
            if not forger.has_all_numbers:
                break
            self._ticks_of_rounds.pop(0)
            # Every kind comes up, then they repeat at random.
            unused = [name for name in self._kinds if name not in forger.sent]
            name = str(forger.rng.choice(unused or self._kinds))
            forger.forge(name, KINDS[name].send)
        if tick < NUM_TICKS:
            velocities = drag_velocities(self._spec, tick, NUM_TICKS)
            self._commands.publish(joint_command(tick, velocities))


def newest(messages: list[String]) -> int:
    return from_state_hash_string(messages[-1]).tick if messages else -1


def by_tick(messages: list[String], first_tick: int) -> dict[int, str]:
    hashes = map(from_state_hash_string, messages)
    return {each.tick: each.sha256 for each in hashes if first_tick <= each.tick <= NUM_TICKS}


@pytest.fixture(scope="module")
def clean_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """Return the run without a forger, in a domain of its own."""
    with pytest.MonkeyPatch.context() as patch, reserve_domain() as domain:
        limit_discovery_to_this_host(patch)
        ros = Ros(domain)
        try:
            yield Dig(ros, tmp_path_factory.mktemp("clean")).finish()
        finally:
            ros.close()


@pytest.mark.parametrize("has_key", [True, False])
def test_run_with_forged_messages_equals_the_run_without(
    ros: Ros, tmp_path: Path, clean_run: Run, has_key: bool
) -> None:
    rounds, seed = (int(os.environ.get(f"CHAOS_{name}", "40")) for name in ("ROUNDS", "SEED"))
    key_file = tmp_path / "exchange.key"
    key_file.write_bytes(os.urandom(32))
    key_file.chmod(0o600)
    forger = ros.add(Forger, seed=seed)
    kinds = sorted(name for name, kind in KINDS.items() if has_key or not kind.needs_key)
    key = str(key_file) if has_key else ""
    run = Dig(ros, tmp_path, key_file=key, forger=forger, kinds=kinds, rounds=rounds).finish()
    assert sum(forger.sent.values()) == rounds
    assert run.imbalance == 0
    assert set(run.soil) == set(range(1, NUM_TICKS + 1))
    assert set(run.machine) == set(range(FIRST_ANSWERED_TICK, NUM_TICKS + 1))
    assert run.soil == clean_run.soil
    assert run.machine == clean_run.machine


def test_consistent_forgeries_without_a_key_lose_no_volume_and_the_run_continues(
    ros: Ros, tmp_path: Path
) -> None:
    forger = ros.add(Forger, seed=0)
    kinds = sorted(name for name, kind in KINDS.items() if kind.needs_key)
    run = Dig(ros, tmp_path, forger=forger, kinds=kinds, rounds=len(kinds)).finish()
    assert set(forger.sent) == set(kinds)
    assert run.imbalance == 0
