"""Visible parts of a stage as moving meshes, and all of them as a .glb file.

A stage as a .glb file: soft meshes as morph targets, one for each shown frame, rigid ones as moving nodes.

No library that is kept up writes morph targets, so the file is put together here; the tests have others read it.
"""

import itertools
import json
import math
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.orientation import CREASE
from balloon_warp.mesh.topology import triangulate, vertex_normals
from balloon_warp.mesh.usd_stage import texture_coordinates
from balloon_warp.studio.render.sampling import cut_at_creases, leave_whole
from balloon_warp.studio.render.stage_reader import (
    DRAWN,
    Covering,
    RenderStage,
    is_round,
    packed_image,
    plain_covering,
    read_colors,
    read_covering,
)
from balloon_warp.system.files import whole_file
from balloon_warp.usd.material import is_shown
from balloon_warp.usd.solids import tube_points, tube_topology
from balloon_warp.usd.studio import Z_TO_Y_UP

LEVEL = ("ground", "floor", "water", "pool")
"""Names of level planes: no export has them, as they are far larger than the parts that move above them"""


@dataclass(frozen=True)
class Part:
    """Thing that a stage shows."""

    name: str
    prim: Usd.Prim
    mesh: PolygonMesh
    """Mesh at the first frame, in the prim's own coordinates"""
    soft: bool
    """Whether its points move in the prim's own coordinates"""
    local_points: Callable[[float], NDArray[np.float64]]
    """Function for the points in a frame, in the prim's own coordinates, shape (vertex_count, 3)"""
    covering: Covering
    """Look of the faces; images are placed by `mesh.texture_coordinates`"""

    @property
    def color(self) -> tuple[float, float, float]:
        """Linear RGB, the mean of several colors."""
        red, green, blue = self.covering.colors.mean(axis=0).tolist()
        return red, green, blue

    def matrix(self, frame: float) -> NDArray[np.float64]:
        """Return the matrix from the prim's own coordinates to the stage's, for row vectors, shape (4, 4)."""
        return np.array(UsdGeom.XformCache(Usd.TimeCode(frame)).GetLocalToWorldTransform(self.prim))

    def points(self, frame: float) -> NDArray[np.float64]:
        """Return the part's points in the stage, in the stage's unit, shape (vertex_count, 3)."""
        points = self.local_points(frame)
        if len(points) != self.mesh.vertex_count or not np.isfinite(points).all():
            raise InputError(
                f"{self.prim.GetPath()}: has {len(points)} points at frame {frame:g}, or points that are not "
                f"finite; expected {self.mesh.vertex_count} finite points"
            )
        matrix = self.matrix(frame)
        return points @ matrix[:3, :3] + matrix[3, :3]

    def velocities(self, frame: float) -> NDArray[np.float64] | None:
        """Return the velocities of its points in the stage, a second, shape (vertex_count, 3), if the prim has them."""
        prim = UsdGeom.PointBased(self.prim)
        own = prim.GetVelocitiesAttr().Get(frame) if prim else None
        if own is None or len(own) != self.mesh.vertex_count:
            return None
        return np.asarray(own, np.float64) @ self.matrix(frame)[:3, :3]

    def seen(self, frame: float) -> bool:
        """Return whether the part is visible."""
        visibility = UsdGeom.Imageable(self.prim).ComputeVisibility(Usd.TimeCode(frame))
        return visibility != UsdGeom.Tokens.invisible


