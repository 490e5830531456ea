"""The command line of a node, read before ROS does: what is wrong is one sentence. Imports nothing heavy.

rcl answers with the state of its parser, and passes over what it takes to be of another node.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

LAUNCH = "ros2 launch room_layout_ros estimator.launch.py"
OF_LAUNCH = {
    "camera": "docs/cameras.md, Without ros2 launch, has the -r lines for it",
    "camera_name": "docs/cameras.md, Without ros2 launch, has the -r lines for it",
    "namespace": "here it is --ros-args -r __ns:=/{value}",
    "node_name": "here it is --ros-args -r __node:={value}",
    "params_file": "here it is --ros-args --params-file {value}",
    "imu": "here it is --ros-args -r imu:={value}",
    "lifecycle": "without it start lifecycle_estimator",
    "rviz": "docs/cameras.md, RViz, says how to start RViz by hand",
    "fixed_frame": "docs/cameras.md, RViz, says how to start RViz by hand",
}
"""Arguments of the launch file that are no parameters, and what does the same without it."""

_RULES = {"-p": "NAME:=VALUE", "--param": "NAME:=VALUE", "-r": "FROM:=TO", "--remap": "FROM:=TO"}
_VALUED = {
    **_RULES,
    "--params-file": "FILE",
    "--log-level": "LEVEL",
    "--log-config-file": "FILE",
    "--log-file-name": "NAME",
    "-e": "NAME",
    "--enclave": "NAME",
}
"""Options of ROS that take the next word, and what it has to be."""

_LONGEST = 120
_PARAMETERS = "ros__parameters"


def words_of_ours(args: Sequence[str]) -> list[str]:
    """Return the words that are none of ROS: outside of `--ros-args ... --`."""
    words, of_ros = [], False
    for word in args:
        if of_ros or word == "--ros-args":
            of_ros = word != "--"
        else:
            words.append(word)
    return words


def options(args: Sequence[str]) -> Iterator[tuple[str, str | None]]:
    """Yield the options of ROS with their values; None where none follows, the option "" before a stray word."""
    of_ros, option = False, ""
    for word in args:
        if option:
            yield option, word
            option = ""
        elif word in ("--ros-args", "--"):
            of_ros = word == "--ros-args"
        elif of_ros and word in _VALUED:
            option = word
        elif of_ros:
            yield "", word
    if option:
        yield option, None


def fault(program: str, args: Sequence[str]) -> str:
    """Return what is wrong with a command line, in a sentence; "" where ROS may read it."""
    ours = words_of_ours(args)
    said = [_of_launch(word) for word in ours]
    if ours:
        return next(filter(None, said), "") or _misplaced(program, ours[0])
    return next(filter(None, (_fault_of(option, value) for option, value in options(args))), "")


def _of_launch(word: str) -> str:
    name, assigned, value = word.partition(":=")
    if not assigned or name not in OF_LAUNCH:
        return ""
    instead = OF_LAUNCH[name].format(value=value[:_LONGEST].removeprefix("/") if name == "namespace" else value)
    return f"{word[:_LONGEST]!r} is an argument of the launch file ({LAUNCH} {word[:_LONGEST]}); {instead}"


def _kind(word: str) -> str:
    return "-r" if word.startswith("__") or "/" in word.partition(":=")[0] else "-p"


def _misplaced(program: str, word: str) -> str:
    if ":=" not in word:
        return f"{word[:_LONGEST]!r} is no argument; all are ROS's, behind --ros-args (see {program} --help)"
    line = f"{program} --ros-args {_kind(word)} {word[:_LONGEST]}"
    return f"{word[:_LONGEST]!r} has to stand behind --ros-args: {line}"


def _fault_of(option: str, value: str | None) -> str:
    if value is None:
        return f"nothing stands behind {option}; it must be {option} {_VALUED[option]}"
    if option == "":
        return _stray(value)
    if option in _RULES:
        return _fault_of_rule(option, value)
    return _fault_of_file(value) if option == "--params-file" else ""


def _stray(word: str) -> str:
    """Return what is wrong with a word that is no value; one that begins with - ROS knows, or refuses in a word."""
    if ":=" in word:
        return _of_launch(word) or f"{_kind(word)} is missing before {word[:_LONGEST]}"
    if word.startswith("-"):
        return ""
    return f"{word[:_LONGEST]!r} is no argument of ROS; what stands before it is complete"


def _fault_of_rule(option: str, rule: str) -> str:
    left, assigned, right = rule.partition(":=")
    given = f"{option} {rule[:_LONGEST]}"
    if not assigned:
        fixed = rule[:_LONGEST].replace("=", ":=", 1) if "=" in rule else _RULES[option]
        return f"':=' is missing in {given}; {'write' if '=' in rule else 'it must be'} {option} {fixed}"
    if not (left and right):
        return f"nothing stands {'behind' if left else 'before'} ':=' in {given}; it must be {option} {_RULES[option]}"
    if option in ("-p", "--param"):
        return _of_launch(rule)
    if left.rpartition(":")[2] == "__ns" and not right.startswith("/"):
        return f"a namespace begins with '/': write {option} {left}:=/{right[:_LONGEST]} in the place of {given}"
    return ""


def _fault_of_file(path: str) -> str:
    if not Path(path).is_file():
        return f"--params-file {path}: there is no such file"
    name, line = _outside(_tree(path))
    if not name:
        return ""
    return (
        f"--params-file {path}, line {line}: {name[:_LONGEST]!r} has to stand below {_PARAMETERS}, "
        "and that below the name of the node: see config/estimator.yaml"
    )


def _tree(path: str) -> Any:
    """Return the nodes of a YAML file; None where it is empty, or broken: ROS says where."""
    import yaml

    try:
        return yaml.compose(Path(path).read_text("utf-8"), Loader=yaml.SafeLoader)
    except (OSError, ValueError, yaml.YAMLError):
        return None


def _pairs(tree: Any) -> list[tuple[Any, Any]]:
    return tree.value if getattr(tree, "id", "") == "mapping" else []


def _outside(tree: Any) -> tuple[str, int]:
    """Return name and line of the first value that is below no `ros__parameters`; ("", 0) where there is none."""
    for key, value in _pairs(tree):
        if key.value == _PARAMETERS:
            continue
        found = _outside(value) if value.id == "mapping" else (str(key.value), key.start_mark.line + 1)
        if found[0]:
            return found
    return "", 0


def node_names(path: str) -> list[str]:
    """Return the names of nodes, with wildcards, for which a parameter file holds something."""
    return list(_names(_tree(path), ""))


def _names(tree: Any, above: str) -> Iterator[str]:
    for key, value in _pairs(tree):
        if key.value == _PARAMETERS:
            yield above
        else:
            yield from _names(value, f"{above}/{str(key.value).strip('/')}")


def is_meant(pattern: str, node: str) -> bool:
    """Return whether a name of a parameter file is that of a node: `*` is any one part of a name, `**` any number."""
    parts = re.escape(pattern).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
    return re.fullmatch(parts, node) is not None
