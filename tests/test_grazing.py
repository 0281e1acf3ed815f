"""Tunneling: nothing passes a wall, at any speed, angle and thickness. Free particles are independent."""

import numpy as np
import pytest
from meshes import grid, mesh_of

from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Obstacle, Scene, Sphere, Stiffness
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

HALF = 1.5
"""of a wall's edge [m]"""
FRAME = 1.0 / 60.0
"""[s], here one substep: at 60 m/s a meter"""
SPEEDS = [(2.0, 10.0), (0.05, 30.0), (5.0, 5.0), (10.0, 60.0), (60.0, 3.0), (400.0, 400.0)]
"""into the wall and along it [m/s]: from a tenth of a degree to straight on"""


def crowd(at: tuple, velocity: tuple, size: float = 0.2) -> Balloon:
    """Return 36 free particles of a square across x, without springs or pressure."""
    flat = grid(5, 5)
    places = flat.points - flat.points.mean(axis=0)
    thin = int(np.argmin(np.ptp(places, axis=0)))
    places = size / np.ptp(places, axis=0).max() * np.roll(places, -thin, axis=1)
    return Balloon(
        mesh=mesh_of(places, flat.face_vertex_indices.reshape(-1, 4).tolist()),
        mass=0.01,
        position=at,
        velocity=velocity,
        stiffness=Stiffness(structural=0.0, shear=0.0, flexion=0.0),
        inflation=Inflation(k_normal=0.0),
        damping=0.0,
    )


def screen() -> PolygonMesh:
    """Return an open sheet across x, of 16 quads."""
    steps = np.linspace(-HALF, HALF, 5)
    faces = [[5 * i + j, 5 * i + j + 1, 5 * i + j + 6, 5 * i + j + 5] for i in range(4) for j in range(4)]
    return mesh_of([(0.0, y, z) for y in steps for z in steps], faces)


def plate(half: float) -> PolygonMesh:
    """Return a closed box across x, much thinner than its edges are long."""
    corners = [(x, y, z) for x in (-half, half) for y in (-HALF, HALF) for z in (-HALF, HALF)]
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return mesh_of(corners, faces)


WALLS = {
    "box": (lambda half: {"size": (2.0 * half, 2.0 * HALF, 2.0 * HALF)}),
    "sheet": (lambda half: {"mesh": screen(), "thickness": half}),
    "mesh": (lambda half: {"mesh": plate(half)}),
    "plane": (lambda half: {"shape": "plane", "position": (-half, 0.0, 0.0), "rotation": (0.0, 0.0, 90.0)}),
}


def expected_end(begin: float, gap: float, into: float, along: float, friction: float, seconds: float) -> float:
    """Return the final place of a particle that flies up to a wall and slides on, slowed by friction."""
    flown = min(gap / into, seconds)
    return begin + flown * along + (seconds - flown) * max(along - friction * into, 0.0)


@pytest.mark.parametrize("kind", WALLS)
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_no_particle_passes_a_wall_at_any_angle(kind: str, friction: float, schedule: str, device: str):
    """Particles stop at the wall and slide on by Coulomb's law: within 2 mm."""
    half, gap, frames = 5e-4, 0.05, 6
    for into, along in SPEEDS[1:] if kind == "mesh" else SPEEDS:
        wall = Obstacle(**WALLS[kind](half), friction=friction)
        begin = crowd((-half - gap, -1.0, 0.0), (into, along, 0.0))
        simulator = Simulator(
            Scene(balloon=[begin], obstacle=[wall], gravity=0.0, frames=frames, substeps=1), device, schedule=schedule
        )
        for number in range(1, frames + 1):
            simulator.step()
            frame = simulator.read_frame()
            place = frame.points[0]
            beside = np.abs(place[:, 1:]).max(axis=1) < HALF - 0.1
            assert (place[beside, 0] <= -half + 2e-5).all()  # of 3 m, float32 tells some micrometers
            expected = expected_end(-1.0, gap, into, along, friction, number * FRAME)
            if kind != "plane" and expected > HALF - 0.2:
                break  # it has left the wall
            # a skin is seen at most half of it on; a plane rubs for the whole step, as the ground does
            slack = 2e-3 + (friction * into * FRAME if kind == "plane" else 0.0)
            assert place[:, 1].mean() == pytest.approx(expected, abs=slack)


