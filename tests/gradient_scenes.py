"""Scenes that gradients are held to the reference in, with the paths of values that they are derived by."""

from typing import Any, NamedTuple

import numpy as np
import trimesh
from conserved import VACUUM
from meshes import mesh_of, quad_sphere

import balloon_warp as bw
from balloon_warp.mesh.orientation import triangles_of

BALL, SMALL = quad_sphere(2), quad_sphere(1, 1.0)
"""Balls of 26 particles, the last octet of which is not full, and of 8"""
TRIANGLES = mesh_of(BALL.points, triangles_of(BALL))
N = len(BALL.points)
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
ALONE = (
    *("force", "atmosphere", "obstacle", "water", "change", "faces", "sphere", "normals", "correction", "contact"),
    *("string", "solver", "touch"),
)
"""Tables of a scene itself"""
CHANGES: list[dict[str, Any]] = [
    {"time": 2.0 / 240.0, "set": {"balloon.damping": 0.3, "balloon.stiffness.structural": 120.0, "gravity": 8.0}},
    {"time": 4.0 / 240.0, "set": {"balloon.inflation.pressure": 30.0, "gravity": 5.0}},
    {"time": 4.0 / 240.0, "set": {"balloon.damping": 0.1}},
]
DRIVEN: list[dict[str, Any]] = [{"particles": [0, 3, 4], "newtons": (0.4, 0.3, -0.2)}, {"newtons": (0.0, 0.1, 0.2)}]
"""Outer forces on some particles, and on all"""
FORWARD, LANES = ("block", "launched"), ("block", "launched", "lanes")
HELD = {"held": ("layout_backwards", "layout_again"), "held forward": ("layout_again",)}
"""Layouts of a block that keep particles in registers, as a GPU's do, by the way back"""


class Case(NamedTuple):
    """A scene, and how its gradients are compared with differences of the reference."""

    scene: bw.Scene
    paths: list[str]
    ways: tuple[str, ...] = ("launched",)
    """Schedules of the way back: launches, blocks, blocks of `HELD`, and eight particles or worlds side by side"""
    reach: float = 1e-5
    """Half of a difference over the value; less where particles meet something, in another substep if it is more"""
    near: float = 2e-4
    """Tolerance over the derivative, of states in float32; beside it 1e-5 of the largest is allowed, as small ones are
    differences of large ones"""
    dot: float = 1e-5
    """Tolerance of a sum over all places and velocities, whose rounding in float32 is a few 1e-7 each"""
    shifts: bool = True
    """Whether it is derived by where particles start: not if one is as near to two faces, or if rubber begins at rest,
    where its tension has a kink"""
    small: tuple[int, int] = (0, 0)
    """Numbers of contacts of small spheres, and of those in which a sphere moves on with faces as one"""


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


def rubber(law: str, **numbers: Any) -> Case:
    """Return a ball of rubber, of triangles for one law, that is taut in places and in wrinkles in others."""
    mesh = {"mesh": TRIANGLES} if law == "gent" else {}
    of = scene("gas", frames=2, substeps=24, material={"kind": law, **numbers}, gas={"start_pressure": 2000.0}, **mesh)
    named = ["balloon.material.ogden_moduli.0"] if law == "ogden" else RUBBER[:1]
    return Case(
        of, [MOTION[4], RUBBER[1], MOTION[1], "gravity", GAS[0], *named], ("block", "lanes"), near=3e-4, shifts=False
    )


