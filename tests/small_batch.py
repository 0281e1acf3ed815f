"""Small batch with one of each kind of thing in a scene."""

from pathlib import Path

from meshes import cube, quad_sphere

from balloon_warp import Scene
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Ground, Inflation, Sphere, String

FRAMES, WORLDS = 5, 5


def scene(**fields) -> Scene:
    """Return a small scene with one of each kind of thing."""
    inflation = Inflation(k_normal=0.2)
    balloons = [
        Balloon(mesh=quad_sphere(3), name="ball", position=(0, 2, 0), helium=20.0, inflation=inflation),
        Balloon(mesh=cube(), name="Sphere_0", position=(3, 0.5, 0), color=(0.1, 0.2, 0.3), inflation=inflation),
    ]
    fields = {
        "description": "one of each",
        "balloon": balloons,
        "sphere": [Sphere(position=(0, 4, 0), radius=0.3)],
        "string": [String(anchor=(0, 0, 0), length=1.5), String(anchor=(4, 0, 0), balloon=1, particle=6)],
        "ground": Ground(),
        **{"frames": FRAMES, "frames_per_second": 30, "substeps": 40, "faces": False, "touch": False},
    } | fields
    return Scene(**fields)


def struck(**fields) -> Scene:
    """Return a ball on a short string above the ground that a sphere strikes, which touches things near it."""
    ball = Balloon(mesh=quad_sphere(3), position=(0.0, 1.2, 0.0), inflation=Inflation(k_normal=0.2))
    sphere, string = Sphere(position=(0.2, 2.1, 0.0), radius=0.3), String(anchor=(0.0, 0.0, 0.0), length=0.1)
    return Scene(balloon=[ball], sphere=[sphere], string=[string], ground=Ground(), **fields)


def write_meshes(folder: Path) -> list[Path]:
    """Write two meshes that differ in their number of particles."""
    paths = [folder / "coarse.obj", folder / "fine, round.obj"]
    for path, mesh in zip(paths, (quad_sphere(3), quad_sphere(4)), strict=True):
        write_obj(path, mesh)
    return paths