@pytest.mark.parametrize("kind", WALLS)
@pytest.mark.parametrize("half", [2.5e-4, 1.5e-3, 0.025])
def test_walls_of_any_thickness_hold(kind: str, half: float, device: str):
    """Walls of any thickness hold at any angle, where the path ends behind or within, and from contact."""
    for gap in (1e-6, 0.05):
        for into, along in [*SPEEDS, (1.0, 8.0), (0.2, 60.0)]:
            begin = crowd((-half - gap, -1.0, 0.0), (into, along, 0.5))
            wall = Obstacle(**WALLS[kind](half), friction=0.0)
            scene = Scene(balloon=[begin], obstacle=[wall], gravity=0.0, frames=4, substeps=1)
            for frame in Simulator(scene, device).run():
                beside = np.abs(frame.points[0][:, 1:]).max(axis=1) < HALF - 0.1
                assert (frame.points[0][beside, 0] <= -half + 2e-5).all()
                assert np.abs(frame.velocities[0][:, 1] - along).max() < 1e-3 * along  # nothing sticks


@pytest.mark.parametrize("kind", WALLS)
def test_what_slides_along_a_wall_or_leaves_it_is_not_held(kind: str, device: str):
    """Particles slide along a wall at 0.7 m/s for two seconds, or leave it at a tenth of a degree at 30 m/s."""
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
    """Spheres slide on along the wall, at their speed without friction."""
    half = 5e-4
    for into, along in SPEEDS:
        wall = Obstacle(**WALLS[kind](half), friction=0.0, restitution=0.0)
        ball = Sphere(radius=radius, mass=1.0, position=(-half - radius - 0.02, -1.0, 0.1), velocity=(into, along, 0.0))
        scene = Scene(
            balloon=[crowd((-50.0, 0.0, 0.0), (0.0, 0.0, 0.0))],
            sphere=[ball],
            obstacle=[wall],
            gravity=0.0,
            frames=3,
            substeps=1,
        )
        for number, frame in enumerate(Simulator(scene, device).run()):
            place = frame.sphere_positions[0]
            if place[1] < HALF - 0.1:
                assert place[0] <= -half - 0.95 * radius
            assert place[1] == pytest.approx(-1.0 + number * FRAME * along, abs=2e-3)


@pytest.mark.parametrize("body", ["box", "sheet"])
def test_no_particle_passes_a_free_body_at_any_angle(body: str, device: str):
    """Particles do not tunnel through a body of 100 kg, which hardly moves."""
    half = 5e-4
    for into, along in SPEEDS:
        begin = crowd((-half - 0.05, -0.3, 0.0), (into, along, 0.0))
        free = Body(**WALLS[body](half), mass=100.0, friction=0.0)
        scene = Scene(balloon=[begin], body=[free], gravity=0.0, frames=3, substeps=1)
        for frame in Simulator(scene, device).run():
            place = frame.points[0]
            beside = np.abs(place[:, 1:]).max(axis=1) < HALF - 0.1
            shifted = place[:, 0] - frame.body_poses[0][0]
            assert (shifted[beside] < 0.5 * half + 2e-3 * into * FRAME).all()  # the body turns by a little


