"""Reader of glTF 2.0 and GLB, through trimesh, with checks of features that trimesh silently skips.

Nodes of a glTF file at its default pose: one after the other, each with its place in the scene.

Transforms, skins, morph weights, instances and normalized integers are applied here. A reader of the file then finds
meshes that stand in a list, however deep and by any means they were placed.
"""

import json
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.files import regular_content
from balloon_warp.mesh.check import Objects
from balloon_warp.mesh.gltf_looks import BROKEN, LARGEST, GltfBuffers, GltfMaterials
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.trimesh_formats import read_triangles

INSTANCING, VISIBILITY = "EXT_mesh_gpu_instancing", "KHR_node_visibility"
MOST_INSTANCES = 100_000
"""Largest number of meshes in a scene, each instance counted"""
MOST_GROUPS = 16
"""Largest number of groups of four joints of a point"""
COMPRESSED = "KHR_draco_mesh_compression"
"""Compression that trimesh decodes where DracoPy is installed"""


class Placed(NamedTuple):
    """A node of the scene."""

    number: int
    matrix: NDArray[np.float64]
    """Transform to the scene, for column vectors, shape (4, 4)"""
    path: tuple[str, ...]
    """Names of the nodes that it stands in, and its own"""


def pose(tree: dict[str, Any], buffers: GltfBuffers, is_taken: Callable[[tuple[str, ...]], bool]) -> list[str]:
    """Replace the nodes of a file by a list of all meshes of its scene, in place, and morph and bend them.

    Args:
        is_taken: whether a mesh is taken, by the names of the nodes that it stands in, its own, and the mesh's.

    Returns:
        Sentences on features that could not be applied, by name.

    Raises:
        LookupError, TypeError, ValueError, AttributeError: the nodes do not fit together, or are too many.
    """
    nodes, meshes = tree.get("nodes", []), tree.get("meshes", [])
    everywhere = {each.number: each for each in _walk(nodes, _roots(nodes), hidden=True)}
    scenes = tree.get("scenes")
    roots = scenes[tree.get("scene", 0)].get("nodes", []) if scenes else _roots(nodes)
    seen = _walk(nodes, roots, hidden=False)
    flat: list[dict[str, Any]] = []
    sentences: list[str] = []
    for placed in (each for each in seen if "mesh" in nodes[each.number]):
        node = nodes[placed.number]
        mesh = meshes[node["mesh"]]
        if not is_taken((*placed.path, str(mesh.get("name", "")))):
            continue
        number, matrices = node["mesh"], _instances(node, placed, buffers, sentences)
        if len(flat) + len(matrices) > MOST_INSTANCES:
            raise ValueError(f"its scene has more than {MOST_INSTANCES:,} meshes, instances included")
        unit = np.diag([*[_unit(tree, mesh)] * 3, 1.0])
        bent = _bent(tree, placed, everywhere, buffers, sentences)
        if bent is not None:
            meshes.append(bent)
            number, unit = len(meshes) - 1, np.eye(4)
            # Joints take a skin to where it is in the scene, wherever its node is.
            matrices = [np.eye(4)] * len(matrices) if "skin" in node else matrices
        flat += [{"mesh": number, "matrix": (matrix @ unit).T.ravel().tolist()} for matrix in matrices]
    tree["nodes"], tree["scene"], tree["scenes"] = flat, 0, [{"nodes": [*range(len(flat))]}]
    for unused in ("skins", "animations", "cameras"):
        tree.pop(unused, None)
    return sentences


def _roots(nodes: list[dict[str, Any]]) -> list[int]:
    inner = {child for node in nodes for child in node.get("children", [])}
    return [number for number in range(len(nodes)) if number not in inner]


def _walk(nodes: list[dict[str, Any]], roots: list[int], hidden: bool) -> list[Placed]:
    """Return the nodes at or below roots, each once, parents first.

    Args:
        hidden: whether to go below nodes that are not visible.
    """
    found, seen = [], set[int]()
    open_ = [(number, np.eye(4), ()) for number in reversed(roots)]
    while open_:
        number, around, path = open_.pop()
        node = nodes[number]
        visible = node.get("extensions", {}).get(VISIBILITY, {}).get("visible", True)
        if number in seen or not (hidden or visible):
            continue
        seen.add(number)
        name = node.get("name")
        # Paths of a chain of many nodes would need the square of their number.
        path = (*path, str(name)) if name is not None and len(path) < 100 else path
        placed = Placed(number, around @ _matrix(node), path)
        found.append(placed)
        open_ += [(child, placed.matrix, path) for child in reversed(node.get("children", []))]
    return found


def _matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return the transform of a node, for column vectors."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    turn, size = node.get("rotation", (0.0, 0.0, 0.0, 1.0)), node.get("scale", (1.0, 1.0, 1.0))
    shift = node.get("translation", (0.0, 0.0, 0.0))
    if "rotation" not in node and "scale" not in node:
        matrix = np.eye(4)
        matrix[:3, 3] = shift
        return matrix
    return _composed(np.array([shift], np.float64), np.array([turn], np.float64), np.array([size], np.float64))[0]