class Animation:
    """The parts of a stage and its time.

    Args:
        path: any file that USD opens.
        on_note: called with sentences on missing files and left-out shapes of the stage.

    Raises:
        InputError: the file cannot be read as a stage, or there is nothing to export in it.
    """

    def __init__(self, path: Path, on_note: Callable[[str], None] = lambda sentence: None):
        opened = RenderStage(path, rounds=True, on_note=on_note)
        self.path, self.stage = path, opened.stage
        self.frames = range(opened.first_frame, opened.last_frame + 1)
        self.frames_per_second = float(opened.frames_per_second)
        self.parts = self._find_parts()
        if not self.parts:
            raise InputError(f"{path}: has no mesh, solid shape or linear curves to export")

    @cached_property
    def balloons(self) -> list[Part]:
        """The parts whose meshes have points that move, without strings and tubes."""
        return [part for part in self.parts if part.soft and bool(UsdGeom.Mesh(part.prim))]

    @property
    def meters_per_unit(self) -> float:
        return float(UsdGeom.GetStageMetersPerUnit(self.stage))

    @property
    def up_axis(self) -> str:
        return str(UsdGeom.GetStageUpAxis(self.stage))

    def y_up_meters(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points of the stage in meters with Y up, as files have them that cannot say otherwise."""
        return points @ (Z_TO_Y_UP if self.up_axis == "Z" else np.eye(3)) * self.meters_per_unit

    def seconds(self, frame: int) -> float:
        """Return the time of a frame, from the first on [s]."""
        return (frame - self.frames[0]) / self.frames_per_second

    def _find_parts(self) -> list[Part]:
        parts, names = [], set[str]()
        for prim in Usd.PrimRange(self.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
            if not any(kind(prim) for kind in DRAWN) or not is_shown(prim):
                continue
            part = _part_of(prim, self.frames[0], prim.GetName())
            if part is None or _is_level(part):
                continue
            words = [part.name, f"{prim.GetParent().GetName()}_{part.name}", str(prim.GetPath())[1:].replace("/", "_")]
            name = next((word for word in words if word not in names), words[-1])
            names.add(name)
            parts.append(replace(part, name=name))
        return parts


def _is_level(part: Part) -> bool:
    return part.name.lower() in LEVEL and part.mesh.face_count == 1


def _part_of(prim: Usd.Prim, first: int, name: str) -> Part | None:
    """Return the part of a prim that is drawn; None where it has no faces."""
    soft, uv, covering = False, None, None
    place: Callable[[float], NDArray[np.float64]]
    if UsdGeom.Mesh(prim):
        mesh = UsdGeom.Mesh(prim)
        soft = mesh.GetPointsAttr().GetNumTimeSamples() > 0
        counts, indices = (
            np.asarray(attribute.Get(first) or [], np.int32)
            for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
        )
        place = _points_of(mesh)
        point_count = len(place(first))
        if np.any(counts < 0) or counts.sum() != len(indices) or np.any((indices < 0) | (indices >= point_count)):
            raise InputError(f"{prim.GetPath()}: its faces do not match its {point_count} points")
        whole = np.repeat(counts, counts) >= 3
        covering, uv = (
            read_covering(mesh, counts, indices, point_count, counts >= 3),
            texture_coordinates(mesh, "st", indices),
        )
        counts, indices = counts[counts >= 3], indices[whole]
        uv = covering.places if covering.places is not None else None if uv is None else uv[whole]
    else:
        curves = UsdGeom.BasisCurves(prim)
        if curves.GetTypeAttr().Get() != UsdGeom.Tokens.linear:
            return None
        soft = curves.GetPointsAttr().GetNumTimeSamples() > 0
        lengths = np.asarray(curves.GetCurveVertexCountsAttr().Get(first) or [], np.int32)
        counts, indices = tube_topology(lengths)
        center, radius = _points_of(curves), 0.5 * float(np.mean(curves.GetWidthsAttr().Get(first) or [0.01]))

        def around(frame: float) -> NDArray[np.float64]:
            return tube_points(center(frame), lengths, radius)

        place = around

    if not len(counts):
        return None
    mesh = PolygonMesh(place(first), counts, indices, name=name, texture_coordinates=uv)
    if covering is None:
        color = read_colors(UsdGeom.Gprim(prim), np.ones(1, np.int32))
        covering = plain_covering(prim, color, len(counts), len(indices))
    return Part(name, prim, mesh, soft, place, covering)


def _points_of(prim: UsdGeom.PointBased) -> Callable[[float], NDArray[np.float64]]:
    attribute = prim.GetPointsAttr()
    return lambda frame: np.asarray(attribute.Get(frame) or [], np.float64).reshape(-1, 3)


VERTICES, CORNERS = 34962, 34963
"""Targets of an array, as glTF numbers them: a vertex's attributes, and the corners of triangles"""
_COMPONENTS = {np.dtype(np.float32): 5126, np.dtype(np.uint32): 5125}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class GlbBuffer:
    """Arrays of one binary buffer, in the order in which they are added."""

    def __init__(self) -> None:
        self.accessors: list[dict[str, Any]] = []
        self._views: list[dict[str, Any]] = []
        self._chunks: list[bytes] = []
        self._length = 0

    def add(self, array: NDArray, target: int | None = None, bounded: bool = False) -> int:
        """Add float32 or uint32 numbers, shape (n,) or (n, 2 to 4), and get the number of their accessor.

        Args:
            target: `VERTICES`, `CORNERS` or neither.
            bounded: whether least and most are said, as glTF wants of positions and times.
        """
        data = np.ascontiguousarray(array)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": self._length, "byteLength": data.nbytes}
        if target is not None:
            view["target"] = target
        columns = data.reshape(len(data), -1)
        accessor: dict[str, Any] = {
            "bufferView": len(self._views),
            "componentType": _COMPONENTS[data.dtype],
            "count": len(data),
            "type": _TYPES[columns.shape[1]],
        }
        if bounded:
            accessor |= {"min": columns.min(axis=0).tolist(), "max": columns.max(axis=0).tolist()}
        self._views.append(view)
        self.accessors.append(accessor)
        self._chunks.append(data.tobytes())  # of 4 bytes each: all stay aligned
        self._length += data.nbytes
        return len(self.accessors) - 1

    def add_bytes(self, data: bytes) -> int:
        """Add bytes that are no array, such as an image's file, and get the number of their view."""
        self._views.append({"buffer": 0, "byteOffset": self._length, "byteLength": len(data)})
        self._chunks.append(data + b"\0" * (-len(data) % 4))
        self._length += len(self._chunks[-1])
        return len(self._views) - 1

    def write(self, path: Path, content: dict[str, Any]) -> None:
        """Write the file: the glTF document, with these arrays."""
        said = content | {
            "accessors": self.accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": self._length}],
        }
        text = json.dumps(said, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        with path.open("wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + self._length))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            file.write(struct.pack("<I4s", self._length, b"BIN\0"))
            file.writelines(self._chunks)


class Surface(NamedTuple):
    """A mesh in triangles, with one normal, one texture coordinate and one color a vertex."""

    topology: PolygonMesh
    """Mesh in vertices of one normal each, whose points do not count"""
    points: NDArray[np.integer]
    """Point of the mesh at each of those, shape (topology.vertex_count,)"""
    vertices: NDArray[np.integer]
    """Topology vertex of each vertex, shape (vertex_count,)"""
    triangles: NDArray[np.uint32]
    """Triangles, shape (triangle_count, 3)"""
    covers: NDArray[np.integer]
    """Number of each triangle's material in the part, shape (triangle_count,)"""
    texture_coordinates: NDArray[np.float32] | None
    """Texture coordinates, shape (vertex_count, 2), v down as glTF has it"""
    colors: NDArray[np.float32] | None
    """Linear RGB, shape (vertex_count, 3), where a material has several colors"""

    def place(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return positions and unit normals for the mesh's points, each of shape (vertex_count, 3)."""
        moved = replace(self.topology, points=points[self.points])
        normals = vertex_normals(moved)
        normals[~normals.any(axis=1)] = (0.0, 1.0, 0.0)  # glTF wants unit vectors everywhere
        return moved.points[self.vertices].astype(np.float32), normals[self.vertices].astype(np.float32)


def surface_of(part: Part) -> Surface:
    """Return the surface of a part.

    Deformable parts are smooth everywhere: a sharp bend of one frame is round in the next.
    """
    smooth = part.soft or is_round(UsdGeom.Mesh(part.prim))
    cut = leave_whole(part.mesh) if smooth else cut_at_creases(part.mesh, CREASE)
    points, counts = part.mesh.points[cut.vertex_points], part.mesh.face_vertex_counts
    topology = PolygonMesh(points, counts, cut.corner_vertices)
    uv, colors = part.mesh.texture_coordinates, _many_colors(part)
    if uv is None and colors is None:
        triangles, faces = triangulate(topology)
        own = np.arange(len(points)), triangles.astype(np.uint32), part.covering.of_faces[faces]
        return Surface(topology, cut.vertex_points, *own, None, None)
    known = [values.astype(np.float64) for values in (uv, colors) if values is not None]
    corners = np.column_stack([cut.corner_vertices.astype(np.float64), *known])
    unique, number = np.unique(corners, axis=0, return_inverse=True)
    triangles, faces = triangulate(PolygonMesh(points, counts, number.ravel().astype(np.int32)))
    own = unique[:, 0].astype(np.int64), triangles.astype(np.uint32), part.covering.of_faces[faces]
    flipped = None if uv is None else (unique[:, 1:3] * [1.0, -1.0] + [0.0, 1.0]).astype(np.float32)
    return Surface(
        topology, cut.vertex_points, *own, flipped, None if colors is None else unique[:, -3:].astype(np.float32)
    )


def _many_colors(part: Part) -> NDArray[np.float32] | None:
    """Return linear RGB at the corners of a part's faces, white below images.

    None where each material has one color.
    """
    covering = part.covering
    of_corners = np.repeat(covering.of_faces, part.mesh.face_vertex_counts)
    alike, shown = True, np.ones_like(covering.colors)
    for number, cover in enumerate(covering.covers):
        here = of_corners == number
        if cover.texture is None:
            shown[here] = covering.colors[here]
            alike &= bool((covering.colors[here] == covering.colors[here][:1]).all())
    return None if alike else shown


MOST_TARGETS = 256
"""Largest number of morph targets of a mesh: as many layers as every WebGL 2 has in the texture that three.js keeps
them in"""
MOST_BYTES = 256 * 2**20
"""Largest size of a file's arrays [bytes]"""
VERTEX_BYTES = 24
"""Bytes of a vertex in a morph target: offsets of its position and its normal from the first frame's"""
OPAQUE = 0.9
"""Opacity from which on a surface is drawn as opaque: viewers draw transparent faces in the wrong order, which costs
more than the last tenth"""


def write_glb(
    output: Path, animation: Animation, on_note: Callable[[str], None], on_frame: Callable[[int, int], None]
) -> None:
    """Write the file, whose size is said before; arguments as `export_stage` has them."""
    surfaces = [surface_of(part) for part in animation.parts]
    moving = [len(surface.vertices) for part, surface in zip(animation.parts, surfaces, strict=True) if part.soft]
    frames, thinned = _shown_frames(animation, sum(moving))
    size = VERTEX_BYTES * sum(moving) * len(frames) + 4 * len(moving) * (len(frames) - 1) * len(frames)
    on_note(
        f"{output}: {len(frames)} frames of {sum(moving):,} moving vertices take about "
        f"{max(size / 2**20, 0.1):.1f} MB{thinned}"
    )
    file = _Glb(animation, frames)
    for done, (part, surface) in enumerate(zip(animation.parts, surfaces, strict=True), start=1):
        file.add(part, surface)
        on_frame(done, len(animation.parts))
    with whole_file(output) as temporary:
        file.write(temporary)


def _shown_frames(animation: Animation, vertices: int) -> tuple[range, str]:
    """Return the frames that fit into a file, and the end of a sentence if those are not all.

    Args:
        vertices: how many move.

    Raises:
        InputError: there is no room for two.
    """
    frames = animation.frames
    room = MOST_BYTES // max(VERTEX_BYTES * vertices, 1)
    if room < 2 <= len(frames):
        raise InputError(
            f"{animation.path}: has {vertices:,} moving vertices, too many for a .glb of {MOST_BYTES >> 20} MB; "
            "expected a coarser mesh, or USD"
        )
    most = min(MOST_TARGETS + 1, room)
    if len(frames) <= most:
        return frames, ""
    step = math.ceil((len(frames) - 1) / (most - 1))
    bound = f"{MOST_TARGETS} morph targets" if most > MOST_TARGETS else f"{MOST_BYTES >> 20} MB"
    return frames[::step], f": every {_ordinal(step)} of {len(frames)} frames, to fit into {bound}; linear in between"


def _ordinal(number: int) -> str:
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


class _Glb:
    """The file as it grows, part by part."""

    def __init__(self, animation: Animation, frames: range):
        self.animation, self.frames = animation, frames
        self.buffer = GlbBuffer()
        times = np.array([animation.seconds(frame) for frame in frames], np.float32)
        self._times = self.buffer.add(times, bounded=True) if len(frames) > 1 else None
        self._meshes: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []
        self._nodes: list[dict[str, Any]] = []
        self._channels: list[dict[str, Any]] = []
        self._samplers: list[dict[str, Any]] = []
        self._pictures: dict[str, dict[str, Any]] = {}
        """Images by their paths"""

    def add(self, part: Part, surface: Surface) -> None:
        """Add a node, with its mesh, material and motion."""
        node: dict[str, Any] = {"name": part.name, "mesh": len(self._meshes)}
        matrices = [part.matrix(frame) for frame in self.frames]
        baked = part.soft or not all(_is_placed(matrix) for matrix in matrices)
        shapes = self._shapes(part, surface, baked)
        positions, normals = next(shapes)
        attributes = {
            "POSITION": self.buffer.add(positions, VERTICES, bounded=True),
            "NORMAL": self.buffer.add(normals, VERTICES),
        }
        if surface.texture_coordinates is not None:
            attributes["TEXCOORD_0"] = self.buffer.add(surface.texture_coordinates, VERTICES)
        if surface.colors is not None:
            attributes["COLOR_0"] = self.buffer.add(surface.colors, VERTICES)
        primitives: list[dict[str, Any]] = [
            {
                "attributes": attributes,
                "indices": self.buffer.add(surface.triangles[surface.covers == number].ravel(), CORNERS),
                "material": len(self._materials) + number,
            }
            for number in range(len(part.covering.covers))
        ]
        mesh: dict[str, Any] = {"name": part.name, "primitives": primitives}
        targets = [
            {
                "POSITION": self.buffer.add(later - positions, VERTICES, bounded=True),
                "NORMAL": self.buffer.add(turned - normals, VERTICES),
            }
            for later, turned in shapes
        ]
        if targets:
            for primitive in primitives:
                primitive["targets"] = targets
            mesh["weights"] = [0.0] * len(targets)
            mesh["extras"] = {"targetNames": [f"frame {frame}" for frame in self.frames[1:]]}
        self._nodes.append(node)
        self._meshes.append(mesh)
        for number in range(len(part.covering.covers)):
            self._materials.append(_material(part, number, self._image(part, number), surface.colors is not None))
        if targets:  # the first frame is the mesh itself, and each other a target of its own
            weights = np.eye(len(targets) + 1, dtype=np.float32)[:, 1:]
            self._animate("weights", weights.ravel())
        if not baked:
            self._place(node, matrices)
        self._show(part, node)

    def _image(self, part: Part, number: int) -> int | None:
        """Return the number of the texture of a part's material; materials with the same file share it."""
        texture = part.covering.covers[number].texture
        if texture is None:
            return None
        if texture.path not in self._pictures:
            data, kind = packed_image(texture)
            self._pictures[texture.path] = {"bufferView": self.buffer.add_bytes(data), "mimeType": kind}
        return list(self._pictures).index(texture.path)

    def write(self, path: Path) -> None:
        root: dict[str, Any] = {"name": "World", "children": list(range(len(self._nodes)))}
        if self.animation.up_axis == "Z":
            root["rotation"] = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
        if self.animation.meters_per_unit != 1.0:
            root["scale"] = [self.animation.meters_per_unit] * 3
        content: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "Balloon Warp"},
            "scene": 0,
            "scenes": [{"nodes": [len(self._nodes)]}],
            "nodes": [*self._nodes, root],
            "meshes": self._meshes,
            "materials": self._materials,
        }
        if any("KHR_materials_clearcoat" in material.get("extensions", {}) for material in self._materials):
            content["extensionsUsed"] = ["KHR_materials_clearcoat"]
        if self._pictures:
            content["images"] = list(self._pictures.values())
            content["textures"] = [{"source": number} for number in range(len(self._pictures))]
        if self._channels:
            said = {"name": "Balloon Warp", "channels": self._channels, "samplers": self._samplers}
            content["animations"] = [said]
        self.buffer.write(path, content)

    def _shapes(
        self, part: Part, surface: Surface, baked: bool
    ) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Return positions and normals of each frame.

        In the stage's coordinates where they change, else once, in the part's own.
        """
        for frame in self.frames if baked else self.frames[:1]:
            yield surface.place(part.points(frame) if baked else part.local_points(frame))

    def _animate(self, path: str, values: NDArray[np.float32], interpolation: str = "LINEAR") -> None:
        """Animate the last node."""
        target = {"node": len(self._nodes) - 1, "path": path}
        self._channels.append({"sampler": len(self._samplers), "target": target})
        output = self.buffer.add(values)
        self._samplers.append({"input": self._times, "output": output, "interpolation": interpolation})

    def _place(self, node: dict[str, Any], matrices: Sequence[NDArray[np.float64]]) -> None:
        """Place a rigid node: at rest, and in each frame if it moves."""
        from scipy.spatial.transform import Rotation  # takes long to load

        sizes = np.array([np.linalg.norm(matrix[:3, :3], axis=1) for matrix in matrices])
        turns = Rotation.from_matrix([(m[:3, :3] / size[:, None]).T for m, size in zip(matrices, sizes, strict=True)])
        quaternions = turns.as_quat()
        for before, after in itertools.pairwise(quaternions):
            after *= 1.0 if before @ after >= 0.0 else -1.0  # the shorter way
        moves = {"translation": np.array([m[3, :3] for m in matrices]), "rotation": quaternions, "scale": sizes}
        for path, values in moves.items():
            node[path] = values[0].tolist()
            if not np.allclose(values, values[0], rtol=0.0, atol=1e-9):
                self._animate(path, values.astype(np.float32))

    def _show(self, part: Part, node: dict[str, Any]) -> None:
        """Hide a part that is absent in some frames by zero scale: glTF has no visibility."""
        seen = np.array([part.seen(frame) for frame in self.frames])
        if not seen.all():
            size = np.array(node.get("scale", [1.0, 1.0, 1.0]), np.float32)
            node["scale"] = (seen[0] * size).tolist()
            if self._times is not None:
                self._animate("scale", seen[:, None] * size, "STEP")


def _is_placed(matrix: NDArray[np.float64]) -> bool:
    """Return whether a matrix is a scale, a rotation and a shift, as in glTF's nodes, without shear or mirroring."""
    rows = matrix[:3, :3]
    sizes = np.linalg.norm(rows, axis=1)
    square = np.allclose(rows @ rows.T, np.diag(sizes**2), atol=1e-6 * sizes.max() ** 2)
    return bool(sizes.all() and np.linalg.det(rows) > 0.0 and square)


def _material(part: Part, number: int, image: int | None, colored: bool) -> dict[str, Any]:
    """Return the glTF material of a part's material.

    Args:
        image: Number of the texture that replaces its color.
        colored: Whether vertices have the color.
    """
    cover, finish = part.covering.covers[number], part.covering.covers[number].finish
    opacity = 1.0 if finish.opacity >= OPAQUE else finish.opacity
    corners = np.repeat(part.covering.of_faces, part.mesh.face_vertex_counts) == number
    color = [1.0] * 3 if colored else part.covering.colors[corners][0].tolist()
    shine: dict[str, Any] = {"metallicFactor": finish.metallic, "roughnessFactor": finish.roughness}
    if image is not None and cover.texture is not None:
        color, shine["baseColorTexture"] = cover.texture.tint, {"index": image}
    shine["baseColorFactor"] = [*np.clip(color, 0.0, 1.0).tolist(), opacity]
    name = f"{part.name}_{cover.name}" if cover.name else part.name
    material: dict[str, Any] = {"name": name, "doubleSided": True, "pbrMetallicRoughness": shine}
    if opacity < 1.0:
        material["alphaMode"] = "BLEND"
    if finish.clearcoat > 0.0:
        material["extensions"] = {"KHR_materials_clearcoat": {"clearcoatFactor": min(finish.clearcoat, 1.0)}}
    return material
