"""Scenes that have all methods between them, for tests of schedules."""

from typing import Literal

import numpy as np
from meshes import cube, grid, mesh_of, prism, quad_sphere
from odd_meshes import finned

from balloon_warp.benchmarks.matrix import of_phase
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.substep import asking_phases
from balloon_warp.scene import (
    Atmosphere,
    Balloon,
    Body,
    Force,
    Ground,
    Inflation,
    Material,
    Neck,
    Obstacle,
    Scene,
    Sphere,
    Stiffness,
    String,
    Touch,
    Tube,
    Water,
)
from balloon_warp.scene.overrides import override_scene, parse_override

PAPERS = Inflation(k_normal=0.2)
"""by normal forces"""


def everything(normals: Literal["cached", "fresh"] = "cached") -> Scene:
    """Return two balloons, with all that a scene can have: n-gons, fixed and unused particles, springs that vary."""
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
            Balloon(
                mesh=prism(5),
                position=(3.0, 0.85, 0.0),
                rotation=(20.0, 30.0, 0.0),
                mass=0.2,
                inflation=PAPERS,
            ),
        ],
        sphere=[
            Sphere(position=(0.1, 1.13, 0.0), radius=0.2, mass=0.4, velocity=(0.0, -1.0, 0.0)),
            Sphere(position=(3.2, 2.1, 0.4), radius=0.5, mass=2.0, penalty=2.0, velocity=(0.0, -3.0, 0.0)),
            Sphere(position=(-2.0, 0.3, 0.0), radius=0.29),
        ],
        string=[
            String(anchor=(0.0, 0.0, 0.0), particle="highest", length=0.8),
            String(anchor=(5.0, 1.0, 0.0), balloon=1, particle=4, length=0.5),
            String(anchor=(5.0, 2.0, 0.0), balloon=1, particle=4, length=30.0),
        ],
        force=[
            Force(particles=[0, 3, 7], newtons=(0.3, 0.1, -0.2)),
            Force(balloon=1, newtons=(0.0, 0.2, 0.1)),
            Force(balloon=1, particles=[1, 3], newtons=(-0.1, 0.0, 0.0)),
        ],
        ground=Ground(),
        touch=False,
    )


def bare() -> Scene:
    """Return a balloon and nothing else."""
    return Scene(balloon=[Balloon(mesh=quad_sphere(3), helium=12.0, inflation=PAPERS)], normals="cached", substeps=33)


def afloat() -> Scene:
    """Return everything in a light liquid whose surface cuts through both balloons."""
    return everything().model_copy(update={"water": Water(level=0.7, density=3.0)})


def with_rubber() -> Scene:
    """Return everything, with springs that are viscous and yield, the second balloon's sooner."""
    rubber = Stiffness(variation=0.3, viscosity=2e-3, yield_stretch=1.4, gradient=(0.5, 1.5))
    other = Stiffness(viscosity=5e-3, yield_stretch=1.02, torsion=0.05)
    return _with_stiffness(everything(), rubber, other)


def _with_stiffness(scene: Scene, *of_balloons: Stiffness) -> Scene:
    balloons = [
        balloon.model_copy(update={"stiffness": stiffness})
        for balloon, stiffness in zip(scene.balloon, of_balloons, strict=True)
    ]
    return scene.model_copy(update={"balloon": balloons})


LATEX = Material(preset="latex", viscosity=20.0, springs=["flexion"])
TOUGH = Material(preset="natural_rubber_treloar", thickness=1e-3)


def of_materials(scene: Scene) -> Scene:
    """Return a scene whose first two balloons are of rubber."""
    first, second, *others = scene.balloon
    first = first.model_copy(update={"material": LATEX})
    second = second.model_copy(update={"material": TOUGH})
    return scene.model_copy(update={"balloon": [first, second, *others]})


def softening() -> Scene:
    """Return a scene with rubber that softens once it has been stretched further (the Mullins effect)."""
    scene = of_materials(in_air())
    softer = {"softening": 0.4, "softening_energy": 3.0e4}
    first, *others = scene.balloon
    first = first.model_copy(update={"material": LATEX.model_copy(update=softer)})
    return scene.model_copy(update={"balloon": [first, *others]})


