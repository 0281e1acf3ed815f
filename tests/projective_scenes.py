"""Scenes for the `projective` solver."""

import numpy as np
import warp as wp
from meshes import quad_sphere
from trajectories import stepped

from balloon_warp import Balloon, Ground, Inflation, Scene, Simulator, Sphere, Stiffness, String

SOFT = Stiffness(structural=20.0, shear=10.0, flexion=5.0)


def kicked_balloon(iterations: int = 10, stiffness: Stiffness = SOFT, **fields) -> Scene:
    """Return a small balloon in large steps, with fixed particles, a taut string and a slack one; no contacts."""
    balloon = Balloon(
        mesh=quad_sphere(2, radius=0.5),
        damping=0.2,
        stiffness=stiffness,
        inflation=Inflation(k_normal=0.1),
        fixed=[3],
    )
    strings = [
        String(anchor=(0.0, -1.5, 0.0), particle="lowest", length=0.8),
        String(anchor=(0.0, 1.5, 0.0), particle="highest", length=2.0),
    ]
    fields = {"substeps": 1, "string": strings} | fields
    return Scene(balloon=[balloon], solver="projective", solver_iterations=iterations, **fields)


def kick(simulator: Simulator, speed: float = 3.0) -> None:
    """Give every free particle a velocity of its own."""
    shape = (1, simulator.model.particle_count, 3)
    velocities = np.random.default_rng(7).normal(0.0, speed, shape)
    velocities[:, simulator.model.particle_mass_share.numpy() == 0.0] = 0.0
    velocities = np.repeat(velocities, simulator.model.world_count, axis=0)
    wp.copy(simulator.state.velocities, wp.array(velocities, dtype=wp.vec3, device=simulator.model.device))


def full_scene(**fields) -> Scene:
    """Return a scene with changing inflation, varied springs, fixed particles, strings, a struck sphere, and ground."""
    balloon = Balloon(
        mesh=quad_sphere(3, radius=0.5),
        position=(0.0, 0.495, 0.0),
        damping=0.2,
        stiffness=Stiffness(variation=0.3),
        inflation=Inflation(k_normal=[(0.0, 0.1), (0.05, 0.3)]),
        fixed=[5],
    )
    return Scene(
        balloon=[balloon, balloon.model_copy(update={"position": (3.0, 0.6, 0.0), "mass": 0.2, "fixed": []})],
        sphere=[Sphere(position=(0.0, 1.14, 0.0), radius=0.25, mass=0.2, velocity=(0.0, -0.5, 0.0))],
        string=[String(anchor=(3.0, 2.0, 0.0), balloon=1, particle="highest", length=0.7)],
        ground=Ground(),
        **fields,
    )


def after_frames(scene: Scene, device: str, frames: int = 4, worlds: int = 1, vary=None, schedule="auto") -> Simulator:
    return stepped(Simulator(scene, device, worlds, vary, schedule), frames)
