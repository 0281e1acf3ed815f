"""Base colors and base textures of a glTF file, and their places on the mesh as trimesh returns them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.gltf_buffers import BROKEN, GltfBuffers, decoded
from balloon_warp.mesh.looks import Look
from balloon_warp.mesh.pictures import Pictures

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
