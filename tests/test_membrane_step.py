"""Stable step of rubber: no longer than its forces really allow, and not much shorter."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from conserved import put
from meshes import halved, quad_sphere

from balloon_warp import Atmosphere, Balloon, Inflation, Material, PolygonMesh, Scene, Simulator
from balloon_warp.model import Model, build_model, initial_state, plan_model
from balloon_warp.model.stability import Network
from balloon_warp.schedules.readout import ForceReader

MESHES = {"quads": quad_sphere(6, 0.1), "triangles": halved(quad_sphere(6, 0.1))}
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
@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("name", STIFFEST)
def test_the_step_is_what_the_stiffest_state_allows(name: str, mesh: str):
    material, stretch = STIFFEST[name]
    scene = scene_of(MESHES[mesh], material)
    step, found = stable_step(scene), longest_step(build_model(scene, "cpu"), stretch)
    assert 1.0 <= found / step < 1.6


def test_film_that_never_leaves_the_verge_of_wrinkling_gets_a_shorter_step():
    """The step of film on the verge of wrinkling is shorter by 1 / sqrt(1.78), so that 0.8 of it is 1.2 / omega; that
    of rubber and of film that does not wrinkle is not."""

    def step(**fields: Any) -> float:
        return stable_step(scene_of(MESHES["triangles"], Material(kind="neo_hookean", **fields)))

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
    steps = [stable_step(scene_of(MESHES["quads"], material)) for material in (elastic, viscous)]
    assert steps[1] < 0.2 * steps[0]
    scene = scene_of(MESHES["quads"], viscous)
    assert fastest(scene, int(np.ceil(1.0 / 60.0 / steps[1])), device) < 1.0


def test_worlds_take_the_step_of_the_stiffest(device: str):
    scene = scene_of(MESHES["quads"], Material(kind="neo_hookean"))
    soft, stiff = (plan_model(scene, 2, {"balloon.material.shear_modulus": [3.3e5, mu]}) for mu in (3.3e5, 13.2e5))
    assert stiff.substeps == pytest.approx(2 * soft.substeps, abs=2)
    thick = plan_model(scene, 2, {"balloon.material.thickness": [2e-4, 8e-4]})
    assert thick.substeps == soft.substeps  # heavier as much as stiffer
