"""A recorded run, and its audit."""

from collections.abc import Callable
from pathlib import Path

import pytest
from support.recorded_exchange import scripted_run
from support.recorded_messages import Recording

from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.audit.report import AuditReport

TICKS = 60


@pytest.fixture(scope="package")
def recording() -> Recording:
    """A scripted machine at work for 60 ticks, with a terrain map every 20 ticks."""
    run = scripted_run(map_interval_ticks=20)
    for _ in range(TICKS):
        run.step()
    return run.recording


@pytest.fixture
def audit(tmp_path: Path) -> Callable[[Recording], AuditReport]:
    """Write a recording as a bag and audit it."""

    def write_and_audit(recording: Recording, **options: object) -> AuditReport:
        return audit_bag(recording.write(tmp_path / "a.mcap", **options))

    return write_and_audit
