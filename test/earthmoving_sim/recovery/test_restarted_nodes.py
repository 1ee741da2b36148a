"""Nodes that end without notice continue their run when they are started again."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from support.machine_scenes import COMMAND_NAMES
from support.node_scenes import TICK, Scene, dig, joint_command, machine_file, ready_to_dig

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec.qos import STATE
from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import MachineHeader, Message
from msg_bridge.testing.ros_context import Ros
from soil_sim.endpoint import SoilEndpoint
from soil_sim.node.soil_node import SoilNode


class CrashScene(Scene):
    """Nodes with recovery, which are removed without notice, as `kill -9` ends a process."""

    def __init__(
        self,
        ros: Ros,
        folder: Path,
        machine_parameters: Mapping[str, object] = MappingProxyType({}),
        **parameters: object,
    ) -> None:
        self.folder, self._machine_parameters = folder, machine_parameters
        self._recovery = {
            "recovery.path": str(folder / "state"),
            "recovery.checkpoint_period": 0.2,
        }
        super().__init__(ros, **self._recovery, **parameters)
        self.digger: MachineNode = self.start_digger()

    def start_digger(self, **parameters: object) -> MachineNode:
        return self.machine(
            machine=machine_file(self.folder, ready_to_dig()),
            **{
                "commands.command_timeout": 60.0,
                **self._recovery,
                **self._machine_parameters,
                **parameters,
            },
        )

    @property
    def run_id(self) -> int:
        return self.soil.run.endpoint.exchange.run_id

    def restart_soil(self, min_run_id: int = 0) -> None:
        """Restart the soil node; it begins a run from `min_run_id` on, or continues the present."""
        run_id = self.run_id
        self.ros.remove(self.soil)
        self.soil = self.ros.add(SoilNode, parameters=self.given)
        assert self.run_id >= min_run_id if min_run_id else self.run_id == run_id

    def restart_digger(self) -> None:
        self.ros.remove(self.digger)
        self.digger = self.start_digger()


def test_soil_node_continues_its_run(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path)
    dig(scene, scene.digger, lambda ledger: ledger.particles > 10**8)
    tick = scene.tick
    scene.restart_soil()
    assert scene.tick >= tick
    scene.more_ticks(100)
    assert scene.ledgers[-1].imbalance == 0
    assert scene.joined == (1,)


def test_machine_node_continues_its_run(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path)
    dig(scene, scene.digger, lambda ledger: ledger.particles > 10**8)
    session_id = scene.digger.run.endpoint.exchange.session_id
    state_hash, tick = scene.digger.run.sim.state_hash(), scene.digger.run.tick
    scene.restart_digger()
    assert scene.digger.run.tick == tick
    assert scene.digger.run.sim.state_hash() == state_hash
    assert scene.digger.run.endpoint.exchange.session_id == session_id
    scene.more_ticks(100)
    assert scene.ledgers[-1].imbalance == 0
    assert scene.ledgers[-1].absent == 0


def test_restarted_machine_publishes_the_states_whose_answers_may_be_lost(
    ros: Ros, tmp_path: Path
) -> None:
    """Commands take effect 3 ticks after the state that they answer; the last ones are missing."""
    lockstep = {"command_wait_period": 1, "command_delay": 3, "state_rate": 100.0}
    states: list[int] = []

    def on_state(state: JointState) -> None:
        states.append(tick_from_stamp(state.header.stamp, TICK))

    ros.helper.create_subscription(JointState, "/excavator/joint_states", on_state, STATE)
    commands = ros.publisher("/excavator/joint_commands", JointState)
    scene = CrashScene(ros, tmp_path, lockstep)
    for tick in range(10):
        ros.spin_until(lambda tick=tick: tick in states, what=f"the state of tick {tick}")
        commands.publish(joint_command(tick, np.full(len(COMMAND_NAMES), 0.01 * (tick + 1))))
    last = 9 + 4
    ros.spin_until(lambda: scene.digger.run.tick == last, what=f"tick {last}")
    before, repeated = len(states), [last - 3, last - 2, last - 1, last]
    scene.restart_digger()
    ros.spin_until(lambda: states[before:][-4:] == repeated, what="the last states")
    before = len(states)
    commands.publish(joint_command(last - 3, np.full(len(COMMAND_NAMES), 0.01)))
    ros.spin_until(lambda: last + 1 in states[before:], what="the next tick")


def test_machine_dropped_in_real_time_returns_with_its_soil(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path, sync="realtime", machine_timeout=0.5)
    dig(scene, scene.digger, lambda ledger: ledger.particles > 10**8)
    ros.remove(scene.digger)
    ros.spin_until(lambda: scene.joined == (), what="the silent machine to be dropped")
    scene.more_ticks(10)
    assert scene.ledgers[-1].absent > 10**8
    scene.digger = scene.start_digger()
    ros.spin_until(lambda: scene.joined == (1,), what="the machine to rejoin")
    scene.more_ticks(50)
    assert scene.ledgers[-1].absent == scene.ledgers[-1].imbalance == 0
    assert scene.ledgers[-1].particles > 10**8


def test_dropped_machine_publishes_its_last_ticks_before_it_rejoins(
    ros: Ros, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process may have died before it sent a tick that its machines have made."""
    scene = CrashScene(ros, tmp_path, sync="realtime", machine_timeout=0.5)
    scene.until_tick(5)
    last = scene.digger.run.tick
    ros.remove(scene.digger)
    ros.spin_until(lambda: scene.joined == (), what="the silent machine to be dropped")
    # What the soil node receives: another subscription may begin after the first of the messages.
    headers: list[MachineHeader] = []
    receive = SoilEndpoint.receive

    def record(endpoint: SoilEndpoint, message: Message) -> bool:
        if isinstance(message, MachineHeader):
            headers.append(message)
        return receive(endpoint, message)

    monkeypatch.setattr(SoilEndpoint, "receive", record)
    scene.digger = scene.start_digger()
    ros.spin_until(lambda: scene.joined == (1,), what="the machine to rejoin")
    rejoin = next(k for k, header in enumerate(headers) if not header.is_tick)
    assert [header.tick for header in headers[:rejoin]] == [last - 2, last - 1, last]


