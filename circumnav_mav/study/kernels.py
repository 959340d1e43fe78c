"""Compiles kernels with numba, each after the kernels it calls; hands them back as they are when numba is absent.

A kernel finds the others as globals of its module. So a compiled kernel is the same code with its globals replaced by
their compiled twins, and no list of kernels in dependency order has to be kept by hand.
Compiled code is kept on disk under a key made from the source of the guidance package and of the study's modules that
the kernels stand in: numba's own cache looks at one file only and would run an old callee after an edit. What older
sources left is cleared away, but for the last few.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import os
import shutil
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import circumnav_mav

numba: Any = None  # without it the study runs twenty times slower
with contextlib.suppress(ImportError):
    import numba

PACKAGE = Path(circumnav_mav.__file__).parent

KEPT = 8
"""Folders of compiled code that stay: one for each state of the sources and each of the study's drivers."""


def available() -> bool:
    """Return whether kernels are compiled."""
    return numba is not None


def compiled(
    kernel: Callable[..., Any], bound: Mapping[str, Callable[..., Any]] | None = None, *, side_by_side: bool = False
) -> Callable[..., Any]:
    """Return the kernel compiled with all it calls; `bound` gives it other functions for some of its globals.

    So one driver, written with global names such as LAW, becomes one machine-code program a law and estimator.
    side_by_side: for loops over many trajectories at once. What the kernel calls is put into it, division is that of C
    and a product may be fused with a sum; without these the loops do not vectorise.
    """
    bound = bound or {}
    if numba is None:
        return _twin(kernel, bound)
    names = "+".join(sorted(f"{f.__module__}.{f.__qualname__}" for f in bound.values())) + f" {side_by_side}"
    directory = _folder(_digest(_files(kernel, bound))) / hashlib.sha256(names.encode()).hexdigest()[:16]
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(directory)
    try:
        return _compile(kernel, bound, {}, SIDE_BY_SIDE if side_by_side else ONE_BY_ONE)
    finally:
        numba.config.CACHE_DIR = before


ONE_BY_ONE: Mapping[str, Any] = {"error_model": "python"}
SIDE_BY_SIDE: Mapping[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}


def _compile(
    kernel: Callable[..., Any], bound: Mapping[str, Any], done: dict[Any, Any], flags: Mapping[str, Any]
) -> Callable[..., Any]:
    if kernel not in done:
        inner = {**flags, "forceinline": True} if flags is SIDE_BY_SIDE else flags
        callees = {name: _compile(f, {}, done, inner) for name, f in _callees(kernel)}
        callees.update({name: _compile(f, {}, done, inner) for name, f in bound.items()})
        done[kernel] = numba.njit(_twin(kernel, callees), nogil=True, cache=True, **flags)
    twin: Callable[..., Any] = done[kernel]
    return twin


def _callees(kernel: Callable[..., Any]) -> Iterator[tuple[str, types.FunctionType]]:
    for name in kernel.__code__.co_names:
        value = kernel.__globals__.get(name)
        if isinstance(value, types.FunctionType) and value.__module__.startswith("circumnav_mav."):
            yield name, value


def _twin(kernel: Callable[..., Any], replaced: Mapping[str, Any]) -> Callable[..., Any]:
    """Return the same function seeing other globals."""
    twin = types.FunctionType(
        kernel.__code__, {**kernel.__globals__, **replaced}, kernel.__name__, kernel.__defaults__, kernel.__closure__
    )
    twin.__qualname__ = kernel.__qualname__
    return twin


def _files(kernel: Callable[..., Any], bound: Mapping[str, Callable[..., Any]]) -> frozenset[Path]:
    """Return the study's source files that the kernel and all it calls stand in."""
    seen: set[Any] = set()
    ahead = [kernel, *bound.values()]
    while ahead:
        one = ahead.pop()
        if one not in seen:
            seen.add(one)
            ahead += [callee for _, callee in _callees(one)]
    files = {Path(inspect.getfile(one)) for one in seen}
    return frozenset(file for file in files if file.parent == PACKAGE / "study")


@functools.cache
def _digest(files: frozenset[Path]) -> str:
    """Return a key of the sources as first seen: an edit must not change the key of a running process."""
    digest = hashlib.sha256()
    for path in sorted({*(PACKAGE / "guidance").rglob("*.py"), *files}):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _folder(key: str) -> Path:
    """Return the folder of a key, the newest one now; make it, and clear what is older than the last KEPT away."""
    folder = _home() / key
    if not folder.exists():
        folder.mkdir(parents=True, exist_ok=True)
        by_age = sorted(folder.parent.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
        for old in by_age[KEPT:]:
            shutil.rmtree(old, ignore_errors=True)
    os.utime(folder)
    return folder


def _home() -> Path:
    """Return where compiled code is kept: beside the sources, or in the user's cache where those cannot be written."""
    beside = PACKAGE / "study" / "__pycache__" / "kernels"
    if os.access(PACKAGE / "study", os.W_OK):
        return beside
    cache = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(cache).expanduser() / "circumnav_mav" / "kernels"
