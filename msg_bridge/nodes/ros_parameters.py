"""Declare, read, validate and change ROS parameters from parameter dataclasses.

A dataclass made with `msg_bridge.contract.parameters.parameter` holds all facts of a parameter, so
a node only names the dataclass:

    soil = declare_parameters(self, SoilParams, "soil.")

Values come from `--params-file`, `-p` and `parameter_overrides` as usual. They are checked before
they are declared, so that the user reads this package's sentence and not rclpy's exception.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable, Collection
from dataclasses import fields
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, check_value, item_type, node_fields
from msg_bridge.contract.suggestions import did_you_mean, nearest_name

__all__ = [
    "declare_parameters",
    "known_parameters",
    "on_parameter_change",
    "parameter_descriptor",
    "parameter_overrides",
    "reject_unknown_overrides",
    "unknown_overrides",
]

P = TypeVar("P", bound=Parameters)

_TYPES = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
}
_LIST_TYPES = {
    bool: Parameter.Type.BOOL_ARRAY,
    int: Parameter.Type.INTEGER_ARRAY,
    float: Parameter.Type.DOUBLE_ARRAY,
    str: Parameter.Type.STRING_ARRAY,
}
_INT64 = 2**63


def declare_parameters(
    node: Node, params_class: type[P], prefix: str = "", changeable: Collection[str] = ()
) -> P:
    """Declare the fields of a parameter dataclass to ROS and read their values.

    A field with `determined_by` is not declared, and has its default.

    Args:
        node: node to declare the parameters on.
        params_class: the dataclass; its fields are made by `parameter`.
        prefix: prefix of each name, with its dot: "soil." makes `soil.repose_angle`.
        changeable: fields that may be set while the node runs (see `on_parameter_change`); the
            others are read-only.

    Returns:
        The dataclass with the values of the user, and defaults where there are none.

    Raises:
        ParameterError: a value of a wrong type or outside its range, one of a field that is not
            declared, or a name declared before.
    """
    _check_field_names(params_class, changeable)
    values = {}
    for field in fields(params_class):
        name = prefix + field.name
        value = field.default
        override = parameter_overrides(node).get(name)
        if override is not None and field.metadata.get("determined_by"):
            raise ParameterError(
                f"{_of(node)} has no parameter {name}: it follows from"
                f" {field.metadata['determined_by']}; set those"
            )
        if override is not None:
            value = _from_ros(field, override.value)
            check_value(name, field, value)
        values[field.name] = value
    made = params_class(**values)
    for field in node_fields(params_class):
        descriptor = parameter_descriptor(field, read_only=field.name not in changeable)
        try:
            _declare(node, prefix + field.name, getattr(made, field.name), descriptor)
        except ParameterException as error:
            raise ParameterError(
                f"parameter {prefix}{field.name} of {_of(node)} cannot be declared: {error}"
            ) from error
    return made


def parameter_descriptor(
    field: dataclasses.Field[Any], *, read_only: bool = True
) -> ParameterDescriptor:
    """Return the descriptor of a field: type, meaning with unit, range, allowed values."""
    meta = field.metadata
    items = item_type(field)
    kind = items or type(field.default)
    descriptor = ParameterDescriptor(
        type=(_LIST_TYPES if items else _TYPES)[kind].value,
        description=meta["doc"] + (f" [{meta['unit']}]" if meta["unit"] else ""),
        read_only=read_only,
    )
    if meta["choices"]:
        descriptor.additional_constraints = f"one of: {', '.join(meta['choices'])}"
    low, high = meta["low"], meta["high"]
    if math.isinf(low) and math.isinf(high):
        return descriptor
    if items:  # ROS has ranges of single numbers only
        descriptor.additional_constraints = f"each from {low} to {high}"
    elif kind is int:
        # A side without a limit gets the largest number there is: a range has both.
        first = -_INT64 if math.isinf(low) else math.ceil(low)
        last = _INT64 - 1 if math.isinf(high) else math.floor(high)
        descriptor.integer_range = [IntegerRange(from_value=first, to_value=last)]
    elif kind is float:
        largest = sys.float_info.max
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=max(low, -largest), to_value=min(high, largest))
        ]
    return descriptor


def on_parameter_change(
    node: Node,
    params_class: type[P],
    prefix: str,
    changeable: Collection[str],
    apply: Callable[[P], None],
) -> None:
    """Allow parameters declared as changeable to be set while the node runs.

    A request is validated as one new dataclass. If it is invalid the request is rejected with the
    reason and nothing changes; else ROS holds the new values and `apply` gets the dataclass.

    Args:
        node: node that declared the parameters.
        params_class, prefix, changeable: as given to `declare_parameters`.
        apply: receives the new parameters; it must not reject them.
    """
    _check_field_names(params_class, changeable)
    by_name = {prefix + field.name: field for field in node_fields(params_class)}

    def with_changes(changed: list[Parameter]) -> P | None:
        """Return the changed dataclass, or None if the request concerns other parameters."""
        own_changes = [parameter for parameter in changed if parameter.name in by_name]
        if not any(by_name[parameter.name].name in changeable for parameter in own_changes):
            return None
        values = {}
        for parameter in [*(node.get_parameter(name) for name in by_name), *own_changes]:
            field = by_name[parameter.name]
            values[field.name] = _from_ros(field, parameter.value)
            check_value(parameter.name, field, values[field.name])
        return params_class(**values)

    def check(changed: list[Parameter]) -> SetParametersResult:
        try:
            with_changes(changed)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def take(changed: list[Parameter]) -> None:
        new = with_changes(changed)
        if new is not None:
            apply(new)

    # Applied after all checks of the request: the check of another component may reject it.
    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(take)


def unknown_overrides(node: Node) -> list[str]:
    """Return the names of overrides that the node has not declared, sorted: typing errors.

    Call it after the node has declared all its parameters.
    """
    return sorted(
        name
        for name in parameter_overrides(node)
        if not node.has_parameter(name) and not name.startswith("qos_overrides.")
    )


def known_parameters(node: Node) -> list[str]:
    """Return the names of all declared parameters, sorted."""
    return sorted(node.list_parameters([], 0).names)


def reject_unknown_overrides(node: Node) -> None:
    """Check that every parameter override is declared.

    Raises:
        ParameterError: an override is unknown; names the nearest parameter, or those of its group.
    """
    known = known_parameters(node)
    sentences = [
        f"{_of(node)} has no parameter {name}{_hint(name, known)}"
        for name in unknown_overrides(node)
    ]
    if sentences:
        raise ParameterError("; ".join(sentences))


def _hint(name: str, known: Collection[str]) -> str:
    """Return a hint at the parameter meant by an unknown name, or at those of its group.

    A name of no known group is compared with all names. If none is similar, the hint has the
    parameters without a group, and the groups as "soil.*".
    """
    group = name.rpartition(".")[0] + "."
    members = [each for each in known if each.startswith(group)]
    if members:  # compare without the group, in which all names would be similar
        nearest = nearest_name(name[len(group) :], [each[len(group) :] for each in members])
        hint = did_you_mean(nearest and group + nearest)
    else:
        hint = did_you_mean(nearest_name(name, known))
        groups = sorted({each.partition(".")[0] for each in known if "." in each})
        members = [each for each in known if "." not in each] + [f"{each}.*" for each in groups]
    return hint or f"; it has {', '.join(members)}"


def parameter_overrides(node: Node) -> dict[str, Parameter]:
    """Return the parameters that files, the command line or the creator of a node give, by name."""
    # rclpy offers no way to see the overrides of parameters that are not declared.
    return dict(node._parameter_overrides)


def _declare(node: Node, name: str, value: Any, descriptor: ParameterDescriptor) -> None:
    if not isinstance(value, tuple):
        node.declare_parameter(name, value, descriptor, ignore_override=True)
        return
    # rclpy takes an empty list for bytes unless the type is given, and with a type it takes no
    # value: so the type is declared, the value is set, and then it becomes read-only if it is to.
    kind = Parameter.Type(descriptor.type)
    bare = ParameterDescriptor(type=descriptor.type)
    node.declare_parameter(name, kind, bare, ignore_override=True)
    node.set_parameters_atomically([Parameter(name, kind, list(value))])
    node.set_descriptor(name, descriptor)


def _from_ros(field: dataclasses.Field[Any], value: Any) -> Any:
    """Convert a ROS value to the type of the field: `cell: 1` in YAML is an integer, meant as
    1.0.
    """
    items = item_type(field)
    if items is None:
        return _to_float(value) if isinstance(field.default, float) else value
    if value is None:  # the value of `[]` in YAML and on the command line
        return ()
    if isinstance(value, (str, bytes, bool, int, float)):
        return value  # rejected by the validation
    return tuple(_to_float(item) if items is float else item for item in value)


def _to_float(value: Any) -> Any:
    whole = isinstance(value, int) and not isinstance(value, bool)
    return float(value) if whole else value


def _check_field_names(params_class: type[Parameters], names: Collection[str]) -> None:
    unknown_fields = set(names) - {field.name for field in fields(params_class)}
    if unknown_fields:
        raise TypeError(f"{params_class.__name__} has no field {', '.join(sorted(unknown_fields))}")


def _of(node: Node) -> str:
    return str(node.get_fully_qualified_name())
