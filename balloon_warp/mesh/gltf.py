"""Formats that trimesh reads: glTF 2.0 with checks of features that it skips silently, and STL, PLY and OFF.

Reader of glTF 2.0 and GLB, through trimesh, with checks of features that trimesh silently skips.

Nodes of a glTF file at its default pose: one after the other, each with its place in the scene.

Transforms, skins, morph weights, instances and normalized integers are applied here. A reader of the file then finds
meshes that stand in a list, however deep and by any means they were placed.
"""

import base64
import binascii
import io
import json
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.crossings import Objects, Pictures, check_mesh
from balloon_warp.mesh.polygon_mesh import Color, Look, Looks, PolygonMesh, linear, looks_of, together
from balloon_warp.mesh.topology import first_coincident
from balloon_warp.system.files import check_regular, legible, regular_content

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
        access = self.looks[number]
        return access and self._pictures.mean_of(access, f"of the material {access.name}")

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


PLAIN = (102, 102, 102, 255)
"""Color of a material of trimesh's without one"""


class Visual(NamedTuple):
    """Texture coordinates and looks, as fields of a `PolygonMesh`."""

    texture_coordinates: NDArray[np.float32] | None
    looks: Looks | None


def read_visual(mesh: PolygonMesh, visual: Any) -> Visual:
    """Read the looks of a mesh from Python; nothing where its `visual` is none of trimesh's."""
    kind, corners = getattr(visual, "kind", None), np.asarray(mesh.face_vertex_indices)
    if not len(corners) or corners.min() < 0 or corners.max() >= mesh.vertex_count:
        return Visual(None, None)  # of a mesh that is refused
    if kind == "texture":
        uv = np.asarray([] if visual.uv is None else visual.uv, np.float64)
        placed = uv.shape == (mesh.vertex_count, 2) and bool(np.isfinite(uv).all())
        access = _look(visual.material, placed, mesh.name)
        looks = looks_of([access], np.zeros(len(corners), np.int32))
        return Visual(uv[corners].astype(np.float32) if placed else None, looks)
    colors = corner_colors(mesh, visual)
    shades = None if colors is None else linear(colors[:, :3] / 255.0)
    return Visual(None, looks_of([], np.full(len(corners), -1, np.int32), shades))


def corner_colors(mesh: PolygonMesh, visual: Any) -> NDArray[np.uint8] | None:
    """Return colors of vertices or faces at all corners, in bytes; None where there are none."""
    kind = getattr(visual, "kind", None)
    if kind == "vertex" and len(visual.vertex_colors) == mesh.vertex_count:
        return np.asarray(visual.vertex_colors)[mesh.face_vertex_indices]
    if kind == "face" and len(visual.face_colors) == mesh.face_count:
        return np.repeat(np.asarray(visual.face_colors), mesh.face_vertex_counts, axis=0)
    return None


def _look(material: Any, placed: bool, name: str) -> Look | None:
    physical = hasattr(material, "baseColorFactor")
    image = getattr(material, "baseColorTexture" if physical else "image", None)
    said = getattr(material, "baseColorFactor" if physical else "diffuse", None)
    color: Color = (1.0, 1.0, 1.0)
    if said is not None and (physical or image is None):
        shares = np.asarray(said, np.float64)[:3] / 255.0
        red, green, blue = (shares if physical else linear(shares)).tolist()
        color = red, green, blue
    if image is not None:
        with io.BytesIO() as file:
            image.convert("RGB").save(file, "PNG")
            access = Look("material", color, Pictures(name).of_bytes(name, file.getvalue()))
            return access if placed else access.plain
    return None if said is None or tuple(said) == PLAIN else Look("material", color)


