"""The commands that everybody starts with: what `make` would run, read off its dry run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
FROM_MAKE = re.compile("AMENT_PREFIX_PATH|FASTRTPS_|ROS_|NUMBA_|MAKE|MFLAGS")


def _make(repository: Path, *arguments: str, **variables: str) -> str:
    env = {k: v for k, v in os.environ.items() if not FROM_MAKE.match(k)} | variables
    command = ["make", "--no-print-directory", "-C", str(repository), *arguments]
    result = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60)
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize("target", ["demo", "test", "check", "bench", "fuzz", "soak"])
def test_each_target_installs_first(repository: Path, tmp_path: Path, target: str) -> None:
    plan = _make(repository, "--dry-run", target, f"VENV={tmp_path}/fresh")
    before, _, after = plan.rpartition(f"touch {tmp_path}/fresh/.installed")
    assert "-m venv" in before
    assert "--constraint constraints.txt --editable '.[all]'" in before
    assert f"{tmp_path}/fresh/bin/" in after


def test_a_second_run_does_not_install(repository: Path, tmp_path: Path) -> None:
    stamp = tmp_path / ".installed"
    stamp.touch()
    assert "pip" not in _make(repository, "--dry-run", "demo", f"VENV={tmp_path}")


def test_a_change_of_the_pins_installs_again(repository: Path, tmp_path: Path) -> None:
    stamp = tmp_path / ".installed"
    stamp.touch()
    assert "pip" in _make(repository, "--dry-run", "demo", f"VENV={tmp_path}", "--what-if=constraints.txt")


@pytest.mark.parametrize("platform", ["Darwin-arm64", "Linux-aarch64"])
def test_where_no_ros_wheel_exists_the_rest_is_installed(repository: Path, tmp_path: Path, platform: str) -> None:
    plan = _make(repository, "--dry-run", "install", f"VENV={tmp_path}/fresh", f"PLATFORM={platform}")
    assert "--editable '.[offline]'" in plan
    assert f'[ offline = all ] || echo "No ROS wheels exist for {platform}' in plan


def test_demo_takes_an_input(repository: Path, tmp_path: Path) -> None:
    (tmp_path / ".installed").touch()
    plan = _make(repository, "--dry-run", "demo", f"VENV={tmp_path}", "INPUT=../shared/data/corridor")
    assert plan.strip() == f"{tmp_path}/bin/room-layout demo --input '../shared/data/corridor'"


def test_demo_takes_any_option(repository: Path, tmp_path: Path) -> None:
    (tmp_path / ".installed").touch()
    options = "--color-topic /left/image --frames 9"
    plan = _make(repository, "--dry-run", "demo", f"VENV={tmp_path}", "INPUT=bag", f"ARGS={options}")
    assert plan.strip() == f"{tmp_path}/bin/room-layout demo --input 'bag' {options}"


@pytest.mark.parametrize("version", ["3.10.13", "3.12.1"])
def test_oldest_refuses_a_python_that_its_pins_are_not_for(repository: Path, tmp_path: Path, version: str) -> None:
    """One sentence before anything is installed; the check is run, with the version it would see."""
    plan = _make(repository, "--dry-run", "oldest", "--what-if=setup.py")
    check = re.search(r"-c '(import sys; sys\.exit\(.*?\))'", plan, re.DOTALL)
    assert check is not None
    seen = f"import sys; sys.version_info = {tuple(map(int, version.split('.')))}; sys.version = '{version}'"
    code = seen + "\n" + check[1].replace("\\\n", "")
    refused = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert refused.returncode == 1
    assert f"Python is {version}; the pins of constraints-oldest.txt are for 3.11" in refused.stderr


def test_ci_runs_make_test_alone(repository: Path) -> None:
    script = repository / ".ci" / "run"
    assert os.access(script, os.X_OK)
    lines = [line for line in script.read_text("utf-8").splitlines() if line and not line.startswith("#")]
    assert lines[-1] == "exec make test"


def test_the_tests_come_after_the_browser(repository: Path, tmp_path: Path) -> None:
    (tmp_path / ".installed").touch()
    plan = _make(repository, "--dry-run", "test", f"VENV={tmp_path}")
    assert 0 < plan.index("apt-get") < plan.index("-m pytest")


def _make_browser(repository: Path, machine: Path, **programs: str) -> str:
    """Run `make browser` on a machine that has these programs (name and script) and the few that the recipe needs."""
    machine.mkdir()
    for needed in ("make", "mktemp", "rm", "tail", "timeout", "env", "cksum", "cut", "uname"):
        (machine / needed).symlink_to(str(shutil.which(needed)))
    for name, script in programs.items():
        (machine / name.replace("_", "-")).write_text(f"#!/bin/bash\n{script}\n", "utf-8")
        (machine / name.replace("_", "-")).chmod(0o755)
    return _make(repository, "browser", PATH=str(machine))


def test_root_gets_a_browser_once(repository: Path, tmp_path: Path) -> None:
    calls = tmp_path / "calls"
    apt = f'echo "$DEBIAN_FRONTEND $*" >> {calls}; [[ $* != *update ]]'  # a list that cannot be had is no reason to end
    told = _make_browser(repository, tmp_path / "bare", id="echo 0", apt_get=apt)
    assert told.startswith("Installing chromium by apt-get")
    assert len(told.splitlines()) == 1
    done = calls.read_text("utf-8").splitlines()
    assert [call.rpartition(" ")[2] for call in done] == ["update", "chromium", "chromium"]
    assert all(call.startswith("noninteractive -qq -y --no-install-recommends ") for call in done)
    assert ["--download-only" in call for call in done] == [False, True, False]


@pytest.mark.parametrize("there", [{"chromium": ""}, {"google_chrome": ""}, {"id": "echo 1000"}, {"apt_get": ""}])
def test_nothing_is_installed_where_a_browser_is_or_none_can_be(
    repository: Path, tmp_path: Path, there: dict[str, str]
) -> None:
    """With a browser, as another user than root, and without apt-get, nothing is called and nothing said."""
    machine = {"id": "echo 0", "apt_get": f"touch {tmp_path}/called", **there}
    if there == {"apt_get": ""}:
        del machine["apt_get"]
    assert _make_browser(repository, tmp_path / "machine", **machine) == ""
    assert not (tmp_path / "called").exists()


@pytest.mark.parametrize(
    ("apt", "reason"),
    [
        ("echo 'E: Unable to locate package chromium' >&2; exit 100", "E: Unable to locate package chromium"),
        ("exit 124", "not fetched in 3 minutes"),
    ],
)
def test_without_a_browser_the_tests_go_on_and_the_reason_is_said(
    repository: Path, tmp_path: Path, apt: str, reason: str
) -> None:
    told = _make_browser(repository, tmp_path / "machine", id="echo 0", apt_get=apt).splitlines()
    assert told[1:] == [f"chromium could not be installed, the test of the dashboard's page is skipped: {reason}"]


def test_processes_get_one_environment(repository: Path, tmp_path: Path) -> None:
    (tmp_path / ".installed").touch()
    print_env = "--eval=print-env: ; @env"
    lines = _make(repository, print_env, f"VENV={tmp_path}", "print-env").splitlines()
    env = dict(line.split("=", 1) for line in lines if "=" in line)
    assert env["AMENT_PREFIX_PATH"] == str(tmp_path)
    assert env["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(repository / "config" / "fastdds.xml")
    assert 1 <= int(env["ROS_DOMAIN_ID"]) <= 100
    assert env["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert not {"PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH"} & env.keys()
