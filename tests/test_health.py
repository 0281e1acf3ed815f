"""Health check after a frame: bad worlds are found, and no others."""

import numpy as np
import pytest
import warp as wp
from meshes import cube, quad_sphere

from balloon_warp import Balloon, Inflation, InputError, Scene, Simulator, Sphere, Stiffness
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.scene.load import override_scene
from balloon_warp.schedules.frames import FARTHEST, MOST_SPAN, HealthCheck

CUBE = cube()
"""of one meter, with 8 particles"""
SLACK = {"stiffness": Stiffness(structural=0.0, shear=0.0, flexion=0.0), "inflation": Inflation(k_normal=0.0)}


def scene(**balloon: object) -> Scene:
    return Scene(balloon=[Balloon(mesh=CUBE, **balloon)], sphere=[Sphere(position=(0.0, 4.0, 0.0))] * 2)


def found(points: np.ndarray, spheres: np.ndarray, device: str, **balloon: object) -> list[int]:
    """Return the first bad particle or sphere of each world, and require that the number of threads does not matter."""
    simulator = Simulator(scene(**balloon), device, world_count=len(points))
    for array, values in ((simulator.state.points, points), (simulator.state.sphere_positions, spheres)):
        wp.copy(array, wp.array(values, dtype=wp.vec3, device=device))
    found_bad = []
    for threads in (None, 1, 3, 20):
        simulator.state.first_bad.fill_(HEALTHY)
        HealthCheck(simulator.model, threads).look(simulator.state)
        found_bad.append(simulator.state.first_bad.numpy().tolist())
    assert all(each == found_bad[0] for each in found_bad)
    return found_bad[0]


def places(worlds: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the places of particles and spheres at the start."""
    return np.tile(CUBE.points, (worlds, 1, 1)), np.tile([0.0, 4.0, 0.0], (worlds, 2, 1))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 3e38, 2.0 * MOST_SPAN])
def test_a_particle_that_is_no_place_or_away_from_its_balloon_is_bad(bad: float, device: str):
    """A sphere has a number after the particles."""
    points, spheres = places(3)
    points[1, 5, 2] = bad
    spheres[2, 1, 0] = bad if abs(bad) > FARTHEST or np.isnan(bad) else 2.0 * FARTHEST
    assert found(points, spheres, device) == [HEALTHY, 5, 8 + 1]


def test_when_the_particle_that_spans_are_taken_from_is_bad_the_world_is(device: str):
    points, spheres = places(3)
    points[0, CUBE.face_vertex_indices[0]] = 2.0 * MOST_SPAN
    points[2, CUBE.face_vertex_indices[0]] = np.nan
    assert [bad != HEALTHY for bad in found(points, spheres, device)] == [True, False, True]


def test_a_balloon_that_is_far_away_as_a_whole_is_good_until_float32_does_not_resolve_it(device: str):
    points, spheres = places(2)
    points += np.array([0.5, 2.0])[:, None, None] * FARTHEST
    assert found(points, spheres, device) == [HEALTHY, int(CUBE.face_vertex_indices[0])]


def test_what_is_burst_fixed_or_unused_is_good_wherever_it_is(device: str):
    points, spheres = places(1)
    assert found(0.1 * MOST_SPAN * points, spheres, device) == [HEALTHY]  # parts thousands of its sizes apart
    points[0, 5] = 10.0 * MOST_SPAN
    assert found(points, spheres, device, fixed=[5]) == [HEALTHY]


@pytest.mark.full
@pytest.mark.parametrize(
    "name",
    [
        *("points", "velocities", "net_forces", "inflation_forces"),
        *("pressures", "gas_amounts", "thrusts", "sphere_positions", "sphere_velocities"),
    ],
)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_frame_that_is_not_finite_says_so_whatever_of_it_is_bad(name: str, bad: float):
    frame = Simulator(scene(), "cpu").read_frame(net_forces=True)
    assert frame.is_finite
    value = getattr(frame, name)
    array = value[0] if isinstance(value, list) else value
    array.flat[-1] = bad
    assert not frame.is_finite


@pytest.mark.full
def test_free_fall_for_ten_minutes_is_good(device: str):
    """Free fall for 177 km is healthy, for balloons of a meter and a centimeter and a sphere."""
    balloons = [Balloon(mesh=CUBE, scale=scale, damping=0.0, **SLACK) for scale in (1.0, 0.01)]
    spheres = [Sphere(radius=0.1, position=(0.0, 4.0, 0.0))]
    fall = Scene(balloon=balloons, sphere=spheres, frames=600, frames_per_second=1.0, substeps=1, touch=False)
    simulator = Simulator(fall, device)
    for _ in range(600):
        simulator.advance()
    assert simulator.state.points.numpy()[..., 1].max() < -0.5 * 9.81 * 599.0**2
    assert simulator.state.first_bad.numpy().tolist() == [HEALTHY]


SCHEDULES = ("scatter", "gather", "block", "lanes", "octets")
OF_KIND = {"penalty": {}, "impulse": {"contact": "impulse"}, "gas": {"balloon.inflation.kind": "gas"}}
"""settings by which the kernels of `block` differ"""


@pytest.mark.parametrize("kind", OF_KIND)
@pytest.mark.parametrize("substeps", [1, 2])
@pytest.mark.parametrize("schedule", SCHEDULES)
def test_each_schedule_looks_at_what_a_frame_wrote(schedule: str, substeps: int, kind: str, device: str):
    """The health check sees bad particles at the frame's end; their springs may spoil neighbors."""
    one = Balloon(mesh=CUBE, stiffness=SLACK["stiffness"])
    apart = scene().model_copy(update={"balloon": [one, one.model_copy(update={"position": (3.0, 0.0, 0.0)})]})
    settings = {"substeps": substeps, "balloon.fixed": [7], **OF_KIND[kind]}
    try:
        simulator = Simulator(override_scene(apart, settings.items()), device, world_count=5, schedule=schedule)
    except InputError as refusal:  # of a feature that a schedule does not have
        pytest.skip(str(refusal))
    points, spheres = simulator.state.points.numpy(), simulator.state.sphere_positions.numpy()
    if kind != "gas":  # that would fill all the space up to there
        points[0, 7] = 10.0 * MOST_SPAN  # fixed
    points[1, 13, 1] = np.nan
    points[2, 5, 2] = 10.0 * MOST_SPAN
    spheres[4, 1, 0] = 10.0 * FARTHEST
    simulator.state.points.assign(points)
    simulator.state.sphere_positions.assign(spheres)
    simulator.advance()
    well, second, first, untouched, sphere = simulator.state.first_bad.numpy().tolist()
    assert (well, untouched, sphere) == (HEALTHY, HEALTHY, 16 + 1)
    assert 8 <= second <= 13
    assert 0 <= first <= 5
    assert simulator.state.frame.numpy().tolist() == [1]


def test_a_bad_particle_is_named_by_its_number(schedule, device):
    """A bad particle is named by its number, not by its place in a schedule's own order. Springs without stiffness
    leave its neighbors in place."""
    ball = Balloon(mesh=quad_sphere(14), **SLACK)
    simulator = Simulator(Scene(balloon=[ball], substeps=2), device, schedule=schedule)
    points = simulator.state.points.numpy()
    points[0, 1000] = 1e13
    simulator.state.points.assign(points)
    simulator.advance()
    assert simulator.state.first_bad.numpy() == [1000]
