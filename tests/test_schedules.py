"""Every schedule against `scatter`, against itself, and a world alone against the same world in a batch."""

import numpy as np
import pytest
import warp as wp
from meshes import mesh_of, prism, quad_sphere

from balloon_warp.errors import InputError
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Sphere, Stiffness, String
from balloon_warp.scene.load import bundled_scenes, load_scene
from balloon_warp.simulator import Simulator

FAST = ["gather"]
"""the schedules that are tested against `scatter`"""
ROUNDING = 3e-6
"""Difference allowed after a short run [m], of bodies some meters large: a float32 there is rounded by up to 2e-7, a
run adds some ten of those, and contacts pass them on. Longer runs differ by more, since colliding bodies are chaotic:
a difference doubles every few frames."""


def everything(normals: str = "cached") -> Scene:
    """Two balloons, with all that a scene can have: n-gons, fixed and unused particles, springs that vary."""
    ball = quad_sphere(4, radius=0.5)
    ball = mesh_of([*ball.points, (9.0, 9.0, 9.0)], ball.face_vertex_indices.reshape(-1, 4).tolist())
    return Scene(
        normals=normals,
        substeps=48,
        balloon=[
            Balloon(
                mesh=ball,
                position=(0.0, 0.49, 0.0),
                helium=3.0,
                damping=0.2,
                stiffness=Stiffness(variation=0.3),
                inflation=Inflation(k_normal=[(0.0, 0.1), (0.03, 0.5), (0.1, 0.2)]),
                fixed=[3, 17],
            ),
            Balloon(mesh=prism(5), position=(3.0, 0.4, 0.0), rotation=(20.0, 30.0, 0.0), mass=0.2),
        ],
        sphere=[
            Sphere(position=(0.1, 1.13, 0.0), radius=0.2, mass=0.4, velocity=(0.0, -1.0, 0.0)),
            Sphere(position=(3.2, 1.9, 0.1), radius=0.5, mass=2.0, penalty=2.0),
            Sphere(position=(-2.0, 0.3, 0.0), radius=0.29),
        ],
        string=[
            String(anchor=(0.0, 0.0, 0.0), particle="highest", length=0.8),
            String(anchor=(5.0, 1.0, 0.0), balloon=1, particle=4, length=0.5),
            String(anchor=(5.0, 2.0, 0.0), balloon=1, particle=4, length=30.0),
        ],
        ground=Ground(),
    )


def bare() -> Scene:
    """A balloon and nothing else."""
    return Scene(balloon=[Balloon(mesh=quad_sphere(3), helium=12.0)], substeps=33)


SCENES = {"everything": everything(), "fresh": everything("fresh"), "bare": bare()}


def after_frames(scene: Scene, schedule: str, device: str, frames: int = 3, worlds: int = 1) -> Simulator:
    simulator = Simulator(scene, device, worlds, schedule=schedule)
    for _ in range(frames):
        simulator.step()
    return simulator


def arrays(simulator: Simulator) -> dict[str, np.ndarray]:
    state = vars(simulator.state)
    return {name: array.numpy() for name, array in state.items()}


@pytest.mark.parametrize("schedule", FAST)
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_a_schedule_gives_scatters_trajectory(scene, schedule, device):
    found, expected = (after_frames(scene, name, device) for name in (schedule, "scatter"))
    start = Simulator(scene, device).state.points.numpy()
    assert np.abs(expected.state.points.numpy() - start).max() > 1000 * ROUNDING  # there is something to compare
    for name, tolerance in {
        "points": ROUNDING,
        "sphere_positions": ROUNDING,
        "velocities": ROUNDING / scene_step(expected) / 10,
        "sphere_velocities": ROUNDING / scene_step(expected) / 10,
        "inflation_aims": ROUNDING,
        "frame": 0,
    }.items():
        np.testing.assert_allclose(arrays(found)[name], arrays(expected)[name], rtol=0, atol=tolerance, err_msg=name)


def scene_step(simulator: Simulator) -> float:
    return simulator.model.step_seconds
