"""Pages of one process: their simulations run side by side, and errors are reported."""

import time
from pathlib import Path

from meshes import quad_sphere

from balloon_warp.scene import Balloon, Scene
from balloon_warp.simulator import Simulator
from balloon_warp.viewer.playground import Playground
from balloon_warp.viewer.session import Session

SCENE = Scene(balloon=[Balloon(mesh=quad_sphere(2))], frames=8)


def wait_for(frame: int, *sessions: Session) -> None:
    """Wait until all sessions have reached a frame, a minute at most."""
    until = time.perf_counter() + 60.0
    while min(session.playground.frame for session in sessions) < frame and time.perf_counter() < until:
        time.sleep(0.01)


def test_sessions_and_a_simulator_step_beside_each_other(tmp_path: Path):
    alone = [frame.points[0].tobytes() for frame in Simulator(SCENE, "cpu").run()]
    sessions = [Session(name, SCENE, "cpu", tmp_path) for name in ("one", "other")]
    for session in sessions:
        session.watched = True
        session.start()
    assert [frame.points[0].tobytes() for frame in Simulator(SCENE, "cpu").run()] == alone
    wait_for(5, *sessions)
    for session in sessions:
        session.stop()
    assert all(session.playground.frame >= 5 and not session.trouble for session in sessions)


def test_a_simulation_that_fails_says_so_and_can_begin_anew(monkeypatch, capfd, tmp_path: Path):
    step = Playground.step

    def failing_step(playground: Playground) -> None:
        raise RuntimeError("no such device any more")

    monkeypatch.setattr(Playground, "step", failing_step)
    session = Session("one", SCENE, "cpu", tmp_path)
    session.watched = True
    session.start()
    until = time.perf_counter() + 60.0
    while not session.picture.trouble and time.perf_counter() < until:
        time.sleep(0.01)
    assert session.picture.trouble == "The simulation failed; the terminal has the error. Reset restarts it."
    assert not session.picture.running
    monkeypatch.setattr(Playground, "step", step)
    session.reset()
    wait_for(3, session)
    session.stop()
    assert session.playground.frame >= 3
    assert not session.trouble
    assert capfd.readouterr().err.count("RuntimeError: no such device any more") == 1
