"""Buffers of a glTF file, its base colors and textures."""

import base64
import binascii
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.files import check_regular, regular_content
from balloon_warp.mesh.check import Pictures
from balloon_warp.mesh.polygon_mesh import Look

LARGEST = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}
"""Integers that stand for 1 in normalized accessors, by component type"""
KINDS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
MOST_NUMBERS = 1 << 28
"""Largest count of numbers in an array"""


class GltfBuffers:
    """Buffers of a glTF file, each read once.

    Args:
        path: of the file, beside which others are.
        tree: its JSON, to which new arrays are added.
        binary: the binary chunk of a GLB.
    """

    def __init__(self, path: Path, tree: dict[str, Any], binary: bytes):
        self._folder, self._tree, self._binary = path.parent, tree, binary
        self._read: dict[int, bytes] = {}

    def view(self, number: Any) -> bytes:
        """Return the bytes of a buffer view.

        Raises:
            LookupError, TypeError, ValueError, AttributeError, InputError: it is not there.
        """
        view = self._tree["bufferViews"][number]
        begin = view.get("byteOffset", 0)
        return self._buffer(view["buffer"])[begin : begin + view["byteLength"]]

    def array(self, number: Any) -> NDArray[np.float64]:
        """Return an accessor's numbers, shape (count, width); normalized integers as their fractions.

        Raises:
            LookupError, TypeError, ValueError, AttributeError, InputError: it is not there, or is larger than its view.
        """
        accessor = self._tree["accessors"][number]
        count, width, kind = accessor["count"], WIDTHS[accessor["type"]], KINDS[accessor["componentType"]]
        if not 0 <= count * width <= MOST_NUMBERS:
            raise ValueError(f"accessor {number} has {count} items")
        values = np.zeros((count, width), kind)
        if "bufferView" in accessor:
            values = self._rows(accessor, accessor["bufferView"], count, width, kind)
        if sparse := accessor.get("sparse"):
            where, what = sparse["indices"], sparse["values"]
            rows = self._rows(where, where["bufferView"], sparse["count"], 1, KINDS[where["componentType"]])
            values = values.copy()
            values[rows[:, 0].astype(np.int64)] = self._rows(what, what["bufferView"], sparse["count"], width, kind)
        numbers = values.astype(np.float64)
        if accessor.get("normalized") and accessor["componentType"] in LARGEST:
            numbers = np.maximum(numbers / LARGEST[accessor["componentType"]], -1.0)
        return numbers

    def add(self, points: NDArray[np.floating]) -> int:
        """Add an array of vectors to the file, and return its accessor's number."""
        data = np.ascontiguousarray(points, np.float32).tobytes()
        uri = f"data:application/octet-stream;base64,{base64.b64encode(data).decode()}"
        self._tree.setdefault("buffers", []).append({"byteLength": len(data), "uri": uri})
        views, accessors = self._tree.setdefault("bufferViews", []), self._tree.setdefault("accessors", [])
        views.append({"buffer": len(self._tree["buffers"]) - 1, "byteLength": len(data)})
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": len(points), "type": "VEC3"})
        return len(accessors) - 1

    def check(self) -> None:
        """Make sure that the files which the buffers name may be read.

        Raises:
            InputError: one is missing, is no regular file, or is too large.
        """
        buffers = self._tree.get("buffers")
        for buffer in buffers if isinstance(buffers, list) else []:
            uri = buffer.get("uri") if isinstance(buffer, dict) else None
            if isinstance(uri, str) and not uri.startswith("data:"):
                check_regular(self._folder / unquote(uri))

    def _buffer(self, number: int) -> bytes:
        if number not in self._read:
            uri = self._tree["buffers"][number].get("uri")
            if uri is None:
                return self._binary
            if uri.startswith("data:"):
                self._read[number] = decoded(uri)
            else:
                self._read[number] = regular_content(self._folder / unquote(uri))
        return self._read[number]

    def _rows(self, said: dict[str, Any], view: int, count: int, width: int, kind: Any) -> NDArray[Any]:
        """Return the rows of a view from an offset on, each after its stride."""
        data, size = self.view(view), np.dtype(kind).itemsize * width
        stride, begin = self._tree["bufferViews"][view].get("byteStride", size), said.get("byteOffset", 0)
        if count and not (size <= stride and 0 <= begin <= begin + (count - 1) * stride + size <= len(data)):
            raise ValueError(f"its buffer view {view} is too short")
        if not count:
            return np.zeros((0, width), kind)
        taken = np.frombuffer(data, np.uint8, (count - 1) * stride + size, begin)
        rows = np.lib.stride_tricks.as_strided(taken, (count, size), (stride, 1), writeable=False)
        return np.ascontiguousarray(rows).view(kind)


def decoded(uri: str) -> bytes:
    """Return the content of a data URI; nothing where it is none."""
    try:
        return base64.b64decode(uri.partition(",")[2])
    except (binascii.Error, ValueError):
        return b""


BROKEN = (LookupError, TypeError, ValueError, AttributeError, OverflowError, InputError)
"""Errors of reading an array where the file does not fit together"""
COORDINATES, COLORS, TRANSFORM = "TEXCOORD_0", "_COLOR_0", "KHR_texture_transform"


