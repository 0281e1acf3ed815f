"""A scene of foil balloons that begin flat, and fill."""

from collections.abc import Mapping
from pathlib import Path

from balloon_warp.mesh.geometry import face_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.scene.schema import Balloon, Inflation, Scene, Stiffness
from balloon_warp.scene.schema.surroundings import Picture

PRESSURE = 50.0
"""[Pa]"""
FILL_SECONDS = 1.0
STIFFNESS_OVER_HEIGHT = 300.0
"""of structural springs [N/m^2]: so much for each meter of height, as what pulls on them grows with it"""
AREAL_DENSITY = 1.0
"""of a sheet [kg/m^2]: more than foil has, so that steps are long"""
DAMPING_RATE = 1.0
"""[1/s]"""
COLORS = ((0.75, 0.1, 0.2), (0.9, 0.55, 0.05), (0.1, 0.45, 0.2), (0.1, 0.3, 0.7), (0.45, 0.15, 0.55), (0.85, 0.3, 0.5))


def scene_of_foil(meshes: Mapping[Path, PolygonMesh], height: float) -> Scene:
    """Each mesh a balloon, as it stands. They hang in the air, and a pressure that grows for a second fills them.

    Foil hardly stretches: its springs are as stiff as its height asks for, and let it bend freely.

    Args:
        meshes: flat sheets sewn at the rim, by the files that they are in.
        height: of all of them [m].
    """
    stiffness = STIFFNESS_OVER_HEIGHT * height
    balloons = []
    for number, (path, mesh) in enumerate(meshes.items()):
        mass = float(f"{AREAL_DENSITY * face_areas(mesh).sum():.2g}")
        balloons.append(
            Balloon(
                mesh=path,
                mass=mass,
                damping=DAMPING_RATE * mass,
                color=COLORS[number % len(COLORS)],
                look="foil",
                stiffness=Stiffness(structural=stiffness, shear=0.5 * stiffness, flexion=0.0),
                inflation=Inflation(kind="pressure", pressure=[(0.0, 0.0), (FILL_SECONDS, PRESSURE)]),
            )
        )
    return Scene(
        description="Foil balloons fill, and wrinkle at their rims",
        gravity=0.0,
        balloon=balloons,
        picture=Picture(azimuth=12.0, elevation=20.0),
    )
