"""A bag shows the same at a time whether it was played up to there or sought."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from support.recorded_messages import Recording
from support.surface_scenes import ChangingTerrain

from machine_sim.machine import load_machine_spec
from machine_sim.machine.description import description_text
from msg_bridge.codec.row_chunks import to_chunk_cloud
from msg_bridge.codec.run_config import RunFacts, to_config_yaml
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.codec.tick_headers import to_multi_array, with_stamp
from msg_bridge.config_files import find_config
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from viewer.scene.scene import Scene
from viewer.sources.bag_scene import BagScene

BAGS = Path(__file__).parents[3] / "bags"
PERIOD = 0.01
TICKS = 300  # of each run


class RecordedRuns:
    """Two runs with a reset in between, as the recorder writes them.

    Transient-local messages are repeated, and some messages come later than those of other topics.
    """

    def __init__(self) -> None:
        self.recording = Recording()
        self.terrain = ChangingTerrain()
        spec = load_machine_spec(find_config("machines/excavator.yaml"))
        self.description = String(data=description_text(spec, meshes="primitives"))
        for run_id in (7, 8):
            self.terrain.run_id = run_id
            self.start(run_id)
            for tick in range(1, TICKS + 1):
                self.tick(run_id, tick)

    def start(self, run_id: int) -> None:
        facts = RunFacts(run_id, PERIOD, True, self.terrain.grid.cell, (LooseSoil(0.15),))
        self.config = String(data=to_config_yaml(facts, {}))
        self.terrain.revision, self.terrain._seq = 0, 1
        self.map = self.cloud()
        self.add("/terrain/map", self.map)  # arrives before the configuration
        self.add("/sim/config", self.config)
        self.add("/sim/paused", Bool(data=False))
        self.add("/excavator/robot_description", self.description)

    def tick(self, run_id: int, tick: int) -> None:
        stamp = stamp_from_tick(tick, PERIOD)
        if tick % 3 == 0:
            for chunk in self.terrain.tick():
                self.add("/terrain/map_updates", to_chunk_cloud(chunk, "map", stamp))
        ledger = Ledger(run_id, tick, 10**12, 0, 0, 0, 0, 0, 10**12)
        self.add("/soil/ledger", to_multi_array(with_stamp(ledger, stamp)))
        if tick > 20 and tick % 2 == 0:
            joints = JointState(name=["boom"], position=[0.001 * tick], velocity=[0.1])
            joints.header.stamp = stamp
            self.add("/excavator/joint_states", joints)
        if tick % 50 == 10:
            self.map = self.cloud()
            self.add("/terrain/map", self.map)
        if tick % 70 == 0:  # the recorder repeats the newest ones
            self.add("/sim/config", self.config)
            self.add("/terrain/map", self.map)
            self.add("/excavator/robot_description", self.description)
        if tick % 40 == 5:  # each node has its own status
            is_stopped = 60 <= tick < 120
            self.add("/diagnostics", diagnostics("soil_sim", "ok"))
            self.add("/diagnostics", diagnostics("excavator/machine_sim", "ok", stop=is_stopped))
        if tick in (60, 120):
            self.add("/diagnostics", diagnostics("soil_sim", "waits", level=1))
            self.add("/excavator/emergency_stop", Bool(data=tick == 60))
            report = diagnostics("excavator/machine_sim", "ok", stop=tick == 60)
            self.add("/diagnostics", report)
        if tick in (33, 133):
            lost = {"/terrain/map_updates": tick}
            self.add("/recorder/status", String(data=json.dumps({"lost": lost})))
        if tick == 100:
            phase = {"phase": f"dig in run {run_id}", "cycle": 1}
            self.add("/excavator/operator/phase", String(data=json.dumps(phase)))

    def add(self, topic: str, message: Any) -> None:
        self.recording.add(topic, message)

    def cloud(self) -> Any:
        terrain = self.terrain
        keyframe = Keyframe(
            terrain.run_id,
            terrain.revision,
            terrain.grid,
            terrain.height.astype(np.float64),
            soil=terrain.soil,
            moisture=terrain.moisture,
        )
        stamp = stamp_from_tick(1, PERIOD)
        return to_terrain_cloud(TerrainMap(keyframe, terrain.loose), "map", stamp)


def diagnostics(node: str, text: str, level: int = 0, stop: bool | None = None) -> DiagnosticArray:
    status = DiagnosticStatus(name=node, message=text, level=bytes([level]))
    if stop is not None:
        status.values = [KeyValue(key="emergency_stop", value=str(stop))]
    return DiagnosticArray(status=[status])


def state(scene: Scene) -> dict[str, Any]:
    """Return everything that a page would be shown."""
    terrain = scene.terrain
    layers = ("height", "loose_depth", "soil", "moisture")
    return {
        "run": scene.run_id,
        "tick": scene.tick,
        "paused": scene.is_paused,
        "ledger": scene.ledger,
        "status": dict(scene.status),
        "tiles": terrain.tiles and [terrain.tiles.layer(name).tobytes() for name in layers],
        "reference": None if terrain.reference is None else terrain.reference.tobytes(),
        "particles": {name: rows.tobytes() for name, rows in scene.clouds.items()},
        "machines": {
            name: (view.model, view.time, view.gauges(), view.base, view.levers)
            for name, view in scene.machines.items()
        },
    }


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return RecordedRuns().recording.write(tmp_path_factory.mktemp("bag") / "runs.mcap")


@pytest.fixture(scope="module")
def with_lost_rows(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the bag of a recorder that has lost rows several times."""
    recording = RecordedRuns().recording
    rows = [each for each in recording.messages if each[0] == "/terrain/map_updates"]
    lost = [id(each) for k, each in enumerate(rows) if k % 23 in (5, 6, 7)]
    recording.messages = [each for each in recording.messages if id(each) not in lost]
    return recording.write(tmp_path_factory.mktemp("lost") / "runs.mcap")


