"""Contact of bodies in the reference, crossings of surfaces, and lists of contacts that are too short at first."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from feature_sets import GROUND, feature_set, varied
from gradient_losses import far
from gradient_scenes import CASES
from meshes import box, grid, joined, mesh_of, quad_sphere
from rigid import SPACE, body_state, scene_of
from trajectories import after_frames, arrays

import balloon_warp as bw
from balloon_warp import Balloon, Body, Ground, Inflation, Obstacle, Scene, Simulator, Sphere, bundled_scenes, load_mesh
from balloon_warp.kernels.schedules.launched import acts_on_few, is_tested_ahead
from balloon_warp.kernels.working import OF_TRIANGLES
from balloon_warp.lab.reference import Reference
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import crossings_of
from balloon_warp.mesh.topology import triangulate
from balloon_warp.scene import load_scene
from balloon_warp.schedules import touch_table


def test_a_sphere_that_has_yet_to_begin_waits_above_the_ground():
    waits = Sphere(position=(0.0, 2.0, 0.0), radius=0.2, velocity=(2.0, 0.0, 0.0), start=1.0)
    balloon = Balloon(mesh=quad_sphere(2))
    reference = Reference(Scene(balloon=[balloon], sphere=[waits], ground=Ground(height=-1.0), contact="impulse"))
    reference.frame()
    assert reference.spheres[0]["position"] == pytest.approx((0.0, 2.0, 0.0))


RUBBING: dict[str, Any] = {"size": (0.2, 0.3, 0.15), "restitution": 1.0, "friction": 0.5}
FIRM = {"structural": 100.0, "shear": 50.0, "flexion": 20.0}
BODIES = {
    "two rub and rebound": (1e-5, scene_of(
        Body(position=(-0.4, 0.05, 0.0), rotation=(20.0, 30.0, 10.0), velocity=(3.0, 0.0, 0.0), mass=1.0,
             angular_velocity=(5.0, -4.0, 3.0), **RUBBING),
        Body(position=(0.4, 0.0, 0.0), rotation=(50.0, 10.0, 70.0), velocity=(-1.0, 0.0, 0.0), mass=3.0, **RUBBING),
        frames_per_second=24.0, substeps=8, frames=8, **SPACE,
    )),
    "a balloon and a sphere hit one": (2e-6, Scene(
        balloon=[Balloon(mesh=quad_sphere(3, 0.5), position=(0.0, 1.0, 0.0), velocity=(0.0, -2.0, 0.0), mass=0.05,
                         inflation=Inflation(pressure=50.0), stiffness=FIRM)],
        body=[Body(size=(0.8, 0.4, 0.4), mass=0.5, position=(0.1, 0.2, 0.05), rotation=(0.0, 20.0, 0.0),
                   velocity=(0.3, 0.0, 0.1), angular_velocity=(0.0, 2.0, 0.0))],
        sphere=[Sphere(radius=0.1, mass=0.1, position=(0.4, 0.7, 0.05), velocity=(0.0, -4.0, 0.0), friction=0.4)],
        frames=4, frames_per_second=100.0, substeps=10, faces=True, ground=Ground(),
    )),
}  # fmt: skip
"""Tolerance of bodies' places [m], some roundings of 40 to 64 steps; and boxes of restitution 1, whose rebound with
friction would give energy, or one on the ground that is hit from above"""


@pytest.mark.full
@pytest.mark.parametrize("name", BODIES)
def test_bodies_move_as_the_product_moves_them(name: str, device: str):
    most, of = BODIES[name]
    simulator, reference = Simulator(of, device, schedule="gather"), Reference(of)
    for _ in range(of.frames):
        simulator.step_unread()
        reference.frame()
    for field, atol in (("position", most), ("velocity", 1e-4)):
        expected = [body[field] for body in reference.bodies]
        np.testing.assert_allclose(body_state(simulator, f"{field}s".replace("ys", "ies")), expected, atol=atol)
    np.testing.assert_allclose(simulator.state.points.numpy()[0], reference.x, atol=1e-5)
    spheres = np.reshape([each["position"] for each in reference.spheres], (-1, 3))
    np.testing.assert_allclose(simulator.state.sphere_positions.numpy()[0], spheres, atol=2e-6)


SHORT = 4
"""Length of short lists of triangles, whole fours; of others it is 1"""


@pytest.mark.full
def test_worlds_that_share_the_ground_move_as_one_does(device: str):
    """A ball falls on one that lies on the ground, of which all worlds read one row, far below balloons."""
    still = {"velocity": (0.0, 0.0, 0.0), "angular_velocity": (0.0, 0.0, 0.0), "restitution": 0.5}
    balls = [still | {"position": (0.02, 0.26, 0.0)}, still | {"position": (0.0, -0.245, 0.0)}]
    places = {f"sphere.{n}.{name}": value for n, ball in enumerate(balls) for name, value in ball.items()}
    places |= {f"balloon.{n}.position": (0.0, 9.0 * (n + 1.0), 0.0) for n in range(2)}
    scene = varied("paper", places)
    alone, beside = (Simulator(scene, device, worlds, schedule="scatter") for worlds in (1, 3))
    for simulator in (alone, beside):
        for _ in range(24):
            simulator.step_unread()
    for name in ("sphere_positions", "sphere_velocities", "sphere_spins"):
        expected, found = (getattr(each.state, name).numpy() for each in (alone, beside))
        np.testing.assert_array_equal(found, np.broadcast_to(expected, found.shape))
    heights, radii = alone.state.sphere_positions.numpy()[0, :, 1], [ball.radius for ball in scene.sphere]
    assert heights[1] > GROUND["height"] + radii[1] - 1e-4
    assert np.abs(alone.state.sphere_velocities.numpy()).max() > 1e-3


@pytest.fixture
def short_lists(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Make lists short at first."""
    usual = touch_table.first_lengths

    def shortened(model, features) -> dict[str, int]:
        first = usual(model, features)
        return {name: min(length, SHORT if name == "candidates" else 1) for name, length in first.items()}

    monkeypatch.setattr(touch_table, "first_lengths", shortened)
    return monkeypatch


