"""Wavefront OBJ files: vertices, polygons, groups, materials and texture coordinates.

Wavefront OBJ files: vertices and polygons, kept as they are written. The n-th `v` line is vertex n.

Texture coordinates go along, base colors and base textures of the .mtl, and the names of groups and objects. Normals,
lines and curves are passed over.
"""

import io
import shlex
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.crossings import FLOAT32_MAX, LARGEST_FACE, Objects, Pictures, beside, of_faces
from balloon_warp.mesh.polygon_mesh import WHITE, Look, Looks, PolygonMesh, encoded, linear, looks_of
from balloon_warp.mesh.topology import face_starts
from balloon_warp.system.files import LINE, check_writable, legible, regular_content, require_ours, whole_file

MOST_GROUPS = 10_000
"""Largest number of names that are kept of a file"""


class ObjGroups:
    """Collects `g` and `o` lines. A face is in the groups of the last `g` line, and in the object of the last `o`."""

    def __init__(self) -> None:
        self._ranges: dict[str, array[int]] = {}
        """Begin and end of runs of faces, by name"""
        self._open: dict[bytes, tuple[list[str], int]] = {}
        """Current names, and the first face that has them, by `g` or `o`"""

    def begin(self, kind: bytes, text: bytes, face: int) -> None:
        """Begin a group: a line with its names, and the number of the next face."""
        self._end(kind, face)
        words = text.split() if kind == b"g" else [text.strip()]
        self._open[kind] = [word.decode("utf-8", "replace") for word in words if word], face

    def of_vertices(self, sizes: NDArray[np.int32], corners: NDArray[np.int32]) -> dict[str, NDArray[np.int32]]:
        """Return the vertices of each group, ascending.

        Args:
            sizes: of all faces.
            corners: of all faces, one after the other.
        """
        for kind in list(self._open):
            self._end(kind, len(sizes))
        ends = np.concatenate([[0], np.cumsum(sizes)])
        groups = {}
        for name, ranges in self._ranges.items():
            runs = [corners[ends[begin] : ends[end]] for begin, end in zip(ranges[::2], ranges[1::2], strict=True)]
            groups[name] = np.unique(np.concatenate(runs))
        return groups

    def faces_of(self, names: Iterable[str], face_count: int) -> NDArray[np.bool_]:
        """Return a mask of the faces that are in a group of these names."""
        mask = np.zeros(face_count, bool)
        for name in names:
            ranges = self._ranges[name]
            for begin, end in zip(ranges[::2], ranges[1::2], strict=True):
                mask[begin:end] = True
        return mask

    def _end(self, kind: bytes, face: int) -> None:
        names, begin = self._open.pop(kind, ([], face))
        for name in names if face > begin else ():
            if name in self._ranges or len(self._ranges) < MOST_GROUPS:
                self._ranges.setdefault(name, array("i")).extend((begin, face))


NOWHERE = -(2**31)
"""Number at the corners of a face that has none"""


class ObjTextures:
    """Collect `vt` lines and faces' references to them.

    Where they make no sense there are none: no mesh is refused for its texture.
    """

    def __init__(self) -> None:
        self._coordinates, self._corners = array("d"), array("i")
        self._complete = True
        self._before = 0
        """Number of corners of faces without any, before the first that has some"""

    def add_vertex(self, words: list[bytes]) -> None:
        """Add a `vt` line: u, and v unless it is 0; a depth may follow."""
        try:
            self._coordinates.extend((float(words[0]), float(words[1]) if len(words) > 1 else 0.0))
        except (IndexError, ValueError):
            self._complete = False

    def add_face(self, words: list[bytes]) -> None:
        """Add the corners of an `f` line: v/vt or v/vt/vn."""
        if not self._corners and b"/" not in words[0]:
            self._before += len(words)
        elif self._complete:
            self._add_corners(words)

    def _add_corners(self, words: list[bytes]) -> None:
        above = len(self._coordinates) // 2
        if all(b"/" not in word or b"//" in word for word in words):
            self._corners.extend(array("i", [NOWHERE]) * len(words))
            return
        try:
            numbers = [int(word.split(b"/", 2)[1]) for word in words]
            self._corners.extend(number - 1 if number >= 0 else above + number for number in numbers)
        except (IndexError, ValueError, OverflowError):
            self._complete = False

    def of_corners(self, partly: bool = False) -> NDArray[np.float32] | None:
        """Return u and v at the corners of all faces, shape (corner_count, 2); None unless all corners have them.

        Args:
            partly: Whether faces may have none, so that zeros stand there.
        """
        coordinates = np.frombuffer(self._coordinates).reshape(-1, 2)
        if not (self._complete and self._corners and len(coordinates)) or (self._before and not partly):
            return None
        corners = np.concatenate([np.full(self._before, NOWHERE), np.frombuffer(self._corners, dtype=np.int32)])
        nowhere = (corners == NOWHERE) & partly
        there = (nowhere | (corners >= 0) & (corners < len(coordinates))).all()
        if not there or not (np.abs(coordinates) <= FLOAT32_MAX).all():
            return None
        return np.where(nowhere[:, None], 0.0, coordinates[np.where(nowhere, 0, corners)]).astype(np.float32)