@pytest.fixture(scope="module")
def without_reports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the bag of machines that do not report their emergency stop."""
    recording = RecordedRuns().recording
    recording.messages = [each for each in recording.messages if each[0] != "/diagnostics"]
    return recording.write(tmp_path_factory.mktemp("silent") / "runs.mcap")


@pytest.mark.parametrize("name", ["two_runs", "format_1", "format_2"])
def test_seeking_shows_what_playing_shows(name: str, request: pytest.FixtureRequest) -> None:
    path = BAGS / name if name.startswith("format") else request.getfixturevalue(name)
    played, sought = BagScene(path), BagScene(path)
    rng = np.random.default_rng(0)
    numbers = sorted({1, 2, 3, *rng.integers(4, played.size, 12).tolist(), played.size})
    expected = {}
    for number in numbers:
        played.advance(number)
        expected[number] = state(played.scene)
    for number in rng.permutation(numbers).tolist():
        sought.restore(number)
        assert state(sought.scene) == expected[number], number
        sought.advance(min(number + 40, sought.size))  # and playing continues from there
    sought.restore(numbers[5])
    sought.advance(numbers[9])
    assert state(sought.scene) == expected[numbers[9]]
    assert played.rejected == sought.rejected == 0
    for bag in (played, sought):
        bag.close()


def test_nothing_of_the_run_before_is_shown_after_a_reset(two_runs: Path) -> None:
    bag = BagScene(two_runs)
    second = bag.number_at(bag.timeline.duration / 2 + 0.02)
    for go in (bag.advance, bag.restore):
        go(second)
        assert (bag.scene.run_id, bag.scene.machines["/excavator"].phase) == (8, "")
        assert bag.scene.machines["/excavator"].joints == {}
        assert bag.scene.tick < 20
        assert bag.scene.terrain.tiles is not None
    bag.close()


def test_time_is_simulated_time_over_all_runs(two_runs: Path) -> None:
    bag = BagScene(two_runs)
    assert bag.timeline.duration == pytest.approx(2 * (TICKS - 1) * PERIOD)
    bag.advance(bag.number_at(1.0))
    assert bag.scene.time == pytest.approx(1.0 + PERIOD, abs=2 * PERIOD)
    assert bag.number_at(bag.timeline.duration) == bag.size
    bag.close()


def test_recording_of_an_earlier_version_shows_its_machine() -> None:
    bag = BagScene(BAGS / "format_1")  # has no robot description
    bag.advance(bag.size)
    machine = bag.scene.machines["/excavator"]
    assert machine.model is not None
    assert machine.levers["boom"] == "right_y"
    assert machine.joints["boom"][0] != 0.0
    bag.close()


@pytest.mark.parametrize("missing", ["/soil/ledger", "/terrain/map", "/sim/config", "/excavator"])
def test_bag_without_some_topics_shows_the_others(tmp_path: Path, missing: str) -> None:
    recording = RecordedRuns().recording
    recording.messages = [m for m in recording.messages if not m[0].startswith(missing)]
    bag = BagScene(recording.write(tmp_path / "part.mcap"))
    bag.advance(bag.size)
    bag.restore(bag.size // 3)
    assert bag.timeline.duration > 0.0
    assert (bag.scene.terrain.tiles is None) == (missing == "/terrain/map")
    assert bool(bag.scene.machines) == (missing != "/excavator")
    bag.close()


def test_seeking_in_a_bag_with_lost_rows_shows_the_newest_map_before_that_time(
    two_runs: Path, with_lost_rows: Path
) -> None:
    complete, lossy = BagScene(two_runs), BagScene(with_lost_rows)

    def tiles(position: float) -> list[Any]:
        for bag in (complete, lossy):
            bag.restore(bag.number_at(position))
        return [state(bag.scene)["tiles"] for bag in (complete, lossy)]

    start_of_second_run = (TICKS - 1) * PERIOD
    for start in (start_of_second_run, 0.0):
        for tick in (210, 160, 60, 10):  # of maps, without rows in the tick after it
            expected, found = tiles(start + tick * PERIOD)
            assert found == expected, (start, tick)
    expected, found = tiles(start_of_second_run + 50 * PERIOD)
    assert found != expected  # rows were lost since the map


def test_conditions_and_emergency_stop_are_shown_from_the_diagnostics_of_a_bag(
    two_runs: Path,
) -> None:
    bag = BagScene(two_runs)
    machine = "/excavator"
    bag.restore(bag.number_at(0.3))
    assert bag.scene.machines[machine].is_stopped is False
    bag.restore(bag.number_at(0.7))
    assert bag.scene.machines[machine].is_stopped is True
    assert bag.scene.status["soil_sim"] == "WARN: waits"
    assert bag.scene.status["recording"] == "WARN: lost 33 on /terrain/map_updates"
    bag.restore(bag.number_at(0.3))
    assert bag.scene.machines[machine].is_stopped is False
    assert bag.scene.status["soil_sim"] == "OK"
    assert "recording" not in bag.scene.status


def test_bag_without_reports_of_the_machine_shows_the_published_emergency_stop(
    without_reports: Path,
) -> None:
    bag = BagScene(without_reports)
    for tick, is_stopped in ((50, None), (70, True), (130, False), (70, True)):
        bag.restore(bag.number_at(tick * PERIOD))
        assert bag.scene.machines["/excavator"].is_stopped is is_stopped
