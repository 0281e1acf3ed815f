"""Contact by default, of balloons with others and with themselves; and layers that start crossed, by name."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import cube, grid, hook, joined, mesh_of, quad_sphere

from balloon_warp import InputError, PolygonMesh, Scene, Simulator, bundled_scenes, load_mesh, load_scene
from balloon_warp.mesh.crossings import find_crossings
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.repair import wrong_sides
from balloon_warp.mesh.thickness import nears_itself
from balloon_warp.model import plan_model
from balloon_warp.model.touch import bends_freely
from balloon_warp.scene import Balloon, Ground, Inflation, Stiffness, Touch
from balloon_warp.scene.load import override_scene
from balloon_warp.scene.write import write_scene
from balloon_warp.schedules.touch_table import surface_of

LIMP = Stiffness(structural=50.0, shear=25.0, flexion=0.0)


def test_a_part_is_as_high_as_the_parts_in_it():
    """Parts are in the order in which a search goes down; a leaf's height is 0."""
    for mesh in (cube(), quad_sphere(6), hook(0.1)):
        surface = surface_of(mesh)
        within = [set(range(part + 1, end)) for part, end in enumerate(surface.ends)]
        for part, height in enumerate(surface.heights):
            assert height == max((surface.heights[each] + 1 for each in within[part]), default=0)
        depths = [sum(part in each for each in within) for part in range(len(within))]
        assert surface.heights[0] == max(depths) > 0


@pytest.mark.parametrize(
    ("name", "overrides", "touches"),
    [
        ("two_balloons", {}, True),
        ("two_balloons", {"touch": True}, True),
        ("two_balloons", {"touch": False}, False),
        ("two_balloons", {"touch": {"friction": 0.1}}, True),
        ("pop", {}, False),
        ("two_balloons", {"solver": "projective"}, False),
        ("two_balloons", {"change": [{"time": 0.1, "set": {"solver": "projective"}}]}, False),
    ],
)
def test_balloons_touch_unless_the_scene_says_not_or_they_cannot(name: str, overrides: dict[str, Any], touches: bool):
    """Contact is off by default for balloons that may burst, and for a solver without contact between them."""
    scene = load_scene(name, overrides)
    assert len(scene.balloon) > 1
    assert scene.touches is touches


def test_a_field_of_touch_asks_for_it_and_false_is_written_and_read(tmp_path: Path):
    apart = load_scene("two_balloons", {"touch": False})
    assert override_scene(apart, [("touch.friction", 0.1)]).touches
    varied = plan_model(load_scene("two_balloons"), 2, {"touch.friction": [0.1, 0.5]})
    assert varied.parameters["touch_friction"].ravel().tolist() == [0.1, 0.5]
    with pytest.raises(InputError, match="touch"):
        plan_model(apart, 2, {"touch.friction": [0.1, 0.5]})
    write_scene(apart, tmp_path / "apart.toml")
    assert load_scene(tmp_path / "apart.toml").touch is False


def test_touch_by_default_hardly_shortens_the_step():
    """Default contact uses the margin of "auto" before it shortens the step."""
    scene = load_scene("two_balloons")
    apart, touching = (plan_model(scene.model_copy(update={"touch": said})).substeps for said in (False, None))
    assert apart <= touching <= 1.15 * apart


@pytest.mark.full
@pytest.mark.parametrize(("name", "itself"), [("foil_letters", True), ("letter_slot", False), ("two_balloons", False)])
def test_foil_touches_itself_by_default(name: str, itself: bool):
    """Foil folds anywhere, so it touches itself; sheets that resist bending do not, nor do balls."""
    assert plan_model(load_scene(name)).scene.touches_itself is itself


@pytest.mark.parametrize("cells", [4, 12])
def test_a_ball_of_limp_triangles_is_no_foil(cells: int):
    """Triangles have detours between neighbors, coarse ones long ones, but lie on no others."""
    quads = quad_sphere(cells)
    mesh = mesh_of(quads.points, triangles_of(quads))
    assert bends_freely(balloon := Balloon(mesh=mesh, stiffness=LIMP))
    assert not plan_model(Scene(balloon=[balloon])).scene.touches_itself


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_what_faces_itself_across_a_small_gap_is_near(scale: float):
    """A hook is near itself once its ends grow across the gap: a tube of radius 0.25 m grows by some 0.03 m outward at
    a stretch of 1.1, and three times as much at 1.3. The sides of a groove are near along the surface too, and those of
    a thin wall face away from each other."""
    groove = quad_sphere(8)
    across, dented = np.abs(groove.points[:, 0]), groove.points.copy()
    dented[:, 1] -= np.where((dented[:, 1] > 0.0) & (across < 0.15), 0.5 * (0.15 - across), 0.0)
    for mesh, stretch, near in [
        (hook(0.05), 0.1, True),
        (hook(0.2), 0.1, False),  # the gap is wider than the ends grow
        (hook(0.2), 0.5, True),
        (quad_sphere(6), 0.1, False),
        (cube(), 0.1, False),
        (grid(4, 4), 0.1, False),  # has no inside
        (replace(groove, points=dented), 0.1, False),
        (replace(groove, points=groove.points * np.array([1.0, 0.02, 1.0])), 0.1, False),
    ]:
        turned = mesh.points[:, [2, 0, 1]] * scale + 5.0 * scale
        assert nears_itself(replace(mesh, points=turned), stretch) == near


