"""The `projective` solver against Newton's method, the explicit schedules, and itself laid out otherwise."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.model import State, build_model
from balloon_warp.scene import Balloon, Change, Ground, Inflation, Scene, Sphere, Stiffness, String, Water
from balloon_warp.simulator import Simulator
from balloon_warp.solvers.dense_inverse import MANY_WORLDS, MOST_PARTICLES, DenseInverse
from balloon_warp.solvers.projective import ProjectiveSolver
from balloon_warp.solvers.sparse_factor import SparseFactor
from balloon_warp.solvers.step_matrices import StepMatrices

SOFT = Stiffness(structural=20.0, shear=10.0, flexion=5.0)


def kicked_balloon(iterations: int = 10, stiffness: Stiffness = SOFT, **fields) -> Scene:
    """A small balloon in large steps, with fixed particles, a taut string and a slack one; no contacts."""
    balloon = Balloon(
        mesh=quad_sphere(2, radius=0.5),
        damping=0.2,
        stiffness=stiffness,
        inflation=Inflation(k_normal=0.1),
        fixed=[3],
    )
    strings = [
        String(anchor=(0.0, -1.5, 0.0), particle="lowest", length=0.8),
        String(anchor=(0.0, 1.5, 0.0), particle="highest", length=2.0),
    ]
    fields = {"substeps": 1, "string": strings} | fields
    return Scene(balloon=[balloon], solver="projective", solver_iterations=iterations, **fields)


def kick(simulator: Simulator, speed: float = 3.0) -> None:
    """Give every particle that moves a velocity of its own."""
    shape = (1, simulator.model.particle_count, 3)
    velocities = np.random.default_rng(7).normal(0.0, speed, shape)
    velocities[:, simulator.model.particle_mass_share.numpy() == 0.0] = 0.0
    velocities = np.repeat(velocities, simulator.model.world_count, axis=0)
    wp.copy(simulator.state.velocities, wp.array(velocities, dtype=wp.vec3, device=simulator.model.device))


class ImplicitStep:
    """The objective of one step of backward Euler, its slope and its curvature, in float64 and by loops."""

    def __init__(self, simulator: Simulator):
        model, state = simulator.model, simulator.state
        self.model, self.h = model, model.step_seconds
        scene, balloon = model.scene, model.scene.balloon[0]
        self.start = state.points.numpy()[0].astype(np.float64)
        self.share = model.particle_mass_share.numpy().astype(np.float64)
        self.inertia = self.share * (balloon.mass + self.h * balloon.damping)
        inflation = np.concatenate(simulator.read_frame().inflation_forces)
        force = inflation - self.share[:, None] * balloon.mass * [0.0, scene.gravity, 0.0]
        impulse = self.share[:, None] * balloon.mass * state.velocities.numpy()[0] + self.h * force
        moves = self.inertia > 0.0
        self.free = np.zeros_like(self.start)
        self.free[moves] = self.h * impulse[moves] / self.inertia[moves, None]
        springs = model.shapes[0].springs
        constants = np.array([SOFT.structural, SOFT.shear, SOFT.flexion])
        self.springs = list(zip(springs.pairs, constants[springs.kind], springs.rest_lengths, strict=True))

    def value(self, points: NDArray) -> float:
        lag = points - self.start - self.free
        total = float((self.inertia[:, None] * lag**2).sum()) / (2.0 * self.h**2)
        for (p, q), k, length in self.springs:
            total += 0.5 * k * (np.linalg.norm(points[q] - points[p]) - length) ** 2
        for p, anchor, length, k in self.strings():
            total += 0.5 * k * max(float(np.linalg.norm(anchor - points[p])) - length, 0.0) ** 2
        return total

    def derivatives(self, points: NDArray) -> tuple[NDArray, NDArray]:
        count = len(points)
        slope = self.inertia[:, None] * (points - self.start - self.free) / self.h**2
        curvature = np.einsum("pq,ij->piqj", np.diag(self.inertia / self.h**2), np.eye(3))
        for (p, q), k, length in self.springs:
            force, block = self.pull(points[q] - points[p], k, length)
            slope[p] -= force
            slope[q] += force
            for a, b, sign in ((p, p, 1), (q, q, 1), (p, q, -1), (q, p, -1)):
                curvature[a, :, b] += sign * block
        for p, anchor, length, k in self.strings():
            if np.linalg.norm(anchor - points[p]) > length:
                force, block = self.pull(anchor - points[p], k, length)
                slope[p] -= force
                curvature[p, :, p] += block
        return slope, curvature.reshape(3 * count, 3 * count)

    def strings(self):
        model = self.model
        places = zip(model.string_particle.numpy(), model.parameters["string_anchor"].numpy()[0], strict=True)
        numbers = zip(
            model.parameters["string_length"].numpy()[0], model.parameters["string_stiffness"].numpy()[0], strict=True
        )
        return [(*place, *number) for place, number in zip(places, numbers, strict=True)]

    @staticmethod
    def pull(d: NDArray, k: float, length: float) -> tuple[NDArray, NDArray]:
        size = np.linalg.norm(d)
        along = np.outer(d, d) / size**2
        return k * (size - length) * d / size, k * (along + (1.0 - length / size) * (np.eye(3) - along))

    def minimum(self, points: NDArray) -> NDArray:
        """By Newton's method from there."""
        moves = np.repeat(self.share > 0.0, 3)
        for _ in range(30):
            slope, curvature = self.derivatives(points)
            step = np.zeros(points.size)
            step[moves] = np.linalg.solve(curvature[np.ix_(moves, moves)], slope.ravel()[moves])
            points = points - step.reshape(-1, 3)
        return points


