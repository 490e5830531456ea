"""The options of every command that estimates: --rgb-only and --set."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from room_layout_ros.commands.camera_pose import POSE
from room_layout_ros.core.config import EstimatorConfig, Value, nearest_name, parameters
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.datasets import DataError
from room_layout_ros.node_config import NodeConfig


def add_estimator_options(parser: argparse.ArgumentParser, rgb_only: str = "leave the depth unused") -> None:
    """Add the options; `rgb_only` says what the first does."""
    parser.add_argument("--rgb-only", action="store_true", help=rgb_only)
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="set a parameter of the estimator (repeatable)"
    )


def parse_settings(settings: Sequence[str], rgb_only: bool = False, **defaults: Value) -> EstimatorConfig:
    """Return the configuration with NAME=VALUE words applied.

    Parameters
    ----------
    settings : words of the command line.
    rgb_only : the option that leaves the depth unused is given.
    **defaults
        Settings that the command has otherwise than the table; the words come before them.

    Raises
    ------
    DataError
        When a name is unknown, a value not allowed, or neither colour nor depth is used.
    """
    table = {parameter.name: parameter for parameter in parameters()}
    values: dict[str, Any] = dict(defaults)
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise DataError(f"--set {setting}: NAME=VALUE with a parameter of the estimator is needed")
        if name not in table:
            if name in {parameter.name for parameter in parameters(NodeConfig)}:
                option = f"; the option is --{name.replace('_', '-')}" if name in POSE else ""
                raise DataError(f"--set {setting}: {name} is a parameter of the node, not of the estimator{option}")
            hint = nearest_name(name, table, "docs/parameters.md has all of them")
            raise DataError(f"--set {setting}: the estimator has no parameter {name}; {hint}")
        try:
            values[name] = table[name].check(_value(text, type(table[name].default)))
        except ValueError as error:
            raise DataError(f"--set {setting}: {error}") from None
    try:
        config = EstimatorConfig(**values)
    except ValueError as error:
        raise DataError(f"--set: {error}") from None
    if not config.use_color and (rgb_only or not config.use_depth):
        both = "--rgb-only leaves the depth unused, and use_color is false"
        both = both if config.use_depth else "use_color and use_depth are both false"
        raise DataError(f"{both}; the estimator needs at least one of the two streams")
    return config


def _value(text: str, kind: type) -> object:
    if kind is bool:
        if text not in ("true", "false"):
            raise ValueError(f"{text!r} is not true or false")
        return text == "true"
    try:
        return kind(text)
    except ValueError:
        raise ValueError(f"{text!r} is no {kind.__name__}") from None


def prepared(frame: RgbdFrame, rgb_only: bool) -> RgbdFrame:
    """Return the frame as every command estimates it: as it is, or with --rgb-only without its depth.

    Raises
    ------
    DataError
        When it has no colour and shall be without its depth.
    """
    if not rgb_only:
        return frame
    if frame.color is None:
        raise no_color(f"frame {frame.name}")
    return frame.without_depth()


def no_color(what: str) -> DataError:
    """Return the refusal of --rgb-only for a frame or an input without colour."""
    return DataError(f"{what} has no colour, and --rgb-only leaves the depth unused")
