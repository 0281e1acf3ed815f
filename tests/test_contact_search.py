"""Searches for contact, of boxes and spheres; contact by default, of others and itself; placement of balloons."""
# pyright: reportGeneralTypeIssues=false

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import trimesh
import warp as wp
from feature_sets import feature_set
from meshes import box, cube, grid, hook, joined, mesh_of, quad_sphere
from scipy.spatial.transform import Rotation

from balloon_warp import (
    Balloon,
    InputError,
    PolygonMesh,
    Scene,
    Simulator,
    String,
    Touch,
    load_scene,
)
from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.contact.boxes import (
    lining_function,
    nearing_function,
)
from balloon_warp.kernels.contact.search import next_of_eight
from balloon_warp.kernels.contact.spheres import part_until_face
from balloon_warp.kernels.laws.contact import NEVER
from balloon_warp.kernels.laws.touch import facing_of, part_until_contact
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working
from balloon_warp.lab.reference.contact import point_triangle
from balloon_warp.mesh.crossings import find_crossings
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.thickness import nears_itself, standing
from balloon_warp.mesh.topology import triangulate
from balloon_warp.model import build_model, plan_model
from balloon_warp.model.shape import shape_balloon
from balloon_warp.model.touch import bends_freely
from balloon_warp.scene import Inflation, Stiffness
from balloon_warp.scene.load import override_scene, write_scene


def bent(mesh: PolygonMesh, radius: float) -> np.ndarray:
    """Return the points of a tube along x, bent to an arc, turned, moved and larger."""
    x, y, z = mesh.points.T
    arc = np.stack([(radius - y) * np.sin(x / radius), radius - (radius - y) * np.cos(x / radius), z], axis=1)
    return 1.2 * Rotation.from_euler("xyz", [20.0, 40.0, 70.0], degrees=True).apply(arc) + 3.0


def test_a_particle_looks_at_the_balloons_whose_boxes_its_way_meets():
    """Boxes are compared one by one as on a GPU, and eight at a time as on a CPU, by ways beyond their padding."""
    simulator = Simulator(feature_set("touch"), "cpu", schedule="gather")
    simulator.step_unread()
    t, working, features = simulator.schedule.tables, simulator.schedule.launches.working, simulator.schedule.features
    is_nearing, line_up = nearing_function(features), lining_function(features)
    count, balloons = simulator.model.particle_count, simulator.model.balloon_count

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def list_near_ridges(
        t: Tables,  # pyright: ignore[reportGeneralTypeIssues]
        working: Working,  # pyright: ignore[reportGeneralTypeIssues]
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        found: wp.array3d[wp.int32],
    ):
        for particle in range(points.shape[1]):
            balloon = t.particles.balloon[particle]
            point = points[0, particle]
            velocity = velocities[0, particle]
            line_up(t, working, 0, particle, particle - 1)
            for other in range(found.shape[2]):
                if is_nearing(t, working, 0, balloon, other, point, velocity):
                    found[0, particle, other] = 1
            other, place = next_of_eight(t, working, 0, balloon, 0, point, velocity)
            while other >= 0:
                found[1, particle, other] = found[1, particle, other] + 1
                other, place = next_of_eight(t, working, 0, balloon, place, point, velocity)

    working.neighbors.assign(np.tile(np.arange(balloons), (1, balloons, 1)))
    working.neighbor_counts.fill_(balloons)
    velocities = 80.0 * np.random.default_rng(3).uniform(-1.0, 1.0, (1, count, 3))
    found = wp.zeros((2, count, balloons), dtype=wp.int32, device="cpu")
    given = wp.array(velocities, dtype=wp.vec3, device="cpu")
    wp.launch(list_near_ridges, 1, [t, working, simulator.state.points, given, found], device="cpu")
    start, own = simulator.state.points.numpy()[0], t.particles.balloon.numpy()
    ends = np.stack([start, start + t.touch.seconds * velocities[0]])
    boxes, pads = working.balloon_boxes.numpy()[0], 0.5 * t.touch.thickness.numpy() + t.touch.slack.numpy()
    apart = np.maximum(ends.min(axis=0)[:, None] - boxes[:, 1], boxes[:, 0] - ends.max(axis=0)[:, None]).max(axis=2)
    expected = apart <= pads[own][:, None] + pads
    np.testing.assert_array_equal(found.numpy(), np.broadcast_to(expected, found.shape))
    assert 0.1 < expected.mean() < 0.6


