"""Compiled kernels on disk that no longer fit their sources are deleted.

Numba keeps a compiled kernel for as long as the file with its source stays as it is. The kernels of other files that it
calls are compiled into it, and a change of those goes unnoticed: after a `git pull` the old code would go on running.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

STAMPS = "kernels.json"
"""In the `__pycache__` of the package: what each file's compiled kernels were made of."""

_IMPORT = re.compile(r"^from (\.+)([\w.]*) import (?:\(([^)]*)\)|(.*))", re.MULTILINE)


def drop_stale_kernels(package: Path) -> list[Path]:
    """Delete the compiled kernels of each file of which the source, or one that it imports, is another now.

    Parameters
    ----------
    package : Path
        Folder of Python files with kernels, searched with its sub-folders.

    Returns
    -------
    list of Path
        The source files whose kernels are gone; empty where nothing changed or the folder cannot be written (Numba
        keeps its files elsewhere then, under the name and time of each source).
    """
    now, kept = _stamps(package), package / "__pycache__" / STAMPS
    before = _read(kept)
    if now == before:
        return []
    changed = [package / name for name, stamp in now.items() if before.get(name) != stamp]
    try:
        for source in changed:
            for compiled in source.parent.glob(f"__pycache__/{source.stem}.*.nb[ic]"):
                compiled.unlink(missing_ok=True)
        kept.parent.mkdir(exist_ok=True)
        unfinished = kept.with_suffix(".new")
        unfinished.write_text(json.dumps(now), "utf-8")
        unfinished.replace(kept)
    except OSError:
        return []
    return changed


def is_compiled(kernel: Any) -> bool:
    """Whether Numba has a kernel compiled for this Python on disk; so too where it compiles nothing at all."""
    if not hasattr(kernel, "stats"):
        return True
    folder, source = kernel.stats.cache_path, Path(kernel.py_func.__code__.co_filename)
    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    return folder is not None and any(Path(folder).glob(f"{source.stem}.{kernel.py_func.__name__}-*.{python}*.nbi"))


def _stamps(package: Path) -> dict[str, str]:
    """Hash of each file with kernels and of all files that it imports, directly or not: their constants count too."""
    texts = {path: path.read_bytes() for path in sorted(package.rglob("*.py"))}
    imports = {path: _imported(path, text.decode()) & texts.keys() for path, text in texts.items()}
    own = {path: hashlib.sha256(text).hexdigest() for path, text in texts.items()}
    stamps = {}
    for path in (path for path, text in texts.items() if b"@njit" in text):
        needed, left = {path}, [path]
        while left:
            new = imports[left.pop()] - needed
            needed |= new
            left += new
        whole = hashlib.sha256("".join(own[one] for one in sorted(needed)).encode())
        stamps[path.relative_to(package).as_posix()] = whole.hexdigest()
    return stamps


def _imported(path: Path, text: str) -> set[Path]:
    """Return the files that relative imports may read: `from .module import name`, where a name may be a module too."""
    found = set()
    for dots, module, in_brackets, in_line in _IMPORT.findall(text):
        folder = path.parents[len(dots) - 1].joinpath(*module.split(".")) if module else path.parents[len(dots) - 1]
        found |= {folder.with_suffix(".py"), folder / "__init__.py"}
        found |= {folder / f"{name.split()[0]}.py" for name in (in_brackets + in_line).split(",") if name.strip()}
    return found


def _read(kept: Path) -> Mapping[str, str]:
    try:
        stamps = json.loads(kept.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return stamps if isinstance(stamps, dict) else {}
