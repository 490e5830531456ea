"""Compiled kernels that no longer fit their sources are dropped, and only those."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from room_layout_ros.core.kernel_cache import STAMPS, drop_stale_kernels

CALLEE = """from numba import njit
from .numbers import STEP


@njit(cache=True)
def inner(x):
    return x + STEP
"""
CALLER = """from numba import njit
from .callee import inner


@njit(cache=True)
def outer(x):
    return 10 * inner(x)
"""
ALONE = """from numba import njit


@njit(cache=True)
def alone(x):
    return x
"""
INIT = """from pathlib import Path
from room_layout_ros.core.kernel_cache import drop_stale_kernels
drop_stale_kernels(Path(__file__).parent)
"""


def written(parent: Path) -> Path:
    """Write the package of kernels, which nobody has compiled."""
    folder = parent / "kernels"
    folder.mkdir()
    files = {"callee": CALLEE, "caller": CALLER, "alone": ALONE, "numbers": "STEP = 1\n", "__init__": INIT}
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    return folder


@pytest.fixture(scope="module")
def once_compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package whose kernels are kept, to be copied."""
    package = written(tmp_path_factory.mktemp("compiled"))
    assert outer_of_1(package) == 20
    return package


@pytest.fixture
def package(once_compiled: Path, tmp_path: Path) -> Path:
    """A package whose kernels are kept."""
    return shutil.copytree(once_compiled, tmp_path / "kernels")


def outer_of_1(package: Path) -> int:
    words = "from kernels.alone import alone; from kernels.caller import outer; print(outer(alone(1)))"
    path = os.pathsep.join([str(package.parent), str(Path(__file__).parents[1])])
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_DISABLE_JIT": "0"}
    done = subprocess.run([sys.executable, "-c", words], env=environment, capture_output=True, text=True, check=True)
    return int(done.stdout)


def compiled(package: Path) -> set[str]:
    return {file.name.partition(".")[0] for file in package.glob("__pycache__/*.nbi")}


def test_a_change_in_a_called_kernel_and_in_its_constant_reaches_the_caller(package: Path) -> None:
    (package / "callee.py").write_text(CALLEE.replace("x + STEP", "x + 2 * STEP"))
    assert outer_of_1(package) == 30
    (package / "numbers.py").write_text("STEP = 2\n")
    assert outer_of_1(package) == 50


def test_only_what_hangs_on_the_change_is_compiled_anew(package: Path) -> None:
    assert compiled(package) >= {"alone", "caller"}
    assert drop_stale_kernels(package) == []
    (package / "numbers.py").write_text("STEP = 3\n")
    assert drop_stale_kernels(package) == [package / "callee.py", package / "caller.py"]
    assert compiled(package) == {"alone"}


@pytest.mark.parametrize("line", ["from . import numbers as n", "from . import (\n    numbers as n,\n)"])
def test_a_module_that_is_imported_by_its_name_counts_too(package: Path, line: str) -> None:
    text = CALLEE.replace("from .numbers import STEP", line).replace("+ STEP", "+ n.STEP")
    (package / "callee.py").write_text(text)
    assert outer_of_1(package) == 20
    (package / "numbers.py").write_text("STEP = 4\n")
    assert outer_of_1(package) == 50


@pytest.mark.parametrize("text", ["", "[1]", "{"], ids=["empty", "a list", "cut off"])
def test_a_broken_stamp_file_means_all_anew(package: Path, text: str) -> None:
    (package / "__pycache__" / STAMPS).write_text(text)
    assert len(drop_stale_kernels(package)) == 3
    assert compiled(package) == set()
    assert outer_of_1(package) == 20


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_left_alone(tmp_path: Path) -> None:
    package = written(tmp_path)
    package.chmod(0o500)
    assert drop_stale_kernels(package) == []
    package.chmod(0o700)
