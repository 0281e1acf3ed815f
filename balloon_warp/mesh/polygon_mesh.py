"""The polygon mesh of the package, its unit, and its appearance face by face."""

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.system.api import Shown, described
from balloon_warp.system.files import check_writable, clear_left_over, require_same, target_of, whole_file

FOLDER = "textures"
"""Folder of images beside a stage"""
Color = tuple[float, float, float]
"""Linear RGB"""
WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Picture:
    """An image file that USD and glTF take: PNG or JPEG."""

    name: str
    """Name of a file, with a hash of its content: different images have different names"""
    data: bytes
    """Content of the file"""
    file: Path | None = field(default=None, compare=False)
    """File that it was read from, if it is one of its own"""

    @cached_property
    def mean(self) -> Color:
        """Mean color, linear RGB."""
        from PIL import Image  # only for a mesh that has images

        with Image.open(io.BytesIO(self.data)) as image:
            image.thumbnail((64, 64))
            red, green, blue = linear(np.asarray(image.convert("RGB")) / 255.0).mean(axis=(0, 1)).tolist()
        return red, green, blue

    @property
    def path(self) -> str:
        """Path as named in a stage."""
        return f"./{FOLDER}/{self.name}"

    def times(self, color: Color) -> "Picture":
        """Return the image with its texels multiplied by a color, as PNG."""
        from PIL import Image

        with Image.open(io.BytesIO(self.data)) as image, io.BytesIO() as packed:
            shades = linear(np.asarray(image.convert("RGB")) / 255.0) * np.array(color)
            Image.fromarray(np.round(255.0 * encoded(shades)).astype(np.uint8)).save(packed, "PNG")
            data = packed.getvalue()
        return Picture(f"{Path(self.name).stem}_{hashlib.sha256(data).hexdigest()[:8]}.png", data)

    def beside(self, stage: Path) -> Path:
        """Return the path of the image, if a stage names it."""
        return stage.parent / FOLDER / self.name

    def places(self, stage: Path) -> list[Path]:
        """List where programs look for it: beside a stage, and, if that is a link, beside its target."""
        return list(dict.fromkeys([self.beside(stage), self.beside(target_of(stage))]))

    def check_beside(self, stage: Path) -> None:
        """Make sure, before any work is done, that `write_beside` can write.

        Raises:
            InputError: it cannot, or another image of that name is there.
        """
        for path in self.places(stage):
            if path.parent.exists():
                check_writable(path, (path.suffix,))
                require_same(path, self.data)

    def write_beside(self, stage: Path) -> None:
        """Write the file into the folder beside a stage, wherever programs look for it.

        Raises:
            InputError: it cannot be written, or another image of that name is there.
        """
        for place in self.places(stage):
            self._write_to(place)

    def _write_to(self, path: Path) -> None:
        try:
            target_of(path.parent).mkdir(exist_ok=True)
            is_there = require_same(path, self.data)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        if not is_there:
            clear_left_over(path.parent)
            with whole_file(path) as temporary:
                temporary.write_bytes(self.data)


@dataclass(frozen=True)
class Look:
    """A material's base color, or its base texture, whose texels are multiplied by the color."""

    name: str
    color: Color
    picture: Picture | None = None

    @property
    def plain(self) -> "Look":
        """The look with the mean color of its image in place of the image."""
        if self.picture is None:
            return self
        red, green, blue = np.multiply(self.color, self.picture.mean).tolist()
        return Look(self.name, (red, green, blue))


