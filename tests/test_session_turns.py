"""Two pages of one process: their simulations take turns on a device."""

import threading
import time
from pathlib import Path

import pytest
from meshes import quad_sphere

from balloon_warp.scene import Balloon, Scene
from balloon_warp.viewer.playground import Playground
from balloon_warp.viewer.session import Session


def test_no_session_uses_a_device_while_another_records_or_steps(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Warp records for all threads of a process at once on a CPU: what another launches meanwhile would be refused, or
    be part of the wrong graph. Each step is made long enough to meet the other's first, in which it is recorded."""
    inside: list[str] = []
    met: list[list[str]] = []
    step = Playground.step

    def slow_step(playground: Playground) -> None:
        inside.append(threading.current_thread().name)
        met.append(list(inside))
        time.sleep(0.01)
        step(playground)
        inside.pop()

    monkeypatch.setattr(Playground, "step", slow_step)
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(2))])
    sessions = [Session(name, scene, "cpu", tmp_path) for name in ("one", "other")]
    for session in sessions:
        session.watched = True
        session.start()
    until = time.perf_counter() + 60.0
    while min(session.playground.frame for session in sessions) < 5 and time.perf_counter() < until:
        time.sleep(0.01)
    for session in sessions:
        session.stop()
    assert all(session.playground.frame >= 5 and not session.trouble for session in sessions)
    assert max(map(len, met)) == 1
