"""Parameter dataclasses as ROS parameters."""

import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import rclpy
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter
from msg_bridge.nodes.ros_parameters import (
    declare_parameters,
    known_parameters,
    on_parameter_change,
    reject_unknown_overrides,
    unknown_overrides,
)
from msg_bridge.testing.ros_context import Ros


@dataclass(frozen=True)
class Example(Parameters):
    cell: float = parameter(0.2, "size of a column", unit="m", low=0.01, high=10.0)
    count: int = parameter(3, "how many", low=1)
    offset: float = parameter(0.0, "from where", unit="m", high=5.0)
    free: float = parameter(0.0, "anything")
    mode: str = parameter("a", "which way", choices=("a", "b"))
    on: bool = parameter(True, "whether at all")
    machines: tuple[int, ...] = parameter((1,), "which", low=1, high=9)
    names: tuple[str, ...] = parameter((), "of what", items=str)
    weights: tuple[float, ...] = parameter((0.5,), "how much")
    rows: int = parameter(2, "how many rows", determined_by="soil.count and soil.cell")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.cell > self.count:
            raise ParameterError(f"cell {self.cell} is more than count {self.count}; make it less")


class ExampleNode(Node):
    def __init__(self, changeable=(), prefix="soil.", **kwargs):
        super().__init__("example", **kwargs)
        self.params = declare_parameters(self, Example, prefix, changeable)
        self.applied = []
        if changeable:
            on_parameter_change(self, Example, prefix, changeable, self.applied.append)


def example(ros, values, **kwargs):
    """Start a node with parameter values; return it."""
    given = {f"soil.{name}": value for name, value in values.items()}
    return ros.add(ExampleNode, parameters=given, **kwargs)


def set_atomically(ros, values):
    """Request new values through the service of the node, as `ros2 param` does."""
    request = SetParametersAtomically.Request(
        parameters=[Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
    )
    return ros.call(SetParametersAtomically, "/example/set_parameters_atomically", request).result


def test_defaults_are_declared_without_overrides(ros: Ros) -> None:
    node = example(ros, {})
    assert node.params == Example()
    for name in ("cell", "count", "mode", "on"):
        assert node.get_parameter(f"soil.{name}").value == getattr(Example(), name)
    assert list(node.get_parameter("soil.machines").value) == [1]
    assert list(node.get_parameter("soil.names").value) == []


def test_parameter_overrides_are_read(ros: Ros) -> None:
    given = {"cell": 0.5, "count": 4, "mode": "b", "on": False}
    lists = {"machines": (2, 3), "names": ("x",), "weights": (1.0, 2.0)}
    node = example(ros, {**given, **lists})
    assert node.params == Example(**given, **lists)
    assert node.get_parameter("soil.mode").value == "b"
    assert list(node.get_parameter("soil.machines").value) == [2, 3]


def test_values_are_read_from_a_file_and_the_command_line(ros: Ros, tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    soil:\n      cell: 1\n      machines: []\n"
        "      weights: [1, 2]\n      names: [left, right]\n"
    )
    arguments = ["--ros-args", "--params-file", str(file), "-p", "soil.count:=7"]
    node = ros.add(ExampleNode, cli_args=arguments)
    assert node.params == Example(
        cell=1.0, count=7, machines=(), weights=(1.0, 2.0), names=("left", "right")
    )


def test_parameter_that_follows_from_others_cannot_be_set(ros: Ros) -> None:
    assert "soil.rows" not in known_parameters(example(ros, {}))
    with pytest.raises(ParameterError, match=r"rows: it follows from soil\.count and soil\.cell"):
        example(ros, {"rows": 2})


def test_integer_is_accepted_for_a_double(ros: Ros) -> None:
    node = example(ros, {"cell": 1, "weights": (1, 2)})
    assert isinstance(node.params.cell, float)
    assert node.get_parameter("soil.cell").type_ is Parameter.Type.DOUBLE
    assert node.get_parameter("soil.weights").type_ is Parameter.Type.DOUBLE_ARRAY


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"cell": 11.0}, r"^soil.cell is 11.0 m; give a value from 0.01 to 10.0 m \(size of a"),
        ({"cell": True}, "soil.cell is True; give a finite number"),
        ({"cell": "wide"}, "soil.cell is 'wide'; give a finite number"),
        ({"count": 2.0}, "soil.count is 2.0; give a whole number"),
        ({"mode": "c"}, "soil.mode is 'c'; give one of: a, b"),
        ({"on": 1}, "soil.on is 1; give true or false"),
        ({"machines": 2}, "soil.machines is 2; give a list"),
        ({"machines": (1, 10)}, r"soil.machines\[1\] is 10; give a value from 1 to 9"),
        ({"names": "x"}, "soil.names is 'x'; give a list"),
        ({"cell": 2.0, "count": 1}, "cell 2.0 is more than count 1"),
    ],
)
def test_invalid_value_is_rejected(ros: Ros, values, message) -> None:
    with pytest.raises(ParameterError, match=message):
        example(ros, values)


def test_duplicate_declaration_is_rejected(ros: Ros) -> None:
    node = example(ros, {})
    with pytest.raises(ParameterError, match=r"parameter soil\.cell of /example cannot be decl"):
        declare_parameters(node, Example, "soil.")


