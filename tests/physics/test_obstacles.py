"""Obstacles with given motion, against closed forms: nothing passes them, at any speed, angle and thickness, and
sliding particles obey Coulomb; and with the motion of a USD stage. Particles without springs are independent."""
# pyright: reportGeneralTypeIssues=false

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from conserved import put, square
from law_functions import COUNT, LAWS, called, compile_together
from meshes import cube, mesh_of, quad_sphere
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt
from scipy.spatial.transform import Rotation

from balloon_warp import Frame, InputError, PolygonMesh, Simulator
from balloon_warp.kernels.laws.contact import MESH, capsule_surface
from balloon_warp.kernels.loops.paths import first_contact_with_mesh, path_function
from balloon_warp.kernels.tables import Solid
from balloon_warp.mesh.topology import triangulate
from balloon_warp.model import plan_model
from balloon_warp.model.obstacles import obstacle_motion
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Obstacle, Scene, Sphere, Stiffness

HALF = 1.5
"""of a wall's edge [m]"""
FRAME = 1.0 / 60.0
"""[s], here one substep: at 60 m/s a meter"""
SPEEDS = [(2.0, 10.0), (0.05, 30.0), (0.2, 60.0), (1.0, 8.0), (5.0, 5.0), (10.0, 60.0), (60.0, 3.0), (400.0, 400.0)]
"""into the wall and along it [m/s]: from a tenth of a degree to straight on"""
GRAVITY, FRICTION = 9.81, 0.5
FREE: dict[str, Any] = {
    "stiffness": Stiffness(structural=0.0, shear=0.0, flexion=0.0), "inflation": Inflation(k_normal=0.0), "damping": 0.0
}  # fmt: skip


@wp.func
def normal_of_capsule(point: wp.vec3, up: wp.vec3):
    """Return the normal of a capsule of 0.1 m about an axis of 1 m."""
    _distance, normal = capsule_surface(point, 0.1, 0.5, up)
    return normal


compile_together({normal_of_capsule: "vec3"})


