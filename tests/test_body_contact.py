"""Contact of free rigid bodies with the ground, obstacles, spheres, each other and balloons."""

from typing import Any

import numpy as np
import pytest
from conserved import energy, momentum, motion, sphere_momenta
from meshes import quad_sphere
from rigid import EPSILON, SPACE, after, body_state, kinetic, scene_of, started, whole

from balloon_warp.scene import Balloon, Body, Ground, Inflation, Obstacle, Scene, Sphere
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


@pytest.fixture(params=["scatter", "gather", "block"])
def laid_out(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.mark.full
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_ball_bounces_on_the_ground_by_its_restitution(restitution, device):
    """A ball bounces to e^2 of its drop height; a step adds an error of order g h T."""
    ball = Body(radius=0.2, length=0.0, position=(0, 1.2, 0), restitution=restitution)
    simulator = started(device, ball, ground=Ground(restitution=restitution), gravity=9.8, substeps=40)
    heights = []
    for _ in range(90):
        simulator.step()
        heights.append(body_state(simulator, "positions")[0, 1] - 0.2)
    landed = int(np.argmin(heights[:60]))  # before it may land once more
    assert min(heights) > -1e-3
    np.testing.assert_allclose(max(heights[landed:]), restitution**2, atol=0.01)


@pytest.mark.parametrize("floor", ["ground", "obstacle"])
def test_a_box_that_falls_comes_to_rest_on_its_side(floor, device):
    box = Body(size=(0.4, 0.2, 0.3), position=(0, 0.5, 0), rotation=(20, 30, 40), restitution=0.2)
    below = (
        {"ground": Ground()} if floor == "ground" else {"obstacle": [Obstacle(size=(9, 1, 9), position=(0, -0.5, 0))]}
    )
    simulator = after(started(device, box, gravity=9.8, **below), 300)
    height = body_state(simulator, "positions")[0, 1]
    assert min(abs(height - half) for half in (0.1, 0.15, 0.2)) < 2e-3
    assert np.abs(body_state(simulator, "velocities")).max() < 0.01
    assert kinetic(simulator) < 1e-4


@pytest.mark.parametrize(("degrees", "slides"), [(20.0, False), (35.0, True)])
def test_a_box_slides_on_a_slope_as_coulomb_says(degrees, slides, device):
    """A box with friction 0.5 sticks below 26.6 degrees, and slides with g (sin - friction cos) above."""
    ramp = Obstacle(shape="plane", rotation=(0, 0, degrees), friction=0.5, restitution=0.0)
    out = np.array([-np.sin(np.radians(degrees)), np.cos(np.radians(degrees)), 0.0])
    box = Body(
        size=(0.4, 0.1, 0.4), position=tuple(0.05 * out), rotation=(0, 0, degrees), friction=0.5, restitution=0.0
    )
    simulator = started(device, box, obstacle=[ramp], gravity=9.8)
    start = body_state(simulator, "positions")[0]
    way = np.linalg.norm(body_state(after(simulator, 50), "positions")[0] - start)
    expected = 0.5 * 9.8 * (np.sin(np.radians(degrees)) - 0.5 * np.cos(np.radians(degrees))) * 0.5**2 if slides else 0.0
    np.testing.assert_allclose(way, expected, atol=0.01 * max(expected, 0.1))


def test_two_that_meet_keep_momentum_and_angular_momentum(device):
    """Momentum is conserved as a box hits another off its center, with friction, and both turn away."""
    boxes = [
        Body(size=(0.4, 0.3, 0.2), position=(-0.6, 0.1, 0.02), velocity=(3.0, 0, 0), mass=1.0),
        Body(size=(0.2, 0.5, 0.3), position=(0, 0, 0), mass=2.0, angular_velocity=(1.0, 0, 2.0)),
    ]
    simulator = started(device, *boxes, **SPACE)
    start, energy = whole(simulator), kinetic(simulator)
    after(simulator, 60)
    for found, expected in zip(whole(simulator), start, strict=True):
        np.testing.assert_allclose(found, expected, atol=600 * EPSILON * 3.0)
    assert body_state(simulator, "velocities")[1, 0] > 0.3
    assert kinetic(simulator) < energy * (1.0 + 1e-4)


@pytest.mark.full
@pytest.mark.parametrize("speed", [2.0, 500.0])
def test_a_sphere_and_a_body_keep_momentum_and_none_goes_through(speed, device):
    """Momentum is conserved without tunneling, where a step takes the sphere ten times the box's thickness."""
    wall = Body(size=(0.05, 1.0, 1.0), mass=3.0, restitution=1.0)
    ball = Sphere(position=(-0.5, 0.2, 0.1), radius=0.05, mass=0.5, velocity=(speed, 0, 0), restitution=1.0)
    simulator = started(device, wall, sphere=[ball], **SPACE)
    start, energy = whole(simulator), 0.25 * speed**2
    after(simulator, 40)
    for found, expected in zip(whole(simulator), start, strict=True):
        np.testing.assert_allclose(found, expected, atol=400 * EPSILON * speed)
    sphere = sphere_momenta(simulator)[0, 0] / 0.5
    assert sphere < body_state(simulator, "velocities")[0, 0]
    np.testing.assert_allclose(kinetic(simulator) + 0.25 * sphere**2, energy, rtol=0.02)


def hit(device: str, schedule: str, mass: float = 0.3, speed: float = 2.0, **fields: Any) -> Simulator:
    """Return a body that hits a balloon at rest off its center, turning."""
    ball = Balloon(mesh=quad_sphere(6, 0.5), mass=0.5, damping=0.0, inflation=Inflation(pressure=0.0))
    brick = Body(
        size=(0.5, 0.3, 0.4),
        position=(0.15, 0.9, 0.05),
        mass=mass,
        velocity=(0, -speed, 0.2),
        angular_velocity=(1, 2, -1),
    )
    setting = SPACE | {"balloon": [ball], "substeps": 40, "faces": False, "frames_per_second": 60.0}
    return started(device, brick, schedule=schedule, **setting | fields)


@pytest.mark.parametrize("mass", [0.02, 0.3, 20.0])
def test_balloon_and_body_together_keep_what_physics_keeps(mass, laid_out, device):
    """Momentum and angular momentum are conserved to rounding, by up to half an epsilon a substep."""
    simulator = hit(device, laid_out, mass)
    start, gained = whole(simulator), kinetic(simulator) + energy(simulator)
    before = body_state(simulator, "velocities")[0]
    for frame in range(1, 31):
        simulator.step()
        rounding = 4.0 * EPSILON * np.sqrt(40 * frame) * 2.0 * (mass + 0.5)
        for found, expected in zip(whole(simulator), start, strict=True):
            np.testing.assert_allclose(found, expected, atol=rounding)
        assert kinetic(simulator) + energy(simulator) < 1.001 * gained
    assert np.abs(body_state(simulator, "velocities")[0] - before).max() > 0.02
    assert np.abs(motion(simulator)[1]).max() > 0.1


@pytest.mark.full
def test_a_ball_that_is_a_body_does_what_a_sphere_does(device):
    """A ball as a body moves like a sphere: both are the same to the impulse rule, but for rounding."""
    ball = Balloon(mesh=quad_sphere(6, 0.5), mass=0.5, damping=0.0, inflation=Inflation(pressure=0.0))
    setting = SPACE | {
        "balloon": [ball],
        "substeps": 40,
        "frames_per_second": 60.0,
        "contact": "impulse",
        "faces": False,
    }
    smooth = Body(radius=0.3, length=0.0, position=(0.1, 0.9, 0), mass=0.3, velocity=(0, -2, 0), friction=0.0)
    as_body = started(device, smooth, **setting)
    sphere = Sphere(position=(0.1, 0.9, 0), radius=0.3, mass=0.3, velocity=(0, -2, 0))
    as_sphere = Simulator(scene_of(sphere=[sphere], **setting), device, schedule="gather")
    after(as_body, 20)
    after(as_sphere, 20)
    np.testing.assert_allclose(
        body_state(as_body, "velocities")[0], as_sphere.state.sphere_velocities.numpy()[0, 0], atol=2e-3
    )
    np.testing.assert_allclose(
        body_state(as_body, "positions")[0], as_sphere.state.sphere_positions.numpy()[0, 0], atol=1e-3
    )
    assert abs(body_state(as_body, "velocities")[0, 1] + 2.0) > 0.5


@pytest.mark.parametrize("way", ["gather", "block", "lanes"])
def test_a_schedule_gives_scatters_trajectory(way, device):
    """Schedules agree within rounding three frames after contact; the collision amplifies it later."""
    if way == "lanes" and device != "cpu":
        pytest.skip("lanes is for the CPU")
    found, expected = (after(hit(device, schedule), 12) for schedule in (way, "scatter"))
    for name in ("positions", "turns", "velocities"):
        np.testing.assert_allclose(body_state(found, name), body_state(expected, name), atol=2e-4)


def test_a_balloon_carries_a_body_by_its_weight(device):
    """A tray comes to rest on a balloon with a contact force equal to its weight, and the reaction is equal and
    opposite. Later it tips over, as an inverted pendulum does."""
    ball = Balloon(mesh=quad_sphere(8, 0.5), mass=0.1, damping=3.0, position=(0, 0.5, 0))
    tray = Body(size=(0.8, 0.05, 0.8), position=(0, 1.3, 0), mass=0.2)
    simulator = Simulator(Scene(balloon=[ball], body=[tray], ground=Ground()), device, schedule="scatter")
    after(simulator, 180)
    height, pressed = body_state(simulator, "positions")[0, 1], []
    for _ in range(20):
        for _ in simulator.schedule.substeps(simulator.state):
            pushes = simulator.schedule.launches.working.body_pushes.numpy()[0].astype(float)
            pressed.append(pushes.sum(axis=0) / simulator.model.step_seconds)
    assert abs(body_state(simulator, "positions")[0, 1] - height) < 0.01
    assert height > 0.9
    np.testing.assert_allclose(np.mean(pressed, axis=0), (0.0, -0.2 * 9.81, 0.0), atol=0.02 * 0.2 * 9.81)


def test_friction_stops_what_slides_on_a_body(device):
    """Friction takes no more than its part of the normal impulse from a ball that slides on a heavy plate without
    gravity, pressed on by its speed; none where the coefficient is zero."""
    slid = []
    for friction in (0.0, 0.1, 5.0):
        plate = Body(size=(4.0, 0.2, 4.0), position=(0, -0.7, 0), mass=1e4, friction=friction)
        ball = Balloon(mesh=quad_sphere(4, 0.5), mass=0.2, damping=0.0, velocity=(2.0, -1.0, 0.0))
        simulator = after(started(device, plate, balloon=[ball], **SPACE, substeps=40), 60)
        lost = 0.4 - momentum(simulator)[0]
        gained = momentum(simulator)[1] + 0.2
        assert gained > 0.2
        slid.append(lost / gained)
    np.testing.assert_allclose(slid[:2], (0.0, 0.1), atol=2e-3)
    assert 0.1 < slid[2] < 1.5


def test_a_body_shot_at_a_balloon_does_not_go_through_particles(device):
    """A plate that moves ten times its thickness in a step does not tunnel: it takes all particles in its way along."""
    plate = Body(size=(2.0, 0.02, 2.0), position=(0, 3.0, 0), mass=50.0, velocity=(0, -80.0, 0))
    ball = Balloon(mesh=quad_sphere(4, 0.5), mass=0.2, inflation=Inflation(pressure=0.0))
    simulator = started(device, plate, balloon=[ball], **SPACE, frames_per_second=60.0, substeps=6)
    after(simulator, 6)
    below = body_state(simulator, "positions")[0, 1]
    assert motion(simulator)[0][:, 1].max() < below