def test_emergency_stop_holds_over_a_restart(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path)
    scene.until_tick(5)
    stop = ros.publisher("/excavator/emergency_stop", Bool, subscriptions=2)
    stop.publish(Bool(data=True))
    arbiter = scene.digger.instances[0].arbiter
    ros.spin_until(lambda: arbiter.is_stopped, what="the emergency stop")
    scene.restart_digger()
    assert scene.digger.instances[0].arbiter.is_stopped
    scene.more_ticks(20)


def test_pause_holds_over_a_restart(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path)
    scene.until_tick(5)
    scene.pause()
    tick = scene.tick
    scene.restart_soil()
    assert scene.soil.run.paused
    scene.step()
    assert scene.tick == tick + 1


def test_run_that_was_stopped_is_not_continued(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path)
    scene.until_tick(5)
    run_id = scene.run_id
    ros.spin_until(lambda: int(time.time()) > run_id, what="a second after the begin of the run")
    scene.soil.stop()
    scene.restart_soil(run_id + 1)
    ros.spin_until(lambda: scene.joined == (1,), what="the machine to join the new run")


def test_new_run_begins_on_purpose(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path)
    scene.until_tick(5)
    scene.given |= {"recovery.resume": False}
    scene.restart_soil(scene.run_id + 1)
    ros.spin_until(lambda: scene.joined == (1,), what="the machine to join the new run")


SOIL_MISTAKES = (
    ({"soil.swell": 0.3}, r"other parameters \(.*swell was 0\.15 and is 0\.3\); start"),
    ({"soil.swel": 0.3}, "did you mean 'soil.swell'"),
    ({"exchange_key_file": "missing.key"}, "cannot be read"),
)
MACHINE_MISTAKES = (
    (
        {"particles.ground_friction": 0.1},
        r"other parameters \(particles\.ground_friction was .*\); start",
    ),
    ({"particles.ground_frictoin": 0.1}, "did you mean 'particles.ground_friction'"),
    ({"exchange_key_file": "missing.key"}, "cannot be read"),
)


@pytest.mark.parametrize(("mistake", "match"), SOIL_MISTAKES)
def test_soil_node_that_cannot_start_keeps_the_saved_run(
    ros: Ros, tmp_path: Path, mistake: dict[str, object], match: str
) -> None:
    scene = CrashScene(ros, tmp_path)
    scene.until_tick(5)
    ros.remove(scene.soil)
    with pytest.raises(EarthmovingError, match=match):
        ros.add(SoilNode, parameters=scene.given | mistake)
    tick, run_id = scene.tick, scene.run_id
    scene.soil = ros.add(SoilNode, parameters=scene.given)
    assert scene.run_id == run_id
    assert scene.tick >= tick
    scene.more_ticks(5)


@pytest.mark.parametrize(("mistake", "match"), MACHINE_MISTAKES)
def test_machine_node_that_cannot_start_keeps_the_saved_run(
    ros: Ros, tmp_path: Path, mistake: dict[str, object], match: str
) -> None:
    scene = CrashScene(ros, tmp_path)
    dig(scene, scene.digger, lambda ledger: ledger.particles > 10**7)
    state_hash = scene.digger.run.sim.state_hash()
    ros.remove(scene.digger)
    with pytest.raises(EarthmovingError, match=match):
        scene.start_digger(**mistake)
    scene.digger = scene.start_digger()
    assert scene.digger.run.sim.state_hash() == state_hash
    scene.more_ticks(5)


def test_machine_that_was_down_during_a_reset_joins_the_new_run(ros: Ros, tmp_path: Path) -> None:
    scene = CrashScene(ros, tmp_path)
    scene.until_tick(5)
    run_id = scene.run_id
    ros.remove(scene.digger)
    assert scene.trigger("/sim/reset").success
    scene.digger = scene.start_digger()
    assert scene.digger.run is not None
    assert scene.digger.run.facts.run_id == run_id
    ros.spin_until(lambda: scene.joined == (1,), what="the machine to join the new run")
    assert scene.digger.run.facts.run_id == run_id + 1


def test_machine_with_dynamic_tracks_continues_with_its_soil(ros: Ros, tmp_path: Path) -> None:
    """Its bodies touch, so that pybullet cannot restore their state exactly."""
    parameters = {"stepping.track_model": "dynamic"}
    scene = CrashScene(ros, tmp_path, machine_timeout=0.5, machine_parameters=parameters)
    dig(scene, scene.digger, lambda ledger: ledger.particles > 10**8)
    scene.more_ticks(150)
    tick, before = scene.digger.run.tick, scene.ledgers[-1]
    scene.restart_digger()
    assert scene.digger.run.tick < tick, "the ticks after the last state are skipped"
    ros.spin_until(lambda: scene.tick > tick + 20, what="the machine to rejoin")
    after = scene.ledgers[-1]
    assert after.imbalance == after.absent == 0
    assert after.particles + after.pending > 0.9 * (before.particles + before.pending)
