"""A recording that fails has its reason until the next one starts."""

from __future__ import annotations

from pathlib import Path

from support.waiting import until

from viewer.recording import RecorderProcess


def test_failure_of_the_recorder_is_kept_until_the_next_start(tmp_path: Path) -> None:
    recorder = RecorderProcess(tmp_path, "/not a namespace")
    recorder.start()
    assert recorder.state.on

    def has_ended() -> bool:
        recorder.update()
        return not recorder.state.on

    until(has_ended)
    assert "namespace" in recorder.state.failure
    recorder.update()
    assert "namespace" in recorder.state.failure
    recorder.start()
    assert recorder.state.failure == ""
    recorder.close()
    assert recorder.state.failure == ""
