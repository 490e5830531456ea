"""How a process of ours joins ROS, and what then can be wrong with what the user gave: one sentence each."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.qos_overriding_options import InvalidQosOverridesError

from msg_adapters.text import clean_text

from .core.config import nearest_name

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
_LONGEST_NAME = 120


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
    for rule in _remaps(args):
        name = rule.partition(":=")[0].removeprefix("rostopic://").removeprefix("rosservice://")
        whose, colon, left = name.rpartition(":")
        if left.startswith("__") or (colon and whose != node.get_name()):
            continue
        if node.resolve_topic_name(left, only_expand=True) not in expanded:
            hint = nearest_name(left, [*known, *sorted(expanded)], "docs/topics.md has all of them")
            yield f"-r {clean_text(rule, _LONGEST_NAME)} changes nothing: no topic or service of this node; {hint}"


def _remaps(args: Sequence[str]) -> Iterator[str]:
    of_ros = False
    for word, value in pairwise((*args, "")):
        of_ros = word == "--ros-args" or (of_ros and word != "--")
        if of_ros and word in ("-r", "--remap"):
            yield value


def sentence(error: Exception) -> str:
    """Return what an error says in one line (rcl marks the place of a bad character on a line of its own)."""
    return " ".join(str(error).split())
