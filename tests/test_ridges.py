"""Ridges: faces of balloons that meet edges, corners and thin things between their particles."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from conserved import energy, momentum
from meshes import grid, mesh_of, quad_sphere
from rigid import SPACE, whole

from balloon_warp import InputError, check_stage, load_scene
from balloon_warp.job import animate
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model.obstacles import shape_obstacle
from balloon_warp.model.plan import plan_model
from balloon_warp.model.ridges import ridges_of
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Obstacle, Scene, Sphere
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

UP = np.array([0.0, 1.0, 0.0])
BLADE = PolygonMesh(
    np.array([(-1.0, -0.6, 0.0), (1.0, -0.6, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]),
    np.array([4], np.int32),
    np.arange(4, dtype=np.int32),
)
ROD = {"shape": "capsule", "radius": 0.008, "length": 2.0, "rotation": (0.0, 0.0, 90.0), "position": (0, -0.008, 0)}
THINGS: dict[str, dict[str, Any]] = {
    "blade": {"obstacle": [Obstacle(mesh=BLADE)]},
    "thin box": {"obstacle": [Obstacle(size=(0.005, 0.5, 2.0), position=(0.03, -0.25, 0.0))]},
    "rod": {"obstacle": [Obstacle(**ROD)]},
    "net": {
        "obstacle": [
            Obstacle(**ROD | {"rotation": (90.0, 0.0, 0.0), "position": (x, -0.008, 0.0)})
            for x in (-0.47, -0.22, 0.03, 0.28, 0.53)
        ]
    },
    "peg": {"obstacle": [Obstacle(shape="capsule", radius=0.01, length=0.5, position=(0.03, -0.26, 0.03))]},
    "corner": {"obstacle": [Obstacle(size=(0.4,) * 3, rotation=(45.0, 0.0, 35.26), position=(0.02, -0.346, 0.03))]},
    "thin body": {"body": [Body(size=(0.006, 0.5, 1.0), position=(0.02, -0.27, 0.03), mass=20.0)], "gravity": 0.0},
    "needle": {"sphere": [Sphere(radius=0.01, mass=0.2, position=(0.03, -0.02, 0.03))], "gravity": 0.0},
}
"""what a ball falls on, its top at a height of 0"""


def ball(cells: int, speed: float = 3.0, height: float = 0.52, **given: Any) -> Balloon:
    inflation = given.pop("inflation", Inflation(kind="pressure", pressure=15.0))
    return Balloon(
        mesh=quad_sphere(cells, 0.5), position=(0.0, height, 0.0), velocity=(0.0, -speed, 0.0), mass=0.3,
        inflation=inflation, damping=0.0, **given,
    )  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("cells", [5, 9], ids=["coarse", "fine"])
@pytest.mark.parametrize("thing", THINGS)
def test_nothing_comes_in_between_particles(thing: str, cells: int, tmp_path: Path) -> None:
    scene = Scene(balloon=[ball(cells)], frames=24, faces=True, **THINGS[thing])
    animate(scene, tmp_path / "stage.usdc", device="cpu")
    # a sphere may come nearer by half its radius, see `kernels.contact.faces`
    report = check_stage(tmp_path / "stage.usdc", within=0.006 if thing == "needle" else None)
    assert report.passed, "\n".join(str(crossing) for crossing in report.crossings[:5])


def test_a_blade_cuts_a_ball_whose_faces_do_not_meet_it(tmp_path: Path) -> None:
    """A blade cuts a ball without contact of faces, as the other tests require."""
    scene = Scene(balloon=[ball(5)], frames=24, faces=False, **THINGS["blade"])
    animate(scene, tmp_path / "stage.usdc", device="cpu")
    assert max(crossing.depth for crossing in check_stage(tmp_path / "stage.usdc").crossings) > 0.1


@pytest.mark.parametrize("thing", ["blade", "rod"])
def test_a_symmetric_drop_stays_symmetric(thing: str) -> None:
    """A symmetric drop stays symmetric: nothing is thrown along a rod, or off it."""
    simulator = Simulator(Scene(balloon=[ball(6)], **THINGS[thing]), device="cpu")
    frame = simulator.step()
    for _ in range(39):
        frame = simulator.step()
    middle, speed = frame.points[0].mean(axis=0), frame.velocities[0].mean(axis=0)
    assert speed[1] > 0.2  # it has bounced
    np.testing.assert_allclose(middle[[0, 2]], 0.0, atol=2e-3)
    np.testing.assert_allclose(speed[[0, 2]], 0.0, atol=0.05)


@pytest.mark.full
@pytest.mark.parametrize("friction", [0.0, 0.6])
@pytest.mark.parametrize("thing", ["blade", "net", "corner"])
def test_energy_never_grows(thing: str, friction: float) -> None:
    none = Inflation(kind="pressure", pressure=0.0)
    rough = [each.model_copy(update={"friction": friction}) for each in THINGS[thing]["obstacle"]]
    thrown = ball(6, inflation=none, angular_velocity=(0.0, 0.0, 2.0))
    scene = Scene(balloon=[thrown], gravity=0.0, substeps=160, faces=True, obstacle=rough)
    simulator = Simulator(scene, device="cpu")
    least = start = energy(simulator)
    for _ in range(30):
        simulator.step()
        assert energy(simulator) < least * (1.0 + 1e-3)  # which a step of symplectic Euler is off by
        least = min(least, energy(simulator))
    assert least < 0.95 * start  # it has met something


def test_what_is_exchanged_with_a_body_is_kept() -> None:
    """Momentum and angular momentum are conserved as a ball flies at a thin plate, off its center."""
    plate = Body(size=(0.006, 0.5, 0.5), position=(0.05, -0.27, 0.03), mass=0.4)
    thrown = ball(5, inflation=Inflation(kind="pressure", pressure=0.0))
    simulator = Simulator(Scene(balloon=[thrown], body=[plate], substeps=40, **SPACE), device="cpu")

    start = np.concatenate(whole(simulator))
    for _ in range(30):
        simulator.step()
    assert abs(momentum(simulator)[1] - start[1]) > 0.1  # the plate flies
    np.testing.assert_allclose(np.concatenate(whole(simulator)), start, atol=3e-4)


def test_it_repeats_to_the_bit_and_worlds_stay_apart() -> None:
    scene = Scene(balloon=[ball(6)], **THINGS["net"])

    def points(worlds: int) -> np.ndarray:
        simulator = Simulator(scene, device="cpu", world_count=worlds)
        for _ in range(20):
            simulator.step()
        return simulator.state.points.numpy()

    alone = points(1)
    np.testing.assert_array_equal(points(1), alone)
    np.testing.assert_array_equal(points(3), np.repeat(alone, 3, axis=0))


@pytest.mark.parametrize("schedule", ["gather", "octets"])
def test_what_was_far_away_and_begins_anew_meets_it_again(schedule: str) -> None:
    """A ball that has flown 3 m away is reset to where it began, and falls on a blade as it did at first."""
    simulator = Simulator(Scene(balloon=[ball(5)], gravity=0.0, **THINGS["blade"]), "cpu", 1, schedule=schedule)
    found = []
    for _ in range(2):
        for _ in range(8):
            simulator.step()
        found.append(simulator.state.points.numpy().copy())
        simulator.state.velocities.assign(np.broadcast_to(np.float32([0.0, 6.0, 0.0]), found[0].shape))
        for _ in range(30):
            simulator.step()
        simulator.reset(np.ones(1, bool))
    np.testing.assert_array_equal(*found)


def test_what_is_far_changes_no_bit() -> None:
    away = {"obstacle": [Obstacle(mesh=BLADE, position=(0.0, -9.0, 0.0))]}
    found = []
    for faces in (True, False):
        simulator = Simulator(Scene(balloon=[ball(5)], faces=faces, **away), device="cpu", schedule="gather")
        frame = simulator.step()
        for _ in range(9):
            frame = simulator.step()
        found.append(frame.points[0])
    np.testing.assert_array_equal(*found)


def ridges(obstacle: Obstacle, edge: float = 0.1) -> Any:
    scene = Scene(balloon=[ball(2)], obstacle=[obstacle])
    return ridges_of(shape_obstacle(0, obstacle, scene), UP, edge)


def test_a_box_has_twelve_ridges_and_eight_tips() -> None:
    found = ridges(Obstacle(size=(1.0, 2.0, 3.0)))
    assert len(found.ends) == 12
    assert sum(bin(tips).count("1") for tips in found.tips) == 8
    middles = found.ends.mean(axis=1)
    outward = -(found.inward.sum(axis=1) * middles).sum(axis=1)
    assert (outward > 0.0).all()  # they lead away from the edges, into the sides


def test_a_sheet_has_a_rim() -> None:
    found = ridges(Obstacle(mesh=BLADE))
    assert len(found.ends) == 4
    assert (found.inward[:, 1] == 0.0).all()
    assert found.radius > 0.0


def test_what_is_round_beside_an_edge_has_no_ridges() -> None:
    """Take edges of a round solid, however fine, for ridges where a face cuts in by more than the skin's thickness.

    A face of edge e cuts into a sphere of radius R by e^2 / 8 R: with e = 0.1 R by e / 80, with 0.3 R by e / 27.
    """
    icosphere = trimesh.creation.icosphere(4)
    for mesh in (quad_sphere(20, 1.0), mesh_of(icosphere.vertices, icosphere.faces)):
        dome = Obstacle(mesh=mesh)
        edges = 3 * len(shape_obstacle(0, dome, Scene(balloon=[ball(2)], obstacle=[dome])).triangles) // 2
        assert len(ridges(dome, edge=0.1).ends) == 0
        assert len(ridges(dome, edge=0.3).ends) > 0.6 * edges  # of quads, which are two triangles, a third is flat


def tiles(gap: float = 0.0) -> list[Obstacle]:
    """Return boxes of 0.3 m side by side, their tops at a height of 0."""
    size = (0.3 - gap, 0.1, 0.3 - gap)
    return [
        Obstacle(size=size, position=(0.3 * i, -0.05, 0.3 * j), friction=0.0) for i in range(-1, 7) for j in (-1, 0, 1)
    ]


def carpet(degrees: float) -> Balloon:
    """Return a cloth of 0.2 m that lies at a height of 0, about the origin, and slides at 3 m/s."""
    flat = grid(5, 5)
    points = flat.points - flat.points.mean(axis=0)
    points = np.roll(points, 1 - int(np.argmin(np.ptp(points, axis=0))), axis=1) * 0.2 / np.ptp(points)
    turn = np.radians(degrees)
    return Balloon(
        mesh=replace(flat, points=points), mass=0.01, damping=0.0, inflation=Inflation(k_normal=0.0),
        velocity=(3.0 * np.cos(turn), 0.0, 3.0 * np.sin(turn)), rotation=(0.0, degrees, 0.0),
    )  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("degrees", [0.0, 5.0, -8.0])
def test_nothing_catches_at_a_seam(degrees: float, device: str) -> None:
    """Cloth slides over a floor of boxes as over one without faces: bit-identical, and without losing speed."""
    scene = Scene(balloon=[carpet(degrees)], obstacle=tiles(), gravity=0.0, frames=30)
    smooth, seamed = (Simulator(scene.model_copy(update={"faces": faces}), device) for faces in (False, True))
    assert sum(len(ridges.ends) for ridges in seamed.model.ridges) > 0  # around the floor
    for simulator in (smooth, seamed):
        for _ in range(30):
            simulator.step()
    frames = [simulator.read_frame() for simulator in (smooth, seamed)]
    np.testing.assert_array_equal(frames[1].points[0], frames[0].points[0])
    np.testing.assert_allclose(np.linalg.norm(frames[1].velocities[0], axis=1), 3.0, rtol=1e-3)


def exposed(obstacles: list[Obstacle], **given: Any) -> list[float]:
    """Return the exposed part of each obstacle's ridges, over the length of all of them."""
    scene = Scene(balloon=[ball(5, height=3.0)], obstacle=obstacles, faces=True, **given)
    alone = scene.model_copy(update={"obstacle": obstacles[:1], "ground": None})
    lengths = [
        [
            float(np.linalg.norm(ridges.ends[:, 1] - ridges.ends[:, 0], axis=1).sum())
            for ridges in plan_model(each).ridges
        ]
        for each in (scene, alone)
    ]
    return [length / lengths[1][0] for length in lengths[0]]