@wp.kernel(enable_backward=False)
def meet_all(
    t: Tables, starts: wp.array[wp.mat33], ends: wp.array[wp.mat33], centers: wp.array2d[wp.vec3],
    radii: wp.array[float], corners: wp.array2d[wp.vec3], found: wp.array2d[float],
):  # fmt: skip
    i = wp.tid()
    facing = facing_of(centers[0, i], centers[1, i], radii[i], starts[i], ends[i])
    part, looks = part_until_contact(facing, radii[i])
    found[0, i] = part
    found[1, i] = float(looks)
    found[2, i] = part_until_face(t, i, centers[0, i], centers[1, i], radii[i], 1.0, corners[0], corners[1])


def test_a_sphere_that_comes_through_a_triangle_is_met_before_half_its_radius():
    """A sphere is met nearer than its radius, and never by half of that, as steps go no further than by half of the
    distance; judged by 4,000 looks on the way. Boxes around the ways hide none of these meetings."""
    rng, count = np.random.default_rng(6), 400
    starts = rng.normal(size=(count, 3, 3))
    ends, centers = starts + rng.normal(size=starts.shape), 1.5 * rng.normal(size=(2, count, 3))
    radii = rng.uniform(0.1, 0.4, count)
    found, t = wp.zeros((3, count), dtype=float, device="cpu"), Tables()
    t.spheres.triangles = wp.array(np.arange(3 * count).reshape(-1, 3), dtype=wp.vec3i, device="cpu")
    of_types = ((starts, wp.mat33), (ends, wp.mat33), (centers, wp.vec3), (radii, float))
    given = [wp.array(values, dtype=kind, device="cpu") for values, kind in of_types]
    corners = wp.array(np.stack([starts, ends]).reshape(2, -1, 3), dtype=wp.vec3, device="cpu")
    wp.launch(meet_all, count, [t, *given, corners, found], device="cpu")
    parts = np.linspace(0.0, 1.0, 4001)[:, None, None]

    def distance(part: np.ndarray) -> np.ndarray:
        corners, center = starts + part[..., None] * (ends - starts), centers[0] + part * (centers[1] - centers[0])
        at = np.concatenate([center[..., None, :], corners], axis=-2).reshape(-1, 4, 3)
        return np.linalg.norm((point_triangle(at) * at).sum(axis=1), axis=1).reshape(-1, count)

    away, (told, looks, of_faces) = distance(parts) / radii, found.numpy()
    outside, met = away[0] > 1.0, told <= 1.0
    near = distance(told[None, :, None])[0] / radii
    assert met[outside & (away < 0.5).any(axis=0)].all()
    assert (near[outside & met] > 0.5 - 1e-4).all()
    assert (near[met] < 1.0 + 1e-4).all()
    np.testing.assert_array_equal(told[(away > 1.0).all(axis=0)], float(NEVER))
    np.testing.assert_array_equal(of_faces, told)
    np.testing.assert_array_equal(looks[told == 0.0], 1.0)
    assert (looks[met & (told > 0.0)] > 1.0).all()
    assert min((outside & met).sum(), (~met).sum()) > 50


LIMP = Stiffness(structural=50.0, shear=25.0, flexion=0.0)


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


