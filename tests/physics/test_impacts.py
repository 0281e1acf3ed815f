"""Momentum and angular momentum stay where things meet in space, and no energy is gained: a case a kind of contact."""

from typing import NamedTuple

import numpy as np
import pytest
from conserved import masses, motion, sphere_momenta, sphere_spins
from meshes import quad_sphere
from numpy.typing import NDArray
from rigid import EPSILON, SPACE, body_masses, body_state, scene_of, whole
from touching import collision

from balloon_warp import Balloon, Body, Inflation, Scene, Simulator, Sphere, Touch
from balloon_warp.model.touch import edge_length

COARSE = quad_sphere(3, 0.5)
EDGE = edge_length(COARSE)
STILL = {"damping": 0.0, "inflation": Inflation(pressure=0.0)}


class Meeting(NamedTuple):
    """Things that meet, and what is allowed to change."""

    scene: Scene
    frames: int
    rounding: float | tuple[float, float]
    """Of momentum [kg m/s] and angular momentum [kg m^2/s] in the end: substeps round to either side, so that it grows
    as the root of their number"""
    pushed: float
    """Change of the momentum of a thing [kg m/s], at least"""
    gain: float = 1e-3
    """Part of the energy: explicit steps swing by h omega / 2 of that in the fastest springs"""
    left: tuple[float, float] = (0.0, 1.001)
    """Part of the energy in the end"""
    falls: bool = False
    """Whether energy that is lost does not come back from springs, either"""
    spun: float = 0.0
    """Spin of a sphere in the end [rad/s], at least"""


def at_a_ball(sphere: Sphere, ball: Balloon | None = None, **fields: object) -> Scene:
    """Return a sphere that flies at a balloon of 386 particles without a pressure, in space."""
    fine = Balloon(mesh=quad_sphere(8, 0.5), mass=0.3, **STILL)
    setting = SPACE | {"contact": "impulse", "substeps": 60}
    return Scene(balloon=[ball or fine], sphere=[sphere], **setting | fields)


def rubbing(at: tuple[float, float, float], radius: float, mass: float, friction: float) -> Meeting:
    """Return a sphere that a balloon turns."""
    sphere = Sphere(position=at, radius=radius, mass=mass, velocity=(-2.0, 1.0, 0.4), friction=friction)
    rounding = 0.35 * 2.4 * EPSILON * np.sqrt(15 * 60) * 4.0
    return Meeting(at_a_ball(sphere), 15, rounding, 0.1 * mass, spun=0.5)


def on_faces(speed: float) -> Meeting:
    """Return a sphere much smaller than a face. Rounding comes once more at each of some hundred contacts."""
    sphere = Sphere(position=(0.7, 0.12, 0.05), radius=0.02, mass=0.05, velocity=(-speed, 0.0, 0.2 * speed))
    rounding = 0.35 * speed * EPSILON * np.sqrt(60 * 60) * 4.0
    return Meeting(at_a_ball(sphere, touch=Touch()), 60, rounding, 0.02 * speed)


def on_a_flat_face(friction: float) -> Meeting:
    """Return a sphere larger than the faces, at the middle of one of them."""
    place, moves = (0.56 + 2.0 * EDGE, 0.16, 0.15), {"velocity": (-2.0, 0.0, 0.5), "mass": 0.2}
    sphere = Sphere(position=place, radius=2.0 * EDGE, friction=friction, **moves)
    scene = at_a_ball(sphere, Balloon(mesh=COARSE, mass=0.3, **STILL), faces=True)
    return Meeting(scene, 40, (2e-6, 6e-5), 0.1, left=(0.0, 0.95), falls=True)


def on_gas() -> Meeting:
    """Return a sphere that hits a balloon, most of whose mass is gas."""
    gas = Inflation(kind="gas", start_pressure=10.0, molar_mass=0.02)
    ball = Balloon(mesh=quad_sphere(4, 0.5), mass=0.1, damping=0.0, inflation=gas)
    sphere = Sphere(position=(0.1, 0.9, 0.05), radius=0.3, mass=0.5, velocity=(0.0, -2.0, 0.3))
    rounding = EPSILON * np.sqrt(40 * 20) * 2.0
    # its pressure stores energy, of which `whole` does not know
    return Meeting(at_a_ball(sphere, ball, substeps=40), 20, rounding, 0.1, gain=np.inf, left=(0.0, np.inf))


def on_a_wall(speed: float) -> Meeting:
    """Return a sphere that a free wall throws back; in a step of the fast one's it goes ten times its thickness."""
    wall = Body(size=(0.05, 1.0, 1.0), mass=3.0, restitution=1.0)
    moves = {"mass": 0.5, "velocity": (speed, 0, 0), "restitution": 1.0}
    scene = scene_of(wall, sphere=[Sphere(position=(-0.5, 0.2, 0.1), radius=0.05, **moves)], **SPACE)
    return Meeting(scene, 40, 400 * EPSILON * speed, 0.5 * speed, gain=0.02, left=(0.98, 1.02))