@pytest.mark.always
def test_the_normal_of_a_capsule_is_a_unit_vector_on_its_axis_too():
    """Any that is across may be that on the axis."""
    random = np.random.default_rng(0)
    ups = np.eye(3)[random.integers(1, 3, COUNT)]  # y or z, as scenes may have it
    points = random.uniform(-1.0, 1.0, (COUNT, 3))
    points[: COUNT // 2] = random.uniform(-0.4, 0.4, (COUNT // 2, 1)) * ups[: COUNT // 2]
    normals = called(normal_of_capsule, {"point": points.astype(np.float32), "up": ups.astype(np.float32)}, "vec3")
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-6)
    np.testing.assert_allclose((normals * ups).sum(axis=1)[: COUNT // 2], 0.0, atol=1e-6)
    arms = points - np.clip((points * ups).sum(axis=1), -0.5, 0.5)[:, None] * ups
    np.testing.assert_allclose((normals * arms).sum(axis=1), np.linalg.norm(arms, axis=1), atol=1e-6)


@wp.kernel(enable_backward=False, module=LAWS)
def meet_sheet(solid: Solid, paths: wp.array2d[wp.vec3], found: wp.array2d[wp.vec3], parts: wp.array[float]):
    i = wp.tid()
    touch = first_contact_with_mesh(solid, wp.vec3(0.0, 1.0, 0.0), paths[0, i], paths[1, i], 0.0, 10.0)
    found[0, i] = touch.normal
    found[1, i] = touch.place
    parts[i] = touch.part


@pytest.mark.always
def test_a_path_meets_a_sheet_without_thickness_where_it_crosses_it():
    """The sheet is a triangle across x. A path stops before it, by the rounding of so large a mesh."""
    corners = np.array([(0.0, -9.0, -9.0), (0.0, 9.0, -9.0), (0.0, 0.0, 9.0)])
    start, end = paths = np.random.default_rng(3).uniform(-1.0, 1.0, (2, 200, 3))
    end[:, 0] += np.where(end[:, 0] < start[:, 0], -0.2, 0.2)  # no path is along the sheet
    given = wp.array(corners, dtype=wp.vec3, device="cpu"), wp.array([0, 1, 2], dtype=wp.int32, device="cpu")
    mesh, solid, count = wp.Mesh(*given), Solid(), len(start)
    solid.mesh, solid.reach = mesh.id, float(np.linalg.norm(corners, axis=1).max())
    found, parts = wp.zeros((2, count), dtype=wp.vec3, device="cpu"), wp.zeros(count, dtype=float, device="cpu")
    wp.launch(meet_sheet, count, [solid, wp.array(paths, dtype=wp.vec3, device="cpu"), found, parts], device="cpu")
    (normals, places), meets = found.numpy(), (start[:, 0] < 0.0) != (end[:, 0] < 0.0)
    np.testing.assert_array_equal(normals[:, 0], np.where(meets, np.sign(start[:, 0]), 0.0))
    part = (start[:, 0] / (start[:, 0] - end[:, 0]))[meets]
    np.testing.assert_allclose(places[meets], start[meets] + part[:, None] * (end - start)[meets], atol=1e-5)
    np.testing.assert_allclose(parts.numpy()[meets], part, atol=3e-4)
    assert 50 < meets.sum() < count - 50


let_through = path_function(True)


@wp.kernel(enable_backward=False, module=LAWS)
def lead_out(solid: Solid, paths: wp.array2d[wp.vec3], led: wp.array[wp.vec3]):
    i = wp.tid()
    let, _outward, _free, _slides, _part = let_through(solid, wp.vec3(0.0, 1.0, 0.0), paths[0, i], paths[1, i], 0.0)
    led[i] = let


@pytest.mark.parametrize("size", [(1.0, 0.4, 2.5), (1.0, 1.0, 0.12)], ids=["box", "plate"])
def test_who_begins_inside_a_mesh_ends_on_its_surface(size: tuple[float, float, float]):
    """Starts are near sides, edges and corners of a turned box; the tolerance is the lift of paths above a surface."""
    turn, half = Rotation.from_euler("xyz", (20.0, 35.0, 10.0), degrees=True), 0.5 * np.array(size)
    box, random, count = plate(*size), np.random.default_rng(4), 2000
    start = half * random.uniform(-1.0, 1.0, (count, 3))
    nearest = (half - np.abs(start)).argmin(axis=1)
    depth = random.uniform(1e-3, 0.04, count)  # deeper than a tenth of its size a solid looks for no surface
    start[np.arange(count), nearest] = np.sign(start[np.arange(count), nearest]) * (half[nearest] - depth)
    end = start + 0.1 * random.normal(size=(count, 3))
    corners = wp.array(turn.apply(box.points), dtype=wp.vec3, device="cpu")
    mesh = wp.Mesh(corners, wp.array(triangulate(box)[0].ravel(), dtype=wp.int32, device="cpu"))
    solid, led = Solid(), wp.zeros(count, dtype=wp.vec3, device="cpu")
    solid.kind, solid.mesh, solid.closed = int(MESH), mesh.id, 1
    solid.reach, solid.blur = float(np.linalg.norm(half)), 1e-4
    paths = wp.array([turn.apply(start), turn.apply(end)], dtype=wp.vec3, device="cpu")
    wp.launch(lead_out, count, [solid, paths, led], device="cpu")
    beyond = (np.abs(turn.inv().apply(led.numpy())) - half).max(axis=1)
    assert beyond.min() > -1e-5


def crowd(at: tuple, velocity: tuple, size: float = 0.2) -> Balloon:
    """Return 36 free particles of a square across x, without springs or pressure."""
    return Balloon(mesh=square(5, size, axis=0), mass=0.01, position=at, velocity=velocity, **FREE)


def plate(*size: float) -> PolygonMesh:
    """Return a closed box of that size about the origin [m]."""
    return replace(cube(), points=(cube().points - 0.5) * size)


def simulated(device: str, begin: Balloon, **fields: Any) -> list[Frame]:
    """Return the frames of one substep each, without gravity."""
    return list(Simulator(Scene(**{"balloon": [begin], "gravity": 0.0, "substeps": 1} | fields), device).run())


WALLS = {
    "box": (lambda half: {"size": (2.0 * half, 2.0 * HALF, 2.0 * HALF)}),
    "sheet": (lambda half: {"mesh": square(4, 2.0 * HALF, axis=0), "thickness": half}),
    "mesh": (lambda half: {"mesh": plate(2.0 * half, 2.0 * HALF, 2.0 * HALF)}),
    "plane": (lambda half: {"shape": "plane", "position": (-half, 0.0, 0.0), "rotation": (0.0, 0.0, 90.0)}),
}


def expected_end(begin: float, gap: float, into: float, along: float, friction: float, seconds: float) -> float:
    """Return the final place of a particle that flies up to a wall and slides on, slowed by friction."""
    flown = min(gap / into, seconds)
    return begin + flown * along + (seconds - flown) * max(along - friction * into, 0.0)


@pytest.mark.parametrize("kind", WALLS)
@pytest.mark.parametrize(
    ("half", "gap", "friction"),
    [
        (5e-4, 0.05, 0.0),
        (5e-4, 0.05, 0.5),
        *((half, gap, 0.0) for half in (2.5e-4, 1.5e-3, 0.025) for gap in (1e-6, 0.05)),
    ],
)
def test_no_particle_passes_a_wall_of_any_thickness_at_any_angle(
    kind: str, half: float, gap: float, friction: float, device: str
):
    """Particles stop at the wall and slide on by Coulomb's law: within 2 mm. Without friction nothing sticks."""
    for into, along in SPEEDS[1:] if kind == "mesh" else SPEEDS:
        wall = Obstacle(**WALLS[kind](half), friction=friction)
        begin = crowd((-half - gap, -1.0, 0.0), (into, along, 0.0))
        for number, frame in enumerate(simulated(device, begin, obstacle=[wall], frames=6)[1:], start=1):
            place = frame.points[0]
            beside = np.abs(place[:, 1:]).max(axis=1) < HALF - 0.1
            assert (place[beside, 0] <= -half + 2e-5).all()  # of 3 m, float32 tells some micrometers
            assert friction or np.abs(frame.velocities[0][:, 1] - along).max() < 1e-3 * along
            expected = expected_end(-1.0, gap, into, along, friction, number * FRAME)
            if kind != "plane" and expected > HALF - 0.2:
                break  # it has left the wall
            # a skin is seen at most half of it on; a plane rubs for the whole step, as the ground does
            slack = 2e-3 + (friction * into * FRAME if kind == "plane" else 0.0)
            assert place[:, 1].mean() == pytest.approx(expected, abs=slack)


@pytest.mark.always("cpu-0", "cpu-1", "cpu-2")
@pytest.mark.parametrize("axis", range(3))
def test_a_wall_is_looked_for_again_on_a_long_way(axis: int, device: str):
    """Particles fly three meters along an axis to a box, with other coordinates as its side's: an old look tells it."""
    along, size = np.eye(3)[axis], np.full(3, 4.0)
    size[axis] = 2.0
    begin = crowd(tuple(np.ones(3) + 3.0 * along), tuple(-7.0 * along))
    box = Obstacle(size=tuple(size), position=tuple(np.ones(3) - along), friction=0.0)
    places = np.array(
        [frame.points[0][:, axis] for frame in simulated(device, begin, obstacle=[box], frames=40, substeps=8)]
    )
    assert places.min() == pytest.approx(1.0, abs=2e-5)


@pytest.mark.parametrize("kind", WALLS)
def test_what_slides_along_a_wall_or_leaves_it_is_not_held(kind: str, device: str):
    half = 5e-4
    wall = Obstacle(**WALLS[kind](half), friction=0.0)
    beside = crowd((-half - 1e-6, -0.7, 0.0), (0.0, 0.7, 0.0))
    leaves = crowd((-half - 1e-6, -1.0, 0.0), (-0.05, 30.0, 0.0))
    scene = Scene(balloon=[beside, leaves], obstacle=[wall], gravity=0.0, frames=120, substeps=2, touch=False)
    *_, last = Simulator(scene, device).run()
    np.testing.assert_allclose(last.points[0][:, 1].mean(), 0.7, atol=1e-3)
    np.testing.assert_allclose(last.velocities[1][:, :2], [[-0.05, 30.0]] * 36, rtol=1e-5)
    np.testing.assert_allclose(last.points[1].mean(axis=0)[:2], [-half - 0.1, 59.0], rtol=1e-3)


@pytest.mark.parametrize("kind", ["box", "sheet", "mesh"])
@pytest.mark.parametrize("radius", [0.005, 0.1])
def test_no_sphere_passes_a_wall_at_any_angle(kind: str, radius: float, device: str):
    half = 5e-4
    for into, along in SPEEDS:
        wall = Obstacle(**WALLS[kind](half), friction=0.0, restitution=0.0)
        ball = Sphere(radius=radius, mass=1.0, position=(-half - radius - 0.02, -1.0, 0.1), velocity=(into, along, 0.0))
        away = crowd((-50.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        for number, frame in enumerate(simulated(device, away, sphere=[ball], obstacle=[wall], frames=3)):
            place = frame.sphere_positions[0]
            if place[1] < HALF - 0.1:
                assert place[0] <= -half - 0.95 * radius
            assert place[1] == pytest.approx(-1.0 + number * FRAME * along, abs=2e-3)


@pytest.mark.parametrize("body", ["box", "sheet"])
def test_no_particle_passes_a_free_body_at_any_angle(body: str, device: str):
    half = 5e-4
    for into, along in SPEEDS:
        begin = crowd((-half - 0.05, -0.3, 0.0), (into, along, 0.0))
        free = Body(**WALLS[body](half), mass=100.0, friction=0.0)
        for frame in simulated(device, begin, body=[free], frames=3):
            place = frame.points[0]
            beside = np.abs(place[:, 1:]).max(axis=1) < HALF - 0.1
            shifted = place[:, 0] - frame.body_poses[0][0]
            assert (shifted[beside] < 0.5 * half + 2e-3 * into * FRAME).all()  # the body turns by a little


@pytest.mark.parametrize("speed", [20.0, 150.0, 400.0])
@pytest.mark.parametrize("kind", ["box", "sheet"])
def test_a_wall_that_moves_takes_along_what_it_meets(kind: str, speed: float, device: str):
    half = 5e-4
    wall = Obstacle(**WALLS[kind](half), friction=0.0, motion=[(0.0, (0, 0, 0)), (1.0, (-speed, 0, 0))])
    for along in (0.0, 10.0):
        begin = crowd((-half - 0.3, -0.8, 0.0), (0.0, along, 0.0))
        for number, frame in enumerate(simulated(device, begin, obstacle=[wall], frames=3)):
            assert (frame.points[0][:, 0] <= -number * FRAME * speed - half + 2e-5).all()


ANGLE = mesh_of(
    [(-2, 0, -2), (0.5, 0, -2), (0.5, 0, 2), (-2, 0, 2), (0.5, 3, -2), (0.5, 3, 2)], [[0, 1, 2, 3], [1, 4, 5, 2]]
)
UPRIGHT = {"size": (1e-3, 3.0, 3.0), "friction": 0.0}
FLOOR = Obstacle(size=(3.0, 1e-3, 3.0), position=(-1.0, -5e-4, 0.0), friction=0.0)
CORNERS = {
    "boxes": [FLOOR, Obstacle(position=(0.5, 1.45, 0.0), **UPRIGHT)],
    "mesh": [Obstacle(mesh=ANGLE, thickness=1e-3, friction=0.0)],
    "ground": [Obstacle(position=(0.5, 1.5, 0.0), **UPRIGHT)],
}
"""a floor and a wall on it, which stands at x = 0.5"""


@pytest.mark.parametrize("kind", CORNERS)
@pytest.mark.parametrize("swapped", [False, True])
def test_what_slides_on_stops_at_the_next_wall(kind: str, swapped: bool, device: str):
    """Contact with faces is off: free particles would stretch these over meters in a step."""
    obstacles = CORNERS[kind][::-1] if swapped else CORNERS[kind]
    for velocity in ((60.0, -20.0, 0.0), (300.0, -10.0, 5.0), (90.0, -100.0, 2.0)):
        begin = crowd((-0.4, 0.3, 0.0), velocity)
        ground = Ground(friction=0.0) if kind == "ground" else None
        frames = simulated(device, begin, obstacle=obstacles, ground=ground, frames=12, faces=False)
        for frame in frames:
            assert frame.points[0][:, 0].max() < 0.5
            assert frame.points[0][:, 1].min() > -1e-5
        frame = frames[-1]
        assert np.abs(frame.velocities[0][:, 0]).max() < 0.05
        assert frame.velocities[0][:, 1].max() < 0.05  # nothing is thrown up the wall
        assert np.abs(frame.velocities[0][:, 2] - velocity[2]).max() < 1e-3 * velocity[0]  # 0.3 um of a skin of 1 mm


@pytest.mark.parametrize("degrees", [90.0, 40.0])
def test_a_wedge_holds_and_lets_go_along_its_crease(degrees: float, device: str):
    half = np.radians(0.5 * degrees)
    deep, high = 2.0 * np.cos(half), 2.0 * np.sin(half)
    rim = [(0.5 - deep, side * high, z) for side in (1.0, -1.0) for z in (3.0, -3.0)]
    vee = mesh_of([(0.5, 0, -3), (0.5, 0, 3), *rim], [[0, 1, 2, 3], [0, 1, 4, 5]])
    walls = [Obstacle(mesh=vee, thickness=1e-3, friction=0.0)]
    for velocity in ((60.0, 1.0, 0.0), (10.0, 3.0, 5.0), (300.0, 50.0, 1.0)):
        begin = crowd((-0.3, 0.0, 0.0), velocity, 0.1)
        frames = simulated(device, begin, obstacle=walls, frames=16)
        for frame in frames:
            place = frame.points[0]
            within = np.maximum(0.5 - place[:, 0], 0.0) * np.tan(half) + 2e-3
            assert (np.abs(place[:, 1]) < within).all()
        assert frames[-1].velocities[0][:, 2].mean() == pytest.approx(velocity[2], abs=0.05)


@pytest.mark.parametrize("radius", [0.005, 0.1])
def test_what_flies_past_a_post_is_stopped_where_it_cuts_it(radius: float, device: str):
    """A chord, with both ends almost outside, enters 40 degrees from the middle, and slides along the plane there."""
    post = Obstacle(radius=radius, length=2.0, friction=0.0)
    speed = 1.32 * radius / FRAME
    begin = crowd((-2.0, 0.0, 0.0), (speed, 0.0, 0.0), 0.01)
    simulator = Simulator(Scene(balloon=[begin], obstacle=[post], gravity=0.0, substeps=1), device)
    points = np.tile([-0.66 * radius, 0.0, 1.2 * radius], (36, 1))
    sine, cosine = np.sin(np.radians(40.0)), np.cos(np.radians(40.0))
    points[::2, 2] = cosine * radius
    put(simulator, points)
    frame = simulator.step()
    slid = [speed * cosine**2, 0.0, speed * sine * cosine]
    np.testing.assert_allclose(frame.velocities[0][::2], [slid] * 18, atol=2e-3 * speed)
    np.testing.assert_allclose(frame.velocities[0][1::2], [[speed, 0.0, 0.0]] * 18, atol=1e-6 * speed)


def particles(points: np.ndarray | list, **fields) -> Balloon:
    """Return free particles: a quad without springs, inflation or damping."""
    return Balloon(mesh=mesh_of(points, [[0, 1, 2, 3]]), **FREE | fields)


SMALL = [(0, 0, 0), (0, 0, 0.1), (0.1, 0, 0.1), (0.1, 0, 0)]
SLOPES = {
    "plane": lambda **place: Obstacle(shape="plane", **place),
    "box": lambda **place: Obstacle(size=(8.0, 0.2, 8.0), **place),
    "mesh": lambda **place: Obstacle(mesh=plate(8.0, 0.2, 8.0), **place),
    "sheet": lambda **place: Obstacle(mesh=square(4, 8.0, axis=1), thickness=0.01, **place),
}
SURFACE = {"plane": 0.0, "box": 0.1, "mesh": 0.1, "sheet": 0.01}
"""above the origin"""


def slope(kind: str, degrees: float, friction: float = FRICTION) -> Obstacle:
    """Return a surface through the origin that rises along x."""
    turn = np.radians(degrees)
    below = -SURFACE[kind] * np.array([-np.sin(turn), np.cos(turn), 0.0])
    return SLOPES[kind](position=tuple(below), rotation=(0.0, 0.0, degrees), friction=friction)


def way_down(kind: str, degrees: float, device: str, balloon: Balloon, substeps: int) -> float:
    """Return the distance that a body slides down a slope in half a second [m]."""
    turned = balloon.model_copy(update={"rotation": (0.0, 0.0, degrees)})
    scene = Scene(balloon=[turned], obstacle=[slope(kind, degrees)], frames=30, gravity=GRAVITY, substeps=substeps)
    first, *_, last = Simulator(scene, device).run()
    up = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])
    return float((first.points[0].mean(axis=0) - last.points[0].mean(axis=0)) @ up)


@pytest.mark.parametrize(
    ("what", "kind", "within", "stays", "slides"),
    [*(("particle", kind, 0.5, 1e-4, 0.005) for kind in SLOPES), ("block", "box", 1.0, 2e-3, 0.02)],
)
def test_a_particle_and_a_block_slide_down_a_slope_as_coulomb_says(
    what: str, kind: str, within: float, stays: float, slides: float, device: str
):
    """A particle slides from atan(friction) on, with g (sin - friction cos), to a step's 1/300 of the distance. A stiff
    cube on its four lower corners begins to slide within a degree of that."""
    stiff = Stiffness(structural=5e4, shear=5e4, flexion=0.0)
    sliders = {
        "particle": (particles(SMALL), 10),
        "block": (Balloon(mesh=cube(), scale=0.2, mass=1.0, **FREE | {"stiffness": stiff}), 200),
    }
    steepest, (slider, substeps) = np.degrees(np.arctan(FRICTION)), sliders[what]
    assert way_down(kind, steepest - within, device, slider, substeps) < stays
    assert way_down(kind, steepest + within, device, slider, substeps) > slides
    steeper = steepest + 8.0
    fall = GRAVITY * (np.sin(np.radians(steeper)) - FRICTION * np.cos(np.radians(steeper)))
    assert way_down(kind, steeper, device, slider, substeps) == pytest.approx(0.5 * fall * 0.25, rel=0.02)


def test_a_particle_inside_comes_out_along_the_normal(device: str):
    ball = Obstacle(radius=0.5, length=0.0, position=(10.0, 0.0, 0.0))
    box = Obstacle(size=(1.0, 2.0, 3.0))
    inside = np.array([(10.3, 0.0, 0.3), (10.0, 0.4, 0.0), (0.45, 0.2, 0.1), (0.0, -0.9, 1.0)])
    scene = Scene(balloon=[particles(inside + 100.0)], obstacle=[ball, box], gravity=0.0, substeps=1)
    simulator = Simulator(scene, device)
    put(simulator, inside)
    last = simulator.step()
    turned = 0.5 / np.sqrt(2.0)
    expected = [(10.0 + turned, 0.0, turned), (10.0, 0.5, 0.0), (0.5, 0.2, 0.1), (0.0, -1.0, 1.0)]
    np.testing.assert_allclose(last.points[0], expected, atol=2e-6)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_ball_goes_over_an_edge_without_a_kick(friction: float, device: str):
    """A ball rolls off a tilted table: in no frame its motion and height gain more than its inflation can store, p V. A
    particle that were kicked at 17 m/s would."""
    ball = Balloon(mesh=quad_sphere(6, 0.2), position=(0.3, 1.22, 0.0), inflation={"pressure": 2.0})
    table = Obstacle(size=(1.2, 0.1, 1.2), position=(0.0, 0.93, 0.0), rotation=(0.0, 0.0, -12.0), friction=friction)
    frames = list(Simulator(Scene(balloon=[ball], obstacle=[table], frames=120), device).run())
    assert frames[-1].points[0][:, 0].min() > 0.6  # it has gone over
    squares = np.array([(frame.velocities[0] ** 2).sum(axis=1).mean() for frame in frames])
    energies = ball.mass * (0.5 * squares + GRAVITY * np.array([frame.points[0][:, 1].mean() for frame in frames]))
    assert np.diff(energies).max() < 2.0 * max(frame.volumes[0] for frame in frames)


def new_stage(path: Path, meters: float, up_axis: str = "Y", start: int = 0) -> Usd.Stage:
    """Return a stage of a second, at 24 samples."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, meters)
    UsdGeom.SetStageUpAxis(stage, up_axis)
    stage.SetTimeCodesPerSecond(24)
    stage.SetStartTimeCode(start)
    stage.SetEndTimeCode(start + 24)
    return stage


def cube_in(stage: Usd.Stage, path: str, points: np.ndarray) -> UsdGeom.Mesh:
    """Return a new mesh of a cube's faces."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(cube().face_vertex_indices)
    return mesh


def stage_of(path: Path, up_axis: str = "Z", scales: bool = False) -> Path:
    """Write a cube of a meter, in centimeters, that goes by a meter along x while its parent turns by a quarter in a
    second."""
    stage = new_stage(path, 0.01, up_axis, start=12)
    parent = UsdGeom.Xform.Define(stage, "/turntable")
    turn = parent.AddRotateZOp() if up_axis == "Z" else parent.AddRotateYOp()
    mesh = cube_in(stage, "/turntable/block", 100.0 * (cube().points - 0.5))
    move, grow = mesh.AddTranslateOp(), mesh.AddScaleOp()
    for code, part in ((12, 0.0), (36, 1.0)):
        turn.Set(90.0 * part, code)
        move.Set(Gf.Vec3d(100.0 * part, 0.0, 0.0), code)
        grow.Set(Gf.Vec3f(1.0 + part * scales), code)
    stage.GetRootLayer().Save()
    return path


def corners_of(path: Path, code: float) -> np.ndarray:
    """Return the cube's corners in USD at a time code, in meters, y up."""
    stage = Usd.Stage.Open(str(path))
    matrix = np.array(UsdGeom.Xformable(stage.GetPrimAtPath("/turntable/block")).ComputeLocalToWorldTransform(code))
    local = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/turntable/block")).GetPointsAttr().Get())
    world = 0.01 * (local @ matrix[:3, :3] + matrix[3, :3])
    return world if UsdGeom.GetStageUpAxis(stage) == "Y" else world[:, [0, 2, 1]] * [1.0, 1.0, -1.0]


def scene_with(path: Path, **fields: Any) -> Scene:
    away, moved = Balloon(mesh=cube(), position=(0.0, 9.0, 0.0)), Obstacle(mesh=path, **fields)
    return Scene(balloon=[away], obstacle=[moved], frames_per_second=60.0, frames=70)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_an_obstacle_goes_where_its_stage_says(tmp_path: Path, up_axis: str):
    path = stage_of(tmp_path / "block.usda", up_axis)
    simulator = Simulator(scene_with(path, position=(0.0, 2.0, 0.0)), "cpu", schedule="gather")
    mesh = simulator.model.obstacles[0].mesh
    assert mesh
    for frame in simulator.run():
        pose = frame.obstacle_poses[0]
        placed = Rotation.from_quat(pose[3:]).apply(mesh.points) + pose[:3]
        code = 12 + min(frame.time, 1.0) * 24
        # a quaternion in float32, of a place two meters away
        np.testing.assert_allclose(placed, corners_of(path, code) + [0.0, 2.0, 0.0], atol=2e-6)


def test_keyframes_take_the_place_of_a_stages_motion(tmp_path: Path):
    path = stage_of(tmp_path / "block.usda")
    scene = scene_with(path, motion=[(0.0, (0.0, 0.0, 0.0)), (1.0, (0.0, 0.0, 3.0))])
    np.testing.assert_allclose(obstacle_motion(scene)[60, 0], [0, 0, 3, 0, 0, 0, 1], atol=1e-12)


@pytest.mark.always
def test_a_stage_that_turns_too_far_in_a_frame_is_refused(tmp_path: Path):
    path = stage_of(tmp_path / "block.usda")
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Xform(stage.GetPrimAtPath("/turntable")).GetOrderedXformOps()[0].Set(170.0, 36)
    stage.Save()
    scene = scene_with(path).model_copy(update={"frames_per_second": 1.0})
    with pytest.raises(InputError, match=r"^obstacle\.0\.motion: turns by 170 degrees in a frame; expected at most "):
        obstacle_motion(scene)


def clock(path: Path) -> Path:
    """Write a still dial and two hands, each turned by its own samples; one by points that turn, one by a transform."""
    stage = new_stage(path, 1.0)
    _, hours, minutes = (
        cube_in(stage, f"/clock/{name}", (cube().points - 0.5) * [0.2, 1.0, 0.2] + [2.0 * number, 0.0, 0.0])
        for number, name in enumerate(("dial", "hours", "minutes"))
    )
    turn = hours.AddRotateZOp()
    turn.Set(0.0, 0)
    turn.Set(60.0, 24)
    points = np.array(minutes.GetPointsAttr().Get())
    for code, way in enumerate(Rotation.from_euler("z", np.linspace(0.0, 90.0, 25)[:, None], degrees=True)):
        minutes.GetPointsAttr().Set(way.apply(points), code)
    stage.GetRootLayer().Save()
    return path


def test_each_part_of_a_stage_moves_by_its_own_samples(tmp_path: Path):
    scene = scene_with(clock(tmp_path / "clock.usda"), friction=0.25, name="clock")
    scene = scene.model_copy(update={"obstacle": [*scene.obstacle, Obstacle(position=(0.0, -9.0, 0.0))]})
    plan = plan_model(scene)
    assert [obstacle.name for obstacle in plan.scene.obstacle] == ["clock_dial", "", "clock_hours", "clock_minutes"]
    assert [obstacle.friction for obstacle in plan.scene.obstacle] == [0.25, 0.5, 0.25, 0.25]
    motion = obstacle_motion(plan.scene)
    turned = Rotation.from_quat(motion[60].reshape(-1, 7)[:, 3:]).magnitude()
    np.testing.assert_allclose(np.degrees(turned), [0.0, 0.0, 60.0, 90.0], atol=1e-4)  # points are in float32
    assert np.degrees(Rotation.from_quat(motion[30, 3, 3:]).magnitude()) == pytest.approx(45.0, abs=0.05)  # a chord
    shape = plan.obstacles[3]
    assert shape.mesh
    pose = motion[60, 3]
    about_the_origin = Rotation.from_euler("z", 90.0, degrees=True).apply(shape.mesh.points)
    placed = Rotation.from_quat(pose[3:]).apply(shape.mesh.points) + pose[:3]
    np.testing.assert_allclose(placed, about_the_origin, atol=1e-5)
    again = plan_model(plan.scene)  # as a worker of a batch has it
    assert len(again.scene.obstacle) == 4


def test_a_part_that_bends_is_refused_by_name(tmp_path: Path):
    path = clock(tmp_path / "clock.usda")
    stage = Usd.Stage.Open(str(path))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/clock/minutes")).GetPointsAttr()
    bent = np.array(points.Get(12))
    bent[0] += 0.1
    points.Set(bent, 12)
    stage.GetRootLayer().Save()
    plan = plan_model(scene_with(path, prim="/clock/hours"))
    assert len(plan.scene.obstacle) == 1
    with pytest.raises(InputError, match=r"clock\.usda: /clock/minutes deforms by its points, skin or blend"):
        obstacle_motion(plan_model(scene_with(path)).scene)


def skinned(path: Path, weights: tuple[float, float]) -> Path:
    """Write a cube held by two joints, of which the second rises by a meter in a second."""
    stage = new_stage(path, 1.0)
    UsdSkel.Root.Define(stage, "/root")
    skeleton = UsdSkel.Skeleton.Define(stage, "/root/bones")
    still = Vt.Matrix4dArray([Gf.Matrix4d(1.0)] * 2)
    skeleton.CreateBindTransformsAttr(still)
    skeleton.CreateRestTransformsAttr(still)
    animation = UsdSkel.Animation.Define(stage, "/root/bones/rise")
    for each in (skeleton, animation):
        each.CreateJointsAttr(["still", "rising"])
    animation.CreateRotationsAttr([Gf.Quatf(1.0)] * 2)
    animation.CreateScalesAttr([Gf.Vec3h(1.0)] * 2)
    moves = animation.CreateTranslationsAttr()
    for code in (0, 24):
        moves.Set([Gf.Vec3f(0.0), Gf.Vec3f(0.0, code / 24.0, 0.0)], code)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    binding = UsdSkel.BindingAPI.Apply(cube_in(stage, "/root/block", cube().points).GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    top = cube().points[:, 1] > 0.5
    binding.CreateJointIndicesPrimvar(False, 1).Set([int(each) for each in np.where(top, *weights)])
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 8)
    stage.GetRootLayer().Save()
    return path


def test_a_skin_is_followed_where_it_is_rigid(tmp_path: Path):
    motion = obstacle_motion(plan_model(scene_with(skinned(tmp_path / "whole.usda", (1, 1)))).scene)
    np.testing.assert_allclose(motion[[0, 30, 60], 0, :3], [[0, 0, 0], [0, 0.5, 0], [0, 1, 0]], atol=1e-6)
    with pytest.raises(InputError, match="/root/block deforms"):
        obstacle_motion(plan_model(scene_with(skinned(tmp_path / "top.usda", (1, 0)))).scene)