BESIDE, FAR = Balloon(mesh=hook(0.05)), Balloon(mesh=quad_sphere(4), position=(3.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("scene", "itself"),
    [
        ((hook(0.05), {}), True),
        ((hook(0.2), {"balloon.inflation.stretch": 0.5}), True),
        *(
            (Scene(balloon=[BESIDE], touch=touch), True)
            for touch in (None, Touch(), Touch(friction=0.1, spheres=False))
        ),
        (Scene(balloon=[FAR, BESIDE]), True),
        (Scene(balloon=[FAR], touch=Touch()), False),
        (Scene(balloon=[BESIDE], solver="projective"), False),
        (Scene(balloon=[BESIDE], touch=False), False),
        (Scene(balloon=[BESIDE], touch=Touch(itself=False)), False),
    ],
)
def test_a_balloon_touches_itself_where_it_is_near(scene: Scene | tuple[PolygonMesh, dict], itself: bool):
    scene = scene if isinstance(scene, Scene) else load_scene(*scene)
    touch = plan_model(scene).scene.touch
    assert (isinstance(touch, Touch) and touch.itself is True) == itself
    if itself and isinstance(touch, Touch):
        assert touch.model_copy(update={"itself": "auto"}) == (scene.touch or Touch())


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


def test_rotations_go_about_x_then_y_then_z():
    mesh = mesh_of([(1, 2, 3), (0, 0, 0), (1, 0, 0)], [[0, 1, 2]])

    def placed(x: float, y: float, z: float) -> list[float]:
        balloon = Balloon(mesh=mesh, rotation=(x, y, z), scale=2.0, position=(10, 20, 30))
        points = shape_balloon(balloon, Scene(balloon=[balloon])).mesh.points
        return ((points[0] - [10, 20, 30]) / 2.0).tolist()

    assert placed(90, 90, 0) == pytest.approx([2, -3, -1], abs=1e-12)  # y first would give (3, 1, 2)
    assert placed(0, 90, 90) == pytest.approx([-2, 3, -1], abs=1e-12)  # z first would give (3, 1, 2)
    assert placed(90, 90, 90) == pytest.approx([3, 2, -1], abs=1e-12)  # z first would give (3, -1, 2)


@pytest.mark.parametrize(("particle", "height"), [("highest", 1.0), ("lowest", 0.0)])
def test_a_string_holds_a_particle_of_a_face(particle: Literal["highest", "lowest"], height: float):
    mesh = joined(mesh_of([(0, 50, 0), (0, -50, 0)], []), cube())  # after two vertices of no face
    scene = Scene(balloon=[Balloon(mesh=mesh)], string=[String(anchor=(0, -2, 0), particle=particle)])
    model = build_model(scene, "cpu")
    held = int(model.string_particle.numpy()[0])
    assert held >= 2
    assert mesh.points[held, 1] == height
    # the length was missing: the distance to that particle
    length = np.linalg.norm(mesh.points[held] - [0, -2, 0])
    assert model.parameters["string_length"].numpy()[0, 0] == pytest.approx(length, rel=1e-6)


def figure(up: str) -> PolygonMesh:
    """Return a ball on a flat foot, upright along an axis."""
    foot = box((0.0, 0.0, -1.2), (2.0, 2.0, 0.4))
    ball = quad_sphere(3)
    whole = joined(foot, ball)
    return whole if up == "Z" else replace(whole, points=whole.points[:, [0, 2, 1]] * [1.0, 1.0, -1.0])


BALL, SLAB = quad_sphere(3), box((0.0, 0.0, 0.0), (4.0, 0.2, 3.0))
FOOT, CUSTOM = "which has its widest flat side below", "as by custom in STL files"


@pytest.mark.parametrize(
    ("mesh", "suffix", "expected"),
    [
        pytest.param(figure("Z"), ".stl", ("Z", FOOT), id="a figure that is to be printed"),
        pytest.param(figure("Y"), ".stl", ("Y", FOOT), id="a figure with Y up"),
        pytest.param(figure("Y"), ".PLY", ("Y", FOOT), id="a scan with Y up"),
        pytest.param(SLAB, ".stl", ("Y", FOOT), id="a slab lies"),
        pytest.param(box((0, 0, 0), (0.2, 0.2, 4)), ".stl", ("Z", CUSTOM), id="a rod"),
        pytest.param(BALL, ".stl", ("Z", CUSTOM), id="nothing flat"),
        pytest.param(BALL, ".off", None, id="nothing flat, and no custom"),
        pytest.param(figure("Z"), ".obj", None, id="OBJ has Y up by custom"),
        pytest.param(replace(figure("Z"), up_known=True), ".stl", None, id="up is known"),
    ],
)
def test_a_shape_stands_on_its_widest_flat_side(mesh: PolygonMesh, suffix: str, expected: tuple[str, str] | None):
    assert standing(mesh, suffix) == expected


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_a_mesh_by_itself_stands_and_says_why(up: str, tmp_path: Path):
    mesh, path = figure(up), tmp_path / "figure.stl"
    trimesh.Trimesh(mesh.points, triangulate(mesh)[0], process=False).export(path)
    scene = load_scene(path)
    assert (scene.up_axis, scene.balloon[0].up) == (up, up)
    other = "Y" if up == "Z" else "Z"
    assert scene.description.endswith(f"names no up axis, so {up} is up, {FOOT}; --up {other} turns it")
    turned = load_scene(path, {"balloon.up": other})
    assert (turned.up_axis, turned.balloon[0].up) == (other, other)
    assert turned.description.endswith(f"{other} is up, as given")


@pytest.mark.full
@pytest.mark.parametrize(("name", "itself"), [("foil_letters", True), ("letter_slot", False), ("two_balloons", False)])
def test_foil_touches_itself_by_default(name: str, itself: bool):
    """Foil folds anywhere, so it touches itself; sheets that resist bending do not, nor do balls."""
    assert plan_model(load_scene(name)).scene.touches_itself is itself
