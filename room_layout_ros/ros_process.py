"""How a process of ours joins ROS, and what then can be wrong with what the user gave: one sentence each."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.qos_overriding_options import InvalidQosOverridesError

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


def sentence(error: Exception) -> str:
    """Return what an error says in one line (rcl marks the place of a bad character on a line of its own)."""
    return " ".join(str(error).split())