@dataclass(frozen=True)
class Looks:
    """Materials of a mesh, and the one at each of its face corners."""

    materials: tuple[Look, ...]
    of_corners: NDArray[np.int32]
    """Material at each corner, the same at all corners of a face, -1 for none, shape (corner_count,)"""
    colors: NDArray[np.float32] | None = None
    """Linear RGB at corners without a material, such as vertex colors; NaN where the file has none, shape
    (corner_count, 3)"""

    def at(self, corners: NDArray[np.integer | np.bool_]) -> "Looks":
        """Return the looks of a mesh with these corners, in that order, or those where a mask is true."""
        return Looks(self.materials, self.of_corners[corners], None if self.colors is None else self.colors[corners])

    def color_at_corners(self, otherwise: Color) -> NDArray[np.float32]:
        """Return linear RGB at each corner without images, shape (corner_count, 3).

        Args:
            otherwise: where the file says none.
        """
        palette = np.array([*(look.color for look in self.materials), otherwise], np.float32)
        found = palette[self.of_corners]
        if self.colors is not None:
            own = (self.of_corners < 0) & np.isfinite(self.colors).all(axis=1)
            found[own] = self.colors[own]
        return found

    def mean(self, otherwise: Color) -> Color:
        """Return the linear RGB over all corners; arguments as above."""
        colors = self.color_at_corners(otherwise)
        for number, look in enumerate(self.materials):
            if look.picture is not None:
                colors[self.of_corners == number] *= np.array(look.picture.mean, np.float32)
        red, green, blue = colors.mean(axis=0).tolist()
        return red, green, blue

    @property
    def pictures(self) -> list[Picture]:
        """The images of its materials."""
        return [look.picture for look in self.materials if look.picture is not None]


def looks_of(
    materials: Sequence[Look | None], of_corners: NDArray[np.integer], colors: NDArray[np.floating] | None = None
) -> Looks | None:
    """Return looks of the materials that are used and say something, or None where nothing is said.

    Args:
        materials: None for those that say no color.
        of_corners: as `Looks` has them.
        colors: vertex colors at all corners, shape (corner_count, 3). They are multiplied by the color of a material,
            and passed over where it has an image.
    """
    own = np.asarray(of_corners, dtype=np.int32).copy()
    if colors is not None:
        shades = np.asarray(colors, dtype=np.float32).copy()
        for number, look in enumerate(materials):
            if look is None or look.picture is None:
                shades[own == number] *= np.array((1.0, 1.0, 1.0) if look is None else look.color, np.float32)
                own[own == number] = -1
        colors = shades if np.isfinite(shades).all(axis=1).any() else None
    used: list[Look] = []
    renumbered = np.full(len(materials) + 1, -1, np.int32)  # the last is that of -1
    for number in np.unique(own[own >= 0]).tolist():
        look = materials[number]
        if look is not None:
            renumbered[number] = len(used)
            used.append(look)
    return Looks(tuple(used), renumbered[own], colors) if used or colors is not None else None


def together(parts: Sequence[Any]) -> dict[str, Any]:
    """Join texture coordinates and looks of meshes that become one, as fields of a `PolygonMesh`.

    Where some have images, others without texture coordinates get zeros.
    """
    counts = [len(part.face_vertex_indices) for part in parts]
    places = [part.texture_coordinates for part in parts]
    pictured = any(part.looks is not None and part.looks.pictures for part in parts)
    if pictured or all(place is not None for place in places):
        filled = [np.zeros((n, 2), np.float32) if p is None else p for n, p in zip(counts, places, strict=True)]
        texture_coordinates = np.concatenate(filled)
    else:
        texture_coordinates = None
    materials: list[Look] = []
    of_corners, colors = [], []
    for part, count in zip(parts, counts, strict=True):
        looks = part.looks or Looks((), np.full(count, -1, np.int32))
        of_corners.append(np.where(looks.of_corners < 0, -1, looks.of_corners + len(materials)))
        materials += looks.materials
        colors.append(np.full((count, 3), np.nan, np.float32) if looks.colors is None else looks.colors)
    shaded = any(part.looks is not None and part.looks.colors is not None for part in parts)
    alike = {look: number for number, look in reversed(list(enumerate(materials)))}
    same = np.array([*(alike[look] for look in materials), -1], np.int32)
    whole = looks_of(materials, same[np.concatenate(of_corners)])
    if shaded:
        shades = np.concatenate(colors)
        renumbered = np.full(sum(counts), -1, np.int32) if whole is None else whole.of_corners
        whole = Looks(() if whole is None else whole.materials, renumbered, shades)
    return {"texture_coordinates": texture_coordinates, "looks": whole}


