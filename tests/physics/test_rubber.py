"""Tarantino's springs beyond Hooke's: viscosity, a yield stretch, constants that change over the balloon, torsion."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from conserved import advanced, forces_by_scatter, put
from meshes import cube, mesh_of, prism, quad_sphere

from balloon_warp import Balloon, Inflation, InputError, PolygonMesh, Scene, Simulator, Stiffness, load_scene
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model.shape import BalloonShape, shape_balloon
from balloon_warp.schedules.readout import ForceReader
from balloon_warp.springs.build import build_hinges

NO_INFLATION = Inflation(k_normal=0.0)


def balloon_of(stiffness: Stiffness, **fields) -> Balloon:
    fields = {"mesh": quad_sphere(3), "damping": 0.0, "inflation": NO_INFLATION} | fields
    return Balloon(stiffness=stiffness, **fields)


def forces_at(scene: Scene, points: np.ndarray, velocities: np.ndarray, device: str) -> list[np.ndarray]:
    """Return net forces as scatter sums them, and as a gathering schedule does."""
    simulator = Simulator(scene, device, schedule="scatter")
    put(simulator, points, velocities)
    return [forces_by_scatter(simulator), ForceReader(simulator.model).net_forces(simulator.state).numpy()[0]]


def test_a_viscous_spring_rings_down_as_the_analytic_solution_says(device):
    """The spring rings by l'' = -(2 k / m) (l - L + t l'): at omega sqrt(1 - (omega t / 2)^2), decay omega^2 t / 2."""
    k, m, t = 50.0, 0.1, 0.01
    pair = mesh_of([[-0.5, 0, 0], [0.5, 0, 0]], [[0, 1]])
    balloon = balloon_of(Stiffness(structural=k, viscosity=t), mesh=pair, mass=2.0 * m)
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, substeps=400), device)
    put(simulator, 1.1 * pair.points)
    squared = 2.0 * k / m
    decay = squared * t / 2.0
    ringing = np.sqrt(squared - decay**2)
    for frame in range(1, 25):
        time = frame / 60.0
        swing = np.cos(ringing * time) + decay / ringing * np.sin(ringing * time)
        length = np.ptp(simulator.step().points[0][:, 0])
        # first order: h omega / 2 of the swing, h = 1/24000 s
        assert length == pytest.approx(1.0 + 0.1 * np.exp(-decay * time) * swing, abs=2e-4)
    assert decay * 24 / 60.0 > 1.0  # there was something to decay


def test_viscosity_leaves_a_rigid_motion_alone(device):
    scene = Scene(balloon=[balloon_of(Stiffness(viscosity=0.05))], gravity=0.0)
    points = quad_sphere(3).points
    turning = np.cross([0.3, -1.0, 2.0], points) + [5.0, 0.0, 1.0]
    for forces in forces_at(scene, points, turning, device):
        np.testing.assert_allclose(forces, 0.0, atol=1e-4)


@pytest.mark.parametrize(("stretch", "pulls"), [(1.45, True), (1.55, False)])
def test_an_overextended_spring_pulls_no_more(stretch: float, pulls: bool, device: str):
    pair = mesh_of([[-0.5, 0, 0], [0.5, 0, 0]], [[0, 1]])
    balloon = balloon_of(Stiffness(structural=8.0, yield_stretch=1.5, viscosity=0.1), mesh=pair)
    velocities = np.array([[0.0, 0, 0], [0.2, 0, 0]])
    for forces in forces_at(Scene(balloon=[balloon], gravity=0.0), stretch * pair.points, velocities, device):
        pull = (8.0 * (stretch - 1.0) + 0.1 * 8.0 * 0.2) if pulls else 0.0
        np.testing.assert_allclose(forces[:, 0], [pull, -pull], atol=1e-5)


BOX = replace(cube(), name="box", groups={"neck": np.array([0, 1]), "tip": np.array([1])})


def shape_of(mesh: PolygonMesh = BOX, height: float = 0.0, **stiffness: Any) -> BalloonShape:
    balloon = Balloon(mesh=mesh, position=(0.0, 0.0, height), stiffness=Stiffness(**stiffness))
    return shape_balloon(balloon, Scene(balloon=[balloon]))


def test_constants_change_along_an_axis():
    """Constants interpolate from the factor at the bottom to the one at the top, at the middle of each spring."""
    shape = shape_of(quad_sphere(4), 7.0, gradient=(0.5, 3.0), gradient_axis="Z")  # from 6 m up to 8 m
    height = shape.mesh.points[shape.springs.pairs].mean(axis=1)[:, 2]
    np.testing.assert_allclose(shape.stiffness_scale, 0.5 + 2.5 * (height - 6.0) / 2.0)
    assert np.ptp(shape.stiffness_scale) > 2.0


