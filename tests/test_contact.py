"""Contact of spheres, ground and strings, against closed forms."""

import numpy as np
import pytest
import warp as wp
from meshes import cube, quad_sphere

from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Sphere, Stiffness, String
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

NO_SPRINGS = Stiffness(structural=0.0, shear=0.0, flexion=0.0)


def run_frames(simulator: Simulator, frames: int) -> Simulator:
    for _ in range(frames):
        simulator.step()
    return simulator


def still_cube(**fields) -> Balloon:
    """Return the unit cube without springs, inflation or damping."""
    fields = {"stiffness": NO_SPRINGS, "inflation": Inflation(k_normal=0.0), "damping": 0.0} | fields
    return Balloon(mesh=cube(), **fields)


@pytest.mark.full
def test_a_particle_inside_a_sphere_moves_out_along_the_ray_from_its_center(device):
    corner = cube().points[6]
    center = corner + [0.06, 0.03, -0.02]
    scene = Scene(
        balloon=[still_cube()],
        sphere=[Sphere(position=tuple(center), radius=0.2)],
        gravity=0.0,
        substeps=1,
        faces=False,
    )
    points = run_frames(Simulator(scene, device), 1).read_frame().points[0]
    outward = (corner - center) / np.linalg.norm(corner - center)
    np.testing.assert_allclose(points[6], center + 0.2 * outward, atol=1e-6)
    np.testing.assert_array_equal(np.delete(points, 6, axis=0), np.delete(cube().points, 6, axis=0))


def test_a_touching_particle_keeps_no_speed_into_the_sphere(device):
    """A corner that flies into a sphere takes the sphere's normal velocity and keeps its tangential one."""
    corner = cube().points[6]
    sphere = Sphere(position=tuple(corner + [0.1, 0.0, 0.0]), radius=0.12, velocity=(-1.0, 0.0, 0.0), mass=5.0)
    simulator = Simulator(
        Scene(balloon=[still_cube()], sphere=[sphere], gravity=0.0, substeps=100, faces=False), device
    )
    velocities = np.zeros((1, 8, 3))
    velocities[0, 6] = [3.0, 0.0, 2.0]
    wp.copy(simulator.state.velocities, wp.array(velocities, dtype=wp.vec3, device=device))
    run_frames(simulator, 1)
    velocity = simulator.read_frame().velocities[0][6]
    relative = simulator.read_frame().points[0][6] - simulator.read_frame().sphere_positions[0]
    outward = relative / np.linalg.norm(relative)
    assert outward @ (velocity - [-1.0, 0.0, 0.0]) >= -1e-5  # no longer approaching
    assert velocity[2] > 1.5  # still sliding along


def test_penalty_force_is_the_touching_particles_inflation(device):
    """A touching corner accelerates the sphere by h * penalty * 100 k_normal (A_p / A_total) / M, away from itself."""
    corner = cube().points[6]
    center = corner + [0.0, 0.15, 0.0]
    sphere = Sphere(position=tuple(center), radius=0.2, mass=3.0, penalty=2.0)
    balloon = still_cube(inflation=Inflation(k_normal=0.6))
    scene = Scene(balloon=[balloon], sphere=[sphere], gravity=0.0, substeps=2, frames_per_second=1000, faces=False)
    velocity = run_frames(Simulator(scene, device), 1).read_frame().sphere_velocities[0]
    expected = (0.001 / 2) * 2.0 * (100.0 * 0.6 / 6.0) / 3.0  # the first substep's contact moves it in the second
    np.testing.assert_allclose(velocity[1], expected, rtol=0.01)  # the corner has moved by some micrometers


@pytest.mark.full
def test_spheres_bounce_on_the_ground_by_their_restitution(device):
    """A sphere bounces from height H above contact to e^2 H; the step adds an error of order g h T."""
    scene = Scene(
        balloon=[still_cube(position=(9, 9, 9))],
        sphere=[Sphere(position=(0, 1.5, 0), radius=0.5)],
        ground=Ground(restitution=0.8),
        frames=60,
        substeps=200,
    )
    simulator = Simulator(scene, device)
    heights = []
    for _ in range(60):
        simulator.step()
        heights.append(float(simulator.read_frame().sphere_positions[0, 1]) - 0.5)
    landed = int(np.argmin(heights))
    assert min(heights) >= -1e-6
    np.testing.assert_allclose(max(heights[landed:]), 0.8**2, rtol=0.01)


