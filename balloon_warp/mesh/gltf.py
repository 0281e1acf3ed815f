"""Reader of glTF 2.0 and GLB, through trimesh, with checks of what trimesh silently skips."""

import json
import struct
from collections.abc import Iterable
from dataclasses import replace
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.mesh.gltf_looks import GltfMaterials
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.trimesh_formats import read_triangles

HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp", "KHR_mesh_quantization")
"""Prefixes of extensions that do not change where triangles are, or that are decoded here"""
COMPRESSED = "KHR_draco_mesh_compression"
"""Compression that trimesh decodes where DracoPy is installed"""
LARGEST = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}
"""Integers that stand for 1 in normalized accessors, by component type"""
JSON_CHUNK, GLB_HEADER = 0x4E4F534A, 12


def read_gltf(path: Path | str) -> PolygonMesh:
    """Read all meshes of a glTF or GLB file as one, in meters, welded at coincident vertices.

    glTF repeats a vertex for each normal and texture coordinate there. Normalized integers are decoded. Base colors,
    base textures and vertex colors go along.

    Raises:
        InputError: the file requires an extension that is not decoded, or as `read_triangles`.
    """
    path = Path(path)
    try:
        tree, rest = _parts(path)
    except (ValueError, KeyError, struct.error, OSError):  # trimesh says what is wrong
        return replace(read_triangles(path, joined=True), unit_known=True, up_known=True)
    required = tree.get("extensionsRequired", [])
    if unknown := [name for name in _texts(required) if not _is_decoded(name)]:
        helps = "; pip install DracoPy, or export without compression" if unknown == [COMPRESSED] else ""
        raise InputError(f"{path}: requires the extension {', '.join(unknown)}, which is not supported{helps}")
    try:
        _scale_normalized(tree)
    except (LookupError, TypeError, AttributeError):  # again
        return replace(read_triangles(path, joined=True), unit_known=True, up_known=True)
    materials = GltfMaterials(path, tree, (rest or b"")[8:])
    materials.name_materials()
    mesh = read_triangles(path, joined=True, source=BytesIO(_file_of(tree, rest)), materials=materials)
    return replace(mesh, unit_known=True, up_known=True, warnings=materials.warnings)


def _parts(path: Path) -> tuple[dict[str, Any], bytes | None]:
    """Return the JSON of a file and what follows it in a GLB; None in a .gltf."""
    data = path.read_bytes()
    if data[:4] != b"glTF":
        tree, rest = json.loads(data), None
    else:
        length, kind = struct.unpack_from("<II", data, GLB_HEADER)
        if kind != JSON_CHUNK:
            raise ValueError("no JSON")
        begin = GLB_HEADER + 8
        tree, rest = json.loads(data[begin : begin + length]), data[begin + length :]
    if not isinstance(tree, dict):
        raise ValueError("no object")
    return tree, rest


def _texts(many: Any) -> Iterable[str]:
    return [each for each in many if isinstance(each, str)] if isinstance(many, list) else []


def _is_decoded(name: str) -> bool:
    return find_spec("DracoPy") is not None if name == COMPRESSED else name.startswith(HARMLESS)


def _scale_normalized(tree: dict[str, Any]) -> None:
    """Hang meshes of normalized integers into nodes that scale them to what they stand for.

    The most negative integer, which stands for -1 as its neighbor does, becomes a little less.
    """
    scales = {}
    for number, mesh in enumerate(tree.get("meshes", [])):
        for primitive in mesh["primitives"]:
            position = tree["accessors"][primitive["attributes"]["POSITION"]]
            if position.get("normalized") and position["componentType"] in LARGEST:
                scales[number] = 1.0 / LARGEST[position["componentType"]]
    nodes = tree.get("nodes", [])
    for node in [node for node in nodes if node.get("mesh") in scales]:
        mesh = node.pop("mesh")
        node["children"] = [*node.get("children", []), len(nodes)]
        nodes.append({"mesh": mesh, "scale": [scales[mesh]] * 3})


def _file_of(tree: dict[str, Any], rest: bytes | None) -> bytes:
    """Return the file with another JSON chunk; of a .gltf the JSON alone."""
    said = json.dumps(tree).encode()
    if rest is None:
        return said
    said += b" " * (-len(said) % 4)
    chunks = struct.pack("<II", len(said), JSON_CHUNK) + said + rest
    return b"glTF" + struct.pack("<II", 2, GLB_HEADER + len(chunks)) + chunks


LOADERS = {".glb": read_gltf, ".gltf": read_gltf}