def pair(
    frames: int = 3, substeps: int = 32, speed: float = 2.0, apart: float = 1.03, meshes: tuple[int, int] = (2, 2),
    **touch: Any,
) -> bw.Scene:  # fmt: skip
    """Return two balls of springs that collide off their centers, one turning; substeps take as long in all scenes."""
    firm: dict[str, Any] = {
        "damping": 0.05, "inflation": bw.Inflation(pressure=20.0),
        "stiffness": {"structural": 100.0, "shear": 50.0, "flexion": 20.0},
    }  # fmt: skip
    left: dict[str, Any] = {"position": (-apart, 1.0, 0.05), "velocity": (speed, 0.3, 0.0), "mass": 0.05, **firm}
    right: dict[str, Any] = {"position": (apart, 1.1, 0.05), "velocity": (-speed, 0.0, 0.1), "mass": 0.08, **firm}
    turning: dict[str, Any] = {"rotation": (0.0, 20.0, 10.0), "angular_velocity": (0.0, 2.0, 5.0)}
    first, second = (quad_sphere(count) for count in meshes)
    return bw.Scene(
        balloon=[bw.Balloon(mesh=first, **left, **turning), bw.Balloon(mesh=second, **right)],
        frames=frames, frames_per_second=1920.0 / substeps, substeps=substeps,
        touch=bw.Touch(itself=False, **touch), **VACUUM,
    )  # fmt: skip


def pinched() -> bw.Scene:
    """Return a flat balloon whose walls are pushed together until they touch from within; each frame searches anew.

    After 32 frames differences in double precision vary by 1.7e-4, as particles start 0.1 µm elsewhere; after 20 by
    1.5e-5.
    """
    ball = quad_sphere(4, 0.5)
    points = ball.points * (1.0, 1.0, 0.4) + np.random.default_rng(1).normal(size=ball.points.shape) * 0.004
    amid = np.linalg.norm(points[:, :2], axis=1) < 0.25
    balloon = bw.Balloon(
        mesh=mesh_of(points, ball.face_vertex_indices.reshape(-1, 4).tolist()), mass=0.05, damping=0.05,
        velocity=(0.3, 0.2, 0.1), angular_velocity=(1.0, 3.0, 2.0), inflation=bw.Inflation(pressure=1.0),
        stiffness={"structural": 60.0, "shear": 30.0, "flexion": 10.0},
    )  # fmt: skip
    forces: list[dict[str, Any]] = [
        {"particles": np.flatnonzero(amid & (side * points[:, 2] > 0.0)).tolist(),
         "newtons": (0.3 * side, 0.5 * side, -side)}
        for side in (1.0, -1.0)
    ]  # fmt: skip
    skin = bw.Touch(itself=True, edges=False, thickness=0.02, stiffness=250.0)
    return bw.Scene(
        balloon=[balloon], force=forces, frames=20, frames_per_second=480.0, substeps=4, touch=skin, **VACUUM
    )


def crossing() -> bw.Scene:
    """Return two cubes that collide edge on edge, across, and bounce off."""
    of = pair(meshes=(1, 1), edges=True, thickness=0.03)
    turns = ((3.0, 5.0, 45.0), (0.0, 45.0, 4.0))
    places = ((-0.85, 1.0, 0.05), (0.85, 1.05, 0.0))
    cubes = [
        cube.model_copy(update={"rotation": turn, "angular_velocity": (0.0, 0.0, 0.0), "position": place})
        for cube, turn, place in zip(of.balloon, turns, places, strict=True)
    ]
    return of.model_copy(update={"balloon": cubes})


def on_a_plate() -> bw.Scene:
    """Return a flat plate on the ground, into which a cube that falls on it presses its corners."""
    of, cube = pair(1, 24, meshes=(1, 1), edges=True, thickness=0.02, stiffness=300.0), quad_sphere(1)
    thin = cube.points * (1.0, 0.0005 / np.abs(cube.points[:, 1]).max(), 1.0)
    plate = {
        "mesh": mesh_of(thin, cube.face_vertex_indices.reshape(-1, 4).tolist()), "position": (0.0, 0.0008, 0.0),
        "velocity": (0.2, 0.0, 0.1), "rotation": (0.0, 20.0, 0.0), "angular_velocity": (0.0, 0.0, 0.0),
        "inflation": bw.Inflation(pressure=0.1),
    }  # fmt: skip
    above = {"position": (0.15, 0.885, 0.1), "velocity": (0.1, -3.0, 0.0), "rotation": (3.0, 10.0, 41.0)}
    balloons = [each.model_copy(update=more) for each, more in zip(of.balloon, (plate, above), strict=True)]
    return of.model_copy(update={"balloon": balloons, "ground": bw.Ground(friction=0.0)})


