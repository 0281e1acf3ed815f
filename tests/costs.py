"""Cost of a run of tests in its last line: wall time, CPU seconds, kernels compiled and kernels found in the cache."""

import os
import time
from collections import Counter
from collections.abc import Collection, Iterable
from contextlib import suppress
from typing import Any

import pytest
import warp as wp
from warp._src.context import Module

STARTED = time.time()
compiled_or_found: Counter[bool] = Counter()
"""Modules of kernels that this process has compiled (True) or found in the cache (False)"""
of_workers: list[Counter[bool]] = []
_compile = Module._compile


def _counted(module: Module, *arguments: Any, **named: Any) -> bool:
    compiled_or_found[compiled := _compile(module, *arguments, **named)] += 1
    return compiled


def nightly_but(usual: Collection[str], names: Iterable[str]) -> list[Any]:
    """Return parameters, of which only the usual ones run in CI."""
    return [name if name in usual else pytest.param(name, marks=pytest.mark.nightly) for name in names]


def pytest_configure(config: pytest.Config) -> None:
    Module._compile = _counted


def pytest_sessionfinish(session: pytest.Session) -> None:
    if hasattr(session.config, "workeroutput"):  # a process of xdist
        session.config.workeroutput |= {"modules": dict(compiled_or_found), "cache": wp.config.kernel_cache_dir}


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    told = getattr(node, "workeroutput", {})
    of_workers.append(Counter(told.get("modules", {})))
    wp.config.kernel_cache_dir = told.get("cache") or wp.config.kernel_cache_dir


def pytest_unconfigure(config: pytest.Config) -> None:
    """Print the costs, once pytest has printed its last line and the processes that tested have ended."""
    Module._compile = _compile
    if hasattr(config, "workerinput") or config.option.collectonly:
        return
    mine = sum(of_workers, compiled_or_found)
    own = os.times()
    cpu = own.user + own.system + own.children_user + own.children_system
    print(
        f"{time.time() - STARTED:.0f} s, {cpu:.0f} CPU seconds, {_added_to_cache()} modules of kernels compiled, "
        f"{mine[False]} found in the cache"
    )


def _added_to_cache() -> int:
    """Return how many modules the cache has that were compiled since the start, by this process or any that tests
    started."""
    if not wp.config.kernel_cache_dir:
        return 0  # nothing was simulated
    made = 0
    for module in os.scandir(wp.config.kernel_cache_dir):
        with suppress(FileNotFoundError, NotADirectoryError):  # another process may be done with a folder of its own
            binaries = [each for each in os.scandir(module) if each.name.endswith((".o", ".cubin", ".ptx"))]
            made += sum(each.stat().st_mtime >= STARTED for each in binaries)
    return made
