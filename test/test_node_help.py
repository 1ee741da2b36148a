"""`--help` of every node executable."""

from collections.abc import Callable

import pytest

from dig_operator.node import main as dig_operator
from machine_sim.node.machine_node import main as machine_sim
from msg_bridge.foxglove_server.node import main as foxglove_server
from msg_bridge.recorder.recorder_node import main as exchange_recorder
from soil_sim.node.soil_node import main as soil_sim
from viewer.cameras.node import main as camera
from viewer.node import main as viewer


@pytest.mark.parametrize(
    ("main", "parameter"),
    [
        (soil_sim, "soil.relaxation_radius: float"),
        (machine_sim, "commands.command_timeout: float [s], 0.01 to 60, default 0.3"),
        (exchange_recorder, "compression: str, one of "),
        (foxglove_server, "port: int, 0 to 65535, default 8765"),
        (dig_operator, "task."),
        (camera, "views: list"),
        (viewer, "frame_rate: float [Hz], 1 to 120, default 30.0"),
    ],
)
def test_help_names_the_executable_and_its_parameters(
    capsys: pytest.CaptureFixture[str], main: Callable[[list[str]], int], parameter: str
) -> None:
    assert main(["program", "--help"]) == 0
    text = capsys.readouterr().out
    package = main.__module__.split(".")[0]
    of_package = {
        "msg_bridge": ("exchange_recorder", "foxglove_server"),
        "viewer": ("viewer", "camera"),
    }
    names = of_package.get(package, (package,))
    assert text.startswith(tuple(f"usage: {name} " for name in names))
    assert parameter in text
