"""A room after a party, at its true size: latex at the window, foil under the ceiling, a squirrel on the table.

The sun shines in from behind. Boxes make the room and its furniture, and no balloon knows more than what it touches.
"""

import numpy as np

import balloon_warp as bw
from balloon_warp import PolygonMesh
from balloon_warp.scene import Balloon, Obstacle, Scene, Sphere, String

FRAMES = 150
SIZE = (960, 540)
SAMPLES = 32
MESHES = bw.bundled_scenes()["table"].parent
PLASTER, OAK, WHITE = (0.36, 0.56, 0.56), (0.36, 0.17, 0.06), (0.90, 0.90, 0.88)
PINE = [(0.55, 0.34, 0.17), (0.47, 0.28, 0.13), (0.60, 0.39, 0.21), (0.51, 0.31, 0.15)]
GRASS, LEAVES = (0.16, 0.30, 0.07), (0.06, 0.18, 0.05)
SOFT = {"structural": 20.0, "shear": 10.0, "flexion": 2.0}
AIR, HELIUM = 0.02897, 0.0040026


def box(size: tuple, position: tuple, color: tuple) -> Obstacle:
    """Return a box that stands still."""
    return Obstacle(shape="box", size=size, position=position, color=color)


def back_wall() -> Obstacle:
    """Return a wall of 4.4 by 2.6 m and 12 cm, with a window of 1.8 by 1.3 m."""
    outer = [(-2.2, 0.0), (2.2, 0.0), (2.2, 2.6), (-2.2, 2.6)]
    window = [(-1.2, 0.9), (0.6, 0.9), (0.6, 2.2), (-1.2, 2.2)]
    points = [(x, y, z) for z in (0.06, -0.06) for x, y in (*outer, *window)]
    faces = []
    for n, m in ((0, 1), (1, 2), (2, 3), (3, 0)):
        faces += [(n, m, m + 4, n + 4), (n + 8, n + 12, m + 12, m + 8)]  # the sides to the room and to the garden
        faces += [(n, n + 8, m + 8, m), (n + 4, m + 4, m + 12, n + 12)]  # the wall's rim and the window's
    wall = PolygonMesh(np.array(points), np.full(16, 4, np.int32), np.array(faces, np.int32).ravel())
    return Obstacle(mesh=wall, position=(0.0, 0.0, -1.95), color=PLASTER)


def room() -> list[Obstacle]:
    """Return a floor of boards with a rug, walls and a window of six panes."""
    boards = [box((4.6, 0.1, 0.245), (0.0, -0.05, -1.97 + 0.25 * n), PINE[3 * n % 4]) for n in range(20)]
    rug = [
        box((1.7, 0.012, 1.1), (0.15, 0.006, -0.15), (0.50, 0.09, 0.08)),
        box((1.5, 0.016, 0.9), (0.15, 0.008, -0.15), (0.80, 0.70, 0.50)),
    ]
    walls = [
        box((0.1, 2.6, 4.9), (-2.2, 1.3, 0.4), PLASTER),
        box((0.1, 2.6, 4.9), (2.2, 1.3, 0.4), PLASTER),
    ]
    frame = [box((1.9, 0.05, 0.24), (-0.3, 0.9, -1.87), WHITE), box((1.8, 0.04, 0.06), (-0.3, 1.6, -1.95), WHITE)]
    bars = [box((0.05, 1.3, 0.06), (x, 1.55, -1.95), WHITE) for x in (-1.18, -0.6, 0.0, 0.58)]
    skirting = box((4.3, 0.1, 0.02), (0.0, 0.05, -1.88), WHITE)
    painting = [
        box((0.5, 0.4, 0.03), (1.35, 1.45, -1.87), OAK),
        box((0.42, 0.32, 0.04), (1.35, 1.45, -1.87), (0.75, 0.42, 0.10)),
    ]
    return [*boards, *rug, *walls, back_wall(), *frame, *bars, skirting, *painting]


def garden() -> list[Obstacle]:
    """Return a hill and a tree behind the window."""
    hills = [
        Obstacle(shape="capsule", radius=r, length=0.0, position=p, color=GRASS)
        for r, p in ((2.4, (-1.6, -1.3, -4.8)), (2.0, (0.9, -1.2, -4.6)))
    ]
    leaves = [((0.05, 1.55, -3.6), 0.34), ((0.36, 1.75, -3.7), 0.3), ((0.12, 1.95, -3.7), 0.26)]
    tree = [Obstacle(shape="capsule", radius=r, length=0.0, position=p, color=LEAVES) for p, r in leaves]
    return [*hills, *tree, box((0.09, 0.9, 0.09), (0.18, 1.0, -3.7), OAK)]


