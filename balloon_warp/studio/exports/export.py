"""Export of a stage as a file of another kind, or as a file for each frame.

Export of a stage as a file of another kind.

A simulation's frames always go into a stage first: it survives a kill, resumes with `--resume`, and passes USD's
validators. An export is made from the stage, and so is the same from `run -o` and, later, from `convert`.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.topology import triangulate, vertex_normals
from balloon_warp.studio.exports.parts import Animation, Part
from balloon_warp.system.arguments import checked
from balloon_warp.system.files import LINE, check_writable, require_ours, sole_writer, whole_file
from balloon_warp.usd import STAGE_SUFFIXES

SEQUENCE_SUFFIXES = (".obj", ".ply")
"""Files of which each frame has one"""


def frame_path(pattern: Path, frame: int) -> Path:
    """Return the file of a frame: its number, with as many digits as the name has `#` at least, in their place.

    Raises:
        InputError: the name has no place for the number.
    """
    if not re.search("#+", pattern.name):
        raise InputError(
            f"{pattern}: is one file for all frames; expected #### in the name for the frame number, such as "
            f"{pattern.stem}.####{pattern.suffix}"
        )
    name = re.sub("#+", lambda found: f"{frame:0{len(found[0])}d}", pattern.name, count=1)
    return pattern.with_name(name)


def write_sequence(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write a file for each frame, each of which appears whole or not at all; arguments as `export_stage` has them."""
    text = _obj if output.suffix.lower() == ".obj" else partial(_ply, in_triangles=_has_many_kinds(animation.parts))
    for done, frame in enumerate(animation.frames, start=1):
        parts = [part for part in animation.parts if part.seen(frame)]
        points = [animation.y_up_meters(part.points(frame)) for part in parts]
        with whole_file(frame_path(output, frame)) as path:
            path.write_bytes(text(parts, points))
        on_frame(done, len(animation.frames))
    if others := _of_no_frame(output, animation):
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        on_note(f"{others[0].name}{more}: from an earlier sequence of that name; kept")


def _of_no_frame(pattern: Path, animation: Animation) -> list[Path]:
    """Return the files of the same name that are of another, longer sequence."""
    before, after = re.split("#+", pattern.name, maxsplit=1)
    form = f"{re.escape(before)}([0-9]+){re.escape(after)}"
    found = ((path, re.fullmatch(form, path.name)) for path in sorted(pattern.parent.iterdir()))
    return [path for path, match in found if match and int(match[1]) not in animation.frames]


def _obj(parts: Sequence[Part], points: Sequence[NDArray[np.float64]]) -> bytes:
    """Return Text: an object for each part, smooth, with texture coordinates where it has them."""
    text, before, coordinates_before = [f"# {LINE}: meters, Y up\n"], 1, 1
    for part, places in zip(parts, points, strict=True):
        mesh = part.mesh
        text.append(f"o {part.name}\n" + "v %.9g %.9g %.9g\n" * len(places) % tuple(places.ravel().tolist()))
        corners = (mesh.face_vertex_indices + before).astype(str)
        if mesh.texture_coordinates is not None:
            unique, number = np.unique(mesh.texture_coordinates, axis=0, return_inverse=True)
            text.append("vt %.9g %.9g\n" * len(unique) % tuple(unique.ravel().tolist()))
            corners = np.char.add(np.char.add(corners, "/"), (number.ravel() + coordinates_before).astype(str))
            coordinates_before += len(unique)
        faces = np.split(corners, np.cumsum(mesh.face_vertex_counts)[:-1])
        text.append("s 1\n" + "".join(f"f {' '.join(face)}\n" for face in faces))
        before += len(places)
    return "".join(text).encode()


def _has_many_kinds(parts: Sequence[Part]) -> bool:
    """Return whether faces differ in their number of corners."""
    return len(np.unique(np.concatenate([part.mesh.face_vertex_counts for part in parts]))) > 1


def _ply(parts: Sequence[Part], points: Sequence[NDArray[np.float64]], in_triangles: bool) -> bytes:
    """Return Binary: all parts in one mesh, with normals and colors at its vertices.

    Args:
        in_triangles: whether faces are cut up: many programs read lists of one length alone.
    """
    vertex = np.dtype([("place", "<f4", 3), ("normal", "<f4", 3), ("color", "u1", 3)])
    vertices, faces, before, face_count = [], [], 0, 0
    for part, places in zip(parts, points, strict=True):
        mesh = replace(part.mesh, points=places)
        counts, indices = mesh.face_vertex_counts, mesh.face_vertex_indices
        if in_triangles:
            indices = triangulate(mesh)[0].ravel()
            counts = np.full(len(indices) // 3, 3)
        rows = np.zeros(len(places), vertex)
        rows["place"], rows["normal"] = places, vertex_normals(mesh)
        rows["color"] = _srgb(part.color)
        starts = np.cumsum(counts) - counts
        vertices.append(rows.tobytes())
        faces.append(np.insert(indices + before, starts, counts).astype("<i4").tobytes())
        before, face_count = before + len(places), face_count + len(counts)
    header = "".join(
        [
            f"ply\nformat binary_little_endian 1.0\ncomment {LINE}: meters, Y up\n",
            f"element vertex {before}\n",
            *(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz")),
            *(f"property uchar {name}\n" for name in ("red", "green", "blue")),
            f"element face {face_count}\nproperty list int int vertex_indices\nend_header\n",
        ]
    )
    return b"".join([header.encode("ascii"), *vertices, *faces])


def _srgb(color: Sequence[float]) -> NDArray[np.uint8]:
    """Return sRGB in 8 bits from linear RGB."""
    linear = np.clip(color, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return np.rint(255.0 * encoded).astype(np.uint8)


HDF5_SUFFIXES = (".h5", ".hdf5")
WRITERS = {
    **dict.fromkeys(STAGE_SUFFIXES, "files.write_stage"),
    ".usdz": "files.write_usdz",
    ".glb": "parts.write_glb",
    ".obj": "export.write_sequence",
    ".ply": "export.write_sequence",
    ".abc": "files.write_alembic",
    **dict.fromkeys(HDF5_SUFFIXES, "files.write_hdf5"),
    ".pvd": "files.write_series",
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
    if suffix in SEQUENCE_SUFFIXES:
        check_writable(frame_path(output, 0), EXPORT_SUFFIXES)
    elif suffix == ".abc":
        from balloon_warp.studio.exports.files import require_blender

        require_blender()
    elif suffix in HDF5_SUFFIXES:
        from balloon_warp.system.arrays import require_h5py

        require_h5py()


def files_of_frames(output: Path, frames: Iterable[int]) -> list[Path]:
    """Return the files of single frames that belong to an output; none of most kinds."""
    suffix = output.suffix.lower()
    if suffix in SEQUENCE_SUFFIXES:
        path_of = frame_path
    elif suffix == ".pvd":
        from balloon_warp.studio.exports.files import grid_path as path_of
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
    from balloon_warp.studio.exports.parts import Animation  # loads USD: only once the output is known to be good

    module, function = WRITERS[output.suffix.lower()].split(".")
    write = getattr(import_module(f"balloon_warp.studio.exports.{module}"), function)
    animation = Animation(stage, on_note)
    for path in files_of_frames(output, animation.frames):
        require_ours(path)
    with sole_writer(output):
        write(output, animation, on_note, on_frame)
