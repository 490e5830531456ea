"""Python processes that tests start, listen to and end."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).resolve().parent


def environment(repository: Path) -> dict[str, str]:
    path = os.pathsep.join([str(repository), str(HERE)])
    return {
        **os.environ,
        "PYTHONPATH": path,
        "PYTHONUNBUFFERED": "1",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(repository / "config" / "fastdds.xml"),
    }


@contextmanager
def python(repository: Path, *arguments: str, **variables: str) -> Iterator[subprocess.Popen[str]]:
    """Start Python with environment variables besides; kill it at the end if it is still there."""
    process = subprocess.Popen(
        [sys.executable, *arguments],
        env={**environment(repository), **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=repository,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait(10)
        if process.stdout:
            process.stdout.close()


def read_until(process: subprocess.Popen[str], pattern: str) -> str:
    """Read lines until one matches. (The tests' own time limit is the node's: it says all this by itself.)"""
    assert process.stdout is not None
    seen = ""
    for line in process.stdout:
        seen += line
        if re.search(pattern, line):
            return seen
    raise AssertionError(f"ended without {pattern!r}: {seen}")


def rest(process: subprocess.Popen[str], seconds: float) -> str:
    return process.communicate(timeout=seconds)[0]


def slack() -> float:
    """Return how much slower this machine is than an idle one: other work must not fail a test."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
