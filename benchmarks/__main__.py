"""Run benchmarks by name; without names, all that end within minutes.

Each is a module of this folder with `main() -> int`. One that lacks its data says so and is passed over.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import sys
from pathlib import Path

ONLY_BY_NAME = ("accuracy",)
"""These take longer."""


def main() -> int:
    names = sorted(m.name for m in pkgutil.iter_modules([str(Path(__file__).parent)]) if not m.name.startswith("_"))
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(names))
    wanted = parser.parse_args().names or [name for name in names if name not in ONLY_BY_NAME]
    for name in wanted:
        if name not in names:
            parser.error(f"there is no benchmark {name!r}; there are {', '.join(names)}")
    code = 0
    for name in wanted:
        module = importlib.import_module(f"benchmarks.{name}")
        if not hasattr(module, "main"):
            continue
        print(f"== {name}: {(module.__doc__ or '').splitlines()[0]}", flush=True)
        code = max(code, int(module.main() or 0))
        print(flush=True)
    return code


if __name__ == "__main__":
    sys.exit(main())