def bursting() -> Scene:
    """Return everything, with a balloon of rubber that a needle pierces, and whose hole does not grow. It is thinner to
    one side, as rounding would choose the most loaded face of a round ball."""
    scene = everything("fresh")
    thinner = (1.0 + 0.6 * scene.balloon[0].mesh.points @ np.array([0.31, 0.17, 0.9])).tolist()
    torn = Material(preset="latex", strength=1e9, tear_strength=1e9, needle_time=0.05, weights=thinner)
    pricked = {"material": torn, "inflation": Inflation(kind="gas", start_pressure=100.0), "helium": 0.0}
    first, *others = scene.balloon
    return scene.model_copy(update={"balloon": [first.model_copy(update=pricked), *others], "substeps": "auto"})


IMPULSE = {"contact": "impulse"}
CORRECTED = {"correction": "provot", "correction_limit": 0.01, "correction_sweeps": 2}


def corrected(correction: Literal["provot", "tarantino"]) -> Scene:
    """Return everything, with springs that reach their strain limit soon."""
    return everything().model_copy(update=CORRECTED | {"correction": correction})


def with_torsion() -> Scene:
    """Return everything, with torsion springs across the edges of quads and of pentagons."""
    return _with_stiffness(everything(), Stiffness(variation=0.3, torsion=0.02), Stiffness(torsion=0.05))


def by_forward_euler() -> Scene:
    """Return everything under forward Euler, for so short a time that it gains little energy."""
    return everything().model_copy(update={"solver": "forward_euler"})


def in_air() -> Scene:
    """Return gas that is pumped, flows through a tube, leaks and drives by a jet, pressure and normal forces, beside
    all that a scene can have."""
    scene = everything("fresh")
    ball, pentagon = scene.balloon
    gas = Inflation(kind="gas", start_pressure=30.0, pump=[(0.0, 0.02), (0.05, -0.01)], gamma=1.3)
    less_gas = gas.model_copy(update={"start_pressure": 9.0, "breathing_damping": 0.3, "leak": 3e-5, "pump": 0.0})
    less_gas = less_gas.model_copy(update={"litres": 2.0, "fill_time": 0.06})
    neck = Neck(at="highest", diameter=0.015, discharge=0.8, opens=0.02)
    balloons = [
        ball.model_copy(update={"helium": 0.0, "inflation": gas, "drag_coefficient": 0.4}),
        pentagon.model_copy(update={"inflation": Inflation(kind="pressure", pressure=[(0.0, 5.0), (0.1, 20.0)])}),
        Balloon(mesh=cube(), position=(6.0, 0.3, 0.0), drag_coefficient=1.0, helium=9.0, inflation=PAPERS),
        Balloon(mesh=quad_sphere(3), position=(-6.0, 2.0, 0.0), inflation=less_gas, neck=neck),
    ]
    surroundings = {
        "tube": [Tube(balloons=(0, 3), conductance=1e-4)],
        "atmosphere": Atmosphere(wind=(3.0, 0.0, -1.0)),
        "water": Water(level=0.3, density=3.0),
    }
    return scene.model_copy(update={"balloon": balloons, **surroundings})


def in_air_with_rubber() -> Scene:
    """Return the scene in air, with springs that depend on velocities."""
    return _with_stiffness(in_air(), *[Stiffness(viscosity=2e-3, yield_stretch=1.4)] * 4)


def in_air_by_forward_euler() -> Scene:
    """Return the scene in air by forward Euler, with a fin, whose faces pass corners twice."""
    scene = in_air()
    ball, other, *others = scene.balloon
    balloons = [ball, other.model_copy(update={"mesh": finned(2)}), *others]
    return scene.model_copy(update={"solver": "forward_euler", "balloon": balloons})


