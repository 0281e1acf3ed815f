"""Reader of glTF 2.0 and GLB, through trimesh, with checks of features that trimesh silently skips."""

import json
import struct
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.files import regular_content
from balloon_warp.mesh.gltf_buffers import GltfBuffers
from balloon_warp.mesh.gltf_looks import GltfMaterials
from balloon_warp.mesh.gltf_nodes import COMPRESSED, INSTANCING, VISIBILITY, pose
from balloon_warp.mesh.objects import Objects
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.trimesh_formats import read_triangles

HARMLESS = (
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp", "KHR_mesh_quantization"),
    *(INSTANCING, VISIBILITY),
)
"""Prefixes of extensions that do not change where triangles are, or that are decoded here"""
OTHER = ("EXT_meshopt_compression", "KHR_animation_", "KHR_audio", "KHR_physics", "EXT_lights_", "EXT_mesh_features")
"""Prefixes of further ones that may be passed over where they are not required: with another form of the same arrays in
the file, or about other things"""
JSON_CHUNK, GLB_HEADER = 0x4E4F534A, 12


def read_gltf(path: Path | str, prim: str | Sequence[str] | None = None) -> PolygonMesh:
    """Read the meshes of a glTF or GLB file's scene as one, in meters, welded at coincident vertices.

    They are at their default pose: nodes, instances, skins and morph weights are applied. glTF repeats a vertex for
    each normal and texture coordinate there. Normalized integers are decoded. Base colors, base textures and vertex
    colors go along.

    Args:
        path: of the file.
        prim: the name of a node or of a mesh, or several: only meshes there or below are taken.

    Raises:
        InputError: the file requires an extension that is not decoded, has no such node, or as `read_triangles`.
    """
    path = Path(path)
    try:
        tree, rest = _parts(path)
        required = tree.get("extensionsRequired", [])
        if unknown := [name for name in _texts(required) if not _is_decoded(name)]:
            helps = "; pip install DracoPy, or export without compression" if unknown == [COMPRESSED] else ""
            raise InputError(f"{path}: requires the extension {', '.join(unknown)}, which is not supported{helps}")
        buffers = GltfBuffers(path, tree, (rest or b"")[8:])
        objects = Objects(prim)
        sentences = pose(tree, buffers, objects.takes)
        buffers.check()
    except InputError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, struct.error, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as {path.suffix[1:].upper()} ({_reason(error)})") from None
    objects.check(path)
    if passed := [name for name in _texts(tree.get("extensionsUsed")) if not _is_harmless(name)]:
        sentences.append(f"Uses the extension {', '.join(passed)}, which is passed over.")
    materials = GltfMaterials(path, tree, buffers)
    materials.name_materials()
    mesh = read_triangles(path, joined=True, source=BytesIO(_file_of(tree, rest)), materials=materials)
    return replace(
        mesh, name=objects.name or mesh.name, unit_known=True, up_known=True, warnings=(*sentences, *materials.warnings)
    )


def _reason(error: Exception) -> str:
    """Return the defect of a file, in one line."""
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    said = " ".join(str(error).split())
    return f"it has no {said}" if isinstance(error, LookupError) else said[:120]


def _parts(path: Path) -> tuple[dict[str, Any], bytes | None]:
    """Return the JSON of a file and the bytes that follow it in a GLB; None in a .gltf."""
    data = regular_content(path)
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


def _is_harmless(name: str) -> bool:
    """Return whether a mesh is the same without an extension that a file does not require."""
    return name.startswith((*HARMLESS, *OTHER, COMPRESSED))


def _file_of(tree: dict[str, Any], rest: bytes | None) -> bytes:
    """Return the file with another JSON chunk; of a .gltf the JSON alone."""
    said = json.dumps(tree).encode()
    if rest is None:
        return said
    said += b" " * (-len(said) % 4)
    chunks = struct.pack("<II", len(said), JSON_CHUNK) + said + rest
    return b"glTF" + struct.pack("<II", 2, GLB_HEADER + len(chunks)) + chunks


LOADERS = {".glb": read_gltf, ".gltf": read_gltf}
