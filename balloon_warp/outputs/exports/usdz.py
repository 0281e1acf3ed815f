"""A stage as one .usdz package, as phones and pages show it."""

from collections.abc import Callable
from pathlib import Path

from pxr import Usd, UsdUtils

from balloon_warp.errors import InputError
from balloon_warp.files import folder_beside, whole_file
from balloon_warp.mesh.pictures import Pictures
from balloon_warp.mesh.usd_open import open_stage
from balloon_warp.mesh.usd_surfaces import content_of
from balloon_warp.outputs.exports.parts import Animation
from balloon_warp.outputs.render.timing import timing_of


def write_usdz(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the package; arguments as `export_stage` has them."""
    with folder_beside(output) as folder, whole_file(output) as temporary:
        flat = folder / f"{output.stem}.usdc"  # a package begins with a binary layer, under this name
        _as_it_is(animation).Export(str(flat), addSourceFileComment=False)  # which names our folder
        if not UsdUtils.CreateNewUsdzPackage(str(flat), str(temporary)):
            raise InputError(f"{output}: USD could not make a package of {animation.path}; is the disk full?")
    on_frame(1, 1)


def write_stage(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the stage in one file of another kind of USD, with its images beside it."""
    flat, pictures = _as_it_is(animation).Flatten(addSourceFileComment=False), Pictures(animation.path)

    def beside(path: str) -> str:
        data = content_of(path)
        picture = pictures.of_bytes(path, data) if data else None
        if picture is None:
            return path
        picture.write_beside(output)
        return picture.path

    UsdUtils.ModifyAssetPaths(flat, beside)
    with whole_file(output) as temporary:
        flat.Export(str(temporary))
    on_frame(1, 1)


def _as_it_is(animation: Animation) -> Usd.Stage:
    """Return the stage with its shapes and instances as they are, where others of its kind read them."""
    return timing_of(open_stage(animation.path), animation.path).stage
