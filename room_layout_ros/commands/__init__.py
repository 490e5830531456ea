"""The subcommands of `room-layout`, one a file: `add_arguments(parser)` and `run(arguments) -> int`.

A new one is this file plus its line in `cli.COMMANDS`.
"""
