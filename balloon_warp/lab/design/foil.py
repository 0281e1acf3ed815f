"""Design of a foil balloon of two sheets: from a target outline to the pattern to cut.

Foil: the flat outline of two sheets, sewn at the rim, that has the wanted outline once it is inflated.

Foil hardly stretches: as the sheets part, the rim is drawn in, and wrinkles; a circle's to 0.763 of its radius. The
error of the rim is fed back to the pattern, a few times, and the sheets follow it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.sparse.linalg import splu

from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.lab.design.job import REPORT, SCENE, Design, write_picture, write_report
from balloon_warp.lab.design.measure import Error, aligned
from balloon_warp.lab.design.target import require_size
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.topology import mesh_edges, total_area
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.scene.load import write_scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.files import whole_file
from balloon_warp.tools.foil import border_loops, foil_parts, from_extra

Values = NDArray[np.float64]
SMOOTH = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0
"""Smoothing kernel along the rim: wrinkles are no part of its shape"""


@dataclass(frozen=True)
class Part:
    """Flat balloon: two sheets with a common rim."""

    mesh: PolygonMesh
    """Flat mesh of the target, inflated outline"""

    @cached_property
    def loops(self) -> list[NDArray[np.int64]]:
        """The rim's vertices in order: around, and around each hole."""
        quads = self.mesh.face_vertex_indices.reshape(-1, 4)
        front = quads[(self.mesh.points[quads][:, :, 2] >= 0.0).all(axis=1)]
        return border_loops(front.astype(np.int64))

    @cached_property
    def rim(self) -> NDArray[np.int64]:
        """Vertices of the rim, loop by loop."""
        return np.concatenate(self.loops)

    @property
    def wanted(self) -> Values:
        """Target places of the rim, shape (r, 2)."""
        return self.mesh.points[self.rim, :2]

    def rim_of(self, points: Values) -> Values:
        """Return the rim of inflated points, smooth and laid onto the wanted one, shape (r, 2)."""
        flat = np.concatenate([_smoothed(points[loop]) for loop in self.loops])
        goal = np.concatenate([self.wanted, np.zeros((len(self.rim), 1))], axis=1)
        return aligned(flat, goal)[:, :2]

    def error(self, rim: Values, size: float) -> Error:
        """Return the distance of an inflated rim from the target outline, over the size."""
        off, begin = [], 0
        for loop in self.loops:
            own = slice(begin, begin + len(loop))
            off += [_to_line(rim[own], self.wanted[own]), _to_line(self.wanted[own], rim[own])]
            begin += len(loop)
        distances = np.concatenate(off) / size
        return Error(float(distances.mean()), float(distances.max()))

    def with_rim(self, rim: Values) -> PolygonMesh:
        """Return the flat mesh with its rim there, shape (r, 2); the sheets follow evenly."""
        moves = rim - self.wanted
        inner = np.setdiff1d(np.arange(self.mesh.vertex_count), self.rim)
        points = self.mesh.points.copy()
        points[self.rim, :2] += moves
        points[inner, :2] += self._harmonic(inner) @ moves
        return replace(self.mesh, points=points)

    def _harmonic(self, inner: NDArray[np.int64]) -> Values:
        """Return the harmonic extension of rim displacements to the other vertices, shape (i, r)."""
        ends, count = mesh_edges(self.mesh).ends, self.mesh.vertex_count
        ones = np.ones(len(ends))
        beside = sparse.coo_matrix((ones, (ends[:, 0], ends[:, 1])), shape=(count, count))
        beside = (beside + beside.T).tocsr()
        laplacian = (sparse.diags(np.asarray(beside.sum(axis=1)).ravel()) - beside).tocsc()
        return -splu(laplacian[inner][:, inner].tocsc()).solve(laplacian[inner][:, self.rim].toarray())


def corrected(part: Part, pattern: Values, rim: Values) -> Values:
    """Return the rim of the next pattern, corrected by the error of an inflated rim, smoothed along the rim."""
    missing, begin, next_ = part.wanted - rim, 0, pattern.copy()
    for loop in part.loops:
        own = slice(begin, begin + len(loop))
        next_[own] += _smoothed(missing[own])
        begin += len(loop)
    return next_


def _smoothed(places: Values) -> Values:
    """Return each place of a closed line as the mean of those around it, less the shrinking of that."""
    once = _mean_around(places)
    return once + (once - _mean_around(once))  # as far as a circle is drawn in by the mean, it is put out again


def _mean_around(places: Values) -> Values:
    half = len(SMOOTH) // 2
    shifted = [np.roll(places, shift, axis=0) for shift in range(-half, half + 1)]
    return np.tensordot(SMOOTH, np.stack(shifted), axes=1)


