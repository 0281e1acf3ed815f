"""Stable step: the highest frequency of a spring network, beside that of its whole matrix; and of rubber no longer than
its forces really allow, and not much shorter."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from conserved import put
from meshes import cube, grid, halved, quad_sphere
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import eigsh

from balloon_warp import (
    Atmosphere,
    Balloon,
    Inflation,
    Material,
    PolygonMesh,
    Scene,
    Simulator,
    build_springs,
    bundled_scenes,
    load_scene,
)
from balloon_warp.model import Model, build_model, initial_state, plan_model
from balloon_warp.model.materials import Bounds
from balloon_warp.model.spectrum import FEW, MARGIN, highest_squared_frequency
from balloon_warp.model.stability import Network
from balloon_warp.schedules.readout import ForceReader

MESHES = {"sphere": quad_sphere(9), "cube": cube(), "sheet": grid(12, 12), "fine": quad_sphere(16)}


def whole_matrix(
    pairs: NDArray[np.integer], constants: NDArray[np.float64], held: NDArray[np.float64], masses: NDArray[np.float64]
) -> csr_array:
    """Return M^-1/2 K M^-1/2, with zeros for particles that do not move."""
    roots = np.where(masses > 0.0, np.maximum(masses, 1e-300) ** -0.5, 0.0)
    (first, second), count = pairs.T, len(masses)
    diagonal = held + np.bincount(first, constants, count) + np.bincount(second, constants, count)
    rows, columns = np.concatenate([first, second, range(count)]), np.concatenate([second, first, range(count)])
    values = np.concatenate([-constants, -constants, diagonal]) * roots[rows] * roots[columns]
    return coo_array((values, (rows, columns))).tocsr()


@pytest.mark.full
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
@pytest.mark.parametrize("seed", range(3))
def test_it_is_that_of_the_whole_matrix_and_never_below_it(mesh: PolygonMesh, seed: int):
    """The frequency of random springs and masses is exact for few particles, else within the margin."""
    random, pairs = np.random.default_rng(seed), build_springs(mesh).pairs
    constants, held = random.uniform(0.1, 10.0, len(pairs)), random.uniform(0.0, 5.0, mesh.vertex_count)
    masses = random.uniform(0.5, 2.0, mesh.vertex_count) * (random.uniform(size=mesh.vertex_count) > 0.1)
    expected = np.linalg.eigvalsh(whole_matrix(pairs, constants, held, masses).toarray()).max()
    found = highest_squared_frequency(pairs, constants, held, masses)
    if np.count_nonzero(masses) <= FEW:
        assert found == pytest.approx(expected, rel=1e-12)
    else:
        assert expected <= found <= 1.0001 * MARGIN * expected


@pytest.mark.parametrize(("masses", "expected"), [((1.0, 3.0), 6.0 * (1.0 + 1.0 / 3.0)), ((0.0, 0.0), 0.0)])
def test_of_a_spring_between_two_masses_it_is_that_of_the_textbook(masses: tuple[float, float], expected: float):
    """The squared frequency is k (1/m + 1/M), and that of fixed particles is zero."""
    found = highest_squared_frequency(np.array([[0, 1]]), np.array([6.0]), np.zeros(2), np.array(masses))
    assert found == pytest.approx(expected)


def is_of_springs(name: str) -> bool:
    """Return whether no balloon of a scene is of rubber."""
    return not any(balloon.material.is_membrane for balloon in load_scene(name).balloon)


OF_SPRINGS = [name for name in bundled_scenes() if is_of_springs(name)]
"""rubber has a bound of its own, see below"""


@pytest.mark.full
@pytest.mark.parametrize("name", OF_SPRINGS)
def test_bundled_scenes_are_within_the_margin(name: str):
    """The margin covers Lanczos's underestimate of the largest eigenvalue on all bundled networks; the reference takes
    a hundred times as much work."""
    plan = plan_model(load_scene(name))
    shape = plan.shapes[0]
    bounds = Bounds(plan.scene, plan.laws, 0, plan.parameters)
    around = Network(plan.shapes, plan.held, plan.laws)._around(plan.scene, 0, bounds)
    stiffest = bounds.stiffest(around, plan.parameters["mass"][:, 0])
    constants = stiffest.springs[shape.springs.kind].sum(axis=1)
    held = np.zeros(len(shape.mass_share))
    held[shape.mass_share > 0.0] = stiffest.held
    found = highest_squared_frequency(shape.springs.pairs, constants, held, shape.mass_share)
    matrix = whole_matrix(shape.springs.pairs, constants, held, shape.mass_share)
    largest = eigsh(matrix, k=1, which="LA", return_eigenvectors=False)
    expected = float(np.max(np.asarray(largest)))
    rounding = 1e-12  # small networks are solved exactly here and there, and differ by rounding alone
    assert (1.0 - rounding) * expected <= found <= 1.001 * MARGIN * expected


@pytest.mark.full
def test_it_lets_bundled_scenes_take_a_fifth_to_a_third_more_than_gershgorins_bound():
    """The step is a fifth to a third longer than Gershgorin's 2 / omega, omega^2 twice the largest sum of constants at
    a particle over its mass, as docs/PHYSICS.md says."""
    ratios = []
    for name in OF_SPRINGS:
        plan = plan_model(load_scene(name, {"touch": False}))
        network = Network(plan.shapes, plan.held, plan.laws)
        step = network.stable_step(plan.scene, plan.parameters)
        bounds = [network._bounds(plan.scene, number, plan.parameters) for number in range(len(plan.shapes))]
        steps = []
        for number, bound in enumerate(bounds):
            around = network._around(plan.scene, number, bound)
            mass = plan.parameters["mass"][:, number]
            rate = 2.0 * bound.largest("drag", around) / mass
            steps.append(4.0 / (np.sqrt(rate**2 + 8.0 * bound.largest("stiffness", around) / mass) + rate))
        ratios.append(step / np.min(steps))
    assert (round(min(ratios), 2), round(max(ratios), 2)) == (1.18, 1.32)


BALLS = {"quads": quad_sphere(6, 0.1), "triangles": halved(quad_sphere(6, 0.1))}
STIFFEST = {
    "neo_hookean": (Material(kind="neo_hookean"), 1.02),
    "latex": (Material(preset="latex"), 6.0),
    "natural rubber": (Material(preset="natural_rubber_treloar"), 6.0),
    "gent": (Material(kind="gent"), 6.79),
    "squeezed": (Material(kind="neo_hookean", wrinkling=False), 0.81),
}
"""materials, and a stretch at which each is about as stiff as it is counted"""


def scene_of(mesh: PolygonMesh, material: Material, **fields: Any) -> Scene:
    still = Inflation(kind="pressure", pressure=0.0)
    balloon = Balloon(mesh=mesh, material=material, inflation=still, damping=0.0)
    return Scene(balloon=[balloon], gravity=0.0, atmosphere=Atmosphere(density=0.0), **fields)


def stable_step(scene: Scene) -> float:
    plan = plan_model(scene)
    return Network(plan.shapes, plan.held, plan.laws).stable_step(plan.scene, plan.parameters)


def longest_step(model: Model, stretch: float) -> float:
    """Return 2 / omega of the evenly stretched ball, omega^2 the largest eigenvalue of the forces' derivative over the
    masses, by power iteration of differences: from below, by some percent."""
    reader, state = ForceReader(model), initial_state(model)
    points = state.points.numpy()[0].astype(np.float64) * stretch
    roots = np.sqrt(model.parameters["mass"].numpy()[0, 0] * model.shapes[0].mass_share)[:, None]

    def forces(places: np.ndarray) -> np.ndarray:
        wp.copy(state.points, wp.array(places[None], dtype=wp.vec3, device="cpu"))
        reader.refresh(state)
        return reader.net_forces(state).numpy()[0].astype(np.float64)

    way, squared = np.random.default_rng(0).normal(size=points.shape), 0.0
    for _ in range(150):
        aside = way / roots
        aside *= 1e-4 * stretch / np.sqrt((aside**2).sum(axis=1).mean())
        slope = -(forces(points + aside) - forces(points - aside)) / (2.0 * roots)
        way = aside * roots
        squared = float((way * slope).sum() / (way**2).sum())
        way = slope
    return 2.0 / np.sqrt(squared)


@pytest.mark.full
@pytest.mark.parametrize("mesh", BALLS)
@pytest.mark.parametrize("name", STIFFEST)
def test_the_step_is_what_the_stiffest_state_allows(name: str, mesh: str):
    material, stretch = STIFFEST[name]
    scene = scene_of(BALLS[mesh], material)
    step, found = stable_step(scene), longest_step(build_model(scene, "cpu"), stretch)
    assert 1.0 <= found / step < 1.6


def test_film_that_never_leaves_the_verge_of_wrinkling_gets_a_shorter_step():
    """The step of film on the verge of wrinkling is shorter by 1 / sqrt(1.78), so that 0.8 of it is 1.2 / omega; that
    of rubber and of film that does not wrinkle is not."""

    def step(**fields: Any) -> float:
        return stable_step(scene_of(BALLS["triangles"], Material(kind="neo_hookean", **fields)))

    assert step(most_stretch=1.1) == pytest.approx(step(most_stretch=6.0) / np.sqrt(1.78), rel=1e-3)
    assert step(most_stretch=1.1, wrinkling=False) == pytest.approx(step(most_stretch=1.6, wrinkling=False), rel=1e-3)


def fastest(scene: Scene, substeps: int, device: str) -> float:
    """Return the highest speed in ten frames of a ball that starts with random velocities of 0.1 m/s."""
    simulator = Simulator(scene.model_copy(update={"substeps": substeps}), device)
    points = simulator.state.points.numpy()[0]
    put(simulator, 1.01 * points, np.random.default_rng(1).normal(scale=0.1, size=points.shape))
    highest = 0.0
    for _ in range(10):
        simulator.step()
        highest = max(highest, float(np.abs(simulator.state.velocities.numpy()).max()))
    return highest


def test_the_step_allows_for_viscosity(device: str):
    """High viscosity reduces the step to an eighth, in which the ball comes to rest."""
    elastic, viscous = Material(kind="neo_hookean"), Material(kind="neo_hookean", viscosity=100.0)
    steps = [stable_step(scene_of(BALLS["quads"], material)) for material in (elastic, viscous)]
    assert steps[1] < 0.2 * steps[0]
    scene = scene_of(BALLS["quads"], viscous)
    assert fastest(scene, int(np.ceil(1.0 / 60.0 / steps[1])), device) < 1.0


def test_worlds_take_the_step_of_the_stiffest(device: str):
    scene = scene_of(BALLS["quads"], Material(kind="neo_hookean"))
    soft, stiff = (plan_model(scene, 2, {"balloon.material.shear_modulus": [3.3e5, mu]}) for mu in (3.3e5, 13.2e5))
    assert stiff.substeps == pytest.approx(2 * soft.substeps, abs=2)
    thick = plan_model(scene, 2, {"balloon.material.thickness": [2e-4, 8e-4]})
    assert thick.substeps == soft.substeps  # heavier as much as stiffer