@pytest.mark.parametrize(
    ("name", "lists"),
    [("touch", {"candidates", "edge_pairs", "listed_contacts"}), ("faces", {"ridge_pairs", "listed_contacts"})],
)
def test_lists_that_grow_change_no_bit(name: str, lists: set[str], device: str, short_lists: pytest.MonkeyPatch):
    """A frame that finds no room is computed again: worlds, in a batch and alone, are as with room from the start."""
    own, gravities = "octets" if device == "cpu" else "gather", [9.81, 2.0, 9.81]
    vary = {"gravity": gravities}
    if feature_set(name).sphere:  # of which each world then has its own row
        vary["sphere.0.radius"] = 3 * [feature_set(name).sphere[0].radius]
    batch = Simulator(feature_set(name), device, 3, vary, schedule=own)
    alone = Simulator(load_scene(feature_set(name), {"gravity": gravities[0]}), device, schedule=own)
    short_lists.undo()
    roomy = Simulator(load_scene(feature_set(name), {"gravity": gravities[0]}), device, schedule=own)
    for simulator in (batch, alone, roomy):
        for _ in range(3):
            simulator.step_unread()
        assert simulator.warnings == roomy.warnings
        assert not simulator.schedule.overflow
    assert set(batch.model.contact_room) == set(alone.model.contact_room) == lists
    assert not roomy.model.contact_room
    for field in ("points", "velocities", "sphere_positions", "frame"):
        expected = getattr(roomy.state, field).numpy()
        np.testing.assert_array_equal(getattr(alone.state, field).numpy(), expected)
        if field != "frame":
            np.testing.assert_array_equal(getattr(batch.state, field).numpy()[[0, 2]], np.repeat(expected, 2, axis=0))


