"""Plugin of pytest: which functions of the source each test executes, on the host or in a kernel that it loads.

    pytest -p balloon_warp.benchmarks.traced_tests --traced-into FOLDER --traced-root ROOT

Each process writes a file of lines of JSON into the folder, a line a test that passes, see `Traced`.
"""

import json
import os
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from types import CodeType, FrameType
from typing import Any
from weakref import WeakKeyDictionary

import pytest
from warp._src import context

from balloon_warp.benchmarks.chosen_tests import processor_seconds


@dataclass(frozen=True)
class Traced:
    """A test that passes."""

    test: str
    """Its node id"""
    seconds: float
    """Of the processor, with the compilations that it was the first to need"""
    functions: dict[str, list[int]]
    """First lines of the functions that it executes, by their files, from the root of the tree"""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--traced-into", help="folder for what tests execute")
    parser.addoption("--traced-root", help="root of the tree whose functions count")


def pytest_configure(config: pytest.Config) -> None:
    tracer, load = Tracer(config.option.traced_into, config.option.traced_root), context.Module.load

    def load_and_note(self: context.Module, *args: Any, **options: Any) -> Any:
        loaded = load(self, *args, **options)
        tracer.loaded.add(self)
        return loaded

    setattr(context.Module, "load", load_and_note)  # noqa: B010 - each launch asks it, be it compiled or not
    config.pluginmanager.register(tracer)


class Tracer:
    """Note the code objects that a test enters, and the functions of the kernels that it loads."""

    def __init__(self, folder: str, root: str):
        self._file = Path(folder) / f"{os.getpid()}.jsonl"
        self._root = f"{Path(root).resolve()}{os.sep}"
        self._entered: dict[int, CodeType] = {}
        self.loaded: set[context.Module] = set()
        """Modules of the kernels that the test launches"""
        self._of_kernels: WeakKeyDictionary[Any, list[CodeType]] = WeakKeyDictionary()
        self._passed = False

    def _enter(self, frame: FrameType, event: str, argument: Any) -> None:
        self._entered[id(frame.f_code)] = frame.f_code

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Trace a test with its fixtures."""
        self._entered.clear()
        self.loaded.clear()
        self._passed = False
        begin = processor_seconds()
        threading.settrace(self._enter)
        sys.settrace(self._enter)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            threading.settrace(None)
            if self._passed:
                seconds = round(processor_seconds() - begin, 3)
                line = json.dumps(asdict(Traced(item.nodeid, seconds, self._functions())))
                with self._file.open("a") as file:
                    file.write(f"{line}\n")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note whether the test itself passes."""
        if report.when == "call":
            self._passed = report.passed

    def _functions(self) -> dict[str, list[int]]:
        found: defaultdict[str, set[int]] = defaultdict(set)
        for code in [*self._entered.values(), *self._in_kernels()]:
            if code.co_filename.startswith(self._root):
                found[Path(code.co_filename[len(self._root) :]).as_posix()].add(code.co_firstlineno)
        return {path: sorted(lines) for path, lines in found.items()}

    def _in_kernels(self) -> Iterator[CodeType]:
        for kernel in [kernel for module in self.loaded for kernel in module._live_kernels]:
            if kernel not in self._of_kernels:
                forms = list(kernel.overloads.values()) if kernel.is_generic else [kernel]
                self._of_kernels[kernel] = [code for form in forms for code in _functions_of(form.adj, set())]
            yield from self._of_kernels[kernel]


def _functions_of(adjoint: Any, seen: set[Any]) -> Iterator[CodeType]:
    """Find the code of a kernel, or of a function of Warp, and of all functions that it calls."""
    yield adjoint.func.__code__
    for function in adjoint.get_references()[2]:
        if function in seen or function.is_builtin():
            continue
        seen.add(function)
        for each in [*function.user_overloads.values(), *function.user_templates.values()]:
            yield from _functions_of(each.adj, seen)
