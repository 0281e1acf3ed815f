"""Looks of an OBJ file: base colors and base textures of its .mtl, and colors behind the coordinates of vertices."""

import shlex
from array import array
from pathlib import Path

import numpy as np

from balloon_warp.mesh.looks import Look, Looks, linear, looks_of
from balloon_warp.mesh.pictures import Pictures, beside
from balloon_warp.mesh.polygon_mesh import PolygonMesh

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
                    for name, look in self._library(file).items():
                        found.setdefault(name, look)
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
        return {name: look for name, rows in said.items() if (look := self._look(name, rows, file.parent))}

    def _look(self, name: str, rows: dict[str, str], folder: Path) -> Look | None:
        named = _file_of_map(rows.get("map_kd", ""))
        picture = self._pictures.of_file(named, folder) if named else None
        color = _color(rows.get("kd", ""))
        if picture is not None:
            # Exporters write black, gray or white beside an image, which other programs pass over.
            look = Look(name, (1.0, 1.0, 1.0), picture)
            return look if self._placed else self._pictures.mean_of(look, named)
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