LARGEST_LIBRARY = 1 << 24
"""Largest size of an .mtl [bytes]"""
OPTIONS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2, "-texres": 1}
"""Options of a map, by the number of following words; -o, -s and -t are followed by up to three numbers"""
UNKNOWN = -1


class ObjMaterials:
    """Collect `mtllib` and `usemtl` lines, and vertices' colors.

    Where they make no sense there are none: no mesh is refused for its looks.
    """

    def __init__(self, path: Path) -> None:
        self._folder, self._pictures = path.parent, Pictures(path)
        self._libraries: list[str] = []
        self._names: dict[str, int] = {}
        self._begins = array("i", [0])
        self._used = array("i", [UNKNOWN])
        self._colors = array("f")
        self._placed = False

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about textures that cannot be read."""
        return tuple(self._pictures.warnings)

    def add_library(self, text: bytes) -> None:
        """Take a `mtllib` line: one name, perhaps with blanks, or several."""
        self._libraries.append(_text(text))

    def use(self, text: bytes, face: int) -> None:
        """Take a `usemtl` line, and the number of the next face."""
        self._begins.append(face)
        self._used.append(self._names.setdefault(_text(text), len(self._names)))

    def add_vertex(self, words: list[bytes]) -> None:
        """Take a `v` line that ends with red, green and blue."""
        self._colors.extend(map(float, words[-3:]))

    def of_corners(self, mesh: PolygonMesh, placed: bool) -> Looks | None:
        """Return the looks at the corners of a mesh; colors of vertices count where all have some.

        Args:
            placed: whether there are texture coordinates; without any, images are their mean color.
        """
        colors = np.frombuffer(self._colors, np.float32).reshape(-1, 3)
        colored = len(colors) == mesh.vertex_count
        if not self._names and not colored:
            return None
        sizes = mesh.face_vertex_counts
        runs = np.diff(np.append(np.frombuffer(self._begins, np.int32), len(sizes)))
        of_faces = np.repeat(np.frombuffer(self._used, np.int32), runs)
        self._placed, known = placed, {}
        if self._names:
            known = self._read()
        shades = None
        if colored:
            scale = 255.0 if colors.max() > 1.0 else 1.0  # some write bytes
            shades = linear(colors / scale)[mesh.face_vertex_indices]
        return looks_of([known.get(name) for name in self._names], np.repeat(of_faces, sizes), shades)

    def _read(self) -> dict[str, Look]:
        """Read the used materials of all libraries that are there, by name; the first of a name counts."""
        found: dict[str, Look] = {}
        for line in self._libraries:
            whole = beside(self._folder, line)
            files = [whole] if whole else [beside(self._folder, name) for name in line.split()]
            for file in files:
                if file is not None and file.stat().st_size <= LARGEST_LIBRARY:
                    for name, access in self._library(file).items():
                        found.setdefault(name, access)
        return found

    def _library(self, file: Path) -> dict[str, Look]:
        said: dict[str, dict[str, str]] = {}
        try:
            text = file.read_bytes().decode("utf-8", "replace")
        except OSError:
            return {}
        name = ""
        for line in text.replace("\\\n", " ").splitlines():
            kind, _, rest = line.partition("#")[0].strip().partition(" ")
            if kind.lower() == "newmtl":
                name = rest.strip()
            elif name in self._names and kind.lower() in ("kd", "map_kd"):
                said.setdefault(name, {}).setdefault(kind.lower(), rest.strip())
        return {name: access for name, rows in said.items() if (access := self._look(name, rows, file.parent))}

    def _look(self, name: str, rows: dict[str, str], folder: Path) -> Look | None:
        named = _file_of_map(rows.get("map_kd", ""))
        picture = self._pictures.of_file(named, folder) if named else None
        color = _color(rows.get("kd", ""))
        if picture is not None:
            # Exporters write black, gray or white beside an image, which other programs pass over.
            access = Look(name, (1.0, 1.0, 1.0), picture)
            return access if self._placed else self._pictures.mean_of(access, named)
        return Look(name, color) if color else None


def _color(text: str) -> tuple[float, float, float] | None:
    """Parse red, green and blue, or one number for all."""
    try:
        numbers = [float(word) for word in text.split()[:3]]
    except ValueError:
        return None
    numbers = numbers * 3 if len(numbers) == 1 else numbers
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        return None
    red, green, blue = np.clip(numbers, 0.0, 1.0).tolist()
    return red, green, blue


def _file_of_map(text: str) -> str:
    """Return the file name behind the options of a map; a name may have blanks."""
    words = text.split(" ")
    while words and words[0].startswith("-"):
        option = words.pop(0).lower()
        most = OPTIONS.get(option, 3 if option in ("-o", "-s", "-t") else 0)
        for _ in range(most):
            if words[:1] and (option in OPTIONS or _is_number(words[0])):
                words.pop(0)
    name = " ".join(words).strip()
    return shlex.split(name)[0] if name[:1] == '"' and name.count('"') == 2 else name


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _text(words: bytes) -> str:
    return words.decode("utf-8", "replace").strip()


PLAIN = "plain"
"""Material of faces that have none"""


def check_materials(path: Path) -> None:
    """Make sure that the materials of an OBJ file can be written beside it.

    Raises:
        InputError: they cannot, or somebody else's stand there.
    """
    library = path.with_suffix(".mtl")
    check_writable(library, (".mtl",))
    require_ours(library, f"the materials of {path.name} go")


def write_materials(path: Path, looks: Looks) -> list[str]:
    """Write the materials that an OBJ file names beside it, and their images into the folder `textures`.

    Returns:
        The names of the materials, and last the one of faces without any.

    Raises:
        InputError: they cannot be written.
    """
    check_materials(path)
    names, lines = [], [f"# {LINE}\n"]
    for number, access in enumerate(looks.materials):
        names.append(f"{'_'.join(access.name.split()) or 'material'}_{number}")
        color, picture = access.color, access.picture
        if picture is not None and color != WHITE:  # most programs pass over a color beside an image
            color, picture = WHITE, picture.times(color)
        lines.append(f"newmtl {names[-1]}\nKd {' '.join(f'{shade:.6g}' for shade in color)}\n")
        if picture is not None:
            picture.write_beside(path)
            lines.append(f"map_Kd {picture.path.removeprefix('./')}\n")
    lines.append(f"newmtl {PLAIN}\n")
    with whole_file(path.with_suffix(".mtl")) as temporary:
        temporary.write_text("".join(lines), encoding="utf-8", errors="replace", newline="\n")
    return [*names, PLAIN]


def vertex_colors(mesh: PolygonMesh) -> NDArray[np.float64] | None:
    """Return sRGB at each vertex, the mean of its corners', where any has a color, shape (vertex_count, 3).

    White where none has, by which a material is not changed.
    """
    looks = mesh.looks
    if looks is None or looks.colors is None:
        return None
    said = np.isfinite(looks.colors).all(axis=1) & (looks.of_corners < 0)
    at = mesh.face_vertex_indices[said]
    counts = np.bincount(at, minlength=mesh.vertex_count)
    sums = [np.bincount(at, shade, mesh.vertex_count) for shade in looks.colors[said].T]
    means = np.stack(sums, axis=1) / np.maximum(counts, 1)[:, None]
    return encoded(np.where(counts[:, None] > 0, means, 1.0))


COMPRESSED = {b"\x1f\x8b": "gzip", b"PK\x03\x04": "zip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"(\xb5/\xfd": "Zstandard"}
"""Compressions by the first bytes of a file"""


class _LineError(Exception):
    """Mistake in a line."""


def read_obj(path: Path | str, prim: str | Sequence[str] | None = None) -> PolygonMesh:
    """Read vertices and polygons. OBJ says nothing of axes and units: they are taken as Y up and meters.

    Args:
        path: of the file; reading takes up to nine times as much memory as it has bytes.
        prim: the name of an object or a group, or several: their faces and vertices alone are taken.

    Raises:
        InputError: the file cannot be read, has no such object, or a line is wrong; it names the line and the reason.
    """
    path = Path(path)
    # Arrays of machine numbers: lists would take ten times as much memory as the file.
    coordinates, vertex_lines = array("d"), array("i")
    corners, sizes, face_lines = array("i"), array("i"), array("i")
    textures, groups, materials = ObjTextures(), ObjGroups(), ObjMaterials(path)
    for number, line in _lines(path):
        kind, *rest = line.split(None, 1) or [b""]
        words = rest[0].split() if rest and kind in (b"v", b"f", b"vt") else []
        try:
            if kind == b"v":
                coordinates.extend(_coordinates(words))
                if len(words) > 5:
                    materials.add_vertex(words)
                vertex_lines.append(number)
            elif kind == b"f":
                face = _face(words, len(vertex_lines))
                corners.extend(face)
                sizes.append(len(face))
                face_lines.append(number)
                textures.add_face(words)
            elif kind == b"vt":
                textures.add_vertex(words)
            elif kind in (b"g", b"o"):
                groups.begin(kind, rest[0] if rest else b"", len(sizes))
            elif kind == b"usemtl":
                materials.use(rest[0] if rest else b"", len(sizes))
            elif kind == b"mtllib" and rest:
                materials.add_library(rest[0])
        except _LineError as problem:
            raise InputError(f"{path}, line {number}: {problem} (got {_quote(line)})") from None
    if not vertex_lines:
        raise InputError(f"{path}: has no vertices (no line begins with v)")
    if not face_lines:
        raise InputError(f"{path}: has no faces (no line begins with f)")

    counts, indices = np.frombuffer(sizes, dtype=np.int32), np.frombuffer(corners, dtype=np.int32)
    mesh = PolygonMesh(
        points=np.frombuffer(coordinates).reshape(-1, 3),
        face_vertex_counts=counts,
        face_vertex_indices=indices,
        name=legible(path.stem),
        groups=groups.of_vertices(counts, indices),
    )
    _check_numbers(path, mesh, vertex_lines, face_lines)
    places = textures.of_corners(partly=True)
    looks = materials.of_corners(mesh, placed=places is not None)
    if looks is None or not looks.pictures:
        places = textures.of_corners()
    mesh = replace(mesh, texture_coordinates=places, looks=looks, warnings=materials.warnings)
    return mesh if prim is None else _objects_of(mesh, path, groups, Objects(prim))


def _objects_of(mesh: PolygonMesh, path: Path, groups: ObjGroups, objects: Objects) -> PolygonMesh:
    """Return the taken objects of a mesh, without the other objects' vertices."""
    faces = groups.faces_of([name for name in mesh.groups if objects.takes([name])], mesh.face_count)
    objects.check(path)
    return replace(of_faces(mesh, faces), name=objects.name or mesh.name)