@pytest.mark.full
def test_gradients_have_the_lists_that_frames_have_come_to_need(device: str, short_lists: pytest.MonkeyPatch):
    of, path = CASES["touch in a crowd"].scene, "balloon.1.velocity.1"
    found = bw.gradient(of, of=[path], loss=far, device=device)
    short_lists.undo()
    expected = bw.gradient(of, of=[path], loss=far, device=device)
    assert (found.loss, found.gradients[path]) == (expected.loss, expected.gradients[path])
    for name in ("by_points", "by_velocities"):
        np.testing.assert_array_equal(*(np.concatenate(getattr(each, name)) for each in (found, expected)))


def test_a_world_that_blows_up_makes_no_list_grow(device: str):
    """Everything is near everything, and ignored contacts are not told."""
    simulator = Simulator(feature_set("touch"), device, schedule="gather")
    lists = simulator.schedule.contact_lists
    assert lists
    working = lists._working
    for bad in (True, False):
        simulator.state.first_bad.fill_(0 if bad else touch_table.HEALTHY)
        needs = np.zeros(working.needs.shape, dtype=np.int32)
        needs[0, int(OF_TRIANGLES)] = 1000
        working.needs.assign(needs)
        working.overflow.fill_(960)
        assert lists.grow(simulator.state) != bad
        assert lists.ignored == 0
        assert simulator.model.contact_room == ({} if bad else {"candidates": 1504})


BALL, SHEET = quad_sphere(4), grid(4, 4)
QUADS = BALL.face_vertex_indices.reshape(-1, 4).tolist()
RISING = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def pulled(x: float = 0.0, y: float = 0.0) -> PolygonMesh:
    """Return a ball whose top is pulled through its bottom, straight down or a little aside."""
    points, top = BALL.points.copy(), BALL.points[:, 2] > 0.6
    points[top] += [x, y, -2.6]
    return replace(BALL, points=points)


def cubes(*center: float, size: float = 1.0) -> PolygonMesh:
    """Return a cube, and another one at some center."""
    return joined(box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), box(center, (size, size, size)))