def one_step(iterations: int, device: str) -> tuple[ImplicitStep, NDArray]:
    simulator = Simulator(kicked_balloon(iterations), device)
    kick(simulator)
    step = ImplicitStep(simulator)
    simulator.step()
    return step, simulator.state.points.numpy()[0].astype(np.float64)


def test_every_iteration_lowers_the_energy(device):
    """At a step of 1/60 s, as long as float32 can tell."""
    steps = [one_step(iterations, device) for iterations in range(1, 17)]
    values = [step.value(points) for step, points in steps]
    step, points = steps[-1]
    begin = step.value(step.start + step.free)
    least = step.value(step.minimum(points))
    assert begin > values[0] + 0.01
    assert np.all(np.diff(values) < 0.0)
    assert 0.0 < values[-1] - least < 0.02 * (begin - least)


def test_iterations_converge_to_newtons_method(device):
    """On the same implicit step. Points of size 1 are rounded by 6e-8, and a step adds up some of those."""
    step, points = one_step(400, device)
    expected = step.minimum(points)
    slope, _ = step.derivatives(expected)
    assert np.abs(slope[step.share > 0.0]).max() < 1e-9  # N; Newton's method has converged
    assert np.abs(expected - step.start).max() > 0.05
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-6)


def test_few_iterations_conserve_momentum(device):
    """A step that has not converged: springs, whatever they do, leave the sum of momenta alone."""
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
    """A thousand times stiffer than symplectic Euler bears at h = 1/60 s, and kicked: the energy falls, and at last the
    balloon has its shape."""
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


def full_scene(**fields) -> Scene:
    """Inflation that changes, springs that vary, fixed particles, strings, a sphere that is hit, and the ground."""
    balloon = Balloon(
        mesh=quad_sphere(3, radius=0.5),
        position=(0.0, 0.495, 0.0),
        damping=0.2,
        stiffness=Stiffness(variation=0.3),
        inflation=Inflation(k_normal=[(0.0, 0.1), (0.05, 0.3)]),
        fixed=[5],
    )
    return Scene(
        balloon=[balloon, balloon.model_copy(update={"position": (3.0, 0.6, 0.0), "mass": 0.2, "fixed": []})],
        sphere=[Sphere(position=(0.0, 1.14, 0.0), radius=0.25, mass=0.2, velocity=(0.0, -0.5, 0.0))],
        string=[String(anchor=(3.0, 2.0, 0.0), balloon=1, particle="highest", length=0.7)],
        ground=Ground(),
        **fields,
    )


def after_frames(scene: Scene, device: str, frames: int = 4, worlds: int = 1, vary=None, schedule="auto") -> Simulator:
    simulator = Simulator(scene, device, worlds, vary, schedule)
    for _ in range(frames):
        simulator.step()
    return simulator


def test_small_steps_approach_scatters_trajectory_at_first_order(device):
    """Contacts, strings, inflation, damping and fixed particles included: the difference to a refined explicit run
    halves with the step. On average, for a particle between two faces may take the area of either."""
    expected = after_frames(full_scene(substeps=1200), device, schedule="scatter").state
    errors = []
    for substeps in (25, 50, 100):
        found = after_frames(full_scene(substeps=substeps, solver="projective"), device).state
        errors.append(np.abs(found.points.numpy() - expected.points.numpy()).mean())
    assert errors[0] < 1e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 1.0, atol=0.2)  # and the next order


def test_a_sphere_is_pushed_as_by_scatter(device):
    """At the same step: particles touch the sphere in some steps and not in others, on which the push depends."""
    fallen = -0.5 - 9.81 * 4 / 60
    scenes = full_scene(substeps=100), full_scene(substeps=100, solver="projective")
    expected, found = (after_frames(scene, device).state.sphere_velocities.numpy()[0, 0, 1] for scene in scenes)
    assert expected - fallen > 0.2  # m/s
    assert found - fallen == pytest.approx(expected - fallen, rel=0.06)  # the balloon itself lags by a step


