"""Python processes that tests start, listen to and end."""

from __future__ import annotations

import json
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


_MANY = """
import json, os, signal, sys, tempfile
from room_layout_ros import estimator_node, node
for line in sys.stdin:
    words, variables = json.loads(line)
    with tempfile.TemporaryFile() as output:
        child = os.fork()
        if not child:
            code = 1
            try:
                signal.alarm(30)
                os.dup2(output.fileno(), 1)
                os.dup2(output.fileno(), 2)
                os.environ.update(variables)
                sys.argv[1:] = words
                code = node.main()
            except SystemExit as end:
                code = end.code
            except BaseException:
                sys.excepthook(*sys.exc_info())
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        output.seek(0)
        print(json.dumps([code, output.read().decode()]), flush=True)
"""


class ManyNodes:
    """Nodes that end by themselves, each a process of its own: a fork of one that has loaded all, but not joined ROS.

    Loading is what a start takes, 1.4 s of CPU time each. One that has not ended after 30 s is killed.
    """

    def __init__(self, repository: Path) -> None:
        self._loaded = subprocess.Popen(
            [sys.executable, "-c", _MANY],
            env=environment(repository),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=repository,
        )

    def run(self, *words: str, **variables: str) -> tuple[int, str]:
        """Run a node with these arguments and environment variables besides; return its exit code and its words."""
        assert self._loaded.stdin is not None
        assert self._loaded.stdout is not None
        self._loaded.stdin.write(json.dumps([words, variables]) + "\n")
        self._loaded.stdin.flush()
        code, said = json.loads(self._loaded.stdout.readline())
        return int(code), str(said)

    def close(self) -> None:
        self._loaded.communicate(timeout=10)


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
