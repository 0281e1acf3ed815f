"""Scenes of gradients, a loss, and finite differences of a run in double precision."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from meshes import mesh_of, quad_sphere
from reference_runs import Run, run

import balloon_warp as bw
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model import plan_model
from balloon_warp.statics.volume import Volume
from balloon_warp.trajectories import Trajectories

BALL = quad_sphere(2)
TRIANGLES = mesh_of(BALL.points, triangles_of(BALL))
N = len(BALL.points)
RNG = np.random.default_rng(3)
WEIGHTS, TARGET = RNG.uniform(0.5, 1.5, (N, 1)), RNG.normal(size=(N, 3))
SPRINGS = ["balloon.stiffness.structural", "balloon.stiffness.shear", "balloon.stiffness.flexion"]
MOTION = [
    *("balloon.mass", "balloon.damping", "gravity", "balloon.position.1", "balloon.velocity.0", "balloon.velocity.1"),
    *("balloon.angular_velocity.2", "balloon.rotation.0"),
]
RUBBER = [f"balloon.material.{name}" for name in ("shear_modulus", "thickness", "mooney_ratio")]
GAS = [
    *("balloon.inflation.start_pressure", "balloon.inflation.added_mass", "balloon.inflation.molar_mass"),
    *("atmosphere.pressure", "atmosphere.temperature"),
]


BESIDE: dict[str, Any] = {
    "position": (0.0, 1.02, 0.0),
    "velocity": (4.0, -2.0, 2.0),
    "angular_velocity": (0.1, 0.2, -0.1),
}
"""A ball that comes down on obstacles, and to those at its sides"""
AMONG = [
    {
        "size": (1.0, 1.0, 3.0),
        "rotation": (0.0, 0.0, 40.0),
        "position": (-0.02, -0.703, 0.0),
        "friction": 0.3,
        "thickness": 0.02,
    },
    {"radius": 0.5, "length": 0.4, "rotation": (80.0, 0.0, 0.0), "position": (1.5, 1.0, 0.1), "friction": 0.4},
    {"shape": "plane", "rotation": (-80.0, 0.0, 10.0), "position": (0.0, 1.0, 1.002), "friction": 0.2},
]
"""The edge of a box below, a capsule and a plane at its sides"""
RIDGED: list[dict[str, Any]] = [
    {"size": (0.4, 0.4, 0.4), "rotation": (45.0, 0.0, 35.26), "position": (0.02, -0.346, 0.03), "friction": 0.4},
    {"size": (0.2, 3.0, 0.2), "rotation": (0.0, 45.0, 3.0), "position": (1.2, 0.4, 0.12), "friction": 0.2},
    {"radius": 0.01, "length": 3.0, "position": (-0.43, 0.11, 0.0), "rotation": (80.0, 0.0, -10.0), "friction": 0.3},
]
"""The corner of a box below, an edge beside, and a rod"""
STAYS = [(0.0, (0.0, 0.0, 0.0)), (1.0, (0.0, 0.0, 0.0))]
"""Motion of an obstacle that may move"""
PUMPED = {"start_pressure": 40.0, "pump": [[0.0, 400.0], [0.04, 100.0]], "leak": 1e-3}
PUMP = ["balloon.inflation.leak", "balloon.0.inflation.pump.0.1", "balloon.0.inflation.pump.1.1"]
CHANGES: list[dict[str, Any]] = [
    {"time": 2.0 / 240.0, "set": {"balloon.damping": 0.3, "balloon.stiffness.structural": 120.0, "gravity": 8.0}},
    {"time": 4.0 / 240.0, "set": {"balloon.inflation.pressure": 30.0, "gravity": 5.0}},
    {"time": 4.0 / 240.0, "set": {"balloon.damping": 0.1}},
]
PRESSED: list[dict[str, Any]] = [
    {"position": (-0.5, 2.5, 0.1), "radius": 0.9, "mass": 0.5, "velocity": (0.5, -4.0, 0.0), "penalty": 0.6},
    {"position": (1.9, 0.89, 0.05), "radius": 0.9, "mass": 0.3, "velocity": (-3.0, 0.0, 1.0), "penalty": 0.7,
     "friction": 0.3, "angular_velocity": (2.0, 1.0, 3.0)},
]  # fmt: skip
"""A sphere that falls on a ball, and one that slides to it on the ground"""
ALONE = (
    *("force", "atmosphere", "obstacle", "water", "change", "faces", "sphere", "normals", "correction", "contact"),
    *("string", "solver"),
)
"""Tables of a scene itself"""
DRIVEN: list[dict[str, Any]] = [
    {"particles": [0, 3, 4], "newtons": (0.4, 0.3, -0.2)},
    {"newtons": (0.0, 0.1, 0.2)},
]
"""Outer forces on some particles, and on all"""
NECK = ["balloon.neck.diameter", "balloon.neck.discharge"]
WIND = {"wind": (6.0, 0.0, 2.0), "shear": 0.3, "wind_height": 2.0, "gusts": 0.2, "gust_length": 4.0}


def scene(
    kind: str = "pressure", frames: int = 1, substeps: int = 32, ground: bool = False, rate: float = 60.0, **more: Any
) -> bw.Scene:
    """Return a scene of a ball that flies and turns, low enough that its foot is in the ground, if there is one."""
    inflation: dict[str, Any] = {"kind": "gas", "start_pressure": 500.0} | more.pop("gas", {})
    if kind == "pressure":
        inflation = {"kind": "pressure", "pressure": [[0.0, 20.0], [0.04, 60.0]]}
    if kind == "normal_force":
        inflation = {"kind": "normal_force", "k_normal": [[0.0, 0.1], [0.04, 0.4]]}
    balloon: dict[str, Any] = {
        "mesh": BALL, "position": (0.0, 0.93, 0.0), "mass": 0.05, "damping": 0.05, "velocity": (0.3, -1.0, 0.1),
        "angular_velocity": (0.5, 1.0, -2.0), "inflation": inflation,
        "stiffness": {"structural": 100.0, "shear": 50.0, "flexion": 20.0},
    }  # fmt: skip
    if "material" in more:
        del balloon["mass"], balloon["stiffness"]
    balloon["stiffness"] = balloon.get("stiffness", {}) | more.pop("springs", {})
    on: dict[str, Any] = {"ground": {"height": 0.0, "friction": 0.3}} if ground else {}
    on |= {table: more.pop(table) for table in ALONE if table in more}
    return bw.Scene(frames=frames, frames_per_second=rate, substeps=substeps, balloon=[balloon | more], **on)


def far(moved: Trajectories) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the loss: the distance from a place at the end, the size on the way, and the speed in the first frame."""
    points, velocities = ([np.zeros(each.shape)] for each in (moved.points[0], moved.velocities[0]))
    off, speeds = moved.points[0][..., -1, :, :] - TARGET, moved.velocities[0][..., 1, :, :].astype(float)
    points[0][..., -1, :, :], velocities[0][..., 1, :, :] = 2.0 * WEIGHTS * off, 0.2 * speeds
    volumes = np.zeros(moved.volumes.shape)
    volumes[..., 1:, :] = 2.0 * moved.volumes[..., 1:, :]
    loss = (WEIGHTS * off**2).sum(axis=(-1, -2)) + 0.1 * (speeds**2).sum(axis=(-1, -2))
    loss = loss + (moved.volumes[..., 1:, 0] ** 2).sum(axis=-1)
    return loss, {"points": points, "velocities": velocities, "volumes": volumes}