@pytest.mark.parametrize("vary", [{}, {"balloon.0.mass": np.linspace(0.1, 0.3, 3)}])
def test_the_inverse_and_the_factor_give_the_same_trajectory(vary, device):
    """Within the rounding of float32, with one matrix for all worlds or one for each. The factor is for the CPU."""
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
    """Of two balloons, 56 rows each, by threads that have a row each, or several rows of several worlds."""
    many = MANY_WORLDS + 5
    right_sides = np.random.default_rng(3).normal(size=(many, 112, 3)).astype(np.float32)
    solutions = []
    for rows in (right_sides, right_sides[-1:]):
        model = build_model(full_scene(), device, len(rows))
        solution = wp.zeros(rows.shape[:2], dtype=wp.vec3, device=device)
        matrices = StepMatrices(model)
        DenseInverse(model, matrices).solve(wp.array(rows, dtype=wp.vec3, device=device), solution)
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
    """Each world of such a batch is that world alone, to the last bit."""
    scene = full_scene(solver="projective")
    batch = after_frames(scene, device, worlds=3, vary=VARIED).state.points.numpy()
    for world in range(3):
        own = {path: values[world : world + 1] for path, values in VARIED.items()}
        alone = after_frames(scene, device, vary=own).state.points.numpy()
        np.testing.assert_array_equal(batch[world], alone[0])
    assert (batch[0] != batch[1]).any()


def test_worlds_share_a_matrix_where_masses_and_spring_constants_are_alike():
    """One is factorized for all of a batch, whatever else differs between its worlds; or one for each of two kinds."""
    scene = full_scene(solver="projective")
    for vary, count in (({"gravity": [9.0, 10.0, 11.0, 12.0]}, 1), ({"balloon.0.mass": [0.1, 0.2, 0.1, 0.2]}, 2)):
        matrices = StepMatrices(Simulator(scene, "cpu", 4, vary).model)
        assert matrices.count == count
        assert matrices.of_world.tolist() == [world % count for world in range(4)]


def test_a_world_alone_is_the_same_world_in_a_batch(device):
    """To the last bit, also in a batch that no eight divide."""
    scene = full_scene(solver="projective", normals="fresh", substeps=3)
    alone, batch = after_frames(scene, device), after_frames(scene, device, worlds=11)
    for name in ("points", "velocities", "sphere_positions", "sphere_forces"):
        found = getattr(batch.state, name).numpy()
        for world in (0, 7, 10):
            np.testing.assert_array_equal(found[world], getattr(alone.state, name).numpy()[0], err_msg=name)


def test_springs_that_change_change_the_matrix_too(device):
    """What goes on in the changed scene is what starts in it."""
    changed = kicked_balloon(100, change=[Change(time=0.0, set={"balloon.stiffness.structural": 200.0})])
    stiff = kicked_balloon(100, SOFT.model_copy(update={"structural": 200.0}))
    found, expected = (after_frames(scene, device, 10).state.points.numpy() for scene in (changed, stiff))
    np.testing.assert_array_equal(found, expected)


def test_the_solver_may_change(device):
    """An explicit start goes on implicitly, and back."""
    change = [Change(time=0.05, set={"solver": "projective"}), Change(time=0.1, set={"solver": "symplectic_euler"})]
    names = []
    simulator = Simulator(full_scene(change=change), device)
    for _ in range(8):
        simulator.step()
        names.append(simulator.schedule.name == "projective")
    assert names == [False] * 3 + [True] * 3 + [False] * 2


def test_auto_takes_few_substeps_and_names_the_solver():
    """However stiff the springs are."""
    stiff = Stiffness(structural=1e6)
    assert build_model(kicked_balloon(stiffness=stiff, substeps="auto"), "cpu").substeps == 2
    assert build_model(full_scene(solver="projective", frames_per_second=24), "cpu").substeps == 10
    assert Simulator(kicked_balloon(), "cpu").schedule.name == "projective"


def test_what_it_cannot_simulate_is_refused():
    with pytest.raises(InputError, match=r'^--schedule gather: is for explicit steps; solver = "projective" takes'):
        Simulator(kicked_balloon(), "cpu", schedule="gather")
    with pytest.raises(InputError, match=r'^solver: "projective" does not simulate water; expected another'):
        Simulator(kicked_balloon(water=Water()), "cpu")
    large = build_model(Scene(balloon=[Balloon(mesh=quad_sphere(27))], solver="projective"), "cpu")
    with pytest.raises(InputError, match=rf"^solver: .* {MOST_PARTICLES:,} particles at most on a GPU \(got 4,376\)"):
        ProjectiveSolver(large, DenseInverse)