STILL = [
    Obstacle(size=(0.2, 1.0, 1.0), position=(0.6, 0.49, 0.0), friction=0.2),
    Obstacle(radius=0.3, length=0.6, position=(2.95, -0.1, 0.1), rotation=(0.0, 0.0, 90.0)),
]
MOVING = [
    *STILL,
    Obstacle(shape="plane", position=(0, -0.5, 0), rotation=(1, 0, 0), motion=[(0, (0, 0, 0)), (0.1, (0, 0.7, 0))]),
    Obstacle(mesh=quad_sphere(3, 0.4), position=(-0.95, 0.4, 0), motion=[(0, (0, 0, 0)), (1, (2, 0, 0), (0, 90, 0))]),
    Obstacle(mesh=grid(3, 3), position=(2.4, 1.2, -0.4), rotation=(-70.0, 0.0, 0.0), thickness=0.05),
]


def among(obstacles: list[Obstacle], scene: Scene) -> Scene:
    """Return a scene with obstacles that its balloons touch from the start."""
    return scene.model_copy(update={"obstacle": obstacles})


def rubbing(scene: Scene) -> Scene:
    """Return a scene whose spheres have friction."""
    return scene.model_copy(update={"sphere": [ball.model_copy(update={"friction": 0.3}) for ball in scene.sphere]})


def in_touch(itself: bool = False) -> Scene:
    """Return the scene with balloons in contact: one comes down on what floats."""
    scene = in_air_with_rubber()
    third = scene.balloon[2].model_copy(update={"position": (0.1, 0.85, 0.0), "helium": 0.0, "velocity": (0, -1, 0)})
    balloons = [*scene.balloon[:2], third, *scene.balloon[3:]]
    return scene.model_copy(
        update={"balloon": balloons, "touch": Touch(itself=itself, spheres=False), "substeps": "auto"}
    )


def with_bodies() -> Scene:
    """Return everything with free bodies: one falls on a balloon, one on the ground and one on an obstacle."""
    scene = everything().model_copy(update={"obstacle": STILL, "touch": Touch(balloons=False)})
    marble = Sphere(position=(0.1, 3.0, 0.05), radius=0.004)
    bodies = [
        Body(size=(0.2, 0.3, 0.4), position=(-0.7, 0.6, 0.1), velocity=(1, 0, 0), mass=0.05),
        Body(mesh=quad_sphere(3, 0.2), position=(5.0, 0.3, 0.0), angular_velocity=(0, 0, 3)),
    ]
    return scene.model_copy(update={"sphere": [*scene.sphere, marble], "body": bodies})


def with_phase(phase: Phase) -> Scene:
    """Return everything with a phase and its parameters."""
    overrides = [each for each in of_phase(phase).overrides if not each.startswith("sphere=")]
    return override_scene(everything(), map(parse_override, overrides))


_SCENES = {
    "everything": everything(),
    "fresh": everything("fresh"),
    "bare": bare(),
    "afloat": afloat(),
    "rubber": with_rubber(),
    "torsion": with_torsion(),
    "materials": of_materials(everything()),
    "materials in air": of_materials(in_air()),
    "softening": softening(),
    "bursting": bursting(),
    "provot": corrected("provot"),
    "tarantino": corrected("tarantino"),
    "forward Euler": by_forward_euler(),
    "in air": in_air(),
    "rubber in air": in_air_with_rubber(),
    "corrected in air": in_air().model_copy(update=CORRECTED),
    "forward Euler in air": in_air_by_forward_euler(),
    "impulse": everything().model_copy(update=IMPULSE),
    "impulse in air": rubbing(in_air().model_copy(update=IMPULSE)),
    "corrected impulse in air": in_air().model_copy(update=CORRECTED | IMPULSE),
    "obstacles": among(STILL, everything()),
    "obstacles in air": among(MOVING, in_air()),
    "corrected impulse among obstacles": rubbing(among(MOVING, everything().model_copy(update=CORRECTED | IMPULSE))),
    "bodies": rubbing(with_bodies()),
    "contacts told": everything().model_copy(update={"contacts": True}),
    "touch": in_touch(),
    "touch itself": in_touch(itself=True),
}
_SCENES |= {phase.name: with_phase(phase) for phase in asking_phases() if phase.rows}
SCENES = {
    name: scene if scene.body or scene.touch else scene.model_copy(update={"faces": False})
    for name, scene in _SCENES.items()
}
"""spheres and obstacles are small beside their coarse faces: so that blocks and lanes do all that they can, these meet
particles alone"""