def test_a_balloon_rests_on_the_ground_and_friction_stops_it(device):
    """Coulomb friction mu stops a balloon that slides at v after v^2 / (2 mu g)."""
    stiff = Stiffness(structural=400.0, shear=400.0, flexion=400.0)
    balloon = still_cube(stiffness=stiff, mass=1.0, damping=0.0)
    scene = Scene(balloon=[balloon], ground=Ground(height=0.0, friction=0.4), frames=60, substeps=64)
    simulator = Simulator(scene, device)
    lowest = cube().points[:, 1].min()
    pushed = np.tile([1.0, 0.0, 0.0], (1, 8, 1))
    wp.copy(simulator.state.velocities, wp.array(pushed, dtype=wp.vec3, device=device))
    start = simulator.read_frame().points[0].mean(axis=0)
    run_frames(simulator, 60)
    frame = simulator.read_frame()
    assert lowest == 0.0
    assert frame.points[0][:, 1].min() >= -1e-6
    slid = frame.points[0].mean(axis=0) - start
    # the springs ring at the stop: some per cent of the way
    np.testing.assert_allclose(slid[0], 1.0 / (2 * 0.4 * 9.81), rtol=0.1)


@pytest.mark.full
def test_a_slack_string_does_nothing_and_a_taut_one_holds(device):
    """Helium lift F on a string of stiffness k ends at length L + F / k, as damping leaves no motion."""
    lift = 0.2 * (20.0 - 9.81)
    balloon = Balloon(mesh=quad_sphere(3), mass=0.2, helium=20.0, damping=0.6, position=(0, 2, 0))
    string = String(anchor=(0, 0, 0), length=1.5, stiffness=30.0)
    simulator = Simulator(Scene(balloon=[balloon], string=[string], frames=400), device)
    held = int(simulator.model.string_particle.numpy()[0])

    first = run_frames(simulator, 5).read_frame().velocities[0]
    free = Simulator(Scene(balloon=[balloon], frames=400, substeps=simulator.model.substeps), device)
    # Kernels for scenes with and without strings may fuse multiplications and additions differently, on a CPU where one
    # of them was compiled for a brief test, without optimization.
    np.testing.assert_allclose(first, run_frames(free, 5).read_frame().velocities[0], rtol=0, atol=1e-6)

    run_frames(simulator, 395)
    length = np.linalg.norm(simulator.read_frame().points[0][held])
    np.testing.assert_allclose(length, 1.5 + lift / 30.0, rtol=0.01)


@pytest.mark.parametrize(("speed", "left"), [(0.1, 0.0), (0.4, 0.0), (0.8, 0.3)])
def test_friction_stops_a_slow_slider_and_does_not_turn_it_back(device, speed: float, left: float):
    """Landing at 1 m/s, friction 0.5 takes at most 0.5 m/s of the sliding speed, and does not reverse it."""
    scene = Scene(balloon=[still_cube()], ground=Ground(friction=0.5), gravity=0.0, substeps=1, faces=False)
    simulator = Simulator(scene, device)
    landing = np.tile([speed, -1.0, 0.0], (1, 8, 1))
    wp.copy(simulator.state.velocities, wp.array(landing, dtype=wp.vec3, device=device))
    velocities = run_frames(simulator, 1).read_frame().velocities[0]
    touching = cube().points[:, 1] == 0.0
    np.testing.assert_allclose(velocities[touching], [[left, 0.0, 0.0]] * 4, atol=1e-6)  # rounding of 1 m/s
    np.testing.assert_allclose(velocities[~touching], landing[0, :4], atol=1e-6)


def test_penalty_follows_the_ramp_of_k_normal_within_a_frame(device):
    """The contact of each substep acts in the next: of four substeps, k_normal at the begin of the first three."""
    corner = cube().points[6]
    sphere = Sphere(position=tuple(corner + [0.0, 0.15, 0.0]), radius=0.2, mass=3.0, penalty=2.0)
    balloon = still_cube(inflation=Inflation(k_normal=[(0.0, 0.2), (0.001, 1.0)]))
    scene = Scene(balloon=[balloon], sphere=[sphere], gravity=0.0, substeps=4, frames_per_second=1000, normals="cached")
    velocity = run_frames(Simulator(scene, device), 1).read_frame().sphere_velocities[0]
    expected = (0.001 / 4) * 2.0 * (100.0 * (0.2 + 0.4 + 0.6) / 6.0) / 3.0
    np.testing.assert_allclose(velocity[1], expected, rtol=0.01)  # the corner has moved by some micrometers