FLOWING = 4e-4
"""Tolerance where gas flows, see `tubed`"""


def tubed(count: int, width: float = 1.0, leak: float = 0.0) -> Case:
    """Return two balls with a gas, one at three times the pressure of the other, and tubes between them.

    Springs keep pressures apart. All is smooth, and a narrower difference would drown in rounding. `FLOWING` is the
    error by that of states in float32: a flow follows the difference of absolute pressures, and turns of 1e-5 degrees
    change derivatives by 1e-4 of themselves.

    Args:
        width: factor on conductances.
        leak: of both [m^2].
    """
    low, high = (
        scene(
            "gas", gas={"start_pressure": pressure, "leak": leak}, position=(side, 1.0, 0.0), mass=mass,
            springs={"structural": 1500.0},
        ).balloon[0]
        for pressure, side, mass in ((900.0, -2.0, 0.05), (2700.0, 2.0, 0.1))
    )  # fmt: skip
    tubes = [bw.Tube(balloons=(0, 1), conductance=width * each) for each in (5e-4, 3e-4)[:count]]
    paths = [f"balloon.{number}.inflation.start_pressure" for number in range(2)]
    paths += ["balloon.0.mass", "balloon.1.stiffness.structural", "tube.0.conductance", "atmosphere.pressure"]
    of = scene("gas", frames=2).model_copy(update={"balloon": [low, high], "touch": False, "tube": tubes})
    return Case(of, paths + ["balloon.1.inflation.leak"] * (leak > 0.0), reach=1e-4, near=FLOWING, dot=FLOWING)


BESIDE: dict[str, Any] = {
    "position": (-0.003, 1.022, 0.0), "velocity": (4.0, -2.0, 2.0), "angular_velocity": (0.1, 0.2, -0.1),
}  # fmt: skip
"""A ball that comes down on obstacles, and to those at its sides"""
AMONG: list[dict[str, Any]] = [
    {"size": (1.0, 1.0, 3.0), "rotation": (0.0, 0.0, 40.0), "position": (-0.02, -0.703, 0.0), "friction": 0.3,
     "thickness": 0.02},
    {"radius": 0.5, "length": 0.4, "rotation": (80.0, 0.0, 0.0), "position": (1.5, 1.0, 0.1), "friction": 0.4},
    {"shape": "plane", "rotation": (-80.0, 0.0, 10.0), "position": (0.0, 1.0, 1.002), "friction": 0.2},
]  # fmt: skip
"""The edge of a box below, a capsule and a plane at its sides"""
OF_AMONG = [
    *("obstacle.0.position.0", "obstacle.0.position.1", "obstacle.0.friction"),
    *("obstacle.1.position.0", "obstacle.1.friction", "obstacle.2.position.2", "obstacle.2.friction"),
]
BELOW = {"size": (3.0, 0.5, 3.0), "position": (0.02, -0.335, 0.03), "friction": 0.3,
         "motion": [(0.0, (0.0, 0.0, 0.0)), (0.01, (0.1, 0.02, 0.0)), (0.1, (0.5, 0.4, 0.3))]}  # fmt: skip
"""A box on a way whose second keyframe is within a frame"""
OF_WAY = [f"obstacle.0.motion.{key}.1.{axis}" for key in (0, 1, 2) for axis in (0, 1)][1:]
RIDGED: list[dict[str, Any]] = [
    {"size": (0.4, 0.4, 0.4), "rotation": (45.0, 0.0, 35.26), "position": (0.02, -0.346, 0.03), "friction": 0.4},
    {"size": (0.2, 3.0, 0.2), "rotation": (0.0, 45.0, 3.0), "position": (1.2, 0.4, 0.12), "friction": 0.2},
    {"radius": 0.01, "length": 3.0, "position": (-0.43, 0.11, 0.0), "rotation": (80.0, 0.0, -10.0), "friction": 0.3},
]
"""The corner of a box below, an edge beside, and a rod"""
MOVES = [(0.0, (0.0, 0.0, 0.0)), (1.0, (0.4, 0.1, -0.2))]


