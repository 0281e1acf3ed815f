"""Kernel precompiler for the page, in a process of its own: a thread would hold Python's lock.

It reports which are done, one kind of scene after the other. Until then a command that needs them waits, and time goes
on.
"""

import contextlib
import functools
import hashlib
import json
import os
import pickle
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.run.provenance import describe_simulation
from balloon_warp.scene import Scene
from balloon_warp.studio.page.playground import REASON, Kinds, Playground, kinds_of
from balloon_warp.system.warp_setup import quiet_warp

NICENESS = 15
"""Niceness of the process: the simulation and the browser come first"""
BURST = 1e9
"""Factor on the inflation under which every skin gives way"""


class KernelPrecompiler:
    """The process that fills Warp's kernel cache, from which the page's own then loads: one at a time, of one scene."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._waiter: threading.Thread | None = None
        self._done: set[Kinds] = set()

    @property
    def busy(self) -> bool:
        """Return whether the process is compiling."""
        return self._process is not None and self._process.poll() is None

    def has(self, kinds: Kinds) -> bool:
        """Return whether nothing is gained by waiting for the kernels of a scene with such things in it."""
        return not self.busy or kinds in self._done

    def begin(
        self, scene: Scene, device: str, laws: Sequence[Law] = (), on_done: Callable[[], None] = lambda: None
    ) -> None:
        """Compile the kernels that playing with a scene takes, and stop compiling those of another scene.

        Nothing is done where all was compiled before, or where only this process knows the laws.

        Args:
            on_done: called, by another thread, whenever `has` may return more.
        """
        self.end()
        task = _task(scene, device, laws)
        if task is None or _mark(scene, device, laws).exists():
            return
        found = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        found["WARP_CACHE_PATH"] = str(_kernels().parent)  # Warp appends its version
        command, pipe = [sys.executable, "-m", __name__], subprocess.PIPE
        try:
            process = subprocess.Popen(
                command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=found, start_new_session=True
            )
        except OSError:  # no room for a process: it is compiled when it is asked for
            return
        self._process, self._done = process, set()
        arguments = (process, task, self._done, on_done)
        self._waiter = threading.Thread(target=_tell_and_hear, args=arguments, name="ahead", daemon=True)
        self._waiter.start()

    def end(self) -> None:
        """Compile nothing any more."""
        if self._process and self._waiter:
            self._process.kill()
            self._waiter.join()
        self._process = self._waiter = None


def _kernels() -> Path:
    """Return the folder of Warp's kernel cache."""
    return Path(str(wp.config.kernel_cache_dir))


def _task(scene: Scene, device: str, laws: Sequence[Law]) -> bytes | None:
    """Return the task for the process, or None where it would not know the laws."""
    if any(law.force.func.__module__ == "__main__" for law in laws):
        return None
    try:
        return pickle.dumps((scene, device, tuple(laws), wp.config.optimization_level))
    except (pickle.PicklingError, AttributeError, TypeError):
        return None


def _mark(scene: Scene, device: str, laws: Sequence[Law]) -> Path:
    """Return the path of a file that marks, beside Warp's kernel cache, that a scene's kernels are complete."""
    what = json.dumps(
        [device, wp.config.optimization_level, describe_simulation(scene, laws, 0)], sort_keys=True, default=str
    )
    return _kernels() / f"balloon_warp_ahead_{hashlib.sha256(what.encode()).hexdigest()[:16]}"


def _tell_and_hear(
    process: "subprocess.Popen[bytes]", task: bytes, done: set[Kinds], on_done: Callable[[], None]
) -> None:
    """Send the task to the process, and note its progress.

    The pipe stays open as long as this process lives, which tells the other that it does.
    """
    assert process.stdin
    assert process.stdout
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(len(task).to_bytes(8, "little") + task)
        process.stdin.flush()
    for line in process.stdout:
        done.add(frozenset(json.loads(line)))
        on_done()
    process.wait()
    on_done()
    _tidy(process.pid)
    process.stdout.close()
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()


def _tidy(process: int) -> None:
    """Delete the unfinished kernels of a process that was ended."""
    for begun in _kernels().glob(f"*_p{process}_*"):
        shutil.rmtree(begun, ignore_errors=True)


def precompile_actions(playground: Playground, on_done: Callable[[Kinds], None] = lambda kinds: None) -> None:
    """Run common actions, a frame each, so that their kernels are compiled: the likeliest first.

    Args:
        on_done: called with the kinds of things whose kernels are there, and with `REASON` beside them after a burst.
    """

    def inflate() -> None:
        playground.inflate(1.01 * playground.inflation)

    def throw() -> None:
        above = playground.points.mean(axis=0) + 2.0 * playground.size * np.array(playground.live.up)
        playground.throw(above, np.zeros(3), 0.1 * playground.size, 1.0)

    def pull() -> None:
        playground.grab("hand", 0, playground.points[0] + 0.1 * playground.size)

    def blow() -> None:
        playground.blow([1.0, 0.0, 0.0])

    def burst() -> None:
        playground.keep_stable = False
        playground.inflate(BURST * max(playground.inflation, 1.0))

    def see_forces() -> None:
        playground.simulator.read_frame(net_forces=True)

    cut = playground.cut_all
    acts: list[list[Callable[[], None]]] = [
        *([inflate], [throw], [burst], [pull], [throw, burst], [throw, pull], [cut], [cut, burst], [cut, throw]),
        *([cut, throw, burst], [pull, burst], [throw, pull, burst], [blow], [blow, burst], [blow, throw]),
        *([blow, pull], [blow, throw, pull], [cut, blow], [cut, pull], [inflate, see_forces]),
    ]
    for some in acts:
        playground.reset()
        playground.keep_stable = True
        for act in some:
            with contextlib.suppress(InputError):
                act()
                if find_reason := playground.step():
                    find_reason()
                    on_done(kinds_of(playground.live) | REASON)
        on_done(kinds_of(playground.live))


def _tell(page: TextIO, kinds: Kinds) -> None:
    """Report progress to the page."""
    print(json.dumps(sorted(kinds)), file=page, flush=True)


def _end_with_the_page() -> None:
    """End when the pipe is closed, however the page's process ended."""
    sys.stdin.buffer.read(1)
    _tidy(os.getpid())
    os._exit(0)


def main() -> None:
    """Read a task from standard input, and do it, as long as that stays open."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    quiet_warp()
    length = int.from_bytes(sys.stdin.buffer.read(8), "little")
    task = sys.stdin.buffer.read(length)
    threading.Thread(target=_end_with_the_page, daemon=True).start()
    scene, device, laws, wp.config.optimization_level = pickle.loads(task)
    page = sys.stdout
    with contextlib.redirect_stdout(sys.stderr):  # of others, who would be taken for what is done
        precompile_actions(Playground(scene, device, laws), functools.partial(_tell, page))
    _mark(scene, device, laws).touch()


if __name__ == "__main__":
    main()
