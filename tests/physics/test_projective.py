"""Projective solver against Newton's method and the explicit schedules, its two linear solvers, and many worlds."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from conserved import advanced, after_each
from implicit_step import one_step
from meshes import quad_sphere
from projective_scenes import SOFT, after_frames, full_scene, kick, kicked_balloon

from balloon_warp import Balloon, Change, Inflation, InputError, Scene, Simulator, Stiffness, Water
from balloon_warp.model import State, build_model
from balloon_warp.solvers.projective import (
    MANY_WORLDS,
    MOST_PARTICLES,
    DenseInverse,
    ProjectiveSolver,
    SparseFactor,
    StepMatrices,
)


def test_iterations_converge_to_newtons_method(device):
    step, points = one_step(400, device)
    expected = step.minimum(points)
    assert np.abs(step.slope(expected)[step.share > 0.0]).max() < 1e-9  # N; Newton's method has converged
    assert np.abs(expected - step.start).max() > 0.05
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-6)


def test_springs_far_too_stiff_for_the_explicit_steps_stay_stable(device):
    """A thousand times stiffer than symplectic Euler bears at h = 1/60 s, and kicked."""
    rest = quad_sphere(4, radius=0.5)

    def scene(factor: float, **fields) -> Scene:
        stiffness = Stiffness(structural=factor, shear=factor, flexion=factor)
        balloon = Balloon(mesh=rest, stiffness=stiffness, damping=0.0, inflation=Inflation(k_normal=0.1))
        return Scene(balloon=[balloon], gravity=0.0, substeps=1, **fields)

    bearable = 1.0
    while True:
        try:
            Simulator(scene(bearable), device)
            break
        except InputError:
            bearable /= 2.0
    simulator = Simulator(scene(1000.0 * 2.0 * bearable, solver="projective"), device)
    kick(simulator)
    velocities = [simulator.step().velocities[0] for _ in range(120)]
    speeds = [np.linalg.norm(each - each.mean(axis=0)) for each in velocities]
    assert np.isfinite(speeds).all()
    assert max(speeds[1:]) < 1.05 * speeds[0]
    frame = simulator.read_frame()
    ends = simulator.model.spring_particles.numpy()
    lengths = np.linalg.norm(np.diff(frame.points[0][ends], axis=1)[:, 0], axis=1)
    # 10 N of inflation in all, 0.1 N a particle, hardly stretch springs of 1,000 N/m; the rest is the swing left over
    np.testing.assert_allclose(lengths / simulator.model.spring_rest_length.numpy(), 1.0, atol=0.05)


def test_small_steps_approach_scatters_trajectory_at_first_order(device):
    """Areas agree on average, as a particle between two faces may take the area of either."""
    expected = after_frames(full_scene(substeps=1200), device, schedule="scatter").state
    errors = []
    for substeps in (25, 50, 100):
        found = after_frames(full_scene(substeps=substeps, solver="projective"), device).state
        errors.append(np.abs(found.points.numpy() - expected.points.numpy()).mean())
    assert errors[0] < 1e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 1.0, atol=0.2)  # and the next order


def test_springs_that_change_change_the_matrix_too(device):
    changed = kicked_balloon(100, change=[Change(time=0.0, set={"balloon.stiffness.structural": 200.0})])
    stiff = kicked_balloon(100, SOFT.model_copy(update={"structural": 200.0}))
    found, expected = (after_frames(scene, device, 10).state.points.numpy() for scene in (changed, stiff))
    np.testing.assert_array_equal(found, expected)


def test_the_solver_may_change(device):
    change = [Change(time=0.05, set={"solver": "projective"}), Change(time=0.1, set={"solver": "symplectic_euler"})]
    simulator = Simulator(full_scene(change=change), device)
    names = after_each(simulator, 8, lambda each: each.schedule.name == "projective")
    assert names == [False] * 3 + [True] * 3 + [False] * 2


def test_auto_takes_few_substeps_and_names_the_solver():
    stiff = Stiffness(structural=1e6)
    assert build_model(kicked_balloon(stiffness=stiff, substeps="auto"), "cpu").substeps == 2
    assert build_model(full_scene(solver="projective", frames_per_second=24), "cpu").substeps == 10
    assert Simulator(kicked_balloon(), "cpu").schedule.name == "projective"


@pytest.mark.parametrize("vary", [{}, {"balloon.0.mass": np.linspace(0.1, 0.3, 3)}])
def test_the_inverse_and_the_factor_give_the_same_trajectory(vary, device):
    states: list[State] = []
    for place, global_step in (("cpu", SparseFactor), (device, DenseInverse)):
        simulator = Simulator(full_scene(solver="projective"), place, 3, vary)
        simulator.schedule = ProjectiveSolver(simulator.model, global_step)
        advanced(simulator, 3)
        states.append(simulator.state)
    assert np.abs(states[0].velocities.numpy()).max() > 0.1
    np.testing.assert_allclose(states[0].points.numpy(), states[1].points.numpy(), rtol=0, atol=1e-5)


def test_the_factor_refuses_a_gpu_which_it_would_compute_wrongly_on():
    on_a_gpu: Any = SimpleNamespace(device=SimpleNamespace(is_cpu=False))
    nothing: Any = None
    with pytest.raises(ValueError, match="SparseFactor runs on the CPU"):
        SparseFactor(on_a_gpu, nothing)


def test_the_inverse_solves_the_system_alike_for_one_world_and_for_many(device):
    """Threads have one row each, or several rows of several worlds, for two balloons of 56 rows each."""
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


def test_a_world_alone_is_the_same_world_in_a_batch(device):
    scene = full_scene(solver="projective", normals="fresh", substeps=3)
    vary = {path: (values * 4)[:11] for path, values in VARIED.items()}
    batch = after_frames(scene, device, worlds=11, vary=vary)
    for world in (0, 7, 10):
        alone = after_frames(scene, device, vary={path: values[world : world + 1] for path, values in vary.items()})
        for name in ("points", "velocities", "sphere_positions", "sphere_forces"):
            of_batch, of_one = (getattr(each.state, name).numpy() for each in (batch, alone))
            np.testing.assert_array_equal(of_batch[world], of_one[0], err_msg=name)
    assert (batch.state.points.numpy()[0] != batch.state.points.numpy()[1]).any()


def test_worlds_share_a_matrix_where_masses_and_spring_constants_are_alike():
    scene = full_scene(solver="projective")
    for vary, count in (({"gravity": [9.0, 10.0, 11.0, 12.0]}, 1), ({"balloon.0.mass": [0.1, 0.2, 0.1, 0.2]}, 2)):
        matrices = StepMatrices(Simulator(scene, "cpu", 4, vary).model)
        assert matrices.count == count
        assert matrices.of_world.tolist() == [world % count for world in range(4)]


def test_what_it_cannot_simulate_is_refused():
    said = r'^schedule gather: is for explicit steps; solver = "projective" needs auto$'
    with pytest.raises(InputError, match=said):
        Simulator(kicked_balloon(), "cpu", schedule="gather")
    with pytest.raises(InputError, match=r'^solver: "projective" does not support water; expected another'):
        Simulator(kicked_balloon(water=Water()), "cpu")
    many = Balloon(mesh=quad_sphere(27), inflation=Inflation(k_normal=0.2))
    large = build_model(Scene(balloon=[many], solver="projective"), "cpu")
    with pytest.raises(InputError, match=rf"^solver: .* {MOST_PARTICLES:,} particles at most on a GPU \(got 4,376\)"):
        ProjectiveSolver(large, DenseInverse)