def linear(encoded: NDArray[np.floating]) -> NDArray[np.float32]:
    """Decode sRGB values from 0 to 1 to linear ones (IEC 61966-2-1)."""
    values = np.clip(np.asarray(encoded, dtype=np.float64), 0.0, 1.0)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4).astype(np.float32)


def encoded(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Encode linear values from 0 to 1 as sRGB ones."""
    shades = np.clip(np.asarray(values, dtype=np.float64), 0.0, 1.0)
    return np.where(shades <= 0.0031308, 12.92 * shades, 1.055 * shades ** (1.0 / 2.4) - 0.055)


@described
@dataclass(frozen=True, repr=False)
class PolygonMesh(Shown):
    """A mesh of polygons of any size, named as in USD. The n-th point is the n-th vertex of the file."""

    points: NDArray[np.float64]
    """Positions in the file's units, shape (vertex_count, 3)"""
    face_vertex_counts: NDArray[np.int32]
    """Number of corners of each face, shape (face_count,)"""
    face_vertex_indices: NDArray[np.int32]
    """Corners of all faces in order, indices into `points`, shape (face_vertex_counts.sum(),)"""
    name: str = "mesh"
    """Name of the file or the prim"""
    up_axis: str = "Y"
    """Axis that points up in the file: "Y" or "Z" """
    up_known: bool = False
    """Whether the up axis is given, by the file or the caller; else it is a guess"""
    meters_per_unit: float = 1.0
    """Meters in one unit of `points`"""
    unit_known: bool = False
    """Whether the unit is given, by the file or the caller; else it is a guess"""
    texture_coordinates: NDArray[np.float32] | None = None
    """Texture coordinates u and v at each corner, shape (corner_count, 2), if the file has them"""
    looks: Looks | None = None
    """Colors and images, if the file has some"""
    stand_ins: NDArray[np.int64] | None = None
    """Vertex that faces have in place of each vertex, itself where it was not welded, shape (vertex_count,); None where
    nothing was"""
    warnings: tuple[str, ...] = field(default=())
    """Warnings of the reader, a sentence each"""
    groups: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)
    """Vertices by the names that the file has for parts of the mesh, each ascending: groups and objects of an OBJ file,
    subsets of USD"""

    def __repr__(self) -> str:
        return f"PolygonMesh({self.name!r}, {self.vertex_count} vertices, {self.face_count} faces)"

    @property
    def vertex_count(self) -> int:
        return len(self.points)

    @property
    def face_count(self) -> int:
        return len(self.face_vertex_counts)

    def stand_in(self, vertex: int) -> int:
        """Find the vertex that faces use instead of this vertex of the file."""
        return vertex if self.stand_ins is None else int(self.stand_ins[vertex])

    @property
    def left_vertices(self) -> NDArray[np.int64]:
        """Vertices that faces have left for others, in order."""
        own = np.arange(self.vertex_count)
        return np.flatnonzero((own if self.stand_ins is None else self.stand_ins) != own)


UpAxis = Literal["Y", "Z"]
Unit = Literal["m", "cm", "mm", "km", "in", "ft"]
METERS: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "in": 0.0254, "ft": 0.3048}
"""Meters in each unit; inch and foot are the international ones of 1959"""
NO_AXIS = "file names no up axis"
"""Phrase for a mesh without an up axis"""


def with_unit_and_up(mesh: PolygonMesh, unit: Unit | None, up: UpAxis | None) -> PolygonMesh:
    """Return the mesh with its unit and up axis as given, in place of its file's; those of the file, when missing."""
    if unit:
        mesh = replace(mesh, meters_per_unit=METERS[unit], unit_known=True)
    return replace(mesh, up_axis=up, up_known=True) if up else mesh
