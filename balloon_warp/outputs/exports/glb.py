"""A stage as a .glb file: soft meshes as morph targets, one for each shown frame, rigid ones as moving nodes.

No library that is kept up writes morph targets, so the file is put together here; the tests have others read it.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.files import whole_file
from balloon_warp.outputs.exports.glb_buffer import CORNERS, VERTICES, GlbBuffer
from balloon_warp.outputs.exports.glb_surface import Surface, surface_of
from balloon_warp.outputs.exports.parts import Animation, Part
from balloon_warp.outputs.render.printed import packed_image

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
