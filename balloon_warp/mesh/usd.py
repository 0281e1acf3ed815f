"""USD files, whatever their suffix. How a stage is read stands in `usd_stage`."""

from pathlib import Path

from balloon_warp.mesh.polygon_mesh import PolygonMesh


def read_usd(path: Path | str, prim_path: str | None = None) -> PolygonMesh:
    """Read the mesh at `prim_path`, or the stage's first, as its control polygons.

    Values are taken at the default time, or at their earliest sample where they have no default. The points are
    transformed to the stage's world, in its own unit and up axis. Left-handed faces are turned right-handed.
    Holes and the subdivision scheme are not looked at.

    Raises:
        InputError: the file is no stage, there is no such mesh, or its arrays do not fit together.
    """
    from balloon_warp.mesh.usd_stage import read_stage  # loads USD: only for a stage

    return read_stage(path, prim_path)


LOADERS = dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), read_usd)
