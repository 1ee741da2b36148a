"""Dataclasses with the quick constructor are as those without."""

from dataclasses import FrozenInstanceError, dataclass, field, replace

import pytest

from msg_bridge.contract.quick_init import quick_init


@quick_init
@dataclass(frozen=True)
class Point:
    x: int
    y: int = 3
    label: str = field(default="a", compare=False)


def test_fields_have_the_values_given_or_their_defaults() -> None:
    point = Point(1, label="b")
    assert (point.x, point.y, point.label) == (1, 3, "b")
    assert point == Point(1) == replace(point, label="c") != Point(2)
    assert hash(point) == hash(Point(x=1, y=3))
    assert repr(point) == "Point(x=1, y=3, label='b')"


def test_fields_cannot_be_set() -> None:
    with pytest.raises(FrozenInstanceError):
        Point(1).x = 2  # type: ignore[misc]


def test_parameters_are_checked() -> None:
    with pytest.raises(TypeError, match="missing 1 required"):
        Point()  # type: ignore[call-arg]


class WithPostInit:
    def __post_init__(self) -> None:
        raise ValueError


class WithFactory:
    numbers: list[int] = field(default_factory=list)


@pytest.mark.parametrize("kind", [WithPostInit, WithFactory])
def test_classes_of_which_the_constructor_would_ignore_something_are_rejected(kind) -> None:
    with pytest.raises(TypeError, match="quick_init"):
        quick_init(dataclass(frozen=True)(kind))


def test_classes_with_slots_are_rejected() -> None:
    with pytest.raises(TypeError, match="slots"):
        quick_init(dataclass(frozen=True, slots=True)(type("Slotted", (), {})))
