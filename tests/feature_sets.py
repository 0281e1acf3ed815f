"""Scenes whose kernels the tests of physics share: few vertices, all that a set has, and in action from the start.

`varied` changes parameters without another kernel, where they come to do nothing, too."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from meshes import cube, mesh_of, prism, quad_sphere, tetrahedron, zigzag

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import LAWS
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.model.parameters import require_changeable, rows_of
from balloon_warp.scene import Scene, load_scene
from balloon_warp.scene.scene import Change

RATE, SUBSTEPS = 60.0, 16
"""Frames a second, and substeps a frame"""
NEVER = 1e4
"""Time at which parameters would have the values of the set again, for which its kernels stay as they are [s]"""
BALL, FINE, PRISM = quad_sphere(2, 0.5), quad_sphere(3, 0.5), prism(5)
TRIANGLES = mesh_of(BALL.points, triangles_of(BALL))
ALIGNED = zigzag(1, 0.004)
FOLDED = replace(ALIGNED, points=ALIGNED.points @ [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [7.0, 5.0, 1.0]])
"""Two layers on each other, no particle above another, which would be as near to several triangles"""
LOWER = np.flatnonzero(FOLDED.points[:, 2] == 0.0).tolist()
SPRINGS = {"structural": 100.0, "shear": 50.0, "flexion": 20.0}
MOVES = {"velocity": (0.3, -1.5, 0.2), "angular_velocity": (2.0, 1.0, -3.0)}
FALLS: dict[str, Any] = {"mass": 0.05, "damping": 0.05, "stiffness": SPRINGS, **MOVES}
LIES = FALLS | {"mesh": FOLDED, "scale": 4.0, "rotation": (-90.0, 0.0, 0.0), "angular_velocity": (0.0, 0.0, 0.0),
                "inflation": {"pressure": 0.0}}  # fmt: skip
GAS = {"kind": "gas", "start_pressure": 400.0}
GROUND = {"height": -0.46, "friction": 0.3}

SETS: dict[str, dict[str, Any]] = {
    "springs": {
        "balloon": [
            FALLS | {
                "mesh": PRISM, "fixed": [3], "helium": 3.0, "friction": 0.2,
                "inflation": {"pressure": [[0.0, 4.0], [0.04, 9.0]]},
                "stiffness": SPRINGS | {"torsion": 0.4, "viscosity": 2e-3, "yield_stretch": 1.05, "variation": 0.3},
            },
            FALLS | {"mesh": TRIANGLES, "position": (3.0, 0.0, 0.0), "inflation": {"pressure": 60.0}},
        ],
        "string": [
            {"anchor": (0.0, 3.0, 0.0), "particle": "highest", "length": 1.9, "stiffness": 30.0},
            {
                "anchor": (3.0, 2.0, 0.1), "balloon": 1, "particle": 4, "length": 1.5,
                "motion": [(0.01, (0.0, 0.0, 0.0)), (0.04, (0.1, 0.3, -0.1))],
            },
        ],
        "force": [{"particles": [0, 4, 7], "newtons": (0.3, 0.1, -0.2)}, {"balloon": 1, "newtons": (0.0, 0.2, 0.1)}],
        "ground": GROUND,
    },
    "paper": {
        "balloon": [
            FALLS | {"mesh": BALL, "helium": 3.0, "inflation": {"k_normal": [[0.0, 0.1], [0.04, 0.5]]}},
            FALLS | {"mesh": PRISM, "position": (3.0, 0.6, 0.0), "inflation": {"k_normal": 0.4}},
        ],
        "normals": "cached", "correction": "tarantino", "correction_limit": 0.004, "faces": False,
        "sphere": [
            {"position": (0.1, 0.68, 0.0), "radius": 0.2, "mass": 0.4, "velocity": (0.0, -2.0, 0.0), "friction": 0.3},
            {"position": (-1.5, -0.26, 0.0), "radius": 0.21, "velocity": (1.0, -1.0, 0.3), "friction": 0.4,
             "angular_velocity": (3.0, 1.0, 2.0)},
        ],
        "ground": GROUND,
    },
    "gas": {
        "balloon": [
            FALLS | {
                "mesh": FINE, "neck": {"diameter": 0.03, "discharge": 0.9, "at": "lowest"},
                "inflation": GAS | {"start_pressure": 900.0, "gamma": 1.4, "pump": [[0.0, 2.0], [0.04, 1.0]],
                                    "leak": 1e-4, "breathing_damping": 0.5},
            },
            FALLS | {"mesh": BALL, "position": (2.0, 0.5, 0.0), "inflation": GAS | {"gamma": 1.4, "litres": 9.0}},
            FALLS | {"mesh": BALL, "position": (4.0, 0.5, 0.0), "inflation": {"pressure": 30.0}},
            FALLS | {"mesh": BALL, "position": (6.0, 9.0, 0.0), "inflation": GAS | {"gamma": 1.0, "leak": 1e-3}},
        ],
        "tube": [{"balloons": (0, 1), "conductance": 3e-4}], "atmosphere": {"lapse": 0.03}, "ground": GROUND,
    },
    "rubber": {
        "balloon": [
            {"mesh": mesh, "position": (1.5 * number, 0.0, 0.0), "velocity": (0.3, -1.5, 0.2), "damping": 0.05,
             "angular_velocity": (20.0, 10.0, -30.0), "inflation": inflation,
             "material": {"kind": kind, "thickness": 1e-3, **more}}
            for number, (kind, mesh, inflation, more) in enumerate((
                ("neo_hookean", BALL, GAS | {"start_pressure": 900.0}, {"viscosity": 10.0}),
                ("mooney_rivlin", TRIANGLES, GAS, {"softening": 0.4, "softening_energy": 1e3}),
                ("ogden", BALL, {"pressure": 600.0}, {"preset": "natural_rubber_treloar", "wrinkling": False}),
                ("gent", BALL, {"pressure": 800.0}, {"gent_limit": 5.0}),
            ))
        ],
        "ground": GROUND,
    },
    "spheres": {
        "balloon": [FALLS | {"mesh": FINE, "inflation": GAS}, FALLS | {"mesh": BALL, "position": (1.2, 0.2, 0.0)}],
        "contact": "impulse", "faces": False,
        "sphere": [
            {"position": (0.3, -0.75, 0.1), "radius": 0.3, "mass": 0.2, "velocity": (0.2, 1.0, 0.1), "friction": 0.4,
             "angular_velocity": (0.0, 0.0, 5.0)},
            {"position": (0.1, 0.75, 0.0), "radius": 0.3, "mass": 0.3, "velocity": (0.0, -3.0, 0.0), "friction": 0.3},
            {"position": (0.6, 0.9, 0.0), "radius": 0.25, "mass": 0.4, "velocity": (-4.0, -3.0, 0.0), "friction": 0.6},
        ],
        "ground": {"height": -1.06, "friction": 0.3},
    },
    "obstacles": {
        "balloon": [FALLS | {"mesh": FINE, "inflation": GAS}, FALLS | {"mesh": BALL, "position": (0.0, 1.5, 0.0)}],
        "faces": False,
        "obstacle": [
            {"size": (1.0, 1.0, 3.0), "rotation": (0.0, 0.0, 40.0), "position": (0.0, -1.15, 0.0), "friction": 0.3,
             "thickness": 0.01, "motion": [(0.0, (0.0, 0.0, 0.0)), (1.0, (0.5, 1.5, 0.0), (0.0, 60.0, 90.0))]},
            {"radius": 0.5, "length": 0.4, "rotation": (80.0, 0.0, 0.0), "position": (1.0, 0.0, 0.1)},
            {"shape": "plane", "rotation": (-80.0, 0.0, 10.0), "position": (0.0, 0.6, 0.6), "friction": 0.2},
        ],
        "ground": {"height": -0.49, "friction": 0.3},
    },
    "air and water": {
        "balloon": [
            FALLS | {"mesh": FINE, "mass": 0.3, "drag_coefficient": 0.5, "face_drag": 1.2, "face_friction": 0.1},
            FALLS | {"mesh": PRISM, "mass": 0.5, "position": (3.0, 0.0, 0.3), "face_drag": 1.0},
        ],
        "up_axis": "Z", "water": {"level": 0.0, "density": 900.0, "drag": 0.8},
        "atmosphere": {"wind": (6.0, 2.0, 0.0), "shear": 0.3, "wind_height": 2.0, "gusts": 0.2, "gust_length": 4.0,
                       "gust_seed": 3},
    },
    "touch": {
        "balloon": [
            FALLS | {"mesh": BALL, "velocity": (0.0, -3.0, 0.2), "position": (0.1, 0.51, 0.05), "friction": 0.4},
            FALLS | {"mesh": tetrahedron(), "fixed": [0, 1, 2, 3], "position": (4.0, 0.0, 0.0)},
            FALLS | {"mesh": BALL, "velocity": (0.3, 2.0, 0.0), "position": (0.0, -0.4, 0.0), "inflation": GAS},
            FALLS | {"mesh": cube(), "position": (-1.0, 0.5, 0.4), "velocity": (0.5, 0.0, -1.0)},
            FALLS | {"mesh": PRISM, "position": (-1.0, 1.6, 0.4), "rotation": (40.0, 0.0, 20.0),
                     "velocity": (0.5, -2.0, 0.0)},
            LIES | {"fixed": LOWER, "position": (2.0, 0.0, 0.0), "velocity": (0.1, -0.4, 0.05)},
            LIES | {"position": (-3.0, -0.879, 0.0), "velocity": (6.0, -0.6, 0.05)},
        ],
        "touch": {"friction": 0.3, "itself": True}, "ground": {"height": -0.88, "friction": 0.3},
    },
    "faces": {
        "balloon": [FALLS | {"mesh": FINE, "inflation": GAS}],
        "contact": "impulse", "faces": True,
        "sphere": [
            {"position": (0.05, 0.56, 0.1), "radius": 0.06, "mass": 0.02, "velocity": (0.0, -6.0, 0.0)},
            {"position": (1.0, 0.1, 0.0), "radius": 0.5, "mass": 0.3, "velocity": (-4.0, 0.0, 0.0), "friction": 0.4},
            {"position": (0.1, 0.2, 0.93), "radius": 0.4, "mass": 0.1, "velocity": (0.0, 0.0, -5.0), "start": 0.02},
        ],
        "obstacle": [
            {"radius": 0.02, "length": 2.0, "position": (-0.53, 0.11, 0.0), "rotation": (80.0, 0.0, -10.0)},
            {"size": (0.4, 0.4, 0.4), "rotation": (45.0, 0.0, 35.26), "position": (0.02, -0.86, 0.03), "friction": 0.4},
        ],
    },
    "bodies": {
        "balloon": [FALLS | {"mesh": FINE, "inflation": GAS}], "faces": False,
        "body": [
            {"size": (0.6, 0.3, 0.5), "mass": 0.4, "position": (0.1, -0.632, 0.0), "velocity": (0.0, 1.0, 0.0),
             "rotation": (5.0, 20.0, 0.0), "angular_velocity": (1.0, 2.0, 0.5)},
            {"shape": "capsule", "radius": 0.15, "length": 0.4, "mass": 0.3, "position": (0.68, 0.1, 0.0),
             "velocity": (-3.0, 0.0, 0.0), "rotation": (0.0, 0.0, 10.0), "friction": 0.3},
            {"size": (0.3, 0.3, 0.3), "mass": 0.4, "position": (0.1, -1.0, 0.9), "velocity": (1.0, -2.0, 0.0),
             "rotation": (20.0, 20.0, 0.0), "angular_velocity": (1.0, 0.0, 0.5)},
        ],
        "obstacle": [
            {"size": (0.3, 0.2, 0.4), "position": (0.5, -0.98, 0.9), "rotation": (10.0, 0.0, 0.0), "friction": 0.3,
             "motion": [(0.0, (0.0, 0.0, 0.0)), (1.0, (-3.0, 0.5, 0.0), (0.0, 90.0, 60.0))]},
        ],
        "string": [
            {"anchor": (0.1, 0.2, 0.0), "body": 1, "particle": "highest", "length": 0.4},
            {"anchor": (0.0, 3.0, 0.0), "particle": 7, "length": 2.5},
            {"anchor": (-0.1, 0.15, 0.1), "body": 2, "length": 0.7, "stiffness": 40.0},
        ],
        "ground": {"height": -1.2, "friction": 0.3},
    },
    "bursting": {
        "balloon": [
            {"mesh": FINE, "damping": 0.05, "inflation": GAS | {"start_pressure": 3000.0}, **MOVES,
             "material": {"preset": "latex", "strength": 2e6, "needle_time": 0.008}},
            {"mesh": BALL, "position": (2.0, 0.0, 0.0), "inflation": {"pressure": 400.0},
             "material": {"preset": "latex", "strength": 2e7}},
        ],
        "ground": GROUND,
    },
    "all": {
        "balloon": [
            FALLS | {"mesh": FINE, "mass": 0.1, "fixed": [3], "drag_coefficient": 0.5,
                     "stiffness": SPRINGS | {"torsion": 0.05, "viscosity": 2e-3, "yield_stretch": 1.4,
                                             "variation": 0.3},
                     "neck": {"diameter": 0.015, "at": "highest"},
                     "inflation": GAS | {"gamma": 1.3, "litres": 9.0, "leak": 1e-4, "breathing_damping": 0.3,
                                         "water_evened": 0.3}},
            FALLS | {"mesh": BALL, "mass": 0.1, "position": (0.1, 0.93, 0.0), "face_drag": 1.0, "helium": 2.0,
                     "inflation": {"k_normal": [[0.0, 0.2], [0.04, 0.4]]}},
            {"mesh": BALL, "position": (1.2, 0.0, 0.0), "inflation": GAS | {"gamma": 1.3, "pump": 0.02},
             "material": {"kind": "mooney_rivlin", "thickness": 1e-3, "viscosity": 10.0, "softening": 0.4,
                          "softening_energy": 1e3}, **MOVES},
        ],
        "substeps": 40, "touch": None, "contact": "impulse", "faces": False,
        "sphere": [{"position": (0.65, -0.4, 0.3), "radius": 0.33, "mass": 0.2, "velocity": (-2.0, 1.0, -1.0),
                    "friction": 0.3}],
        "obstacle": [{"size": (3.0, 0.2, 3.0), "rotation": (0.0, 0.0, 20.0), "position": (-1.3, -1.1, 0.0),
                      "motion": [(0.0, (0.0, 0.0, 0.0)), (1.0, (0.5, 0.2, 0.0), (0.0, 90.0, 0.0))]}],
        "string": [
            {"anchor": (2.6239, 3.4081, 0.0), "obstacle": 0, "balloon": 1, "particle": "highest", "length": 1.5},
        ],
        "tube": [{"balloons": (0, 2), "conductance": 3e-4}],
        "force": [{"balloon": 2, "newtons": (0.3, 0.2, 0.1)}], "ground": {"height": -1.06, "friction": 0.3},
        "water": {"level": -0.3}, "atmosphere": {"wind": (3.0, 0.0, 1.0), "gusts": 0.1, "lapse": 0.03},
    },
}  # fmt: skip
"""Sets by name"""


@cache
def feature_set(name: str) -> Scene:
    """Return the scene of a set."""
    told = {"frames": 3, "frames_per_second": RATE, "substeps": SUBSTEPS, "touch": False, **SETS[name]}
    return Scene(**told)


def varied(name: str, values: Mapping[str, Any]) -> Scene:
    """Return the scene of a set with other values by their paths, and the same kernels.

    A law that a value of the set lets act acts still, since a change at a time that never comes brings it back."""
    scene = feature_set(name)
    back = {path: value for path in values if (value := value_at(scene, path)) is not None and may_change(scene, path)}
    other = load_scene(scene, dict(values))
    return other.model_copy(update={"change": [*other.change, Change(time=NEVER, set=back)]}) if back else other


def may_change(scene: Scene, path: str) -> bool:
    """Return whether a value may change while a scene is simulated."""
    try:
        require_changeable(scene, rows_of(LAWS), [path])
    except InputError:
        return False
    return True


def value_at(scene: Scene, path: str) -> Any:
    """Return the value of a scene at a path."""
    value: Any = scene
    for name in path.split("."):
        value = value[int(name)] if name.isdecimal() else getattr(value, name)
    return value
