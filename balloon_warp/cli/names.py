"""Names of outputs that the user did not give."""

import os
from collections.abc import Iterator
from pathlib import Path

from balloon_warp.files import STAGES, is_ours, require_ours
from balloon_warp.mesh.load import load_mesh
from balloon_warp.scene import Scene
from balloon_warp.scene.load import files_of_scene
from balloon_warp.scene.schema import MESHED


def own_name(usual: Path, scene: Scene | None = None) -> Path:
    """Return a name whose file is not there, or is ours to replace: the usual one, or another if that is an input.

    Args:
        scene: whose meshes, with their textures, and other files are the inputs.

    Raises:
        InputError: somebody else's file is in its place.
    """
    name = usual.with_stem(f"{usual.stem}_balloon") if scene and _is_input(usual, scene) else usual
    require_ours(name)
    return name


def _is_input(path: Path, scene: Scene) -> bool:
    return path.exists() and any(os.path.realpath(path) == os.path.realpath(each) for each in _inputs(scene, path))


def _inputs(scene: Scene, path: Path) -> Iterator[Path]:
    """Iterate over the files that a scene names, and, if another's picture is at the path, that its meshes name."""
    yield from files_of_scene(scene)
    if path.suffix.lower() in STAGES or is_ours(path):
        return
    for meshed in (each for name in MESHED for each in getattr(scene, name) if isinstance(each.mesh, Path)):
        looks = load_mesh(meshed.mesh, meshed.prim).looks
        yield from (picture.file for picture in looks.pictures if picture.file) if looks else ()
