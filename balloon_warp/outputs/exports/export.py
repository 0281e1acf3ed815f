"""Export of a stage as a file of another kind.

A simulation's frames always go into a stage first: it survives a kill, resumes with `--resume`, and passes USD's
validators. An export is made from the stage, and so is the same from `run -o` and, later, from `convert`.
"""

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path

from balloon_warp.arguments import checked
from balloon_warp.errors import InputError
from balloon_warp.files import check_writable
from balloon_warp.outputs.usd import STAGE_SUFFIXES
from balloon_warp.ownership import require_ours, sole_writer

HDF5_SUFFIXES = (".h5", ".hdf5")
WRITERS = {
    **dict.fromkeys(STAGE_SUFFIXES, "usdz.write_stage"),
    ".usdz": "usdz.write_usdz",
    ".glb": "glb.write_glb",
    ".obj": "sequence.write_sequence",
    ".ply": "sequence.write_sequence",
    ".abc": "alembic.write_alembic",
    **dict.fromkeys(HDF5_SUFFIXES, "hdf5.write_hdf5"),
    ".pvd": "vtu.write_series",
}
"""Writers by suffix, loaded when first needed: functions of the output path, the stage's `Animation`, and listeners to
notes and to progress"""
EXPORT_SUFFIXES = tuple(WRITERS)


def check_export(output: Path) -> None:
    """Make sure, before any work is done, that a file of this kind can be written there.

    Raises:
        InputError: it cannot.
        MissingExtraError: the package that writes it is not installed.
    """
    suffix = output.suffix.lower()
    check_writable(output, EXPORT_SUFFIXES)
    if suffix in (".obj", ".ply"):
        from balloon_warp.outputs.exports.sequence import frame_path

        check_writable(frame_path(output, 0), EXPORT_SUFFIXES)
    elif suffix == ".abc":
        from balloon_warp.outputs.exports.alembic import require_blender

        require_blender()
    elif suffix in HDF5_SUFFIXES:
        from balloon_warp.outputs.hdf5_arrays import require_h5py

        require_h5py()


def files_of_frames(output: Path, frames: Iterable[int]) -> list[Path]:
    """Return the files of single frames that belong to an output; none of most kinds."""
    suffix = output.suffix.lower()
    if suffix in (".obj", ".ply"):
        from balloon_warp.outputs.exports.sequence import frame_path as path_of
    elif suffix == ".pvd":
        from balloon_warp.outputs.exports.vtu import grid_path as path_of
    else:
        return []
    return [path_of(output, frame) for frame in frames]


@checked
def export_stage(
    stage: str | Path,
    output: str | Path,
    *,
    on_note: Callable[[str], None] = lambda sentence: None,
    on_frame: Callable[[int, int], None] = lambda done, count: None,
) -> None:
    """Convert a stage to a file of another kind.

    That is .usdc, .usda, .usd, .usdz, .glb, .abc, .h5, .pvd, or one .obj or .ply for each frame, where the name has
    #### for its number. Files appear whole or not at all.

    Args:
        stage: Any file that USD opens.
        output: File to write.
        on_note: Called with sentences, such as the size of a file to come, or the missing files of the stage.
        on_frame: Called with the amount done, and the whole.

    Raises:
        InputError: the stage cannot be read, the output cannot be written, or the file of a frame is not ours.
        MissingExtraError: the package that writes it is not installed.
    """
    stage, output = Path(stage), Path(output)
    check_export(output)
    if stage.exists() and output.exists() and stage.samefile(output):
        raise InputError(f"{output}: is the input stage; expected another name, with -o")
    from balloon_warp.outputs.exports.parts import Animation  # loads USD: only once the output is known to be good

    module, function = WRITERS[output.suffix.lower()].split(".")
    write = getattr(import_module(f"balloon_warp.outputs.exports.{module}"), function)
    animation = Animation(stage, on_note)
    for path in files_of_frames(output, animation.frames):
        require_ours(path)
    with sole_writer(output):
        write(output, animation, on_note, on_frame)