def ridged(frames: int) -> bw.Scene:
    """Return a ball without damping whose faces meet moving ridges."""
    return scene(
        frames=frames, rate=120.0, substeps=16, position=(0.05, 1.02, 0.1), velocity=(1.5, -2.0, 0.1), damping=0.0,
        faces=True, obstacle=[each | {"motion": MOVES} for each in RIDGED],
    )  # fmt: skip


STRING = {
    "anchor": (0.3, 3.0, 0.1), "length": 1.02, "stiffness": 30.0,
    "motion": [(0.0, (0.0, 0.0, 0.0)), (0.05, (0.1, 0.2, 0.0))],
}  # fmt: skip
OF_STRING = [*(f"string.0.anchor.{axis}" for axis in range(3)), "string.0.length", "string.0.stiffness"]
PUMPED = {"start_pressure": 40.0, "pump": [[0.0, 400.0], [0.04, 100.0]], "leak": 1e-3}
PUMP = ["balloon.inflation.leak", "balloon.0.inflation.pump.0.1", "balloon.0.inflation.pump.1.1"]
WIND = {"wind": (6.0, 0.0, 2.0), "shear": 0.3, "wind_height": 2.0, "gusts": 0.2, "gust_length": 4.0}
OF_WIND = [
    *(f"balloon.{name}" for name in ("drag_coefficient", "face_drag", "face_friction")),
    *(f"atmosphere.{name}" for name in ("wind.0", "wind.2", "shear", "gusts", "gust_length", "temperature")),
]

PRESSED: list[dict[str, Any]] = [
    {"position": (-0.5, 2.5, 0.1), "radius": 0.9, "mass": 0.5, "velocity": (0.5, -4.0, 0.0), "penalty": 0.6},
    {"position": (1.9, 0.93, 0.05), "radius": 0.9, "mass": 0.3, "velocity": (-3.0, -2.0, 1.0), "penalty": 0.7,
     "friction": 0.3, "angular_velocity": (2.0, 1.0, 3.0)},
]  # fmt: skip
"""A sphere that falls on a ball, and one that bounces to it on the ground"""
MEETING: list[dict[str, Any]] = [
    {"position": (-0.5, 2.5, 0.1), "radius": 0.9, "mass": 0.5, "velocity": (0.5, -4.0, 0.0), "penalty": 0.6,
     "friction": 0.2},
    {"position": (3.0, 0.42, 0.0), "radius": 0.4, "mass": 0.3, "velocity": (4.0, -2.0, 1.0), "friction": 0.3,
     "angular_velocity": (2.0, 1.0, 3.0), "restitution": 0.6},
    {"position": (4.0, 0.6, 0.1), "radius": 0.5, "mass": 0.8, "velocity": (-4.0, -1.0, 0.0), "friction": 0.4,
     "restitution": 0.5},
]  # fmt: skip
"""A sphere that falls on a ball, and two that meet each other on the ground"""
PLANE: dict[str, Any] = {"shape": "plane", "rotation": (0.0, 0.0, 60.0), "position": (4.9, 0.0, 0.0), "friction": 0.2,
                         "thickness": 0.01}  # fmt: skip
OUT = np.array([-np.sin(np.pi / 3.0), 0.5, 0.0])
SLAB = {**PLANE, "shape": "mesh", "mesh": trimesh.creation.box((12.0, 4.0, 12.0)),
        "position": tuple(np.array(PLANE["position"]) - 2.0 * OUT)}  # fmt: skip
"""The plane, as the side of a mesh"""


def meeting(side: dict[str, Any], smooth: bool = False) -> bw.Scene:
    """Return a scene of 192 substeps in which spheres meet a ball, each other, obstacles and the ground."""
    box = {"size": (1.0, 1.0, 3.0), "rotation": (0.0, 0.0, 20.0), "position": (2.05, 0.2, 0.0), "friction": 0.3,
           "restitution": 0.5}  # fmt: skip
    capsule = {"radius": 0.5, "length": 1.0, "rotation": (80.0, 0.0, 0.0), "position": (-1.9, 2.2, 0.1),
               "friction": 0.4}  # fmt: skip
    spheres = [*MEETING[:2], MEETING[2] | ({"friction": 0.05} if smooth else {})]
    return scene(
        ground=True, frames=6, velocity=(0.3, -1.2, 0.1), sphere=spheres, obstacle=[box, side, capsule], faces=False,
        contact="penalty",
    )  # fmt: skip


