"""A scene of foil balloons that begin flat, and fill."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from balloon_warp.mesh.geometry import face_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.scene.schema import Balloon, Inflation, Scene, Stiffness, String
from balloon_warp.scene.schema.surroundings import Picture

PRESSURE = 50.0
"""Pressure [Pa]"""
FILL_SECONDS = 1.0
STIFFNESS_OVER_HEIGHT = 300.0
"""Constant of structural springs per meter of height [N/m^2], as the forces on them grow with it"""
AREAL_DENSITY = 1.0
"""Areal density of a sheet [kg/m^2]: more than foil has, so that steps are long"""
DAMPING_RATE = 1.0
"""Damping rate [1/s]"""
HELIUM = 9.3
"""Lift that carries nearly all of the weight [m/s^2]: foil itself weighs almost nothing"""
TOP = 0.25
"""Fraction of a part's height, at the top, in which it is held at its left and its right"""
HANGING = 0.5
"""Length of strings above the highest part, over the height of all parts"""
COLORS = ((0.75, 0.1, 0.2), (0.9, 0.55, 0.05), (0.1, 0.45, 0.2), (0.1, 0.3, 0.7), (0.45, 0.15, 0.55), (0.85, 0.3, 0.5))


def scene_of_foil(meshes: Mapping[Path, PolygonMesh], height: float) -> Scene:
    """Return each mesh a balloon that hangs on two strings, and that a pressure fills, which grows for a second.

    Foil hardly stretches: its springs are as stiff as its height asks for, and let it bend freely.

    Args:
        meshes: flat sheets sewn at the rim, by the files that they are in.
        height: of all of them [m].
    """
    stiffness = STIFFNESS_OVER_HEIGHT * height
    balloons, strings = [], []
    ceiling = max(float(mesh.points[:, 1].max()) for mesh in meshes.values()) + HANGING * height
    for number, (path, mesh) in enumerate(meshes.items()):
        mass = float(f"{AREAL_DENSITY * face_areas(mesh).sum():.2g}")
        balloons.append(
            Balloon(
                mesh=path,
                mass=mass,
                damping=DAMPING_RATE * mass,
                helium=HELIUM,
                color=COLORS[number % len(COLORS)],
                look="foil",
                stiffness=Stiffness(structural=stiffness, shear=0.5 * stiffness, flexion=0.0),
                inflation=Inflation(kind="pressure", pressure=[(0.0, 0.0), (FILL_SECONDS, PRESSURE)]),
            )
        )
        for held in places_to_hold(mesh):
            x, _, z = mesh.points[held].tolist()
            anchor = (float(f"{x:.6g}"), float(f"{ceiling:.6g}"), float(f"{z:.6g}"))
            strings.append(String(anchor=anchor, balloon=number, particle=held, stiffness=stiffness, knot=False))
    return Scene(
        description="Foil balloons fill as they hang, and wrinkle at their rims",
        balloon=balloons,
        string=strings,
        picture=Picture(azimuth=12.0, elevation=20.0),
    )


def places_to_hold(mesh: PolygonMesh) -> tuple[int, int]:
    """Return the vertices by which a part hangs upright: the leftmost and the rightmost of its top."""
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    top = np.flatnonzero(y >= y.max() - TOP * np.ptp(y))
    return int(top[np.argmin(x[top])]), int(top[np.argmax(x[top])])