def _check_numbers(path: Path, mesh: PolygonMesh, vertex_lines: Sequence[int], face_lines: Sequence[int]) -> None:
    """Check coordinates and vertex numbers.

    Raises:
        InputError: A coordinate is too large, or a face names a vertex that is not there; it names the line.
    """
    outside = ~(np.abs(mesh.points) <= FLOAT32_MAX).all(axis=1)
    if outside.any():
        vertex = int(outside.argmax())
        got = " ".join(map(str, mesh.points[vertex]))
        raise InputError(
            f"{path}, line {vertex_lines[vertex]}: coordinates must be finite and fit in 32-bit floats (got {got})"
        )
    # A face may stand above its vertices, so this shows only at the end.
    missing = mesh.face_vertex_indices >= mesh.vertex_count
    if missing.any():
        corner = int(missing.argmax())
        line = face_lines[int(np.searchsorted(np.cumsum(mesh.face_vertex_counts), corner, side="right"))]
        vertex = mesh.face_vertex_indices[corner] + 1
        raise InputError(f"{path}, line {line}: there is no vertex {vertex}, the file has {mesh.vertex_count}")


LOADERS = {".obj": read_obj}


def write_obj(path: Path | str, mesh: PolygonMesh) -> None:
    """Write vertices and polygons, with texture coordinates and looks where there are some.

    Materials go into an .mtl beside the file, images into a folder `textures`. Reading them gives the same float64
    points. The file appears whole or not at all.

    Raises:
        InputError: the file cannot be written, or the .mtl is another program's.
    """
    path = Path(path)
    colors = vertex_colors(mesh)
    ends = [""] * mesh.vertex_count if colors is None else [" {:.5g} {:.5g} {:.5g}".format(*c) for c in colors.tolist()]
    lines = [f"v {x!r} {y!r} {z!r}{end}\n" for (x, y, z), end in zip(mesh.points.tolist(), ends, strict=True)]
    corners = list(map(str, (mesh.face_vertex_indices + 1).tolist()))
    if mesh.texture_coordinates is not None:
        places, numbers = np.unique(mesh.texture_coordinates, axis=0, return_inverse=True)
        lines += [f"vt {u:.7g} {v:.7g}\n" for u, v in places.tolist()]
        corners = [f"{corner}/{number}" for corner, number in zip(corners, numbers.ravel() + 1, strict=True)]
    begins = _material_lines(path, mesh)
    if begins:
        lines.insert(0, f"mtllib {path.with_suffix('.mtl').name}\n")
    lines.insert(0, f"# {LINE}\n")
    begin = 0
    for face, end in enumerate(np.cumsum(mesh.face_vertex_counts).tolist()):
        lines.append(f"{begins.get(face, '')}f {' '.join(corners[begin:end])}\n")
        begin = end
    with whole_file(path) as temporary:
        temporary.write_text("".join(lines), encoding="utf-8", errors="surrogateescape", newline="\n")