@pytest.mark.parametrize("speed", [20.0, 150.0, 400.0])
@pytest.mark.parametrize("kind", ["box", "sheet"])
def test_a_wall_that_moves_takes_along_what_it_meets(kind: str, speed: float, schedule: str, device: str):
    """A moving wall sweeps up particles that rest or fly along it: at 400 m/s it goes 6.7 m in a step."""
    half = 5e-4
    wall = Obstacle(**WALLS[kind](half), friction=0.0, motion=[(0.0, (0, 0, 0)), (1.0, (-speed, 0, 0))])
    for along in (0.0, 10.0):
        begin = crowd((-half - 0.3, -0.8, 0.0), (0.0, along, 0.0))
        scene = Scene(balloon=[begin], obstacle=[wall], gravity=0.0, frames=3, substeps=1)
        for number, frame in enumerate(Simulator(scene, device, schedule=schedule).run()):
            assert (frame.points[0][:, 0] <= -number * FRAME * speed - half + 2e-5).all()


CORNERS = {
    "boxes": [
        Obstacle(size=(3.0, 1e-3, 3.0), position=(-1.0, -5e-4, 0.0), friction=0.0),
        Obstacle(size=(1e-3, 3.0, 3.0), position=(0.5, 1.45, 0.0), friction=0.0),
    ],
    "mesh": [
        Obstacle(
            mesh=mesh_of(
                [(-2, 0, -2), (0.5, 0, -2), (0.5, 0, 2), (-2, 0, 2), (0.5, 3, -2), (0.5, 3, 2)],
                [[0, 1, 2, 3], [1, 4, 5, 2]],
            ),
            thickness=1e-3,
            friction=0.0,
        )
    ],
    "ground": [Obstacle(size=(1e-3, 3.0, 3.0), position=(0.5, 1.5, 0.0), friction=0.0)],
}
"""a floor and a wall on it, which stands at x = 0.5"""


@pytest.mark.parametrize("kind", CORNERS)
@pytest.mark.parametrize("swapped", [False, True])
def test_what_slides_on_stops_at_the_next_wall(kind: str, swapped: bool, device: str):
    """A particle that hits the floor and slides into the wall in one step continues along the corner alone.

    Contact with faces is off: free particles would stretch these over meters in a step."""
    obstacles = CORNERS[kind][::-1] if swapped else CORNERS[kind]
    for velocity in ((60.0, -20.0, 0.0), (300.0, -10.0, 5.0), (90.0, -100.0, 2.0)):
        begin = crowd((-0.4, 0.3, 0.0), velocity)
        ground = Ground(friction=0.0) if kind == "ground" else None
        scene = Scene(
            balloon=[begin], obstacle=obstacles, ground=ground, gravity=0.0, frames=12, substeps=1, faces=False
        )
        frames = list(Simulator(scene, device).run())
        for frame in frames:
            assert frame.points[0][:, 0].max() < 0.5
            assert frame.points[0][:, 1].min() > -1e-5
        frame = frames[-1]
        assert np.abs(frame.velocities[0][:, 0]).max() < 0.05
        assert frame.velocities[0][:, 1].max() < 0.05  # nothing is thrown up the wall
        assert np.abs(frame.velocities[0][:, 2] - velocity[2]).max() < 1e-3 * velocity[0]  # 0.3 um of a skin of 1 mm


