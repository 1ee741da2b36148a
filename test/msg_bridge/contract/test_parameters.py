from dataclasses import dataclass
from typing import Any

import pytest

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter


@dataclass(frozen=True)
class Example(Parameters):
    speed: float = parameter(1.0, "how fast", unit="m/s", low=0.0, high=2.0)
    count: int = parameter(3, "how many", low=1, high=9)
    mode: str = parameter("a", "which way", choices=("a", "b"))
    on: bool = parameter(True, "whether at all")
    machines: tuple[int, ...] = parameter((1,), "which", low=1, high=9)
    names: tuple[str, ...] = parameter((), "what for", items=str)


def test_mapping_sets_the_named_parameters() -> None:
    made = Example.from_mapping({"speed": 2, "mode": "b", "on": False})
    assert made == Example(speed=2, count=3, mode="b", on=False)


def test_list_is_converted_to_a_tuple() -> None:
    made = Example.from_mapping({"machines": [2, 1], "names": ["a"]})
    assert (made.machines, made.names) == ((2, 1), ("a",))
    assert hash(made) == hash(Example(machines=(2, 1), names=("a",)))


def test_empty_list_default_requires_an_element_type() -> None:
    with pytest.raises(TypeError, match="give `items` too"):
        parameter((), "which")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"speed": 3.0}, "speed is 3.0 m/s; give a value from 0.0 to 2.0 m/s"),
        ({"speed": float("nan")}, "finite number"),
        ({"speed": "fast"}, "finite number"),
        ({"count": 2.5}, "whole number"),
        ({"count": True}, "whole number"),
        ({"mode": "c"}, "give one of: a, b"),
        ({"on": 1}, "true or false"),
        ({"sped": 1.0}, "has no parameter sped .*; it has speed, count, mode, on"),
        ({"machines": 1}, "machines is 1; give a list"),
        ({"machines": [1, 10]}, r"machines\[1\] is 10; give a value from 1 to 9"),
        ({"machines": [True]}, r"machines\[0\] is True; give a whole number"),
        ({"names": ["a", 2]}, r"names\[1\] is 2; give one of: a text"),
    ],
)
def test_error_of_an_invalid_parameter_names_it(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        Example.from_mapping(values)


def test_error_names_a_parameter_as_the_user_has_written_it() -> None:
    for prefix, name in ((None, "Example.speed"), ("drive.", "drive.speed"), ("--", "--speed")):
        with pytest.raises(ParameterError, match=f"^{name} is 3.0 m/s"):
            Example.from_mapping({"speed": 3.0}, prefix=prefix)
