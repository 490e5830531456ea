"""The command `room-layout`: one subcommand a file in room_layout_ros/commands."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from room_layout_ros import __version__

COMMANDS = {
    "demo": "render, play and watch a whole run: synthetic rooms, or your frames",
    "estimate": "estimate room layouts of a folder, bag or .mat, offline",
    "view": "look at a frame or a bag with everything that was estimated",
    "play": "publish a bag or a frames folder on ROS 2 topics",
    "convert": "make a bag of a frames folder and back",
    "render": "render a synthetic walk with exact truth",
    "fit": "fit layouts to labelled frames",
    "scene": "train the network that looks at the colour image",
    "train": "learn the weights of the model",
    "furniture": "learn furniture by kernel descriptors",
    "calibrate": "calibrate the confidences on frames with known layouts",
    "evaluate": "measure against ground truth",
    "bench": "measure the speed, on your frames or rendered ones",
    "dashboard": "a page that shows a live node or a bag",
}
"""Every subcommand and its line in the help; the module is room_layout_ros.commands.NAME and holds
`add_arguments(parser)` and `run(arguments) -> int`."""

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
TRACEBACK_VARIABLE = "ROOM_LAYOUT_TRACEBACK"
"""Set this in the environment to see where an error came from."""


class _Parser(argparse.ArgumentParser):
    """Argument errors in one sentence, exit code 2."""

    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_BAD_INPUT, f"{self.prog}: {message} (see {self.prog} --help)\n")


def _module_name(command: str) -> str:
    return f"room_layout_ros.commands.{command}"


def _top_parser() -> argparse.ArgumentParser:
    listing = "\n".join(f"  {name:<10} {text}" for name, text in COMMANDS.items())
    parser = _Parser(
        prog="room-layout",
        description="Room layout, clutter and free space from RGB-D frames.",
        epilog=f"commands:\n{listing}\n\n'room-layout COMMAND --help' tells more about each.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="room-layout [-h] [--version] COMMAND ...",
    )
    parser.add_argument("--version", action="version", version=f"room-layout {__version__}")
    parser.add_argument("command", metavar="COMMAND", choices=list(COMMANDS), help=argparse.SUPPRESS)
    parser.add_argument("rest", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `room-layout`; return its exit code (0 done, 2 bad input, 130 interrupted)."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if not words:
            _top_parser().print_help()
            return EXIT_BAD_INPUT
        parsed = _top_parser().parse_args(words)
        # Only the module of the wanted command is imported: the others may need extras that are not there.
        module = importlib.import_module(_module_name(parsed.command))
        parser = _Parser(
            prog=f"room-layout {parsed.command}",
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(parser)
        return int(module.run(parser.parse_args(parsed.rest)))
    except SystemExit as exit_:
        return exit_.code if isinstance(exit_.code, int) else 0
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone (| head): nothing to tell it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ValueError, OSError, ModuleNotFoundError) as error:
        ours = isinstance(error, ModuleNotFoundError) and (error.name or "").startswith("room_layout_ros")
        if ours or os.environ.get(TRACEBACK_VARIABLE):
            raise
        print(f"room-layout: {_sentence(error)}", file=sys.stderr)
        return EXIT_BAD_INPUT


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return " ".join(str(error).split())


if __name__ == "__main__":
    sys.exit(main())
