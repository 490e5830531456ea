"""How a process of ours joins ROS, and what then can be wrong with what the user gave: one sentence each."""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.qos_overriding_options import InvalidQosOverridesError

from msg_adapters.text import MAX_NAME, clean_text

from .core.config import nearest_name
from .ros_arguments import is_meant, node_names, options

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
LAST_DOMAIN = 232
"""DDS has no ports for more."""

BAD_SETTINGS = (
    ValueError,
    ParameterException,
    NameValidationException,
    InvalidQosOverridesError,
    RuntimeError,  # what rcl says of its arguments and files
)
"""What `join`, making a node and making its topics raise where names, arguments or environment are wrong."""


def join(args: Sequence[str] | None, **options: Any) -> None:
    """Call `rclpy.init`.

    Raises
    ------
    ValueError
        When ROS_DOMAIN_ID is no domain: Fast DDS would end the process without a word of ours.
    """
    text = os.environ.get(DOMAIN_VARIABLE, "")
    if text and not (text.isascii() and text.isdigit() and int(text) <= LAST_DOMAIN):
        raise ValueError(f"{DOMAIN_VARIABLE} is {text[:40]!r}; it must be a whole number of 0 to {LAST_DOMAIN}")
    rclpy.init(args=None if args is None else list(args), **options)


def leave() -> None:
    """Call `rclpy.try_shutdown`: a signal may end the context between its look and its call."""
    with suppress(RuntimeError):
        rclpy.try_shutdown()


def message_class(kind: str) -> type:
    """Return the class of a message type, "sensor_msgs/msg/Image".

    Raises
    ------
    ImportError, AttributeError
        When it is not installed.
    """
    package, _, name = kind.split("/")
    found: type = getattr(importlib.import_module(f"{package}.msg"), name)
    return found


_OF_EVERY_NODE = (
    "/rosout", "/parameter_events", "/clock", "/tf", "/tf_static", "/diagnostics",
    *(f"~/{service}" for service in (
        "describe_parameters", "get_parameter_types", "get_parameters", "list_parameters", "set_parameters",
        "set_parameters_atomically", "get_type_description", "get_logger_levels", "set_logger_levels",
        "change_state", "get_state", "get_available_states", "get_available_transitions", "get_transition_graph",
        "transition_event",
    )),
)  # fmt: skip


def unknown_remaps(node: Any, args: Sequence[str], topics: Iterable[str]) -> Iterator[str]:
    """Yield a sentence for each remapping of the command line whose left side is no name of a node; ROS says nothing.

    Parameters
    ----------
    node : rclpy node
    args : sequence of str
        Of the process.
    topics : iterable of str
        The node's own, as it gives them to ROS.
    """
    known = [*topics, *_OF_EVERY_NODE]
    expanded = {node.resolve_topic_name(name, only_expand=True) for name in known}
    for option, rule in options(args):
        if option not in ("-r", "--remap") or rule is None:
            continue
        name = rule.partition(":=")[0].removeprefix("rostopic://").removeprefix("rosservice://")
        whose, colon, left = name.rpartition(":")
        if left.startswith("__") or (colon and whose != node.get_name()):
            continue
        if node.resolve_topic_name(left, only_expand=True) not in expanded:
            hint = nearest_name(left, [*known, *sorted(expanded)], "docs/topics.md has all of them")
            yield f"-r {clean_text(rule, MAX_NAME)} changes nothing: no topic or service of this node; {hint}"


def idle_files(node: Any, args: Sequence[str]) -> Iterator[str]:
    """Yield a sentence for each parameter file of the command line that holds nothing for a node; ROS says nothing."""
    own = node.get_fully_qualified_name()
    for option, path in options(args):
        names = node_names(path) if option == "--params-file" and path else [own]
        if not any(is_meant(name, own) for name in names):
            hint = nearest_name(own, names, f"it is for {', '.join(names[:3])}" if names else "it is for no node")
            yield f"--params-file {path} holds nothing for {own}; {hint}"


def sentence(error: Exception) -> str:
    """Return what an error says in one line, without the places and the lexemes of rcl."""
    if type(error).__name__ == "UnknownROSArgsError":  # a list and nothing else
        return f"{str(error)[1:-1]} is no argument of ROS"
    words = re.sub(r",? at /[^ ,]+:\d+", "", " ".join(str(error).split())).removeprefix("failed to initialize rcl: ")
    return re.sub(r"Expected lexeme .*? at index (\d+)", r"it is wrong behind its first \1 characters", words)