def test_ridges_end_where_another_solid_begins() -> None:
    """Ridges end where another solid begins. Boxes of 0.3 x 0.1 x 0.3 have 2.8 m of edges: one alone keeps all; one
    that stands on the ground loses the four of its foot; two side by side lose the edges of the side that they share,
    on both; a moving one shares nothing; and a small one on a large one loses its foot alone, the large one nothing."""
    box = Obstacle(size=(0.3, 0.1, 0.3))
    beside = box.model_copy(update={"position": (0.3, 0.0, 0.0)})
    apart = box.model_copy(update={"position": (0.4, 0.0, 0.0)})
    moving = beside.model_copy(update={"motion": [(0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 0.0, 0.0))]})
    half = beside.model_copy(update={"position": (0.3, 0.0, 0.15)})
    small = Obstacle(size=(0.1, 0.1, 0.1), position=(0.0, 0.1, 0.0))
    assert exposed([box, apart]) == pytest.approx([1.0, 1.0])
    assert exposed([box], ground=Ground(height=-0.05)) == pytest.approx([1.6 / 2.8])
    assert exposed([box, beside]) == pytest.approx([(2.8 - 0.8) / 2.8] * 2)
    assert exposed([box, moving]) == pytest.approx([1.0, 1.0])
    shared = 2 * 0.15 + 0.1  # of the long edges a half, and the upright one in the middle of the other's side
    assert exposed([box, half]) == pytest.approx([(2.8 - shared) / 2.8] * 2, abs=2e-3)
    assert exposed([box, small]) == pytest.approx([1.0, 0.8 / 2.8])


def test_whether_faces_meet_is_yes_no_or_auto() -> None:
    scene = Scene(balloon=[ball(3)], faces=True, **THINGS["rod"])
    with pytest.raises(InputError, match="faces"):
        load_scene(scene, {"faces": "perhaps"})
    meet = []
    for turn in ((0.0, 0.0, 0.0), (0.0, 30.0, 20.0), (0.0, 0.0, 45.0), (45.0, 0.0, 35.26)):
        thick = Obstacle(size=(2.0, 2.0, 2.0), rotation=turn, position=(0.0, -3.0, 0.0))
        meet.append(bool(plan_model(Scene(balloon=[ball(6)], obstacle=[thick])).ridges))
    assert meet == [False, False, True, True]