def needle(tip: float) -> PolygonMesh:
    """Return a flat box and a pyramid whose tip is at that height over it."""
    base = [(x, y, 2.0) for x, y in ((-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (-0.3, 0.3))]
    pyramid = mesh_of([*base, (0.0, 0.0, tip)], [[0, 1, 2, 3], *([k, 4, (k + 1) % 4] for k in range(4))])
    return joined(box((0.0, 0.0, -0.5), (2.0, 2.0, 1.0)), pyramid)


def with_slivers() -> PolygonMesh:
    """Return a slab whose top is cut finer along one line, with triangles of no area between."""
    xs = np.linspace(0.0, 1.0, 9)
    points = [(x, 0.0, 0.0) for x in xs] + [(0.0, -1.0, 0.0), (1.0, -1.0, 0.0)] + [(x, 1.0, 0.0) for x in xs]
    fine = [[k, k + 1, 12 + k, 11 + k] for k in range(8)]
    slivers = [[0, k + 1, k] for k in range(1, 8)]
    return mesh_of(points, [[9, 10, 8, 0], *slivers, *fine])


CROSSING = {
    "edge on edge": pulled(),
    "edge on edge, of triangles": mesh_of(pulled().points, triangulate(pulled())[0].tolist()),
    "aside": pulled(0.1, 0.07),
    "in a plane of symmetry": pulled(0.0, 0.07),
    "corner on corner": cubes(0.5, 0.5, 0.5),
    "sides in one plane": cubes(0.5, 0.0, 0.0),
    "vertex in a side": cubes(0.25, 0.25, 0.25, size=0.5 + 1e-3),
    "edges in sides": cubes(0.5, 0.25, 0.0),
    "a cross": joined(box((0.0, 0.0, 0.0), (3.0, 1.0, 1.0)), box((0.0, 0.0, 0.0), (1.0, 3.0, 1.0))),
    "a needle": needle(-0.1),
    "vertices that coincide": joined(SHEET, replace(SHEET, points=SHEET.points[:, [0, 2, 1]] + [0, 2, -2])),
}
TOUCHING = {
    "a ball": BALL,
    "side on side": cubes(1.0, 0.0, 0.0),
    "side on a part of a side": cubes(0.75, 0.1, 0.0, size=0.5),
    "edge on edge": cubes(1.0, 1.0, 0.0),
    "corner on corner": cubes(1.0, 1.0, 1.0),
    "a needle": needle(0.0),
    "a repeated face": mesh_of(BALL.points, [*QUADS, QUADS[0]]),
    "a seam": joined(SHEET, replace(SHEET, points=SHEET.points + [4, 0, 0])),
    "a seam where it bends": joined(SHEET, replace(SHEET, points=SHEET.points @ RISING + [4, 0, 0])),
    "slivers": with_slivers(),
    "a squirrel": load_mesh(bundled_scenes()["squirrel_inflate"].with_name("squirrel.obj")),
}
MIRRORED, SWAPPED = np.diag([-1.0, 1.0, 1.0]), np.eye(3)[[2, 1, 0]]
TURNED = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def counts(mesh: PolygonMesh) -> list[int]:
    """Return the crossings of a mesh as it is, mirrored, with axes swapped, and turned, far off, with other numbers."""
    new = np.random.default_rng(1).permutation(mesh.vertex_count)
    turned = np.empty_like(mesh.points)
    turned[new] = 0.01 * mesh.points @ TURNED.T + [0.3, -2.0, 7.0]
    other = replace(mesh, points=turned, face_vertex_indices=new[mesh.face_vertex_indices].astype(np.int32))
    posed = [replace(mesh, points=mesh.points @ pose) for pose in (np.eye(3), MIRRORED, SWAPPED)]
    return [len(crossings_of(each).edges) for each in (*posed, other)]


@pytest.mark.parametrize("name", CROSSING)
def test_what_goes_through_itself_crosses_in_whatever_pose(name: str):
    assert min(counts(CROSSING[name])) > 0


@pytest.mark.parametrize("name", TOUCHING)
def test_what_only_touches_itself_does_not_cross_in_any_pose(name: str):
    assert max(counts(TOUCHING[name])) == 0


FRAMES = 10
LID = 1.002  # height of the plane above the ball, which swells to it [m]


RESTING = Balloon(mesh=quad_sphere(10, 0.5), position=(0.0, 0.501, 0.0), inflation=Inflation(k_normal=2.0))
"""of more than 512 particles, part of a list of its own"""
FLOOR = Obstacle(size=(3.0, 1.0, 3.0), position=(0.0, -0.5, 0.0))
CEILING = Obstacle(shape="plane", position=(0.0, LID, 0.0), rotation=(0.0, 0.0, 180.0))


@pytest.mark.full
@pytest.mark.parametrize(("changed", "is_told"), [({}, True), ({"correction": "provot"}, False)], ids=["told", "asked"])
def test_a_list_of_those_that_leave_obstacles_changes_nothing(changed, is_told, device, monkeypatch):
    """Whoever moves a particle notes it, or where others move it after that, the list asks for itself."""
    scene = Scene(balloon=[RESTING], obstacle=[FLOOR, CEILING], **changed)
    expected = arrays(after_frames(scene, "gather", device, FRAMES, worlds=3))
    monkeypatch.setattr("balloon_warp.schedules.gather.has_many", lambda model: True)
    simulator = after_frames(scene, "gather", device, FRAMES, worlds=3)
    step = simulator.schedule.launches.step
    (piece,) = (piece for piece in step.pieces if acts_on_few(step, piece))
    assert is_tested_ahead(step, piece) == is_told
    found = arrays(simulator)
    heights = found["points"][0, :, 1]
    assert np.isclose(heights, 0.0, atol=1e-6).any()
    assert np.isclose(heights, LID, atol=1e-6).any()
    np.testing.assert_equal(found, expected)