def far_in_float64(of: bw.Scene, values: dict[str, float]) -> float:
    return far_of(of, run(of, values))


def far_of(of: bw.Scene, moved: Run) -> float:
    """Return the loss of places and velocities in all frames."""
    volume, points, velocities = Volume(plan_model(of).shapes[0].mesh), moved.points[0], moved.velocities[0]
    sizes = [volume.of(each) ** 2 for each in points[1:]]
    return float((WEIGHTS * (points[-1] - TARGET) ** 2).sum() + 0.1 * (velocities[1] ** 2).sum() + sum(sizes))


def value_at(of: bw.Scene, path: str) -> float:
    if path.startswith("change."):
        number, inner = path.removeprefix("change.").split(".set.")
        return float(of.change[int(number)].set[inner])
    value: Any = of.balloon[0] if path.startswith("balloon") else of
    *inner, name = path.removeprefix("balloon.").removeprefix("0.").split(".")
    for each in (*inner, name):
        value = value[int(each)] if each.isdecimal() else getattr(value, each)
    return float(plan_model(of).parameters[name][0, 0] if value is None else value)


def differences(of: bw.Scene, paths: list[str]) -> dict[str, float]:
    """Return central differences, on the ground so narrow that no particle meets it in another substep."""
    found = {}
    for path in paths:
        value = value_at(of, path)
        h = (1e-5 if of.ground is None else 3e-7) * (abs(value) or 1.0)
        more, less = (far_in_float64(of, {path: value + sign * h}) for sign in (1.0, -1.0))
        found[path] = (more - less) / (2.0 * h)
    return found


@cache
def told_loss(case: str) -> float:
    return far_in_float64(CASES[case][0], {})


@cache
def told_of(case: str) -> dict[str, float]:
    return differences(*CASES[case])