def _to_line(places: Values, line: Values) -> Values:
    """Return the distances of places from a closed line, shape (n,)."""
    begin, end = line, np.roll(line, -1, axis=0)
    way = end - begin
    along = ((places[:, None] - begin) * way).sum(axis=2) / np.maximum((way**2).sum(axis=1), 1e-30)
    nearest = begin + np.clip(along, 0.0, 1.0)[:, :, None] * way
    return np.linalg.norm(places[:, None] - nearest, axis=2).min(axis=1)


Loops = Sequence[Sequence[NDArray[np.int64]]]
"""Vertices of each loop, of each part"""
SEAM = 0.008
"""Allowance beyond the seam [m]"""
MARGIN = 0.01
"""Margin of the page [m]"""
PIXELS, GAP, ROW = 920, 36, 30
"""Width of a picture, margin around it, and height of a row of its legend [pixels]"""
FINER = 4
"""Factor by which a picture is drawn larger, so that its lines are smooth"""
COLORS = {
    "wanted": (214, 222, 230),
    "without design": (224, 122, 66),
    "inflated": (26, 84, 160),
    "pattern": (70, 74, 80),
}
WIDTHS = {"without design": 2.2, "inflated": 3.2, "pattern": 1.3}
"""Width of lines [pixels]; kinds without one are areas"""
NAMES = {"inflated": "designed, inflated", "pattern": "pattern, flat", "without design": "without design, inflated"}