def _composed(
    shifts: NDArray[np.float64], turns: NDArray[np.float64], sizes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return transforms that scale, then turn, then shift, shape (n, 4, 4)."""
    from scipy.spatial.transform import Rotation  # loads slowly

    lengths = np.linalg.norm(turns, axis=1, keepdims=True)
    turns = np.where(lengths > 0.0, turns, (0.0, 0.0, 0.0, 1.0))
    matrices = np.tile(np.eye(4), (len(shifts), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(turns).as_matrix() * sizes[:, None, :]
    matrices[:, :3, 3] = shifts
    return matrices


def _instances(
    node: dict[str, Any], placed: Placed, buffers: GltfBuffers, sentences: list[str]
) -> list[NDArray[np.float64]]:
    """Return the places of a node's mesh: one, or those of its instances."""
    said = node.get("extensions", {}).get(INSTANCING)
    if said is None:
        return [placed.matrix]
    try:
        found = {name: buffers.array(number) for name, number in said["attributes"].items() if not name.startswith("_")}
        count = max(map(len, found.values()))
        matrices = _composed(
            *(
                found.get(name, np.tile(plain, (count, 1)))
                for name, plain in (
                    ("TRANSLATION", (0.0, 0.0, 0.0)),
                    ("ROTATION", (0.0, 0.0, 0.0, 1.0)),
                    ("SCALE", (1.0, 1.0, 1.0)),
                )
            )
        )
    except BROKEN:
        sentences.append(f"The instances of {_named(placed)} cannot be read ({INSTANCING}); it is taken once.")
        return [placed.matrix]
    return [*(placed.matrix @ matrices)]


def _bent(
    tree: dict[str, Any],
    placed: Placed,
    everywhere: dict[int, Placed],
    buffers: GltfBuffers,
    sentences: list[str],
) -> dict[str, Any] | None:
    """Return a node's mesh with its points morphed and bent by its skin; None where it is as it is."""
    node = tree["nodes"][placed.number]
    mesh = tree["meshes"][node["mesh"]]
    weights = np.array(node.get("weights", mesh.get("weights", ())), np.float64)
    morphed = weights.any() and any(primitive.get("targets") for primitive in mesh["primitives"])
    if not morphed and "skin" not in node:
        return None
    try:
        bones = _bones(tree, node["skin"], everywhere, buffers) if "skin" in node else None
        primitives = []
        for primitive in mesh["primitives"]:
            if COMPRESSED in primitive.get("extensions", {}):
                raise ValueError("it is compressed")
            attributes = primitive["attributes"]
            points = buffers.array(attributes["POSITION"])
            for weight, target in zip(weights, primitive.get("targets", []), strict=False):
                if weight and "POSITION" in target:
                    points = points + weight * buffers.array(target["POSITION"])
            points = points if bones is None else _skinned(points, attributes, bones, buffers)
            if not np.isfinite(points).all():
                raise ValueError("it is not finite")
            primitives.append({**primitive, "attributes": {**attributes, "POSITION": buffers.add(points)}})
    except BROKEN as problem:
        what = "skin" if "skin" in node else "morph weights"
        sentences.append(f"The {what} of {_named(placed)} cannot be read ({problem}): passed over.")
        return None
    return {**mesh, "primitives": primitives}


def _bones(
    tree: dict[str, Any], number: int, everywhere: dict[int, Placed], buffers: GltfBuffers
) -> NDArray[np.float64]:
    """Return the transform of each joint of a skin from the mesh at rest to the scene, shape (n, 4, 4)."""
    skin = tree["skins"][number]
    joints = np.array([everywhere[joint].matrix for joint in skin["joints"]])
    if "inverseBindMatrices" not in skin:
        return joints
    inverse = buffers.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
    return joints @ inverse[: len(joints)]


def _skinned(
    points: NDArray[np.float64], attributes: dict[str, Any], bones: NDArray[np.float64], buffers: GltfBuffers
) -> NDArray[np.float64]:
    """Return points where the mean of their joints takes them, each by its weight, shape (n, 3)."""
    mean, total = np.zeros((len(points), 4, 4)), np.zeros(len(points))
    for group in range(MOST_GROUPS):
        if f"JOINTS_{group}" not in attributes:
            break
        joints = buffers.array(attributes[f"JOINTS_{group}"]).astype(np.int64)
        for joint, weight in zip(joints.T, buffers.array(attributes[f"WEIGHTS_{group}"]).T, strict=True):
            used = weight > 0.0
            mean[used] += weight[used, None, None] * bones[joint[used]]
            total += weight
    if not (total > 0.0).all():
        raise ValueError("a point has no joint")
    return np.einsum("nij,nj->ni", mean[:, :3], np.column_stack([points, np.ones(len(points))])) / total[:, None]


def _unit(tree: dict[str, Any], mesh: dict[str, Any]) -> float:
    """Return the value of the integer 1 in a mesh of normalized ones, else 1.

    The most negative integer, which stands for -1 as its neighbor does, becomes a little less.
    """
    for primitive in mesh["primitives"]:
        position = tree["accessors"][primitive["attributes"]["POSITION"]]
        if position.get("normalized") and position["componentType"] in LARGEST:
            return 1.0 / LARGEST[position["componentType"]]
    return 1.0


def _named(placed: Placed) -> str:
    return placed.path[-1] if placed.path else f"node {placed.number}"


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