CASES = {
    "pressure": (scene(), [*SPRINGS, *MOTION, "balloon.0.inflation.pressure.0.1", "balloon.0.inflation.pressure.1.1"]),
    "a substep": (scene(rate=1200.0, substeps=1), [*SPRINGS, *MOTION]),
    "frames": (scene(frames=4), [*SPRINGS, *MOTION]),
    "changes": (
        scene(frames=6, rate=240.0, substeps=8, change=CHANGES),
        [
            *(*SPRINGS, *MOTION[:3], "balloon.0.inflation.pressure.0.1"),
            *(f"change.{number}.set.{path}" for number, change in enumerate(CHANGES) for path in change["set"]),
        ],
    ),
    "triangles": (scene(mesh=TRIANGLES), [*SPRINGS[::2], *MOTION]),
    "rubber": (scene(frames=6, material={"kind": "mooney_rivlin"}), [*RUBBER, *MOTION[1:]]),
    "gas": (scene("gas", frames=2), [*SPRINGS, *MOTION, *GAS]),
    "torsion": (scene(springs={"torsion": 2.0}), [*SPRINGS, *MOTION, "balloon.stiffness.torsion"]),
    "torsion of triangles": (scene(springs={"torsion": 2.0}, mesh=TRIANGLES), ["balloon.stiffness.torsion", *MOTION]),
    "wind": (
        scene(frames=2, mass=0.4, drag_coefficient=0.5, face_drag=1.2, face_friction=0.1, atmosphere=WIND),
        [
            *SPRINGS,
            *MOTION,
            *(f"balloon.{name}" for name in ("drag_coefficient", "face_drag", "face_friction")),
            "atmosphere.wind.0",
            "atmosphere.wind.2",
            *("atmosphere.shear", "atmosphere.gusts", "atmosphere.gust_length"),
            "atmosphere.temperature",
        ],
    ),
    "ground": (scene(ground=True, frames=2, force=DRIVEN), [*SPRINGS, *MOTION, "ground.height", "ground.friction"]),
    "pump, leak and jet": (
        scene(
            "gas",
            frames=2,
            springs={"structural": 1500.0},
            gas=PUMPED,
            neck={"diameter": 0.05, "discharge": 0.9},
        ),
        [
            *SPRINGS,
            *MOTION,
            *GAS[:4],
            *PUMP,
            "balloon.neck.diameter",
            "balloon.neck.discharge",
        ],  # by the temperature the amount and the molar volume cancel
    ),
    **{
        f"{normals} normals": (
            scene("normal_force", frames=6, rate=240.0, substeps=8, normals=normals),
            [*SPRINGS[:2], *MOTION, *(f"balloon.0.inflation.k_normal.{key}.1" for key in (0, 1))],
        )
        for normals in ("fresh", "cached")
    },
    "water": (
        scene(rate=240.0, substeps=8, mass=1.0, water={"level": 0.62, "density": 900.0}),
        [*SPRINGS[::2], *MOTION, "water.level", "water.density", "water.drag"],
    ),
    "gas among obstacles": (
        scene("gas", frames=2, obstacle=AMONG, faces=False, **BESIDE),
        [SPRINGS[0], "balloon.mass", "balloon.position.1", "balloon.velocity.0", "balloon.rotation.0", GAS[0]],
    ),
    "ridges": (
        scene(
            frames=2,
            rate=120.0,
            substeps=16,
            position=(0.05, 1.02, 0.1),
            velocity=(1.5, -2.0, 0.1),
            damping=0.0,
            faces=True,
            obstacle=[each | {"motion": STAYS} for each in RIDGED],
        ),
        [SPRINGS[0], MOTION[0], *MOTION[2:]],
    ),
    "gas beside spheres": (
        scene("gas", ground=True, frames=2, sphere=PRESSED),
        [
            *(SPRINGS[0], "balloon.mass", "balloon.position.1", "balloon.velocity.0", GAS[0], "gravity"),
            *(f"sphere.0.{name}" for name in ("radius", "mass", "penalty", "position.0", "velocity.1")),
            *(f"sphere.1.{name}" for name in ("radius", "position.2", "velocity.0", "angular_velocity.2", "penalty")),
            *("ground.height", "ground.restitution"),
        ],
    ),
    "gas on the ground": (
        scene("gas", ground=True, frames=2),
        [*SPRINGS, *MOTION, *GAS, "ground.height", "ground.friction"],
    ),
}


LAUNCHED = ("pump, leak and jet", "water", "ridges", "gas beside spheres", "fresh normals", "cached normals")
"""Cases that do not run backwards in blocks"""
IN_LANES = ("pressure", "a substep", "frames", "changes", "triangles", "rubber", "gas", "ground", "gas on the ground")
"""Cases that run backwards eight particles or worlds side by side, on a CPU"""


def require_way(way: str, device: str) -> None:
    """Skip a test of lanes on a GPU, which has none."""
    if way == "lanes" and device != "cpu":
        pytest.skip("lanes are a CPU's")


def ways_of(case: str) -> tuple[str, ...]:
    """Return the schedules of the backward pass for a case."""
    if case in LAUNCHED:
        return ("launched",)
    return ("block", "launched", "lanes") if case in IN_LANES else ("block", "launched")