def write_pattern(path: Path, rims: Sequence[Values], loops: Loops) -> None:
    """Write the seam and, outside it, the line to cut along, in millimeters, twice to be cut and sewn.

    Args:
        rims: of each part [m], its loops one after the other, shape (r, 2).
    """
    shapely = from_extra("shapely")
    lines: list[tuple[str, Values]] = []
    for rim, of_part in zip(_apart(rims), loops, strict=True):
        outer, *holes = _split(rim, of_part)
        lines += [("seam", line) for line in (outer, *holes)]
        cut = shapely.Polygon(outer, holes).buffer(SEAM)
        for polygon in getattr(cut, "geoms", [cut]):
            lines += [("cut", np.asarray(line.coords)[:-1, :2]) for line in (polygon.exterior, *polygon.interiors)]
    low, high = _bounds([line for _, line in lines])
    width, height = 1000.0 * (high - low + 2.0 * MARGIN)
    placed = ((kind, 1000.0 * (line - low + MARGIN) * [1.0, -1.0] + [0.0, height]) for kind, line in lines)
    drawn = "\n".join(_path(kind, line) for kind, line in placed)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" height="{height:.2f}mm" '
    text = f'{head}viewBox="0 0 {width:.2f} {height:.2f}">\n{drawn}\n</svg>\n'
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def outline_picture(lines: Mapping[str, Sequence[Values]], loops: Loops, got: str) -> Image.Image:
    """Draw rims over each other, by name, those of each part apart from the next one's.

    Args:
        got: stands beside the name of the inflated rims.
    """
    lines = _beside(lines)
    low, high = _bounds([rim for rims in lines.values() for rim in rims])
    scale = FINER * PIXELS / float(high[0] - low[0])
    width, height = (scale * (high - low)).astype(int) + 2 * FINER * GAP
    image = Image.new("RGB", (width, height + FINER * (ROW * len(lines) + GAP // 2)), (255, 255, 255))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(18 * FINER)
    for row, (name, rims) in enumerate(lines.items()):
        color, thick = COLORS[name], round(FINER * WIDTHS.get(name, 0))
        for rim, of_part in zip(rims, loops, strict=True):
            for number, line in enumerate(_split(rim, of_part)):
                places = (scale * (line - low) * [1.0, -1.0] + [FINER * GAP, height - FINER * GAP]).tolist()
                corners = [tuple(place) for place in (*places, *places[:2])]
                if thick:
                    draw.line(corners, color, thick, joint="curve")
                else:
                    draw.polygon(corners, (255, 255, 255) if number else color)
        told = f"{NAMES.get(name, name)}: {got}" if name == "inflated" else NAMES.get(name, name)
        left, middle = FINER * GAP, height + FINER * ROW * (row + 0.5)
        half = 0.5 * (thick or 14 * FINER)
        draw.rectangle((left, middle - half, left + 34 * FINER, middle + half), color)
        draw.text((left + 48 * FINER, middle), told, (40, 40, 40), font, anchor="lm")
    return image.resize((image.width // FINER, image.height // FINER), Image.Resampling.LANCZOS)


def _beside(lines: Mapping[str, Sequence[Values]]) -> dict[str, list[Values]]:
    """Return the rims of all names with each part to the right of all rims of the part before."""
    moved: dict[str, list[Values]] = {name: [] for name in lines}
    right, gap = -np.inf, SEAM
    for rims in zip(*lines.values(), strict=True):
        low, high = _bounds(rims)
        shift = [max(0.0, right + gap - float(low[0])), 0.0]
        for name, rim in zip(lines, rims, strict=True):
            moved[name].append(rim + shift)
        right = float(high[0]) + shift[0]
    return moved


def _apart(rims: Sequence[Values]) -> list[Values]:
    """Return the parts side by side, so far apart that the lines to cut along do not meet."""
    placed, right = [], -np.inf
    for rim in rims:
        shift = max(0.0, right + 2.0 * SEAM + MARGIN - float(rim[:, 0].min()))
        placed.append(rim + np.array([shift, 0.0]))
        right = float(placed[-1][:, 0].max())
    return placed


def _split(rim: Values, loops: Sequence[NDArray[Any]]) -> list[Values]:
    """Return a part's loops, the longest first."""
    lines = np.split(rim, np.cumsum([len(loop) for loop in loops])[:-1])
    return sorted(lines, key=lambda line: -float(np.ptp(line, axis=0).sum()))


def _bounds(lines: Sequence[Values]) -> tuple[Values, Values]:
    points = np.concatenate(lines)
    return points.min(axis=0), points.max(axis=0)


def _path(kind: str, line: Values) -> str:
    places = " ".join(f"{x:.3f},{y:.3f}" for x, y in line.tolist())
    dashes = ' stroke-dasharray="3 2"' if kind == "seam" else ""
    return f'<polygon class="{kind}" points="{places}" fill="none" stroke="black" stroke-width="0.3"{dashes}/>'


EDGES = 20
"""Number of edges in the height"""
PRESSURE, FILL_SECONDS, FRAMES = 200.0, 0.2, 60
MODULUS, DENSITY = 1.0e7, 1390.0
"""Shear modulus [Pa] and density [kg/m^3]: film far stiffer than the pressure needs, and soft enough for long steps"""
DAMPING_RATE = 20.0
"""Damping rate [1/s]"""
THICKNESS = 1.0e-4
"""Thickness [m], where none is given: it hardly changes the outline"""
CORRECTIONS = 4
GOOD = 0.01
"""Local error over the size above which it is reported"""


@dataclass(frozen=True)
class Foil:
    """Parts of a foil balloon."""

    parts: Sequence[Part]
    size: float
    thickness: float
    device: str | None

    def scene(self, meshes: Sequence[PolygonMesh], paths: Sequence[Path] | None = None) -> Scene:
        """Return the scene of its parts, each a balloon that a pressure inflates.

        Args:
            meshes: of the flat parts.
            paths: of the files that have them, if they are written.
        """
        material = Material(
            kind="neo_hookean", shear_modulus=MODULUS, thickness=self.thickness, density=DENSITY, most_stretch=1.1
        )
        inflation = Inflation(pressure=[(0.0, 0.0), (FILL_SECONDS, PRESSURE)])
        balloons = [
            Balloon(
                mesh=source, holes="keep", weld=False, material=material, inflation=inflation, look="foil",
                damping=float(f"{DAMPING_RATE * total_area(mesh) * self.thickness * DENSITY:.4g}"),
            )
            for mesh, source in zip(meshes, paths or meshes, strict=True)
        ]  # fmt: skip
        told = "Foil of a wanted outline"  # flat parts may overlap: they are larger than they will be
        return Scene(description=told, balloon=balloons, gravity=0.0, frames=FRAMES, touch=False)

    def inflated(self, scene: Scene) -> list[Values]:
        """Return the points of each part once the scene is over.

        Raises:
            InputError: it blows up.
        """
        try:
            *_, last = Simulator(scene, self.device).run()
        except BlowUpError as failure:
            raise InputError(f"the foil does not come to rest: {failure}; expected thicker foil") from None
        return [points.astype(np.float64) for points in last.points]

    def error(self, rims: Sequence[Values]) -> Error:
        """Return the error of all rims together."""
        found = [part.error(rim, self.size) for part, rim in zip(self.parts, rims, strict=True)]
        weights = [len(part.rim) for part in self.parts]
        mean = np.average([each.mean for each in found], weights=weights)
        return Error(float(mean), max(each.worst for each in found))


@dataclass(frozen=True)
class Tried:
    """Patterns, and their inflated shapes."""

    error: Error
    patterns: Sequence[Values]
    """Flat rims of the parts [m], each of shape (r, 2)"""
    meshes: Sequence[PolygonMesh]
    """Flat meshes of the parts"""
    rims: Sequence[Values]
    """Inflated rims [m], each of shape (r, 2)"""
    points: Sequence[Values]
    """Inflated points [m], each of shape (n, 3)"""


def design_of_foil(
    source: str, size: float, thickness: float, folder: Path, steps: int, device: str | None, say: Callable[[str], None]
) -> Design:
    """Correct the outline of a pattern until the inflated rim is where it should be.

    Args:
        source: letters, or a drawing, .svg.
        size: largest extent of the inflated outline [m].

    Raises:
        InputError: nothing is drawn, or the foil does not come to rest.
    """
    foil = Foil(_parts(source, size, size / EDGES, None), size, thickness, device)
    return _written(foil, *_corrected(foil, min(steps, CORRECTIONS), say), folder)


def foil_of_inflated_size(
    source: str,
    size: float,
    edge: float | None,
    font: str | None,
    say: Callable[[str], None],
    device: str | None = None,
) -> tuple[Foil, list[PolygonMesh]]:
    """Find the flat foil that has the drawn outline once it is inflated: each part's mesh, standing on y = 0.

    Args:
        source: letters, or a drawing, .svg.
        size: largest extent of the inflated outline [m].
        edge: approximate edge length [m]; a twentieth of the size if missing.
        font: as for `foil_parts`.
        say: told how far it is.
        device: Warp device; the GPU, or else the CPU, if not given.

    Raises:
        InputError: nothing is drawn, or the foil does not come to rest.
    """
    require_size(size)
    foil = Foil(_parts(source, size, edge or size / EDGES, font), size, THICKNESS, device)
    meshes = _corrected(foil, CORRECTIONS, say)[0].meshes
    low = min(float(mesh.points[:, 1].min()) for mesh in meshes)
    return foil, [replace(mesh, points=mesh.points - [0.0, low, 0.0]) for mesh in meshes]


def _corrected(foil: Foil, corrections: int, say: Callable[[str], None]) -> tuple[Tried, Tried]:
    """Correct the patterns so often; return the best, and the first, which is not corrected.

    Raises:
        InputError: the foil does not come to rest.
    """
    patterns: Sequence[Values] = [part.wanted for part in foil.parts]
    tried = []
    for number in range(corrections + 1):
        meshes = [part.with_rim(pattern) for part, pattern in zip(foil.parts, patterns, strict=True)]
        points = foil.inflated(foil.scene(meshes))
        rims = [part.rim_of(each) for part, each in zip(foil.parts, points, strict=True)]
        error = foil.error(rims)
        say(f"correction {number}: {error} of the size")
        tried.append(Tried(error, patterns, meshes, rims, points))
        patterns = [corrected(*each) for each in zip(foil.parts, patterns, rims, strict=True)]
    return min(tried, key=lambda each: each.error.mean), tried[0]


def _written(foil: Foil, best: Tried, first: Tried, folder: Path) -> Design:
    """Write the best pattern, its scene, picture and report."""
    error, paths = best.error, [folder / f"balloon_{number}.obj" for number in range(1, len(best.meshes) + 1)]
    for path, mesh in zip(paths, best.meshes, strict=True):
        write_obj(path, mesh)
    scene = foil.scene(best.meshes, paths)
    write_scene(scene, folder / SCENE)
    loops = [part.loops for part in foil.parts]
    write_pattern(folder / "pattern.svg", best.patterns, loops)
    wanted = [part.wanted for part in foil.parts]
    cannot = []
    if error.worst > GOOD:
        cannot.append(f"the rim is off by {100.0 * error.worst:.2g}% of the size at its worst point, where it wrinkles")
    got = float(np.ptp(np.concatenate(best.rims), axis=0).max())
    design = Design(
        scene, folder, error, error, first.error, stretch=1.0, stretch_asked=None, size=got, size_asked=foil.size,
        cannot=cannot, simulated=np.concatenate(best.points),
    )  # fmt: skip
    write_report(folder / REPORT, {"of": "foil", **design.report()})
    lines = {"wanted": wanted, "without design": first.rims, "inflated": best.rims, "pattern": best.patterns}
    write_picture(folder / "error.png", outline_picture(lines, loops, design.got))
    return design


def _parts(source: str, size: float, edge: float, font: str | None) -> list[Part]:
    """Return the flat parts, as large as they are to be when they are inflated."""
    meshes = foil_parts(source, size, edge, font)
    points = np.concatenate([mesh.points for mesh in meshes])
    scale = size / np.ptp(points, axis=0)[:2].max()
    middle = 0.5 * (points.max(axis=0) + points.min(axis=0)) * [1.0, 1.0, 0.0]
    return [Part(replace(mesh, points=(mesh.points - middle) * scale)) for mesh in meshes]