def read_triangles(
    path: Path | str, joined: bool = False, source: BytesIO | None = None, materials: GltfMaterials | None = None
) -> PolygonMesh:
    """Read a mesh through trimesh: all of a scene's parts as one, in its world, polygons split into triangles.

    Vertices keep the file's order. Colors of vertices or faces go along.

    Args:
        joined: make vertices at exactly the same place one.
        source: content to read in place of the file's, with the files beside it.
        materials: of the file, whose numbers are their names in `source`.

    Raises:
        InputError: trimesh cannot read the file, or it has no triangles.
    """
    import trimesh  # only for such a file: it takes a second
    from trimesh.resolvers import FilePathResolver

    path = Path(path)
    try:
        # process=False: trimesh would merge and reorder vertices. Textures stay closed.
        read = trimesh.load_scene(
            source or path,
            file_type=path.suffix[1:].lower(),
            resolver=FilePathResolver(str(path)),
            process=False,
            skip_materials=materials is None,
        )
        parts = [part for part in map(_of_strips, read.dump()) if isinstance(part, trimesh.Trimesh)]
    except Exception as error:  # its readers let any exception of the parsing through
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: cannot be read as {path.suffix[1:].upper()} ({reason})") from error
    meshes = [_of_part(part, materials) for part in parts]
    points = np.concatenate([np.zeros((0, 3)), *(mesh.points for mesh in meshes)])
    begins = np.cumsum([0, *(mesh.vertex_count for mesh in meshes)])
    each = [mesh.face_vertex_indices.astype(np.int64) + begin for mesh, begin in zip(meshes, begins, strict=False)]
    corners = np.concatenate([np.zeros(0, np.int64), *each])
    if joined:
        kept, merged = np.unique(first_coincident(points), return_inverse=True)
        points, corners = points[kept], merged[corners]
    mesh = PolygonMesh(
        points=points,
        face_vertex_counts=np.full(len(corners) // 3, 3, dtype=np.int32),
        face_vertex_indices=corners.astype(np.int32),
        name=legible(path.stem),
        **(together(meshes) if meshes else {}),
    )
    check_mesh(mesh, str(path))
    return mesh


def _of_strips(part: Any) -> Any:
    """Return the triangles of a part that trimesh takes for points, as a PLY file of a scanner may have strips of them.

    Any other part is returned as it is.
    """
    import trimesh

    strips = part.metadata.get("_ply_raw", {}).get("tristrips")
    if not isinstance(part, trimesh.PointCloud) or not strips:
        return part
    said = strips["data"]["vertex_indices"]
    numbers = np.asarray(said["f1"] if said.dtype.names else said, np.int64).ravel()
    triangles = np.lib.stride_tricks.sliding_window_view(numbers, 3).copy()
    begins = np.append(0, np.flatnonzero(numbers < 0) + 1)  # a strip ends with -1
    places = np.arange(len(triangles))
    odd = (places - begins[np.searchsorted(begins, places, side="right") - 1]) % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]  # every other one of a strip is wound the other way
    triangles = triangles[(triangles >= 0).all(axis=1)]
    colors = part.colors if len(part.colors) else None
    return trimesh.Trimesh(part.vertices, triangles, vertex_colors=colors, process=False)


def _of_part(part: Any, materials: GltfMaterials | None) -> PolygonMesh:
    """Return a part of a scene of trimesh's, with its looks."""
    points, triangles = np.array(part.vertices, dtype=np.float64), np.array(part.faces, dtype=np.int64)
    corners, visual = triangles.ravel(), part.visual
    shape = {"points": points.reshape(-1, 3), "face_vertex_counts": np.full(len(triangles), 3, dtype=np.int32)}
    mesh = PolygonMesh(**shape, face_vertex_indices=corners.astype(np.int32))
    of_corners, known, places = np.full(len(corners), -1), [], None
    if visual.kind == "texture" and materials is not None:
        number = int(visual.material.name)
        of_corners[:], known = number, materials.looks
        if visual.uv is not None and len(visual.uv) == len(points):
            places = moved(np.asarray(visual.uv, np.float64)[corners], materials.transforms[number])
    if COLORS in part.vertex_attributes:
        shades = np.asarray(part.vertex_attributes[COLORS])[corners]
    else:
        shades = corner_colors(mesh, visual)
    if shades is not None:
        shades = _lightness(shades, encoded=materials is None)
    if places is None or not np.isfinite(places).all():
        places = None
        if materials is not None and known:
            known = [materials.unplaced(each) if each == of_corners[0] else None for each in range(len(known))]
    return replace(mesh, texture_coordinates=places, looks=looks_of(known, of_corners, shades))


def _lightness(colors: NDArray, encoded: bool) -> NDArray[np.float32]:
    """Return the linear RGB of colors in any type of numbers.

    Args:
        encoded: whether they are sRGB, as all but glTF has them.
    """
    most = np.iinfo(colors.dtype).max if np.issubdtype(colors.dtype, np.integer) else 1.0
    shares = colors[:, :3].astype(np.float64) / most
    return linear(shares) if encoded else np.clip(shares, 0.0, 1.0).astype(np.float32)


def read_joined_triangles(path: Path | str) -> PolygonMesh:
    """Read triangles as `read_triangles`, and weld them: STL repeats a vertex for each triangle.

    A balloon made of such vertices would fall apart.
    """
    return read_triangles(path, joined=True)


TRIANGLE_LOADERS = {
    ".stl": read_joined_triangles,
    ".ply": read_triangles,
    ".off": read_triangles,
}
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