def test_unknown_changeable_field_is_a_type_error(ros: Ros) -> None:
    with pytest.raises(TypeError, match="Example has no field sell"):
        example(ros, {}, changeable=("sell",))


def test_descriptors_have_type_meaning_unit_and_range(ros: Ros) -> None:
    node = example(ros, {}, changeable=("count",))
    names = ["soil.cell", "soil.count", "soil.offset", "soil.free", "soil.mode", "soil.machines"]
    request = DescribeParameters.Request(names=names)
    answer = ros.call(DescribeParameters, "/example/describe_parameters", request)
    cell, count, offset, free, mode, machines = answer.descriptors
    assert (cell.type, cell.description) == (ParameterType.PARAMETER_DOUBLE, "size of a column [m]")
    (span,) = cell.floating_point_range
    assert (span.from_value, span.to_value) == (0.01, 10.0)
    assert [d.read_only for d in (cell, count, machines)] == [True, False, True]
    (span,) = count.integer_range
    assert (span.from_value, span.to_value) == (1, 2**63 - 1)
    (span,) = offset.floating_point_range
    assert (span.from_value, span.to_value) == (-sys.float_info.max, 5.0)
    assert list(free.floating_point_range) == []
    assert mode.additional_constraints == "one of: a, b"
    assert machines.type == ParameterType.PARAMETER_INTEGER_ARRAY
    assert machines.additional_constraints == "each from 1 to 9"
    assert known_parameters(node)[:2] == ["soil.cell", "soil.count"]


def test_empty_list_keeps_its_type(ros: Ros) -> None:
    example(ros, {})
    request = GetParameters.Request(names=["soil.names"])
    (value,) = ros.call(GetParameters, "/example/get_parameters", request).values
    assert value.type == ParameterType.PARAMETER_STRING_ARRAY


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("soil.sell", " (did you mean 'soil.cell'?)"),
        ("soil.verbose", "; it has soil.cell, soil.count, "),
        ("verbose", ", use_sim_time, soil.*"),
    ],
)
def test_error_of_an_unknown_parameter_suggests_a_similar_name_or_its_group(
    ros_domain: int, name: str, hint: str
) -> None:
    context = Context()
    rclpy.init(
        args=["test", "--ros-args", "-p", f"{name}:=0.1", "-p", "qos_overrides./tf.x.depth:=3"],
        context=context,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    try:
        node = ExampleNode(context=context)
        assert unknown_overrides(node) == [name]
        with pytest.raises(ParameterError) as caught:
            reject_unknown_overrides(node)
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)
    assert str(caught.value).startswith(f"/example has no parameter {name}")
    assert hint in str(caught.value)


def test_valid_names_are_not_reported(ros: Ros) -> None:
    node = example(ros, {"cell": 0.5})
    assert unknown_overrides(node) == []
    reject_unknown_overrides(node)


def test_parameter_change_is_applied_as_one_dataclass(ros: Ros) -> None:
    node = example(ros, {"mode": "b"}, changeable=("cell", "count", "machines"))
    asked = {"soil.cell": 5.0, "soil.count": 8, "soil.machines": [4, 5]}
    assert set_atomically(ros, asked).successful
    assert node.applied == [Example(cell=5.0, count=8, mode="b", machines=(4, 5))]
    assert node.get_parameter("soil.cell").value == 5.0


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        ({"soil.cell": 2.0, "soil.count": 1}, "cell 2.0 is more than count 1; make it less"),
        ({"soil.count": 5, "soil.machines": [0]}, "soil.machines[0] is 0; give a value from 1"),
        ({"soil.count": 5, "soil.mode": "b"}, "read-only parameter: soil.mode"),
        ({"soil.count": 0}, "soil.count"),
    ],
)
def test_invalid_change_is_rejected_and_changes_nothing(ros: Ros, asked, reason) -> None:
    node = example(ros, {}, changeable=("cell", "count", "machines"))
    result = set_atomically(ros, asked)
    assert not result.successful
    assert reason in result.reason
    assert node.applied == []
    assert node.get_parameter("soil.count").value == 3
    assert node.get_parameter("soil.cell").value == 0.2


def test_change_of_other_parameters_is_ignored(ros: Ros) -> None:
    node = example(ros, {}, changeable=("cell",))
    node.declare_parameter("other", 1)
    assert set_atomically(ros, {"other": 2}).successful
    assert node.applied == []


@pytest.mark.parametrize(("good", "bad"), [("first", "second"), ("second", "first")])
def test_change_rejected_by_one_component_is_applied_to_none(ros: Ros, good: str, bad: str) -> None:
    node = ros.node("example")
    applied = []
    for prefix in ("first.", "second."):
        declare_parameters(node, Example, prefix, ("count", "cell"))
        on_parameter_change(node, Example, prefix, ("count", "cell"), applied.append)
    result = set_atomically(ros, {f"{good}.count": 5, f"{bad}.cell": 9.0})
    assert "cell 9.0 is more than count 3" in result.reason
    assert applied == []
    assert set_atomically(ros, {"first.count": 5, "second.count": 6}).successful
    assert sorted(params.count for params in applied) == [5, 6]
