"""Projective solver against Newton's method and the explicit schedules."""

import numpy as np
import pytest
from implicit_step import one_step
from meshes import quad_sphere
from projective_scenes import SOFT, after_frames, full_scene, kick, kicked_balloon

from balloon_warp.errors import InputError
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Change, Inflation, Scene, Stiffness, Water
from balloon_warp.simulator import Simulator
from balloon_warp.solvers.dense_inverse import MOST_PARTICLES, DenseInverse
from balloon_warp.solvers.projective import ProjectiveSolver


@pytest.mark.full
def test_every_iteration_lowers_the_energy(device):
    """Each iteration reduces the objective at a step of 1/60 s, as long as float32 resolves it."""
    steps = [one_step(iterations, device) for iterations in range(1, 17)]
    values = [step.value(points) for step, points in steps]
    step, points = steps[-1]
    begin = step.value(step.start + step.free)
    least = step.value(step.minimum(points))
    assert begin > values[0] + 0.01
    assert np.all(np.diff(values) < 0.0)
    assert 0.0 < values[-1] - least < 0.02 * (begin - least)


def test_iterations_converge_to_newtons_method(device):
    """Iterations converge to Newton's minimum of the implicit step, up to rounding of points of size 1."""
    step, points = one_step(400, device)
    expected = step.minimum(points)
    slope, _ = step.derivatives(expected)
    assert np.abs(slope[step.share > 0.0]).max() < 1e-9  # N; Newton's method has converged
    assert np.abs(expected - step.start).max() > 0.05
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-6)


def test_few_iterations_conserve_momentum(device):
    """A step that has not converged conserves momentum: springs are internal forces."""
    balloon = Balloon(mesh=quad_sphere(4), mass=0.5, damping=0.0, inflation=Inflation(k_normal=0.0))
    scene = Scene(balloon=[balloon], gravity=0.0, solver="projective", solver_iterations=2, substeps=1)
    simulator = Simulator(scene, device)
    kick(simulator)
    before = simulator.state.velocities.numpy()[0].mean(axis=0)
    for _ in range(5):
        simulator.step()
    after = simulator.state.velocities.numpy()[0]
    np.testing.assert_allclose(after.mean(axis=0), before, atol=2e-6)  # sums of float32 near 3, of 98 particles
    assert np.abs(after - after.mean(axis=0)).max() > 0.1


def test_springs_far_too_stiff_for_the_explicit_steps_stay_stable(device):
    """Springs a thousand times stiffer than symplectic Euler bears at h = 1/60 s, and kicked, lose energy, and at last
    the balloon has its shape."""
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
    speeds = []
    for _ in range(120):
        simulator.step()
        velocities = simulator.state.velocities.numpy()[0]
        speeds.append(np.linalg.norm(velocities - velocities.mean(axis=0)))
    assert np.isfinite(speeds).all()
    assert max(speeds[1:]) < 1.05 * speeds[0]
    frame = simulator.read_frame()
    ends = simulator.model.spring_particles.numpy()
    lengths = np.linalg.norm(np.diff(frame.points[0][ends], axis=1)[:, 0], axis=1)
    # 10 N of inflation in all, 0.1 N a particle, hardly stretch springs of 1,000 N/m; the rest is what still swings
    np.testing.assert_allclose(lengths / simulator.model.spring_rest_length.numpy(), 1.0, atol=0.05)


@pytest.mark.full
def test_small_steps_approach_scatters_trajectory_at_first_order(device):
    """The difference to a refined explicit run halves with the step, with contacts, strings, inflation, damping and
    fixed particles; on average, as a particle between two faces may take the area of either."""
    expected = after_frames(full_scene(substeps=1200), device, schedule="scatter").state
    errors = []
    for substeps in (25, 50, 100):
        found = after_frames(full_scene(substeps=substeps, solver="projective"), device).state
        errors.append(np.abs(found.points.numpy() - expected.points.numpy()).mean())
    assert errors[0] < 1e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 1.0, atol=0.2)  # and the next order


@pytest.mark.full
def test_a_sphere_is_pushed_as_by_scatter(device):
    """The push on a sphere agrees with `scatter` at the same step, though particles touch it in some steps only."""
    fallen = -0.5 - 9.81 * 4 / 60
    scenes = full_scene(substeps=100), full_scene(substeps=100, solver="projective")
    expected, found = (after_frames(scene, device).state.sphere_velocities.numpy()[0, 0, 1] for scene in scenes)
    assert expected - fallen > 0.2  # m/s
    assert found - fallen == pytest.approx(expected - fallen, rel=0.06)  # the balloon itself lags by a step


def test_springs_that_change_change_the_matrix_too(device):
    """A run with changed springs is bit-identical to one that starts with them."""
    changed = kicked_balloon(100, change=[Change(time=0.0, set={"balloon.stiffness.structural": 200.0})])
    stiff = kicked_balloon(100, SOFT.model_copy(update={"structural": 200.0}))
    found, expected = (after_frames(scene, device, 10).state.points.numpy() for scene in (changed, stiff))
    np.testing.assert_array_equal(found, expected)


def test_the_solver_may_change(device):
    """The solver may change during a run, from explicit to implicit and back."""
    change = [Change(time=0.05, set={"solver": "projective"}), Change(time=0.1, set={"solver": "symplectic_euler"})]
    names = []
    simulator = Simulator(full_scene(change=change), device)
    for _ in range(8):
        simulator.step()
        names.append(simulator.schedule.name == "projective")
    assert names == [False] * 3 + [True] * 3 + [False] * 2


def test_auto_takes_few_substeps_and_names_the_solver():
    """The automatic number of substeps is small, however stiff the springs are."""
    stiff = Stiffness(structural=1e6)
    assert build_model(kicked_balloon(stiffness=stiff, substeps="auto"), "cpu").substeps == 2
    assert build_model(full_scene(solver="projective", frames_per_second=24), "cpu").substeps == 10
    assert Simulator(kicked_balloon(), "cpu").schedule.name == "projective"


def test_what_it_cannot_simulate_is_refused():
    with pytest.raises(
        InputError, match=r'^--schedule gather: is for explicit steps; solver = "projective" needs auto$'
    ):
        Simulator(kicked_balloon(), "cpu", schedule="gather")
    with pytest.raises(InputError, match=r'^solver: "projective" does not support water; expected another'):
        Simulator(kicked_balloon(water=Water()), "cpu")
    many = Balloon(mesh=quad_sphere(27), inflation=Inflation(k_normal=0.2))
    large = build_model(Scene(balloon=[many], solver="projective"), "cpu")
    with pytest.raises(InputError, match=rf"^solver: .* {MOST_PARTICLES:,} particles at most on a GPU \(got 4,376\)"):
        ProjectiveSolver(large, DenseInverse)
