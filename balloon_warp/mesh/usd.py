"""USD files of any suffix. The reader of stages is `usd_stage`."""

from collections.abc import Sequence
from pathlib import Path

from balloon_warp.mesh.polygon_mesh import PolygonMesh


def read_usd(path: Path | str, prim: str | Sequence[str] | None = None) -> PolygonMesh:
    """Read the meshes of a stage as one, as their control polygons.

    They are those at or below `prim`, or all that are visible and of purpose "default" or "render".

    Each is a group by its prim's name. The mesh's warnings name omissions.

    Values are taken at the default time, or at their earliest sample where they have no default. The points are
    transformed to the stage's world, in its own unit and up axis. Left-handed faces are turned right-handed.
    Holes and the subdivision scheme are not looked at.

    Raises:
        InputError: the file is no stage, there is no such mesh, none is shown, or its arrays do not fit together.
    """
    from balloon_warp.mesh.usd_stage import read_stage  # loads USD: only for a stage

    return read_stage(path, prim)


LOADERS = dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), read_usd)