NEAR, FAR = Balloon(mesh=hook(0.05)), Balloon(mesh=quad_sphere(4), position=(3.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("scene", "itself"),
    [
        ((hook(0.05), {}), True),
        ((hook(0.2), {"balloon.inflation.stretch": 0.5}), True),
        ((hook(0.2), {}), False),
        ((quad_sphere(4), {}), False),
        *((Scene(balloon=[NEAR], touch=touch), True) for touch in (None, Touch(), Touch(friction=0.1, spheres=False))),
        (Scene(balloon=[FAR, NEAR]), True),
        (Scene(balloon=[FAR], touch=Touch()), False),
        (Scene(balloon=[NEAR], solver="projective"), False),
        (Scene(balloon=[NEAR], touch=False), False),
        (Scene(balloon=[NEAR], touch=Touch(itself=False)), False),
    ],
)
def test_a_balloon_touches_itself_where_it_is_near(scene: Scene | tuple[PolygonMesh, dict], itself: bool):
    """Self-contact is on where an inflated skin comes near itself, of a mesh by itself, too, unless the scene disables
    it or cannot have it; the scene's other settings stay."""
    scene = scene if isinstance(scene, Scene) else load_scene(*scene)
    touch = plan_model(scene).scene.touch
    assert (isinstance(touch, Touch) and touch.itself is True) == itself
    if itself and isinstance(touch, Touch):
        assert touch.model_copy(update={"itself": "auto"}) == (scene.touch or Touch())


@pytest.mark.full
@pytest.mark.physics
def test_strands_that_sag_into_each_other_are_kept_apart():
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


def sheet(tilt: float, height: float = 0.0) -> PolygonMesh:
    """Return a sheet of 4 by 4 quads about the origin, which rises along x, lifted by a height [m]."""
    flat = grid(4, 4)
    along, beside = (flat.points[:, :2] / 4.0 - 0.5).T
    return replace(flat, points=np.stack([along, tilt * along + height, beside], axis=1))


def told(*meshes: PolygonMesh, **touch: Any) -> list[str]:
    """Return the warnings on touching of balloons of limp sheets."""
    balloons = [Balloon(mesh=each, stiffness=LIMP, inflation=Inflation(pressure=0.0)) for each in meshes]
    warnings = plan_model(Scene(balloon=balloons, touch=Touch(**touch), substeps=50)).warnings
    return [each for each in warnings if each.startswith("touch:")]


def test_sheets_that_start_crossed_are_named():
    """A tilted sheet goes through a flat one along x = -0.15 m: nearest are particles at x = -0.25 m, 20 mm below."""
    flat, tilted = sheet(0.0), sheet(0.2, 0.03)
    (of_two,) = told(flat, tilted)
    (of_one,) = told(joined(flat, tilted), itself=True)
    for sentence, words in (
        (of_two, (" cross at the start", "touch.balloons = false")),
        (of_one, ("cross each other at the start", "touch.itself = false")),
    ):
        assert "up to 0.02 m near (-0.15, 0, " in sentence
        assert all(word in sentence for word in words)


def test_what_is_apart_pushed_apart_or_does_not_touch_is_not_named():
    """Closed balloons that overlap at the start are pushed apart. Two sheets that meet at a seam do not cross there."""
    flat, lifted, up = sheet(0.0), sheet(0.2, 0.03), sheet(0.3)
    assert told(flat, sheet(0.2, height=0.2)) == []
    round_one = quad_sphere(2)
    assert told(round_one, replace(round_one, points=round_one.points + [0.3, 0.2, 0.1])) == []
    assert told(joined(flat, lifted), itself=False) == []
    both = joined(flat, replace(up, points=up.points + [1.0, 0.15, 0.0]))
    assert len(find_crossings(both.points, triangles_of(both)).triangles) == 0