class GltfMaterials:
    """Materials of a glTF file: base colors, base textures and their transforms.

    Args:
        tree: its JSON, in which `name_materials` then puts others in their place.
        buffers: of the file.
    """

    def __init__(self, path: Path, tree: dict[str, Any], buffers: GltfBuffers):
        self._tree, self._buffers, self._folder = tree, buffers, path.parent
        self._pictures = Pictures(path)
        self._base = [_base(material) for material in _dicts(tree, "materials")]
        self.looks = [self._look(number) for number in range(len(self._base))]
        """Look of each material; None for materials that say nothing"""
        self.transforms = [_transform(_child(base, "baseColorTexture")) for base in self._base]
        """Transforms of texture coordinates, one a material: rows of a matrix, shape (2, 3), for v down"""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about textures that cannot be read."""
        return tuple(self._pictures.warnings)

    def unplaced(self, number: int) -> Look | None:
        """Return the look of a material on a mesh without texture coordinates: of its image the mean color."""
        look = self.looks[number]
        return look and self._pictures.mean_of(look, f"of the material {look.name}")

    def name_materials(self) -> None:
        """Rename materials to their numbers, and select the texture coordinates of base textures.

        The material's coordinates become the first set, and vertex colors an attribute `COLORS`.
        """
        for mesh in _dicts(self._tree, "meshes"):
            for primitive in _dicts(mesh, "primitives"):
                number, attributes = primitive.get("material"), _child(primitive, "attributes")
                if "COLOR_0" in attributes:  # which trimesh loses where there is a material, too
                    attributes[COLORS] = attributes.pop("COLOR_0")
                if isinstance(number, int) and 0 <= number < len(self._base):
                    texture = _child(self._base[number], "baseColorTexture")
                    chosen = _child(_child(texture, "extensions"), TRANSFORM).get(
                        "texCoord", texture.get("texCoord", 0)
                    )
                    if chosen and (other := attributes.get(f"TEXCOORD_{chosen}")) is not None:
                        attributes[COORDINATES] = other
                else:
                    primitive.pop("material", None)
        self._tree["materials"] = [{"name": str(number)} for number in range(len(self._base))]
        for unused in ("textures", "images", "samplers"):
            self._tree.pop(unused, None)

    def _look(self, number: int) -> Look | None:
        base, material = self._base[number], _dicts(self._tree, "materials")[number]
        factor = base.get("baseColorFactor", base.get("diffuseFactor"))
        color = _color(factor)
        picture = None
        texture = base.get("baseColorTexture")
        if isinstance(texture, dict):
            picture = self._picture(texture.get("index"))
        if picture is None and color is None:
            return None
        return Look(str(material.get("name", f"material_{number}")), color or (1.0, 1.0, 1.0), picture)

    def _picture(self, texture: Any):
        textures, images = _dicts(self._tree, "textures"), _dicts(self._tree, "images")
        if not isinstance(texture, int) or not 0 <= texture < len(textures):
            return None
        sources = [textures[texture].get("source")]
        sources += [each.get("source") for each in _child(textures[texture], "extensions").values() if _is_dict(each)]
        source = next((each for each in sources if isinstance(each, int) and 0 <= each < len(images)), None)
        if source is None:
            return None
        image = images[source]
        uri, view = image.get("uri"), image.get("bufferView")
        named = str(image.get("name") or f"image_{source}")
        if isinstance(uri, str) and uri.startswith("data:"):
            return self._pictures.of_bytes(f"{named}_{source}", decoded(uri))
        if isinstance(uri, str):
            return self._pictures.of_file(unquote(uri), self._folder)
        try:
            data = self._buffers.view(view)
        except BROKEN:
            data = b""
        return self._pictures.of_bytes(f"{named}_{source}", data)


def moved(places: NDArray[np.float64], transform: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the texture coordinates with v up as a transform for v down has them, shape (n, 2)."""
    down = np.column_stack([places[:, 0], 1.0 - places[:, 1], np.ones(len(places))]) @ transform.T
    return np.column_stack([down[:, 0], 1.0 - down[:, 1]]).astype(np.float32)


def _base(material: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a material's base color, under the names of metallic roughness."""
    metallic = _child(material, "pbrMetallicRoughness")
    glossy = _child(_child(material, "extensions"), "KHR_materials_pbrSpecularGlossiness")
    if not metallic and "diffuseTexture" in glossy:
        return {**glossy, "baseColorTexture": glossy["diffuseTexture"]}
    return metallic or glossy


def _transform(texture: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return the texture transform of KHR_texture_transform."""
    said = _child(_child(texture, "extensions"), TRANSFORM)
    try:
        (x, y), (wide, high) = said.get("offset", (0.0, 0.0)), said.get("scale", (1.0, 1.0))
        c, s = np.cos(said.get("rotation", 0.0)), np.sin(said.get("rotation", 0.0))
        return np.array([[c * wide, s * high, x], [-s * wide, c * high, y]], dtype=np.float64)
    except (TypeError, ValueError):
        return np.eye(3)[:2]


def _color(factor: Any) -> tuple[float, float, float] | None:
    try:
        red, green, blue = np.clip(np.array(factor[:3], dtype=np.float64), 0.0, 1.0).tolist()
    except (TypeError, ValueError):
        return None
    return red, green, blue


def _child(parent: Mapping[str, Any], name: str) -> dict[str, Any]:
    child = parent.get(name)
    return child if isinstance(child, dict) else {}


def _dicts(parent: Mapping[str, Any], name: str) -> list[dict[str, Any]]:
    children = parent.get(name)
    return [each if isinstance(each, dict) else {} for each in children] if isinstance(children, list) else []


def _is_dict(each: Any) -> bool:
    return isinstance(each, dict)
