"""The benchmark's peer simulates the same balloons, and its cases are what they say."""

import numpy as np
import pytest
from meshes import quad_sphere as looped_quad_sphere

from balloon_warp.benchmarks.cases import CPU_CASES, GPU_CASES, Case
from balloon_warp.benchmarks.measure import FRAMES, REPEATS, seconds_a_frame
from balloon_warp.benchmarks.quad_sphere import quad_sphere
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.model import build_model, initial_state
from balloon_warp.schedules import SCHEDULES, make_schedule


def test_the_mesh_is_the_quad_sphere_of_the_other_tests():
    found, expected = quad_sphere(4, 0.5), looped_quad_sphere(4, 0.5)
    assert found.vertex_count == expected.vertex_count == 6 * 16 + 2
    assert found.face_count == expected.face_count == 6 * 16
    np.testing.assert_allclose(np.sort(found.points, axis=0), np.sort(expected.points, axis=0), atol=1e-12)
    np.testing.assert_allclose(signed_volume(found), signed_volume(expected), rtol=1e-12)  # winds outward


@pytest.mark.parametrize("case", {case.cells: case for case in CPU_CASES + GPU_CASES if case.cells < 100}.values())
def test_the_cases_can_be_built(case):
    model = build_model(case.scene(), "cpu")
    assert model.particle_count == 6 * case.cells**2 + 2
    assert all(case.schedule in SCHEDULES for case in CPU_CASES + GPU_CASES)


def test_every_frame_that_is_timed_is_simulated():
    """The warm-up, its repeat, and the repeats that count; recorded frames are replayed, not only recorded."""
    model = build_model(Case("", "gather", 1, cells=2).scene(), "cpu")
    state = initial_state(model)
    assert seconds_a_frame(make_schedule(model, "gather"), model, state) > 0.0
    assert state.frame.numpy()[0] == 1 + FRAMES * (1 + REPEATS)


@pytest.mark.parametrize("normals", ["cached", "fresh"])
def test_newton_gives_the_same_trajectory(normals, device):
    """Over three frames, but for float32: springs, damping, gravity, inflation and the integrator are the same."""
    pytest.importorskip("newton")
    from balloon_warp.benchmarks.newton_peer import NewtonPeer

    model = build_model(Case("", "scatter", 2, cells=4, normals=normals).scene(), device, 2)
    state, unused = initial_state(model), initial_state(model)
    scatter, peer = make_schedule(model, "scatter"), NewtonPeer(model)
    start = state.points.numpy().copy()
    for _ in range(3):
        scatter.advance_frame(state)
        unused.frame.assign(state.frame.numpy() - 1)
        peer.advance_frame(unused)
    assert np.abs(state.points.numpy() - start).max() > 1e-2
    np.testing.assert_allclose(peer.points.numpy(), state.points.numpy(), rtol=0, atol=2e-5)
