"""Gravity, helium, damping, springs and the integrator, against closed forms."""

import numpy as np
import pytest
from conserved import advanced, forces_by_scatter, put
from meshes import cube, mesh_of, quad_sphere

from balloon_warp import Balloon, Frame, Inflation, InputError, Scene, Simulator, Sphere, Stiffness, String
from balloon_warp.model import build_model

NO_INFLATION = Inflation(k_normal=0.0)
FLOAT32 = 1.2e-7
"""relative rounding of float32"""


def triangle_balloon(stiffness: float = 50.0, **fields) -> Balloon:
    """Return an equilateral triangle, corners one meter from the origin, in the x-y plane."""
    angles = np.radians([90.0, 210.0, 330.0])
    corners = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    fields = {"mass": 0.3, "damping": 0.0, "inflation": NO_INFLATION} | fields
    return Balloon(mesh=mesh_of(corners, [[0, 1, 2]]), stiffness=Stiffness(structural=stiffness), **fields)


def simulated(scene: Scene, device: str) -> Frame:
    """Return the last frame."""
    return advanced(Simulator(scene, device), scene.frames)


def test_free_fall_is_the_listing_to_the_last_bit_but_rounding(device):
    """Symplectic Euler gives x = -g h^2 n (n + 1) / 2 after n steps, not n^2 nor n (n - 1)."""
    scene = Scene(balloon=[triangle_balloon()], gravity=2.0, frames=10, frames_per_second=10, substeps=20)
    h, n = 0.1 / 20, 200
    fallen = simulated(scene, device).points[0] - triangle_balloon().mesh.points
    # 200 additions of velocities near 1: rounding of some 200 * 1.2e-7 relative
    np.testing.assert_allclose(fallen[:, 1], -2.0 * h * h * n * (n + 1) / 2, rtol=200 * FLOAT32)
    np.testing.assert_allclose(fallen[:, [0, 2]], 0.0, atol=1e-5)


def test_helium_lifts_against_gravity_along_the_up_axis(device):
    balloon = triangle_balloon(helium=12.0)
    scene = Scene(balloon=[balloon], up_axis="Z", gravity=2.0, frames=10, frames_per_second=10, substeps=20)
    velocities = simulated(scene, device).velocities[0]
    np.testing.assert_allclose(velocities, [[0.0, 0.0, 10.0]] * 3, atol=1e-4)


def test_coincident_ends_give_no_force(device):
    simulator = Simulator(Scene(balloon=[triangle_balloon()], gravity=0.0), device)
    put(simulator, np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    pull = 50.0 * (np.sqrt(3.0) - 1.0)  # both other springs are squeezed to length 1
    np.testing.assert_allclose(
        forces_by_scatter(simulator), [[0, 2 * pull, 0], [0, -pull, 0], [0, -pull, 0]], rtol=1e-5
    )


def test_stable_step_holds_and_is_not_wasteful(device):
    balloon = Balloon(mesh=quad_sphere(4), damping=0.0, inflation=NO_INFLATION)
    scene = Scene(balloon=[balloon], gravity=0.0, frames_per_second=6, frames=20)
    fewest = int(0.801 * Simulator(scene, device).model.substeps)  # "auto" takes 0.8 of the stable step
    simulator = Simulator(scene.model_copy(update={"substeps": fewest}), device)
    kick = np.random.default_rng(1).normal(0.0, 0.01, (simulator.model.particle_count, 3))
    put(simulator, velocities=kick)
    # all the energy is kinetic at first, so the rms speed can hardly grow while the scheme is stable
    assert np.std(advanced(simulator, 20).velocities[0]) < 1.5 * np.std(kick)
    with pytest.raises(InputError, match=r"^substeps: \d+ are too few .* at least \d+ are needed"):
        Simulator(scene.model_copy(update={"substeps": fewest // 2}), device)


def test_a_stiff_string_is_part_of_the_stable_step(device):
    balloon = triangle_balloon(fixed=[1, 2], helium=20.0, damping=6.0)
    string = String(anchor=(0.0, 0.9, 0.0), particle=0, stiffness=1e5)
    frame = simulated(Scene(balloon=[balloon], string=[string], frames=60), device)
    # exp(-10) of the ringing is left, so that float32's steps of 1e-7 m at a height of 1 m count
    np.testing.assert_allclose(frame.points[0][0], [0.0, 1.0 + 0.3 * (20.0 - 9.81) / 1e5, 0.0], atol=5e-7)
    assert np.abs(frame.velocities[0]).max() < 1e-3


@pytest.mark.parametrize("damping", [6.0, 60.0, 6000.0])
def test_heavy_damping_asks_for_no_shorter_step_and_never_turns_a_balloon_back(damping: float, device):
    """A balloon that is thrown up slows down and sinks at m g / c, however fast damping is for the step, by which it
    approaches that as 1 / (1 + c h / m) to the power of the steps."""
    balloon = triangle_balloon(damping=damping, velocity=(0.0, 1.0, 0.0))
    simulator = Simulator(Scene(balloon=[balloon], frames_per_second=600.0), device)
    undamped = Scene(balloon=[triangle_balloon()], frames_per_second=600.0)
    assert simulator.model.substeps == build_model(undamped, device).substeps == 1
    sinking, speeds = -0.3 * 9.81 / damping, [1.0]
    for _ in range(600):
        speeds.append(simulator.step().velocities[0][:, 1].mean())
    rate = 1.0 + damping / 0.3 / 600.0
    np.testing.assert_allclose(speeds, sinking + (1.0 - sinking) * rate ** -np.arange(601.0), atol=1e-4)


def test_frames_stay_as_they_were_read(device):
    balloon = Balloon(mesh=cube(), inflation=NO_INFLATION)
    scene = Scene(balloon=[balloon], sphere=[Sphere(position=(5, 5, 5))], frames=3)
    frames = list(Simulator(scene, device).run())
    heights = [float(frame.points[0][0, 1]) for frame in frames]
    assert heights == sorted(heights, reverse=True)
    assert len(set(heights)) == len({float(frame.sphere_positions[0, 1]) for frame in frames}) == 4
