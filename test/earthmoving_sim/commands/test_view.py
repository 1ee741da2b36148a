"""`earthmoving view`: invalid input is reported before a server is started."""

import pytest

from earthmoving_sim.cli import main


@pytest.mark.parametrize("port", ["70000", "-1", "http"])
def test_invalid_port_is_rejected(capsys, port):
    with pytest.raises(SystemExit) as stop:
        main(["view", "bags/format_2", "--port", port])
    assert stop.value.code == 2
    assert "--port" in capsys.readouterr().err