def of_spheres(count: int, *names: str) -> list[str]:
    return [f"sphere.{number}.{name}" for number in range(count) for name in names]


OF_MEETING = [
    *("balloon.0.mass", "balloon.0.velocity.0", "gravity", "ground.height", "ground.restitution"),
    *(
        f"sphere.{number}.{name}"
        for number in range(3)
        for name in ("mass", "radius", "position.0", "position.2", "velocity.0", "velocity.2", "angular_velocity.2")
        if (number, name) != (0, "angular_velocity.2")  # which rubs on nothing
    ),
    "sphere.0.penalty",
]
OF_RUBBING = [
    *("sphere.1.friction", "sphere.1.restitution", "sphere.2.friction", "sphere.2.restitution"),
    "obstacle.0.restitution",
]
EXCHANGING: list[dict[str, Any]] = [
    {"position": (0.3, 0.5012, 0.1), "radius": 0.5, "mass": 0.2, "velocity": (0.2, -1.0, 0.1), "friction": 0.4,
     "angular_velocity": (0.0, 0.0, 1.0)},
    {"position": (0.1, 0.89, 1.35), "radius": 0.9, "mass": 0.3, "velocity": (0.0, -0.2, -1.0), "friction": 0.3,
     "angular_velocity": (2.0, 1.0, 3.0)},
]  # fmt: skip
"""Spheres that a ball meets from above: one lands beneath it, and both exchange momentum with the same particles"""
BETWEEN_CORNERS: list[dict[str, Any]] = [
    EXCHANGING[0] | {"radius": 0.82, "position": (0.3, 0.8212, 0.1)},
    EXCHANGING[1] | {"position": (0.15, 1.85, 1.66)},
]  # fmt: skip
"""Spheres that faces meet between their corners, one beneath a ball and one beside it"""
OF_EXCHANGE = [
    *("balloon.0.mass", "balloon.0.velocity.0", "balloon.0.inflation.start_pressure", "gravity", "ground.height"),
    *("balloon.0.stiffness.structural", "balloon.0.stiffness.shear"),
    *of_spheres(2, "mass", "radius", "position.0", "position.2", "velocity.0", "velocity.1", "angular_velocity.2"),
]


def exchange(spheres: list[dict[str, Any]], height: float, **more: Any) -> bw.Scene:
    """Return a scene of a ball with a gas that exchanges momentum with spheres, in 2 frames of 3 substeps: so short
    that nothing rests on the ground, where rounding would decide whether there is a gap."""
    return scene(
        "gas", ground=True, frames=2, rate=640.0, substeps=3, sphere=spheres, contact="impulse",
        position=(0.0, height, 0.0), velocity=(0.1, -2.0, 0.0), **more,
    )  # fmt: skip


def tiny(kind: str, small: tuple[int, int], *spheres: dict[str, Any], **more: Any) -> Case:
    """Return spheres smaller than faces that fly to a ball's wall, from within unless told otherwise."""
    own = {"radius": 0.2, "mass": 0.02, "velocity": (3.0, -2.0, -10.0), "friction": 0.3, "position": (0.1, 1.0, 0.2),
           "angular_velocity": (2.0, 1.0, 3.0)}  # fmt: skip
    paths = ["balloon.0.mass", "balloon.0.stiffness.structural", "balloon.0.friction"]
    paths += of_spheres(len(spheres), "mass", "radius", "position.0", "velocity.1", "angular_velocity.1", "friction")
    of = scene(kind, friction=0.2, sphere=[own | sphere for sphere in spheres], **{"contact": "impulse"} | more)
    return Case(of, paths, reach=1e-6, near=1e-4, small=small)


