"""Benchmark of balloons in contact: the same balloons on both sides, and how deep they are in each other."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import warp as wp

from balloon_warp.benchmarks import crowd_rate
from balloon_warp.benchmarks.cases import CPU_CASES
from balloon_warp.benchmarks.crowd import CrowdCase
from balloon_warp.benchmarks.run import run_case
from balloon_warp.model import Model, State, build_model, initial_state
from balloon_warp.schedules import make_schedule

CASE = CrowdCase("", "newton", cells=4)
FRAMES = 20


def parts_of(points: np.ndarray, model: Model) -> list[np.ndarray]:
    return [points[begin:end].astype(np.float64) for begin, end in pairwise(model.particle_offsets)]


def widths(points: np.ndarray, model: Model) -> np.ndarray:
    """Return the mean distance of each balloon's particles from their middle, over the radius at the start."""
    parts = parts_of(points, model)
    return np.array([np.linalg.norm(part - part.mean(axis=0), axis=1).mean() for part in parts]) / CASE.radius


def check_motion(peer: Any, model: Model, frames: int) -> np.ndarray:
    """Return a peer's final points, and require that the same balloons get wider while fixed particles stay."""
    np.testing.assert_allclose(peer.points, model.initial_points.numpy(), atol=1e-6)
    held = model.particle_mass_share.numpy() == 0.0
    assert 8 <= held.sum() < model.particle_count // 4
    unused = initial_state(model)
    for _ in range(frames):
        peer.advance_frame(unused)
    points = np.asarray(peer.points)
    assert np.isfinite(points).all()
    np.testing.assert_allclose(points[held], model.initial_points.numpy()[held], atol=1e-5)
    return points


def test_the_balloons_are_apart_at_first_and_press_each_other_then():
    model = build_model(CASE.scene(), "cpu")
    state = initial_state(model)
    start = state.points.numpy()[0]
    assert crowd_rate._overlap(start, model) == 0.0
    schedule = make_schedule(model)
    for _ in range(FRAMES):
        schedule.advance_frame(state)
    ended = state.points.numpy()[0]
    assert (state.holds.numpy()[0, :, 3] != 0.0).sum() >= 24  # four pairs in each direction, two sides each
    assert 1.05 < widths(ended, model).min() < widths(ended, model).max() < 1.3
    assert crowd_rate._overlap(ended, model) < 0.02 * CASE.radius
    alone = build_model(CASE.scene().model_copy(update={"touch": False}), "cpu")
    free, passing = make_schedule(alone), initial_state(alone)
    for _ in range(FRAMES):
        free.advance_frame(passing)
    assert crowd_rate._overlap(passing.points.numpy()[0], alone) > 0.1 * CASE.radius  # else there is nothing to do


def test_newton_blows_them_up_alike():
    """Newton's balloons get as wide as ours, to a few percent, with the same springs and pressure though by implicit
    steps; and they do not interpenetrate."""
    pytest.importorskip("newton")
    from balloon_warp.benchmarks.newton_crowd import NewtonCrowd

    model = build_model(CASE.scene(), "cpu")
    points = check_motion(NewtonCrowd(model), model, FRAMES)
    assert crowd_rate._overlap(points, model) < 0.02 * CASE.radius
    state, schedule = initial_state(model), make_schedule(model)
    for _ in range(FRAMES):
        schedule.advance_frame(state)
    np.testing.assert_allclose(widths(points, model), widths(state.points.numpy()[0], model), rtol=0.05)


def test_blender_blows_them_up_alike():
    """Blender's balloons get a seventh wider, as ours, on the measured mesh, for which its pressure was chosen."""
    pytest.importorskip("bpy")
    from balloon_warp.benchmarks.blender_peer import BlenderPeer

    model = build_model(replace(CASE, cells=8).scene(), "cpu")
    points = check_motion(BlenderPeer(model, crowd_rate.BLENDER_PRESSURE), model, FRAMES)
    np.testing.assert_allclose(widths(points, model), 8 / 7, rtol=0.03)


class Mover:
    """Peer whose second balloon ends a tenth of its radius in the first."""

    def __init__(self, model: Model):
        self.model = model
        parts = parts_of(model.initial_points.numpy(), model)
        apart = parts[1].mean(axis=0) - parts[0].mean(axis=0)
        parts[1] = parts[1] - apart * (1.0 - 1.9 * CASE.radius / np.linalg.norm(apart))
        self.points = np.concatenate(parts)


def test_ratio_and_overlaps_are_of_the_same_run(monkeypatch):
    """Ratio and overlaps come from one run: all frames take the same time, ours half as long."""
    asked = []

    def seconds(contenders: list[Any], frames: int, states: list[State]) -> list[float]:
        asked.append((frames, len(contenders), len(states)))
        return [0.5, 1.0]

    monkeypatch.setattr(crowd_rate, "seconds_a_frame", seconds)
    monkeypatch.setattr(crowd_rate, "peers_of", lambda case, model: [Mover(model)])
    result = run_case(CASE, wp.get_device("cpu"))
    assert asked == [(CASE.frames, 2, 2)]
    assert (result.rate, result.peer, result.peer_rate, result.ratio) == (2 / 24, "newton", 1 / 24, 2.0)
    assert (result.worlds, result.particles, result.overlap) == (1, 8 * 98, 0.0)
    assert result.peer_overlap == pytest.approx(0.1, abs=0.02)  # a vertex of the mesh is not quite the deepest


def test_both_peers_are_cases_of_a_processor():
    crowds = [case for case in CPU_CASES if isinstance(case, CrowdCase)]
    assert [case.peer for case in crowds] == ["newton", "blender"]
    assert replace(crowds[0], peer="blender") == crowds[1]
    assert build_model(crowds[0].scene(), "cpu").particle_count == 8 * 386
