"""Two linear solvers of the `projective` solver, and many worlds at once."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from projective_scenes import after_frames, full_scene

from balloon_warp.model import State, build_model
from balloon_warp.simulator import Simulator
from balloon_warp.solvers.dense_inverse import MANY_WORLDS, DenseInverse
from balloon_warp.solvers.projective import ProjectiveSolver
from balloon_warp.solvers.sparse_factor import SparseFactor
from balloon_warp.solvers.step_matrices import StepMatrices


@pytest.mark.full
@pytest.mark.parametrize("vary", [{}, {"balloon.0.mass": np.linspace(0.1, 0.3, 3)}])
def test_the_inverse_and_the_factor_give_the_same_trajectory(vary, device):
    """The dense inverse and the sparse factor, which is for the CPU, agree to float32's rounding."""
    states: list[State] = []
    for place, global_step in (("cpu", SparseFactor), (device, DenseInverse)):
        simulator = Simulator(full_scene(solver="projective"), place, 3, vary)
        simulator.schedule = ProjectiveSolver(simulator.model, global_step)
        for _ in range(3):
            simulator.step()
        states.append(simulator.state)
    assert np.abs(states[0].velocities.numpy()).max() > 0.1
    np.testing.assert_allclose(states[0].points.numpy(), states[1].points.numpy(), rtol=0, atol=1e-5)


def test_the_factor_refuses_a_gpu_which_it_would_compute_wrongly_on():
    on_a_gpu: Any = SimpleNamespace(device=SimpleNamespace(is_cpu=False))
    nothing: Any = None
    with pytest.raises(ValueError, match="SparseFactor runs on the CPU"):
        SparseFactor(on_a_gpu, nothing)


def test_the_inverse_solves_the_system_alike_for_one_world_and_for_many(device):
    """The inverse gives a world's solution bit-identically alone and among many, by threads with one row each or
    several rows of several worlds, for two balloons of 56 rows each."""
    many = MANY_WORLDS + 5
    right_sides = np.random.default_rng(3).normal(size=(many, 112, 3)).astype(np.float32)
    solutions = []
    for rows in (right_sides, right_sides[-1:]):
        model = build_model(full_scene(), device, len(rows))
        solution = wp.zeros(rows.shape[:2], dtype=wp.vec3, device=device)
        matrices = StepMatrices(model)
        going = wp.full(len(rows), 1, dtype=wp.int32, device=device)
        DenseInverse(model, matrices).solve(wp.array(rows, dtype=wp.vec3, device=device), solution, going)
        solutions.append(solution.numpy())
    np.testing.assert_array_equal(solutions[0][-1], solutions[1][0])
    back = np.einsum("pq,wqa->wpa", matrices.matrix(0).toarray(), solutions[0])
    np.testing.assert_allclose(back, right_sides, rtol=0, atol=1e-4)  # float32, times a condition of 100


VARIED = {
    "balloon.0.stiffness.structural": [20.0, 35.0, 0.0],
    "balloon.1.mass": [0.2, 0.3, 0.25],
    "balloon.0.damping": [0.1, 0.1, 0.4],
    "string.0.stiffness": [20.0, 25.0, 40.0],
    "gravity": [9.0, 10.0, 11.0],
}


def test_parameters_of_worlds_may_differ(device):
    """Worlds of other parameters are bit-identical to each alone."""
    scene = full_scene(solver="projective")
    batch = after_frames(scene, device, worlds=3, vary=VARIED).state.points.numpy()
    for world in range(3):
        own = {path: values[world : world + 1] for path, values in VARIED.items()}
        alone = after_frames(scene, device, vary=own).state.points.numpy()
        np.testing.assert_array_equal(batch[world], alone[0])
    assert (batch[0] != batch[1]).any()


def test_worlds_share_a_matrix_where_masses_and_spring_constants_are_alike():
    """A single factorization serves all worlds of equal masses and spring constants, or one for each of two kinds."""
    scene = full_scene(solver="projective")
    for vary, count in (({"gravity": [9.0, 10.0, 11.0, 12.0]}, 1), ({"balloon.0.mass": [0.1, 0.2, 0.1, 0.2]}, 2)):
        matrices = StepMatrices(Simulator(scene, "cpu", 4, vary).model)
        assert matrices.count == count
        assert matrices.of_world.tolist() == [world % count for world in range(4)]


def test_a_world_alone_is_the_same_world_in_a_batch(device):
    """A world alone is bit-identical to that in a batch, also in a batch that no eight divide."""
    scene = full_scene(solver="projective", normals="fresh", substeps=3)
    alone, batch = after_frames(scene, device), after_frames(scene, device, worlds=11)
    for name in ("points", "velocities", "sphere_positions", "sphere_forces"):
        found = getattr(batch.state, name).numpy()
        for world in (0, 7, 10):
            np.testing.assert_array_equal(found[world], getattr(alone.state, name).numpy()[0], err_msg=name)
