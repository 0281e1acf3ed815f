"""Parts of a balloon that touches itself: how far they are from each other, and what that saves."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from conserved import advanced
from meshes import cube, grid, joined, quad_sphere
from odd_things import hair
from test_folded import crossings, folding_tube, tube
from touching import VACUUM

from balloon_warp import Balloon, Ground, Inflation, Obstacle, PolygonMesh, Scene, Simulator, Touch, load_scene
from balloon_warp.kernels.contact.free_frames import BUSY, FREE, HURRIED
from balloon_warp.mesh.least_gaps import least_gaps
from balloon_warp.mesh.slenderness import slenderness
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model import plan_model
from balloon_warp.schedules.own_parts import part_count, parts_of


def verdict(simulator: Simulator) -> int:
    """Return the verdict on the last frame of a world alone."""
    return int(simulator.schedule.busy.outlook.table.verdicts.numpy()[0])


def test_the_length_of_a_tube_over_its_diameter_is_its_slenderness():
    """Balls, a sheet and hair, which is open, are left alone, as is what has too few vertices to bend; a long tube
    touches itself, softly."""
    for mesh, expected, itself in [
        (quad_sphere(8), np.pi**2 / 4.0, False),
        (cube(), 0.0, False),
        (grid(8, 8), np.pi, False),
        (hair(40), 19.3, False),
        (tube(17, 12), 2.2 / 0.16, "soft"),
        (tube(65, 48), 2.2 / 0.16, "soft"),
    ]:
        assert slenderness(mesh) == pytest.approx(expected, rel=0.1)
        touch = plan_model(load_scene(mesh)).scene.touch
        assert (touch.itself if touch else False) == itself


@pytest.mark.parametrize("schedule", ["octets", "block"])
def test_a_straight_tube_moves_as_without_contact(schedule: str, device: str):
    """It flies, turns and swells in free frames alone, to the same places to the bit."""
    if schedule == "octets" and device != "cpu":
        pytest.skip("runs on a CPU")
    thrown: dict[str, Any] = {"balloon.velocity": (9.0, 0.0, 0.0), "balloon.angular_velocity": (0.0, 3.0, 0.0)}
    ends = list[np.ndarray]()
    for touch in (None, False):
        simulator = Simulator(load_scene(tube(17, 12), thrown | {"touch": touch}), device, schedule=schedule)
        for _ in range(40):
            simulator.step()
            assert touch is False or verdict(simulator) == FREE
        ends.append(simulator.read_frame().points[0])
    np.testing.assert_array_equal(ends[0], ends[1])


def test_a_tube_that_folds_is_nowhere_in_itself_by_default():
    """Its halves fold until they meet at 8 m/s; without contact they cross at more than 100 places."""
    simulator, mesh = folding_tube(None)
    assert simulator.schedule.name == "octets"
    seen = []
    for _ in range(60):
        assert crossings(simulator.step().points[0], mesh) == 0
        seen.append(verdict(simulator))
    assert set(seen) == {BUSY, HURRIED}
    simulator, mesh = folding_tube(False)
    assert crossings(advanced(simulator, 60).points[0], mesh) > 100


@pytest.mark.always
@pytest.mark.parametrize(("ways", "expected"), [((0.0, -1.0), HURRIED), ((-1.0, -1.0), FREE), ((0.0, 1.0), FREE)])
def test_parts_that_pass_through_each_other_within_a_frame_are_seen(ways: tuple[float, float], expected: int):
    """Two strips may have met in between if one goes to the other side; not if both go along, or away."""
    flat = grid(8, 2).points * 0.1
    mesh = joined(*(replace(grid(8, 2), points=flat + (0.0, 0.0, height)) for height in (0.0, 0.5)))
    scene = Scene(balloon=[Balloon(mesh=mesh, inflation=Inflation(k_normal=0.0))], touch=Touch(itself=True), **VACUUM)
    simulator = Simulator(scene, "cpu", schedule="octets")
    busy, state = simulator.schedule.busy, simulator.state
    busy.find(state)
    assert verdict(simulator) == FREE
    points = state.points.numpy()
    points[0, : len(flat), 2] += ways[0]
    points[0, len(flat) :, 2] += ways[1]
    state.points.assign(points)
    busy.outlook.look_back(state)
    assert verdict(simulator) == expected


def true_gap(mesh: PolygonMesh, points: np.ndarray, apart: float) -> float:
    """Return how near particles are to a grid in triangles that they may touch [m]: no less than the true distance."""
    triangles = triangles_of(mesh)
    weights = np.array([(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]) / 8.0
    places = np.einsum("wk,nkx->nwx", weights, points[triangles])
    least = np.inf
    for particle in range(len(points)):
        rest = np.linalg.norm(mesh.points[triangles] - mesh.points[particle], axis=-1).min(axis=1)
        found = np.linalg.norm(places[rest >= apart] - points[particle], axis=-1)
        least = min(least, float(found.min(initial=np.inf)))
    return least


@pytest.mark.always("0.5")
@pytest.mark.parametrize("bend", [0.0, 0.5, 2.0, 4.0])
def test_the_room_is_no_larger_than_the_gap(bend: float):
    """There is some room in a tube until it has bent by a radian in its length."""
    mesh = tube(17, 12)
    simulator = Simulator(load_scene(mesh), "cpu", schedule="octets")
    x, y, z = mesh.points.T
    radius = 1.0 / max(bend, 1e-9) * 2.0
    bent = np.stack([(radius - y) * np.sin(x / radius), radius - (radius - y) * np.cos(x / radius), z], axis=1)
    bent = 1.1 * bent[:, [2, 0, 1]] + 3.0
    state, schedule = simulator.state, simulator.schedule
    state.points.assign(bent[None].astype(np.float32))
    schedule.busy.find(state)
    touch = schedule.busy.outlook._tables.touch
    pad = float(touch.thickness.numpy()[0] + 2.0 * touch.slack.numpy()[0])
    room, gap = float(state.rooms.numpy()[0, 0]), true_gap(mesh, bent, float(touch.apart.numpy()[0]))
    assert room <= gap - pad
    assert verdict(simulator) == (FREE if room > 0.0 else BUSY)
    assert (room > 0.0) == (bend < 1.0)


@pytest.mark.always
def test_least_gaps_are_those_of_all_pairs():
    """The least distances at the start are those that a grid of points in triangles shows, up to its width."""
    mesh = tube(17, 12)
    apart, most = 0.12, 0.1
    found = least_gaps(mesh, apart, most).min()
    assert found == pytest.approx(min(true_gap(mesh, mesh.points, apart), most), rel=0.05)
    assert least_gaps(mesh, 1e-6, most).min() <= true_gap(mesh, mesh.points, 1e-6)


@pytest.mark.always
def test_parts_have_all_triangles():
    for mesh in (tube(17, 12), quad_sphere(8), cube()):
        parts = parts_of(mesh)
        assert len(parts.particles) == part_count(mesh)
        np.testing.assert_array_equal(np.unique(np.concatenate(parts.particles)), np.arange(mesh.vertex_count))


def test_a_ball_on_a_thin_rod_does_not_cross_itself_where_it_touches_itself_softly():
    most = dict[bool | str, int]()
    mesh = quad_sphere(16, 0.5)
    ball = Balloon(mesh=mesh, position=(0.0, 1.2, 0.0), mass=0.3)
    rod = Obstacle(shape="capsule", radius=0.01, length=2.0, position=(0.0, 0.3, 0.0), rotation=(0.0, 0.0, 90.0))
    for itself in (False, "soft"):
        simulator = Simulator(Scene(balloon=[ball], ground=Ground(), obstacle=[rod], touch=Touch(itself=itself)), "cpu")
        places = [simulator.step().points[0] for _ in range(40)]
        most[itself] = max(crossings(points, mesh) for points in places[30:])
    assert most[False] > 50
    assert most["soft"] == 0