def rolling() -> bw.Scene:
    """Return a sphere that rolls on a plane, apart from the ball."""
    ball = {"position": (3.0, -0.3, 0.0), "velocity": (1.5, 0.0, 0.0), "radius": 0.2, "mass": 0.3, "friction": 0.3}
    plane = {"shape": "plane", "friction": 0.1, "position": (0.0, -0.5, 0.0)}
    return scene(obstacle=[plane], faces=False, sphere=[ball], contact="impulse", frames=4, substeps=16)


NARROW: dict[str, Any] = {"reach": 1e-6, "near": 1e-4}
STARTS = ["balloon.0.velocity.0", "balloon.0.velocity.1", "balloon.1.position.2"]
SKINS = ["balloon.0.mass", "balloon.1.mass", "balloon.0.stiffness.structural", "balloon.1.stiffness.shear"]
TOUCH = ["touch.friction", "touch.thickness", "touch.stiffness"]
KEYS = ["balloon.0.inflation.pressure.0.1", "balloon.0.inflation.pressure.1.1"]
DRAG = {"drag_coefficient": 0.5, "atmosphere": {"wind": (6.0, 0.0, 2.0)}}
STIFF = {"springs": {"structural": 1500.0}}

CASES: dict[str, Case] = {
    "pressure": Case(scene(), [*SPRINGS, *MOTION, *KEYS], LANES),
    "a substep": Case(scene(rate=1200.0, substeps=1), [*SPRINGS, *MOTION], LANES),
    "frames": Case(scene(frames=4), [*SPRINGS, *MOTION], LANES),
    "changes": Case(
        scene(frames=6, rate=240.0, substeps=8, change=CHANGES),
        [*SPRINGS, *MOTION[:3], KEYS[0],
         *(f"change.{number}.set.{path}" for number, change in enumerate(CHANGES) for path in change["set"])], LANES,
    ),
    "triangles": Case(scene(mesh=TRIANGLES), [*SPRINGS[::2], *MOTION], LANES),
    "rubber": Case(
        scene(frames=6, material={"kind": "mooney_rivlin"}), [*RUBBER, *MOTION[1:]], LANES, shifts=False
    ),
    "neo-Hookean rubber": rubber("neo_hookean", wrinkling=0.0),
    "Mooney and Rivlin's rubber": rubber("mooney_rivlin", mooney_ratio=0.2),
    "Gent's rubber": rubber("gent", gent_limit=30.0),
    "Ogden's rubber": rubber("ogden", ogden_moduli=(6e5, 2e3, -1e4), ogden_exponents=(1.3, 5.0, -2.0)),
    "gas": Case(scene("gas", frames=2), [*SPRINGS, *MOTION, *GAS], LANES),
    "gas, some fixed": Case(scene("gas", fixed=[0, 5]), [MOTION[0]]),
    "springs that vary, in a wind": Case(
        scene(substeps=24, springs={"variation": 0.2}, **DRAG),
        [*MOTION[:3], MOTION[4], *SPRINGS[::2], OF_WIND[0], "atmosphere.wind.2"], ("lanes",),
    ),
    "moved by the old velocity": Case(
        scene(substeps=96, solver="forward_euler"), [*MOTION[:3], MOTION[4], SPRINGS[0], KEYS[1]], ("lanes",)
    ),
    "torsion": Case(scene(springs={"torsion": 2.0}), [*SPRINGS, *MOTION, "balloon.stiffness.torsion"], FORWARD),
    "wind": Case(
        scene(frames=2, mass=0.4, drag_coefficient=0.5, face_drag=1.2, face_friction=0.1, atmosphere=WIND),
        [*SPRINGS, *MOTION, *OF_WIND], FORWARD,
    ),
    "water": Case(
        scene(rate=240.0, substeps=8, mass=1.0, water={"level": 0.62, "density": 900.0}),
        [*SPRINGS[::2], *MOTION, "water.level", "water.density", "water.drag"],
    ),
    "crushed in water": Case(  # for the last thirteen substeps, which brake a hundred meters a second
        scene(rate=48.0, substeps=64, mass=20.0, water={"level": 2.5, "drag": 0.0}, touch=False),
        [*MOTION, "water.level", "water.density", "balloon.mass"],
    ),
    "gas in water": Case(
        scene("gas", rate=240.0, substeps=8, mass=0.2, water={"level": 0.62}),
        [*MOTION, GAS[0], "water.density", "water.drag"], dot=3e-5,  # of a skin that bears little: small differences
    ),
    "soft gas under water": Case(
        scene("gas", rate=240.0, substeps=8, mass=0.2, water={"level": 1.3}, gas={"water_evened": 0.7}),
        [*MOTION, GAS[0], "water.level", "water.density", "balloon.inflation.water_evened"],
    ),
    "pump, leak and jet": Case(  # by the temperature the amount and the molar volume cancel
        scene("gas", frames=2, gas=PUMPED, neck={"diameter": 0.05, "discharge": 0.9}, **STIFF),
        [*SPRINGS, *MOTION, *GAS[:4], *PUMP, "balloon.neck.diameter", "balloon.neck.discharge"],
    ),
    **{
        f"{normals} normals": Case(
            scene("normal_force", frames=6, rate=240.0, substeps=8, normals=normals),
            [*SPRINGS[:2], *MOTION, *(f"balloon.0.inflation.k_normal.{key}.1" for key in (0, 1))], shifts=False,
        )
        for normals in ("fresh", "cached")
    },
    "a viscous ball on a string": Case(
        scene(string=[STRING], velocity=(0.3, -2.0, 0.1), springs={"viscosity": 0.003}, **DRAG),
        [*OF_STRING, "balloon.stiffness.viscosity", OF_WIND[0], MOTION[5]],
    ),
    "an anchor that moves": Case(
        scene(frames=2, string=[STRING], velocity=(0.3, -2.0, 0.1)), [SPRINGS[0], MOTION[0], MOTION[5]],
        ("launched", "block"),
    ),
    "two tubes": tubed(2),
    "a wide tube": tubed(1, 400.0),
    "two tubes and leaks": tubed(2, leak=2e-3),
    "ground": Case(
        scene(ground=True, frames=2, force=DRIVEN), [*SPRINGS, *MOTION, "ground.height", "ground.friction"], LANES, 3e-7
    ),
    "gas on the ground": Case(
        scene("gas", ground=True, frames=2), [*SPRINGS, *MOTION, *GAS, "ground.height", "ground.friction"], LANES, 3e-7
    ),
    "some fixed, on the ground": Case(
        scene(substeps=8, helium=2.0, fixed=[0, 3], ground=True),
        [*MOTION[:3], MOTION[4], SPRINGS[0], "balloon.helium"], ("lanes",), 3e-7,
    ),
    "gas among obstacles": Case(
        scene("gas", frames=2, obstacle=AMONG, faces=False, **BESIDE),
        [SPRINGS[0], MOTION[0], *MOTION[3:5], MOTION[7], GAS[0]], FORWARD, 3e-7,
    ),
    "by obstacles": Case(scene("gas", frames=2, obstacle=AMONG, faces=False, **BESIDE), OF_AMONG, reach=3e-7),
    "a box that moves": Case(
        scene(frames=2, substeps=16, obstacle=[BELOW], faces=False),
        [*OF_WAY, "obstacle.0.position.1", "obstacle.0.friction"], reach=3e-7,
    ),
    "beside a box that moves": Case(
        scene(frames=2, substeps=16, obstacle=[BELOW], faces=False), [SPRINGS[0], *MOTION[3:5], MOTION[7]],
        ("launched", "block"), 3e-7,
    ),
    "ridges": Case(ridged(2), [SPRINGS[0], MOTION[0], *MOTION[2:]], reach=3e-7),
    "ridges for a frame": Case(ridged(1), SPRINGS[:1], reach=3e-7),
    "gas beside spheres": Case(
        scene("gas", ground=True, frames=2, sphere=PRESSED),
        [
            *(SPRINGS[0], "balloon.mass", "balloon.position.1", "balloon.velocity.0", GAS[0], "gravity"),
            *(f"sphere.0.{name}" for name in ("radius", "mass", "penalty", "position.0", "velocity.1")),
            *(f"sphere.1.{name}" for name in ("radius", "position.2", "velocity.0", "angular_velocity.2", "penalty")),
            *("ground.height", "ground.restitution"),
        ], reach=3e-7,
    ),
    "exchange": Case(
        exchange(EXCHANGING, 1.6), [*OF_EXCHANGE, "sphere.0.friction", "sphere.1.friction"], reach=1e-7
    ),
    "exchange with faces": Case(exchange(BETWEEN_CORNERS, 1.75, faces=True), OF_EXCHANGE, reach=1e-7),
    "a sphere that rolls": Case(rolling(), ["obstacle.0.friction", "sphere.0.velocity.0"], reach=1e-6),
    "a fast small sphere": tiny(
        "gas", (100, 0), {"radius": 0.1, "velocity": (10.0, -200.0, 5.0), "mass": 0.05, "position": (0.12, 1.97, 0.2),
                          "friction": 0.02}, rate=480.0, substeps=4,
    ),
    "a small sphere and faces as one": tiny(
        "pressure", (66, 1), {"radius": 0.005, "velocity": (3.0, -200.0, 2.0), "mass": 0.05,
                              "position": (0.02, 1.97, 0.03)}, rate=480.0, substeps=4,
    ),
    "small spheres for frames": tiny(
        "gas", (72, 0), {}, {"position": (0.3, 2.15, 0.03), "radius": 0.1, "velocity": (2.0, -8.0, 0.2),
                             "friction": 0.05}, ground=True, frames=8, contact="penalty",
    ),
    "touch for a substep": Case(
        pair(1, 1, apart=0.95, thickness=0.3, stiffness=300.0), [*STARTS, *SKINS[:2], *TOUCH], **NARROW
    ),
    "touch": Case(pair(), [*STARTS[:2], *SKINS[1:], TOUCH[0]], **NARROW),
    "touch as said": Case(pair(thickness=0.06, stiffness=300.0), [*STARTS[:2], *SKINS[1:3], *TOUCH], **NARROW),
    "touch in a crowd": Case(
        pair(2, speed=5.0, meshes=(4, 4), thickness=0.16), [*STARTS[1:], *SKINS[::2], *TOUCH[:2]], reach=1e-6
    ),
    "touch for long": Case(pair(12, friction=0.0), [STARTS[0], *SKINS[::2]], **NARROW),
    "touch of itself": Case(pinched(), ["balloon.0.mass", "touch.thickness"], **NARROW),
    "touch of edges": Case(crossing(), [STARTS[1], *SKINS[1:3], *TOUCH[:2]], **NARROW),
    "touch on the ground": Case(
        on_a_plate(), [STARTS[0], *SKINS[:2], *TOUCH[:2], "ground.height"], **NARROW
    ),
    "8 particles, driven on the ground": Case(
        scene("gas", mesh=SMALL, ground=True, substeps=8, force=DRIVEN),
        [MOTION[1], MOTION[4], "gravity", MOTION[0], *SPRINGS[:2], GAS[0]], ("held", "held forward"), 3e-7,
    ),
    "8 particles, springs that vary and torsion": Case(
        scene(mesh=SMALL, substeps=8, springs={"torsion": 2.0, "variation": 0.2}),
        [MOTION[1], MOTION[4], "gravity", MOTION[0], *SPRINGS[:2], KEYS[0]], ("held", "block"),
    ),
    "8 particles, rubber and gas": Case(
        scene("gas", mesh=SMALL, frames=4, gas={"start_pressure": 3000.0}, material={"kind": "neo_hookean"}),
        [MOTION[1], MOTION[4], "gravity", RUBBER[0]], ("held",), shifts=False,
    ),
}  # fmt: skip
"""Cases by name. Those of contact take 1 to 384 substeps: contacts begin and end, share where more meet than a step
allows for, and rub"""