def on_the_end_of_a_box() -> Meeting:
    box = Body(shape="box", size=(0.4, 0.1, 0.3), mass=0.5, friction=0.8)
    ball = Sphere(position=(0.12, 0.3, 0.02), radius=0.1, mass=0.3, velocity=(-1.0, -2.0, 0.3), friction=0.8)
    scene = scene_of(box, sphere=[ball], **SPACE, frames_per_second=60.0, substeps=60)
    return Meeting(scene, 12, 2e-6, 0.1, left=(0.0, 0.99), spun=1.0)


def two_boxes() -> Meeting:
    """Return a box that hits another off its center, with friction, so that both turn away."""
    boxes = [
        Body(size=(0.4, 0.3, 0.2), position=(-0.6, 0.1, 0.02), velocity=(3.0, 0, 0), mass=1.0),
        Body(size=(0.2, 0.5, 0.3), position=(0, 0, 0), mass=2.0, angular_velocity=(1.0, 0, 2.0)),
    ]
    return Meeting(scene_of(*boxes, **SPACE), 60, 600 * EPSILON * 3.0, 0.6, gain=1e-4)


def body_at_a_ball(mass: float) -> Meeting:
    """Return a turning body that hits a balloon at rest off its center."""
    ball = Balloon(mesh=quad_sphere(6, 0.5), mass=0.5, **STILL)
    moves = {"position": (0.15, 0.9, 0.05), "velocity": (0, -2.0, 0.2), "angular_velocity": (1, 2, -1)}
    setting = SPACE | {"balloon": [ball], "substeps": 40, "faces": False, "frames_per_second": 60.0}
    rounding = 4.0 * EPSILON * np.sqrt(40 * 30) * 2.0 * (mass + 0.5)
    return Meeting(scene_of(Body(size=(0.5, 0.3, 0.4), mass=mass, **moves), **setting), 30, rounding, 0.02 * mass)


MEETINGS = {
    "balloons": Meeting(collision(), 60, EPSILON * np.sqrt(48 * 60) * 0.6 * 4.0, 0.3, left=(0.5, 0.99)),
    **{f"large sphere, friction {mu}": rubbing((0.75, 0.2, 0.05), 0.15, 0.2, mu) for mu in (0.3, 5.0)},
    **{f"small sphere, friction {mu}": rubbing((0.6, 0.2, 0.05), 0.02, 0.05, mu) for mu in (0.3, 5.0)},
    **{f"faces at {speed} m per s": on_faces(speed) for speed in (1.0, 20.0)},
    **{f"flat face, friction {mu}": on_a_flat_face(mu) for mu in (0.0, 0.6)},
    "gas": on_gas(),
    **{f"wall at {speed} m per s": on_a_wall(speed) for speed in (2.0, 500.0)},
    "end of a box": on_the_end_of_a_box(),
    "two boxes": two_boxes(),
    **{f"body of {mass} kg": body_at_a_ball(mass) for mass in (0.02, 0.3, 20.0)},
}
BY_DEFAULT = ("flat face, friction 0.0", "wall at 2.0 m per s", "wall at 500.0 m per s", "end of a box", "two boxes",
              "body of 0.3 kg")  # fmt: skip


def momenta(simulator: Simulator) -> NDArray[np.float64]:
    """Return the momentum of each balloon, sphere and body [kg m/s], shape (things, 3)."""
    of_particles = masses(simulator)[:, None] * motion(simulator)[1]
    of_balloons = np.add.reduceat(of_particles, simulator.model.particle_offsets[:-1])
    of_bodies = body_masses(simulator)[:, None] * body_state(simulator, "velocities")
    return np.concatenate([of_balloons, sphere_momenta(simulator), of_bodies])


@pytest.mark.always(*(f"{device}-{name}" for device in ("cpu", "cuda:0") for name in BY_DEFAULT))
@pytest.mark.parametrize("name", MEETINGS)
def test_momentum_and_angular_momentum_stay_and_no_energy_is_gained(name: str, device: str):
    scene, frames, rounding, pushed, gain, left, falls, spun = MEETINGS[name]
    simulator = Simulator(scene, device)
    start, before, energies, most = whole(simulator), momenta(simulator), [1.0], 0.0
    for frame in range(1, frames + 1):
        simulator.step_unread()
        *now, energy = whole(simulator)
        allowed = np.broadcast_to(rounding, 2) * np.sqrt(frame / frames)
        for found, expected, atol in zip(now, start[:2], allowed, strict=True):
            np.testing.assert_allclose(found, expected, atol=atol)
        energies.append(energy / start[2])
        most = max(most, float(np.abs(momenta(simulator) - before).max()))
    assert most > pushed
    bounds = np.minimum.accumulate(energies)[:-1] if falls else np.ones(frames)
    assert (energies[1:] < (1.0 + gain) * bounds).all()
    assert left[0] < energies[-1] < left[1]
    assert np.abs(sphere_spins(simulator)).max(initial=0.0) >= spun
