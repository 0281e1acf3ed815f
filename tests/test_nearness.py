"""Meshes that come near themselves, and balloons of them."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import cube, grid, hook, quad_sphere

from balloon_warp import Scene, Simulator, bundled_scenes, load_scene
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.nearness import nears_itself
from balloon_warp.mesh.sides import wrong_sides
from balloon_warp.model import plan_model
from balloon_warp.scene import Balloon, Ground, Stiffness, Touch

pytestmark = pytest.mark.physics


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_what_faces_itself_across_a_small_gap_is_near(scale: float):
    """A hook is near itself once its ends grow across the gap: a tube of radius 0.25 m grows by some 0.03 m outward at
    a stretch of 1.1, and three times as much at 1.3."""
    for mesh, stretch, near in [
        (hook(0.05), 0.1, True),
        (hook(0.2), 0.1, False),  # the gap is wider than the ends grow
        (hook(0.2), 0.5, True),
        (quad_sphere(6), 0.1, False),
        (cube(), 0.1, False),
        (grid(4, 4), 0.1, False),  # has no inside
    ]:
        turned = mesh.points[:, [2, 0, 1]] * scale + 5.0 * scale
        assert nears_itself(replace(mesh, points=turned), stretch) == near


def test_a_groove_and_a_thin_wall_are_not_near_themselves():
    """The sides of a groove face each other, but are near along the surface too; the two sides of a thin wall face away
    from each other."""
    groove = quad_sphere(8)
    across = np.abs(groove.points[:, 0])
    dented = groove.points.copy()
    dented[:, 1] -= np.where((dented[:, 1] > 0.0) & (across < 0.15), 0.5 * (0.15 - across), 0.0)
    assert not nears_itself(replace(groove, points=dented), 0.1)
    assert not nears_itself(replace(groove, points=groove.points * np.array([1.0, 0.02, 1.0])), 0.1)


def touches_itself(scene: Scene) -> bool:
    """Return whether contact of a balloon with itself is on once a scene is planned, since it is near itself."""
    touch = plan_model(scene).scene.touch
    return bool(touch) and touch.itself is True


def test_a_mesh_by_itself_touches_itself_where_it_is_near():
    """A mesh by itself has self-contact where its inflated skin comes near itself."""
    assert touches_itself(load_scene(hook(0.05)))
    assert touches_itself(load_scene(hook(0.2), {"balloon.inflation.stretch": 0.5}))
    assert not touches_itself(load_scene(hook(0.2)))
    assert not touches_itself(load_scene(quad_sphere(4)))


@pytest.mark.parametrize(
    "touch", [None, Touch(), Touch(friction=0.1, spheres=False)], ids=["missing", "empty", "given"]
)
def test_any_balloon_touches_itself_where_it_is_near(touch: Touch | None):
    """Self-contact is on where a mesh is near itself, unless the scene disables it or cannot have it; other balloons
    pay nothing, and the scene's other settings stay."""
    near, far = Balloon(mesh=hook(0.05)), Balloon(mesh=quad_sphere(4), position=(3.0, 0.0, 0.0))
    assert touches_itself(Scene(balloon=[near], touch=touch))
    assert touches_itself(Scene(balloon=[far, near], touch=touch))
    assert plan_model(Scene(balloon=[far], touch=touch)).scene.touches is False
    assert not touches_itself(Scene(balloon=[near], touch=touch, solver="projective"))
    settled = plan_model(Scene(balloon=[near, near], touch=touch)).scene
    assert settled.touch
    assert settled.touch.model_copy(update={"itself": "auto"}) == (touch or Touch())


@pytest.mark.parametrize("touch", [False, Touch(itself=False)], ids=["false", "itself = false"])
def test_a_scene_may_say_that_a_balloon_passes_through_itself(touch: Touch | bool):
    assert not touches_itself(Scene(balloon=[Balloon(mesh=hook(0.05))], touch=touch))


@pytest.mark.full
def test_strands_that_sag_into_each_other_are_kept_apart():
    """Strands of a knot with soft default springs sag and are kept apart by self-contact."""
    mesh, enclosed = load_mesh(bundled_scenes()["knot"].parent / "knot.obj"), dict[bool, float]()
    for touching in (True, False):
        balloon = Balloon(mesh=mesh, mass=0.1, damping=1.0, stiffness=Stiffness(thin="softer"))
        scene = Scene(balloon=[balloon], ground=Ground(height=-0.05), touch=Touch(itself=touching))
        simulator = Simulator(scene, "cpu")
        for _ in range(110):
            simulator.advance()
        sides = wrong_sides(replace(mesh, points=simulator.read_frame().points[0].astype(np.float64)))
        enclosed[touching] = float(sides.areas[sides.enclosed].sum() / sides.areas.sum())
    assert enclosed[False] > 0.03
    assert enclosed[True] < 0.2 * enclosed[False]
