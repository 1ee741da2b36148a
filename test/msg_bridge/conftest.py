"""Fixture: recorders in the executor of a test."""

import pytest

from msg_bridge.recorder.recorder_node import RecorderNode


@pytest.fixture
def recorder(ros, tmp_path):
    """Return a function that starts a recorder of the topics below /t/ into the folder `dig`."""

    def make(**parameters) -> RecorderNode:
        given = {"path": str(tmp_path / "dig"), "include": "^/t/", "progress": False}
        given["scan_period"] = 0.02  # publishers are checked every 0.2 s then
        return ros.add(RecorderNode, parameters={**given, **parameters})

    return make
