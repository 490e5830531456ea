#!/usr/bin/env python3
"""Write constraints.txt: the newest versions that fit setup.py, for Python 3.10 and for 3.11 and newer.

usage: .ci/pin.py python3.10 python3.11

numpy, SciPy and others have left Python 3.10; those lines appear twice, with a marker.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# colcon-core wants setuptools < 80. pip does not list what builds, so these stand here.
BUILD = {"pip": "26.3", "setuptools": "79.0.1", "wheel": "0.45.1"}


def resolve(interpreter: str) -> dict[str, str]:
    """Return name -> version of all that `pip install .[all]` takes with this interpreter, without installing it."""
    with tempfile.TemporaryDirectory() as folder:
        python = f"{folder}/venv/bin/python"
        report = Path(folder, "report.json")
        build = [f"{name}=={version}" for name, version in BUILD.items()]
        subprocess.run([interpreter, "-m", "venv", f"{folder}/venv"], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *build], check=True)
        subprocess.run(
            [python, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--no-build-isolation"]
            + ["--report", str(report), f"{ROOT}[all]", *build],
            check=True,
        )
        found = (item["metadata"] for item in json.loads(report.read_text("utf-8"))["install"])
        versions = {re.sub(r"[-_.]+", "-", m["name"]).lower(): m["version"] for m in found}
        del versions["room-layout-ros"]
        return versions


def main() -> None:
    """Resolve twice and write the file."""
    old, new = (resolve(interpreter) for interpreter in sys.argv[1:3])
    lines = ["# Exact versions of all that make installs. Written by .ci/pin.py; `make install` holds pip to them."]
    for name in sorted(old.keys() | new.keys()):
        if old.get(name) == new.get(name):
            lines.append(f"{name}=={new[name]}")
            continue
        lines += [f'{name}=={old[name]}; python_version < "3.11"'] if name in old else []
        lines += [f'{name}=={new[name]}; python_version >= "3.11"'] if name in new else []
    (ROOT / "constraints.txt").write_text("\n".join(lines) + "\n", "utf-8")


if __name__ == "__main__":
    main()