@pytest.mark.parametrize("degrees", [90.0, 40.0])
@pytest.mark.parametrize("kind", ["boxes", "mesh"])
def test_a_wedge_holds_and_lets_go_along_its_crease(degrees: float, kind: str, device: str):
    """Two thin walls in a wedge contain what flies into it, which keeps its speed along the crease."""
    half = np.radians(0.5 * degrees)
    deep, high = 2.0 * np.cos(half), 2.0 * np.sin(half)
    if kind == "boxes":
        walls = [
            Obstacle(
                size=(2.0, 2e-3, 6.0),
                rotation=(0.0, 0.0, -side * 0.5 * degrees),
                position=(0.5 - 0.5 * deep, side * 0.5 * high, 0.0),
                friction=0.0,
            )
            for side in (1.0, -1.0)
        ]
    else:
        rim = [(0.5 - deep, side * high, z) for side in (1.0, -1.0) for z in (3.0, -3.0)]
        vee = mesh_of([(0.5, 0, -3), (0.5, 0, 3), *rim], [[0, 1, 2, 3], [0, 1, 4, 5]])
        walls = [Obstacle(mesh=vee, thickness=1e-3, friction=0.0)]
    for velocity in ((60.0, 1.0, 0.0), (10.0, 3.0, 5.0), (300.0, 50.0, 1.0)):
        begin = crowd((-0.3, 0.0, 0.0), velocity, 0.1)
        scene = Scene(balloon=[begin], obstacle=walls, gravity=0.0, frames=16, substeps=1)
        frames = list(Simulator(scene, device).run())
        for frame in frames:
            place = frame.points[0]
            within = np.maximum(0.5 - place[:, 0], 0.0) * np.tan(half) + 2e-3
            assert (np.abs(place[:, 1]) < within).all()
        assert frames[-1].velocities[0][:, 2].mean() == pytest.approx(velocity[2], abs=0.05)


@pytest.mark.parametrize("radius", [0.005, 0.1])
def test_what_flies_past_a_post_is_stopped_where_it_cuts_it(radius: float, device: str):
    """A particle that cuts a chord of a capsule, with both ends almost outside, is stopped at its entry, 40 degrees
    from the middle, and slides along the plane there."""
    post = Obstacle(radius=radius, length=2.0, friction=0.0)
    speed = 1.32 * radius / FRAME
    begin = crowd((-2.0, 0.0, 0.0), (speed, 0.0, 0.0), 0.01)
    scene = Scene(balloon=[begin], obstacle=[post], gravity=0.0, frames=1, substeps=1)
    simulator = Simulator(scene, device)
    points = np.zeros((1, 36, 3), dtype=np.float32)
    points[0, :, 0] = -0.66 * radius
    sine, cosine = np.sin(np.radians(40.0)), np.cos(np.radians(40.0))
    points[0, ::2, 2], points[0, 1::2, 2] = cosine * radius, 1.2 * radius
    simulator.state.points.assign(points)
    simulator.step()
    frame = simulator.read_frame()
    slid = [speed * cosine**2, 0.0, speed * sine * cosine]
    np.testing.assert_allclose(frame.velocities[0][::2], [slid] * 18, atol=2e-3 * speed)
    np.testing.assert_allclose(frame.velocities[0][1::2], [[speed, 0.0, 0.0]] * 18, atol=1e-6 * speed)


@pytest.mark.parametrize("friction", [0.0, 0.2])
@pytest.mark.parametrize("degrees", [0.0, 17.0])
def test_flush_boxes_are_one_floor(degrees: float, friction: float, device: str):
    """Seams of flush boxes do not disturb sliding: friction alone slows it; without gravity, exactly along the tops,
    nothing does."""
    boxes = [
        Obstacle(size=(0.3, 0.1, 0.3), position=(0.3 * i, -0.05, 0.3 * j), friction=friction)
        for i in range(-1, 8)
        for j in range(-1, 6)
    ]
    turn = np.radians(degrees)
    velocity = (3.0 * np.cos(turn), 0.0, 3.0 * np.sin(turn))
    flat = crowd((0.0, 0.0, 0.2), velocity).model_copy(update={"rotation": (0.0, 0.0, 90.0)})
    for gravity in (9.81, 0.0):
        simulator = Simulator(Scene(balloon=[flat], obstacle=boxes, gravity=gravity, frames=30), device)
        for _ in range(30):
            simulator.advance()
        frame = simulator.read_frame()
        speeds = np.linalg.norm(frame.velocities[0], axis=1)
        np.testing.assert_allclose(speeds, 3.0 - 0.5 * friction * gravity, rtol=1e-4)  # float32, thirty steps
        assert np.abs(frame.points[0][:, 1]).max() < 1e-5
