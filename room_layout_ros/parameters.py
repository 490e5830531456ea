"""Settings tables <-> ROS parameters: descriptors with ranges, atomic checks with reasons."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from msg_adapters.text import MAX_NAME, clean_text

from .core.config import Parameter, Value, nearest_name, parameters
from .node_config import TABLES

Table = TypeVar("Table")

_OF_ROS = ("qos_overrides.",)
"""Parameters that rclpy declares later, with the topics."""

_FLOATS = {row.name for _, table in TABLES for row in parameters(table) if type(row.default) is float}
_INT_MAX = 2**31 - 1


def describe(parameter: Parameter) -> ParameterDescriptor:
    """Return what `ros2 param describe` shows: meaning, unit, choices and range."""
    constraints = []
    if parameter.unit:
        constraints.append(f"unit: {parameter.unit}")
    if parameter.choices:
        constraints.append(f"one of: {', '.join(parameter.choices)}")
    if not parameter.runtime:
        constraints.append("fixed after the start")
    descriptor = ParameterDescriptor(
        name=parameter.name,
        description=parameter.meaning,
        additional_constraints="; ".join(constraints),
        read_only=not parameter.runtime,
    )
    bounded = parameter.low is not None and parameter.high is not None
    if bounded and type(parameter.default) is float:
        descriptor.floating_point_range = [FloatingPointRange(from_value=parameter.low, to_value=parameter.high)]
    elif bounded and type(parameter.default) is int:
        high = min(int(parameter.high or 0), _INT_MAX)
        descriptor.integer_range = [IntegerRange(from_value=int(parameter.low or 0), to_value=high, step=1)]
    return descriptor


def widened(changes: Iterable[RosParameter]) -> list[RosParameter]:
    """Return parameters, a whole number as a float where the tables have one: `camera_height:=1` is 1.0."""
    return [_as_float(p) if p.type_ == RosParameter.Type.INTEGER and p.name in _FLOATS else p for p in changes]


def _as_float(whole: RosParameter) -> RosParameter:
    return RosParameter(whole.name, RosParameter.Type.DOUBLE, float(whole.value))


def declare(node: Node, tables: Iterable[type]) -> None:
    """Declare every row of the tables; what is given at the start may be a whole number where a float is meant.

    Raises
    ------
    rclpy.exceptions.ParameterException
        When a value given at the start is of the wrong type or out of range.
    """
    given = node._parameter_overrides  # rclpy refuses a whole number
    given.update({p.name: p for p in widened(given.values())})
    for table in tables:
        for row in parameters(table):
            node.declare_parameter(row.name, row.default, describe(row))


def refuse_unknown(node: Node) -> None:
    """Look for values given at the start that no declared parameter takes; rclpy passes over them without a word.

    Raises
    ------
    ValueError
        With the name, and that of the parameter which is nearest to it.
    """
    given = node._parameter_overrides  # rclpy tells them to nobody
    unknown = sorted(name for name in given if not node.has_parameter(name) and not name.startswith(_OF_ROS))
    if not unknown:
        return
    known = sorted(node.get_parameters_by_prefix(""))
    hint = nearest_name(unknown[0], known, "`ros2 param list` and docs/parameters.md have all of them")
    more = f" (and {len(unknown) - 1} more)" if len(unknown) > 1 else ""
    raise ValueError(f"{clean_text(unknown[0])} is no parameter of this node{more}; {hint}")


def unknown_overrides(node: Node, known: Iterable[str]) -> Iterator[str]:
    """Yield a sentence for each `qos_overrides` given at the start that is neither known nor declared.

    They are not refused: their names hold that of a topic, so that one file may have those of several nodes.
    """
    names = sorted(known)
    for name in sorted(node._parameter_overrides):
        if name.startswith(_OF_ROS) and name not in names and not node.has_parameter(name):
            hint = nearest_name(name, names, "docs/parameters.md says what may stand there")
            yield f"{clean_text(name, MAX_NAME)} changes nothing: it is of no topic or policy of this node; {hint}"


def read(node: Node, table: type[Table]) -> Table:
    """Return the parameters of the node as a value of `table`. Raises ValueError when they are at odds."""
    return table(**{row.name: node.get_parameter(row.name).value for row in parameters(table)})


def changed(current: Table, values: Mapping[str, Value | None]) -> Table:
    """Return `current` with those of `values` that belong to it; all or nothing.

    Raises
    ------
    ValueError
        With the reason, when one is wrong, fixed after the start, or at odds with another.
    """
    rows = {row.name: row for row in parameters(type(current))}
    new: dict[str, Any] = {}
    for name, value in values.items():
        row = rows.get(name)
        if row is None:
            continue
        value = row.check(value)
        if not row.runtime and value != getattr(current, name):
            raise ValueError(f"{name} is fixed after the start; set it in the parameter file or on the command line")
        new[name] = value
    return dataclasses.replace(current, **new) if new else current  # type: ignore[type-var]
