"""`--help` of every node executable."""

from collections.abc import Callable

import pytest

from dig_operator.node import main as dig_operator
from machine_sim.node.machine_node import main as machine_sim
from msg_bridge.recorder.recorder_node import main as exchange_recorder
from soil_sim.node.soil_node import main as soil_sim


@pytest.mark.parametrize(
    ("main", "parameter"),
    [
        (soil_sim, "soil.relaxation_radius: float"),
        (machine_sim, "commands.command_timeout: float [s], 0.01 to 60, default 0.3"),
        (exchange_recorder, "compression: str, one of "),
        (dig_operator, "task."),
    ],
)
def test_help_names_the_executable_and_its_parameters(
    capsys: pytest.CaptureFixture[str], main: Callable[[list[str]], int], parameter: str
) -> None:
    assert main(["program", "--help"]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: {main.__module__.split('.')[0]} ") or "exchange_rec" in text
    assert parameter in text