def _material_lines(path: Path, mesh: PolygonMesh) -> dict[int, str]:
    """Write a mesh's materials; return the line that stands before each face from which on it is another."""
    if mesh.looks is None or not mesh.looks.materials or not mesh.face_count:
        return {}
    names = write_materials(path, mesh.looks)
    of_faces = mesh.looks.of_corners[face_starts(mesh)]
    begins = np.flatnonzero(np.append(True, of_faces[1:] != of_faces[:-1])).tolist()
    return {face: f"usemtl {names[of_faces[face]]}\n" for face in begins}


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Iterate over the lines of the file with their numbers, without comments.

    A continued line has the number of its first part.
    """
    text = _content(path)
    if text.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in text:
        raise InputError(f"{path}: is binary or UTF-16, not the plain text of an OBJ file")
    # Bytes throughout: comments and names may be in any 8-bit encoding.
    text = text.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    lines = enumerate(io.BytesIO(text), start=1)
    if b"#" in text or b"\\" in text:
        return _plain(lines)
    return lines


def _plain(lines: Iterator[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
    """Return the lines without comments, each continued one joined with those that follow."""
    for number, line in lines:
        line = line.partition(b"#")[0]
        yield number, _joined(line, lines) if line.rstrip().endswith(b"\\") else line


def _joined(line: bytes, following: Iterator[tuple[int, bytes]]) -> bytes:
    """Return a line that ends in a backslash, and those that it is continued on."""
    whole = bytearray()
    while (text := line.rstrip()).endswith(b"\\"):
        whole += text[:-1] + b" "
        _, line = next(following, (0, b""))
        line = line.partition(b"#")[0]
    return bytes(whole + line)


def _content(path: Path) -> bytes:
    content = regular_content(path)
    for opening, format_name in COMPRESSED.items():
        if content.startswith(opening):
            raise InputError(f"{path}: is compressed ({format_name}), not the plain text of an OBJ file")
    return content


def _coordinates(words: list[bytes]) -> list[float]:
    """Return the first three numbers of a `v` line. A weight or a color may follow."""
    if len(words) < 3:
        raise _LineError(f"a vertex needs three coordinates, not {len(words)}")
    try:
        numbers = list(map(float, words))
    except ValueError:
        raise _LineError("coordinates must be decimal numbers") from None
    if b"_" in b"".join(words):  # which Python reads, as in 1_000
        raise _LineError("coordinates must be decimal numbers")
    return numbers[:3]


def _face(words: list[bytes], above: int) -> list[int]:
    """Return the vertices of an `f` line, from 0; of v/vt/vn only v is read. `above` vertices stand above the line."""
    if len(words) < 3:
        raise _LineError(f"a face needs three corners or more, not {len(words)}")
    if len(words) > LARGEST_FACE:
        raise _LineError(f"a face may have at most {LARGEST_FACE:,} corners, not {len(words):,}")
    try:
        numbers = [int(word.split(b"/", 1)[0]) for word in words]
    except ValueError:
        raise _LineError("vertex numbers must be integers") from None
    if min(numbers) < 1 or max(numbers) > above or b"_" in b"".join(words):
        return [_vertex(number, word, above) for number, word in zip(numbers, words, strict=True)]
    return [number - 1 for number in numbers]


def _vertex(number: int, word: bytes, above: int) -> int:
    """Return a vertex, from 0, from its number in the file: from 1, or negative, counting back from the last."""
    if b"_" in word:
        raise _LineError("vertex numbers must be integers")
    if number == 0:
        raise _LineError("vertex numbers begin at 1, not 0")
    if abs(number) > np.iinfo(np.int32).max:
        raise _LineError(f"there is no vertex {_shortened(str(number))}, which takes more than 32 bits")
    if number < -above:
        raise _LineError(f"there is no vertex {number}, only {above} stand above this line")
    return number - 1 if number > 0 else above + number


def _quote(line: bytes) -> str:
    return repr(_shortened(line.strip().decode("latin-1")))


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:60]}..."