def chair(x: float, z: float) -> list[Obstacle]:
    """Return a chair with its seat at 0.45 m, which looks to the right."""
    legs = [box((0.04, 0.45, 0.04), (x + i, 0.225, z + j), OAK) for i in (-0.19, 0.19) for j in (-0.19, 0.19)]
    back = [box((0.04, 0.5, 0.04), (x - 0.19, 0.7, z + j), OAK) for j in (-0.19, 0.19)]
    rails = [box((0.03, 0.08, 0.36), (x - 0.19, y, z), OAK) for y in (0.72, 0.9)]
    return [*legs, *back, *rails, box((0.44, 0.04, 0.44), (x, 0.45, z), OAK)]


def ball(name: str, position: tuple, color: tuple, molar_mass: float, **more: object) -> Balloon:
    """Return a party balloon, 33 cm wide."""
    inflation = {"kind": "gas", "start_pressure": 500.0, "molar_mass": molar_mass}
    return Balloon(
        name=name, mesh=MESHES / "ball.obj", position=position, mass=0.003, color=color, stiffness=SOFT,
        inflation=inflation, damping=0.01, drag_coefficient=0.47, **more,
    )  # fmt: skip


balloons = [
    ball("red", (-0.55, 1.45, -1.0), (0.70, 0.03, 0.04), HELIUM),
    ball("yellow", (-0.95, 1.55, -0.85), (0.85, 0.55, 0.02), HELIUM),
    ball("violet", (-0.8, 1.4, -1.3), (0.35, 0.05, 0.45), HELIUM),
    ball("teal", (-0.35, 1.75, -0.75), (0.02, 0.40, 0.42), HELIUM),
    ball("pink", (-0.7, 1.85, -1.1), (0.85, 0.25, 0.40), HELIUM),
    ball("blue", (0.35, 0.05, 0.55), (0.03, 0.20, 0.65), AIR),
    ball("green", (-0.55, 0.05, 0.75), (0.05, 0.40, 0.12), AIR),
    ball("white", (-0.15, 0.05, 0.0), (0.80, 0.80, 0.80), AIR),
    ball("orange", (-1.6, 0.05, 0.6), (0.85, 0.22, 0.02), AIR),
    Balloon(
        name="cloud", mesh=MESHES / "pillow.obj", scale=0.6, position=(0.8, 1.75, -0.7), rotation=(10.0, 20.0, 4.0),
        mass=0.1, helium=9.83, damping=0.3, color=(0.82, 0.83, 0.86), look="foil",
        stiffness={"structural": 100.0, "shear": 50.0, "flexion": 0.0},
        inflation={"kind": "pressure", "pressure": 60.0},
    ),
    Balloon(
        name="cushion", mesh=MESHES / "pillow.obj", scale=0.36, print=MESHES / "pillow.png",
        position=(-0.64, 0.5, -0.62), mass=0.3, damping=2.0,
        stiffness={"structural": 200.0, "shear": 100.0, "flexion": 20.0},
        inflation={"kind": "pressure", "pressure": 150.0},
    ),
    Balloon(
        name="squirrel", mesh=MESHES / "squirrel.obj", scale=0.42, position=(1.2, 0.73, -0.75),
        rotation=(0.0, -50.0, 0.0), mass=0.2, helium=7.0, damping=2.0, color=(0.80, 0.07, 0.06),
        stiffness={"structural": 100.0, "shear": 50.0, "flexion": 10.0},
        inflation={"kind": "pressure", "pressure": 120.0},
    ),
]  # fmt: skip
table = Obstacle(mesh=MESHES / "table.obj", position=(1.3, 0.0, -0.75), color=OAK)
scene = Scene(
    description="A room after a party",
    frames=FRAMES,
    balloon=balloons,
    obstacle=[*room(), *garden(), *chair(-0.7, -0.62), table],
    sphere=[Sphere(radius=0.11, mass=0.4, position=(1.35, 0.2, 0.6), color=(0.75, 0.20, 0.03))],
    string=[String(balloon=n, anchor=(-0.89, 0.95, -0.66 + 0.02 * n), stiffness=5.0) for n in range(5)],
    touch={"edges": True},
    picture={
        "azimuth": 0.0,
        "elevation": 6.0,
        "zoom": 2.62,
        "look_at": (0.0, 1.09, -0.6),
        "light": 8.0,
        "paper": (0.55, 0.72, 0.85),
    },
)
bw.animate(scene, "room.usdc")
bw.render_stage("room.usdc", "room.png", size=SIZE, samples=SAMPLES)
