"""Spheres that are small beside faces collide with these, with `[touch]`: no tunneling at any size and speed."""

import numpy as np
import pytest
from conserved import after_each, motion
from meshes import cube, grid, quad_sphere

from balloon_warp import Atmosphere, Balloon, Ground, Inflation, Scene, Simulator, Sphere, Touch
from balloon_warp.benchmarks.overlap import winding
from balloon_warp.schedules.choose import schedule_named
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.touch_table import triangles_of

RADIUS = 0.5


def flight(sphere: Sphere, contact: str = "impulse", **fields) -> Scene:
    """Return a balloon of 386 particles in space, and a sphere."""
    ball = Balloon(mesh=quad_sphere(8, RADIUS), mass=0.3, damping=0.0)
    setting = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0), "touch": Touch(), "contact": contact}
    return Scene(balloon=[ball], sphere=[sphere], **setting | fields)


def flying(mass: float = 0.05) -> Sphere:
    """Return a sphere smaller than a tenth of a face that flies at the balloon between particles."""
    return Sphere(position=(1.0, 0.022, 0.031), radius=0.004, mass=mass, velocity=(-40.0, 0.0, 0.0))


def sides_of(scene: Scene, device: str, schedule: str, frames: int) -> list[float]:
    """Return the winding numbers around the sphere's center after each frame, or each substep of `scatter`."""
    simulator = Simulator(scene, device, schedule=schedule)
    triangles = triangles_of(simulator.model.shapes[0].mesh)
    found = []
    for _ in range(frames):
        for _ in simulator.schedule.substeps(simulator.state) if schedule == "scatter" else [simulator.step()]:
            points, _ = motion(simulator)
            center = simulator.state.sphere_positions.numpy()[0, 0].astype(float)
            found.append(float(winding(center[None], points[triangles])[0]))
    return found


@pytest.mark.parametrize("speed", [0.5, 5.0, 100.0, 1000.0])
@pytest.mark.parametrize("radius", [0.0001, 0.005, 0.03])
def test_one_that_is_inside_stays_inside(radius, speed, device):
    """A substep at the highest speed would take it three times the balloon's width, and the balloon moves along."""
    ball = Sphere(position=(0.05, 0.02, 0.03), radius=radius, mass=0.05, velocity=(speed, 0.3 * speed, 0.1 * speed))
    np.testing.assert_allclose(sides_of(flight(ball), device, "scatter", frames=12), 1.0, atol=1e-3)


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
@pytest.mark.parametrize("mass", [0.001, 0.05, 2.0])
def test_one_that_is_outside_stays_outside(mass, contact, device):
    ball = flying(mass=mass)
    np.testing.assert_allclose(sides_of(flight(ball, contact), device, "scatter", frames=12), 0.0, atol=1e-3)


def test_without_touch_it_flies_through(device):
    assert max(sides_of(flight(flying(), touch=None, faces=False), device, "scatter", frames=4)) > 0.9


def test_it_lies_on_a_net_that_bears_its_weight(device):
    """A net pinned at its border sags under a ball a fifth as wide as a face, in 10 seconds of slow rolling."""
    net = grid(4, 4)
    border = [n for n, point in enumerate(net.points) if point[:2].min() == 0.0 or point[:2].max() == 4.0]
    slack = Inflation(pressure=0.0)
    held = Balloon(mesh=net, scale=0.1, rotation=(-90, 0, 0), fixed=border, inflation=slack, mass=0.05, damping=0.5)
    ball = Sphere(position=(0.24, 0.1, -0.23), radius=0.01, mass=0.1)
    simulator = Simulator(Scene(balloon=[held], sphere=[ball], touch=Touch(), contact="impulse", substeps=48), device)
    assert isinstance(simulator.schedule, GatherSchedule)
    heights = after_each(simulator, 900, lambda each: float(each.state.sphere_positions.numpy()[0, 0, 1]))
    lowest = float(simulator.state.points.numpy()[0, :, 1].min())
    assert lowest < heights[-1] < lowest + 0.02  # on the lowest faces, by less than two radii of the lowest corner
    assert -0.15 < lowest < -0.05
    assert np.ptp(heights[-60:]) < 0.002
    assert np.abs(simulator.state.sphere_velocities.numpy()).max() < 0.02


def test_what_is_large_beside_faces_needs_no_more(device):
    ball = Sphere(position=(1.0, 0.0, 0.0), radius=0.2)
    assert schedule_named("block", Simulator(flight(ball), device).model).name == "block"
    beside_a_cube = flight(ball).model_copy(update={"balloon": [Balloon(mesh=cube())]})
    assert issubclass(schedule_named("auto", Simulator(beside_a_cube, device).model), GatherSchedule)


def test_touch_says_that_spheres_may_be_left_alone(device):
    ball = Sphere(position=(1.0, 0.0, 0.0), radius=0.01)
    model = Simulator(flight(ball, touch=Touch(itself=True, spheres=False)), device).model
    assert model.warnings[0].startswith("sphere 0: its radius of 0.01 m fits through faces")
    assert Simulator(flight(ball), device).model.warnings == []


def test_a_ball_rolls_about_in_a_balloon_on_the_ground(device):
    marble = Sphere(position=(0.1, 0.0, 0.05), radius=0.015, mass=0.02)
    scene = flight(marble, gravity=9.8, ground=Ground(height=-0.7))
    found = sides_of(scene, device, "gather", frames=90)
    np.testing.assert_allclose(found, 1.0, atol=1e-3)