@pytest.mark.parametrize(
    ("weights", "of_vertices"),
    [
        (np.arange(8.0), np.arange(8.0)),
        ({"neck": 3.0, "tip": 7.0}, [3.0, 7.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
        (lambda points: 2.0 * points[:, 1], 2.0 * BOX.points[:, 1]),
    ],
    ids=["of vertices", "of groups", "by a rule"],
)
def test_weights_make_parts_stiffer(weights: Any, of_vertices: Any):
    plain = shape_of(variation=0.4)
    expected = plain.stiffness_scale * np.array(of_vertices)[plain.springs.pairs].mean(axis=1)
    np.testing.assert_allclose(shape_of(variation=0.4, weights=weights).stiffness_scale, expected, rtol=1e-15)


def test_weights_by_a_rule_are_written_as_numbers():
    written = Balloon(mesh=BOX, stiffness={"weights": lambda points: points[:, 0]}).model_dump()["stiffness"]
    assert written["weights"] == BOX.points[:, 0].tolist()


@pytest.mark.parametrize(
    ("weights", "said"),
    [
        ([1.0, 2.0], r"stiffness\.weights: box has 8 vertices; expected a number for each \(got 2"),
        ({"nek": 2.0}, r"stiffness\.weights: box has no group nek; it has neck, tip"),
        (lambda points: points, r"balloon\.stiffness\.weights: the function must return a number for each point, of"),
        (lambda points: -np.ones(8), r"balloon\.stiffness\.weights\.0: must be greater than or equal to 0"),
        ({"neck": -1.0}, r"stiffness\.weights: must be greater than or equal to 0"),
    ],
)
def test_weights_that_cannot_be_are_refused(weights: Any, said: str):
    with pytest.raises(InputError, match=rf"^{said}"):
        shape_of(weights=weights)


def test_the_seed_decides_on_the_draws_alone():
    first, again, other = (shape_of(quad_sphere(8), variation=0.4, seed=seed).stiffness_scale for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.1  # of two thousand springs it is 0.02 or so by chance
    # a fifth of uniform draws is in each fifth of the range, within three standard deviations
    counts, _ = np.histogram(first, 5, (0.6, 1.4))
    assert counts.sum() == len(first) > 2000
    np.testing.assert_allclose(counts, len(first) / 5, atol=3.0 * np.sqrt(0.16 * len(first)))


def test_the_stable_step_counts_viscosity(device):
    """The automatic step damps the springs, and four times that one is refused, as it does not."""
    scene = Scene(balloon=[balloon_of(Stiffness(viscosity=0.1))], gravity=0.0, frames=20)
    plain = Scene(balloon=[balloon_of(Stiffness())], gravity=0.0)
    substeps = Simulator(scene, "cpu").model.substeps
    assert substeps > 5 * Simulator(plain, "cpu").model.substeps
    with pytest.raises(InputError, match=r"^substeps: \d+ are too few"):
        Simulator(scene.model_copy(update={"substeps": substeps // 2}), "cpu")
    simulator = Simulator(scene, device)
    put(simulator, velocities=np.random.default_rng(1).normal(scale=0.01, size=(56, 3)))
    advanced(simulator, scene.frames)
    assert np.abs(simulator.state.velocities.numpy()).max() < 0.02


def test_hinges_are_the_edges_of_two_faces():
    for mesh, count in ((cube(), 12), (prism(5), 15), (quad_sphere(3), 108)):
        assert build_hinges(mesh).count == count
    three_at_an_edge = mesh_of(np.eye(5, 3), [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert build_hinges(three_at_an_edge).count == 0
    np.testing.assert_allclose(np.abs(build_hinges(cube()).angles(cube().points)), np.pi / 2.0)


def test_a_fold_that_is_pushed_through_itself_comes_back_the_short_way(device):
    """The moment of two triangles folded past shut is continuous, though the angle jumps by a whole turn."""
    edge, open_by = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], np.radians(5.0)

    def fold(half: float) -> np.ndarray:
        wings = [[0.5, np.cos(half), np.sin(half)], [0.5, np.cos(half), -np.sin(half)]]
        return np.array([*edge, *wings])

    torsion = Stiffness(structural=0.0, shear=0.0, flexion=0.0, torsion=0.7)
    balloon = balloon_of(torsion, mesh=mesh_of(fold(open_by), [[0, 1, 2], [1, 0, 3]]))
    for forces in forces_at(Scene(balloon=[balloon], gravity=0.0), fold(-0.5 * open_by), np.zeros((4, 3)), device):
        moment = torsion.torsion * 3.0 * open_by  # from 5 to -2.5 degrees on either side, 1 m from the edge
        np.testing.assert_allclose(np.linalg.norm(forces[2:], axis=1), moment, rtol=2e-5)  # pi rounded, over 0.13
        assert forces[2, 2] > 0.0 > forces[3, 2]


def test_torsion_springs_hardly_change_a_balloon(device):
    """Results differ by a hundredth where they are stiff enough to shorten the time step, as the paper finds."""
    ends = []
    for torsion in (0.0, 0.02):
        scene = load_scene("squirrel_inflate", [("balloon.stiffness.torsion", torsion), ("frames", 110)])
        simulator = Simulator(scene, device)
        points = advanced(simulator, scene.frames).points[0].astype(np.float64)
        ends.append((simulator.model.substeps, replace(simulator.model.shapes[0].mesh, points=points)))
    (substeps, plain), (substeps_with_torsion, stiff) = ends
    assert substeps_with_torsion > substeps
    assert signed_volume(stiff) == pytest.approx(signed_volume(plain), rel=0.02)
