"""Design of a foil balloon of panels: laid flat, numbered, and sewn.

Panels laid flat with the least strain, and seams as long on both sides.

A conformal map begins (Levy and others 2002, least squares); then Gauss and Newton's steps lessen the squared strain of
the film between the flat panel and the surface, where a difference between the sides of a seam counts far more.

Design of a foil balloon of panels: from a target shape to its sewn panels, simulated.

Panels laid flat lose the double curvature of a surface, and the film between seams bulges. So the shape that is laid
flat is corrected by the error of the simulated balloon, a few times.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.sparse.linalg import splu

from balloon_warp.errors import InputError
from balloon_warp.lab.design.foil import MARGIN, SEAM
from balloon_warp.lab.design.job import (
    MORE_FRAMES,
    SLOW_FOIL,
    Design,
    DesignStep,
    Equilibrium,
    Job,
    common_fields,
    scene_of,
    simulate_from_rest,
)
from balloon_warp.lab.design.target import Panels, centered, cut_into_panels, gores_of, require_size, seams_of, shape_of
from balloon_warp.mesh.crossings import means_over_neighbors
from balloon_warp.mesh.load import MeshLike
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.topology import component_labels, total_area
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.system.files import whole_file
from balloon_warp.tools.foil import from_extra

Values = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class SeamLine:
    """Seam, from end to end."""

    sides: Numbers
    """Vertices of the panels along both sides, shape (2, k)"""
    forward: tuple[bool, bool]
    """Whether the panel of a side is on the left of it"""

    def marks(self, flat: Values, spacing: float) -> tuple[Values, Values]:
        """Places that meet when it is sewn, evenly along it, and the ways out of the panels, shapes (2, c, 2).

        Args:
            flat: of the panels' vertices [m], shape (m, 2).
            spacing: about how far places are from each other [m].
        """
        lines = flat[self.sides]
        ways = np.diff(lines, axis=1)
        lengths = np.linalg.norm(ways, axis=2)
        along = np.append(0.0, np.cumsum(lengths.mean(axis=0)))
        count = max(1, round(along[-1] / spacing) - 1)
        where = along[-1] * np.arange(1, count + 1) / (count + 1)
        edge = np.clip(np.searchsorted(along, where, side="right") - 1, 0, len(along) - 2)
        part = (where - along[edge]) / np.maximum(along[edge + 1] - along[edge], 1e-30)
        places = lines[:, edge] + part[None, :, None] * ways[:, edge]
        sign = np.where(self.forward, 1.0, -1.0)[:, None, None]
        out = sign * np.stack([ways[:, edge, 1], -ways[:, edge, 0]], axis=2)
        return places, out / np.maximum(np.linalg.norm(out, axis=2, keepdims=True), 1e-30)


def seam_lines(panels: Panels) -> list[SeamLine]:
    """Return all seams, each from where it meets others, or ends, to the next such place."""
    ends = panels.sewn_to[panels.seams[:, 0]]  # of both sides the same
    sides = np.sort(panels.of_vertices[panels.seams[:, :, 0]], axis=1)
    degrees = np.bincount(ends.ravel(), minlength=panels.mesh.vertex_count)
    by_vertex: dict[int, list[int]] = {}
    for edge, pair in enumerate(ends.tolist()):
        for vertex in pair:
            by_vertex.setdefault(vertex, []).append(edge)
    joins = [
        edges for vertex, edges in by_vertex.items()
        if degrees[vertex] == 2 and (sides[edges[0]] == sides[edges[1]]).all()
    ]  # fmt: skip
    first, second = np.array(joins, dtype=np.int64).reshape(-1, 2).T
    labels = component_labels(len(ends), first, second)
    return [_line(panels, ends, np.flatnonzero(labels == label)) for label in np.unique(labels)]


def _line(panels: Panels, ends: Numbers, edges: Numbers) -> SeamLine:
    """Return the edges of a seam in order."""
    left = {int(edge) for edge in edges}
    count = np.bincount(ends[edges].ravel())
    odd = np.flatnonzero(count == 1)
    here = int(odd[0]) if len(odd) else int(ends[edges[0], 0])
    order: list[tuple[int, bool]] = []
    while left:
        edge = next(edge for edge in sorted(left) if here in ends[edge])
        turned = int(ends[edge, 1]) == here
        here = int(ends[edge, 0 if turned else 1])
        order.append((edge, turned))
        left.remove(edge)
    # Both sides as they are at the first edge; which of the two comes first may change from edge to edge.
    lines: list[list[int]] = [[], []]
    last: list[int | None] = [None, None]
    for edge, turned in order:
        pair = panels.seams[edge][:, ::-1] if turned else panels.seams[edge]
        swap = last[0] is not None and int(pair[0, 0]) != last[0]
        for side, (begin, end) in enumerate(pair[::-1].tolist() if swap else pair.tolist()):
            lines[side] += [begin, end] if last[side] is None else [end]
            last[side] = end
    edge, turned = order[0]
    ways = panels.forward[edge] ^ turned
    return SeamLine(np.array(lines), (bool(ways[0]), bool(ways[1])))


SEAM_WEIGHT = 100.0
"""Weight of a seam's strain over that of the film"""
MOST_STEPS = 60
FLATTER = 1.0e-6
"""Least relative gain in the sum of squares for another step"""


def flattened(panels: Panels, points: Values, flat: Values | None = None) -> Values:
    """Return the places of the panels' vertices in the plane, shape (m, 2).

    Args:
        points: of the sewn mesh [m], shape (n, 3).
        flat: to begin with.

    Raises:
        InputError: a panel would fold over.
    """
    frames = _frames(points[panels.sewn_to][panels.corners])
    here = _conformal(panels, frames) if flat is None else flat
    here = _relaxed(panels, frames, here)
    sides = here[panels.corners]
    folded = _cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]) <= 0.0
    if folded.any():
        panel = panels.of_faces[folded][0]
        raise InputError(
            f"panels: panel {panel + 1}, of {(panels.of_faces == panel).sum()} triangles, is too curved and folds over "
            "when flattened; expected more seams through it"
        )
    return here


def seam_lengths(panels: Panels, flat: Values) -> Values:
    """Return the lengths of both sides of each seam's edge [m], shape (s, 2)."""
    ends = flat[panels.seams]
    return np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)


def _frames(places: Values) -> Values:
    """Return the triangles in planes of their own, the first edge along x: edges as columns, shape (t, 2, 2)."""
    first, second = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
    length = np.linalg.norm(first, axis=1)
    along = (first * second).sum(axis=1) / length
    across = np.linalg.norm(np.cross(first, second), axis=1) / length
    return np.stack([np.stack([length, along], 1), np.stack([np.zeros(len(length)), across], 1)], axis=1)


def _conformal(panels: Panels, frames: Values) -> Values:
    """Return each panel conformal, as large as it is."""
    inverse, areas = np.linalg.inv(frames), 0.5 * np.linalg.det(frames)
    # The slopes of linear functions in a triangle, by its corners' values: shape (t, 2, 3).
    slopes = np.einsum("tij,ki->tjk", inverse, np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]))
    slopes *= np.sqrt(areas)[:, None, None]
    count, rows = len(panels.sewn_to), np.arange(len(frames))
    triples = np.repeat(rows, 3), panels.corners.ravel()
    dx, dy = (sparse.csr_matrix((slopes[:, k].ravel(), triples), shape=(len(rows), count)) for k in range(2))
    both = sparse.csc_matrix(sparse.bmat([[dx, -dy], [dy, dx]]))
    pinned = np.concatenate([_far_apart(panels, panel) for panel in range(panels.count)])
    values = np.concatenate([np.tile([0.0, 1.0], panels.count), np.zeros(len(pinned))])
    held = np.concatenate([pinned, pinned + count])
    free = np.setdiff1d(np.arange(2 * count), held)
    normal = (both[:, free].T @ both[:, free]).tocsc()
    found = np.zeros(2 * count)
    found[held] = values
    found[free] = splu(normal).solve(-both[:, free].T @ (both[:, held] @ values))
    flat = found.reshape(2, count).T
    sides = flat[panels.corners]
    now = np.abs(0.5 * _cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]))
    ratio = np.bincount(panels.of_faces, areas) / np.bincount(panels.of_faces, now)
    return flat * np.sqrt(ratio)[panels.of_vertices][:, None]


def _far_apart(panels: Panels, panel: int) -> NDArray[np.int64]:
    """Return two vertices of a panel's border, as far from each other as can be."""
    border = panels.borders[panel]
    places = panels.mesh.points[panels.sewn_to[border]]
    first = int(np.linalg.norm(places - places.mean(axis=0), axis=1).argmax())
    return border[[first, int(np.linalg.norm(places - places[first], axis=1).argmax())]]


def _relaxed(panels: Panels, frames: Values, flat: Values) -> Values:
    """Return the flat places with the least strain (Levenberg and Marquardt)."""
    damping, (residual, slopes) = 1.0e-3, _strains(panels, frames, flat)
    before = float(residual @ residual)
    for _ in range(MOST_STEPS):
        normal, gradient = slopes.T @ slopes, slopes.T @ residual
        unit = float(normal.diagonal().mean())
        found = None
        while damping < 1.0e6:
            step = splu((normal + damping * unit * sparse.identity(len(gradient))).tocsc()).solve(-gradient)
            there = flat + step.reshape(-1, 2)
            residual, slopes = _strains(panels, frames, there)
            if float(residual @ residual) < before:
                found = there
                break
            damping *= 10.0
        if found is None:
            return flat
        flat, damping, after = found, max(damping / 10.0, 1.0e-10), float(residual @ residual)
        if after > (1.0 - FLATTER) * before:
            return flat
        before = after
    return flat


def _strains(panels: Panels, frames: Values, flat: Values) -> tuple[Values, Any]:
    """Return the residuals, and their derivatives by the flat places.

    They are Green's strains of triangles, weighted by the roots of their areas, and the differences of the squared
    lengths of both sides of seams.
    """
    edges, corners = flat[panels.corners], panels.corners
    edges = (edges[:, 1:] - edges[:, :1]).transpose(0, 2, 1)  # as columns
    inverse, root = np.linalg.inv(frames), np.sqrt(0.5 * np.linalg.det(frames))
    turn = edges @ inverse
    squared = np.einsum("tki,tkj->tij", turn, turn)
    weight = np.array([0.5, 0.5, np.sqrt(0.5)])
    parts = np.stack([squared[:, 0, 0] - 1.0, squared[:, 1, 1] - 1.0, squared[:, 0, 1]], axis=1)
    films = parts * weight * root[:, None]
    # By corners: the slope of the map is linear in their places.
    by_corner = np.einsum("tij,ki->tkj", inverse, np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]))
    slopes = np.stack([
        2.0 * by_corner[:, :, 0, None] * turn[:, None, :, 0],
        2.0 * by_corner[:, :, 1, None] * turn[:, None, :, 1],
        by_corner[:, :, 0, None] * turn[:, None, :, 1] + by_corner[:, :, 1, None] * turn[:, None, :, 0],
    ], axis=1) * (weight * root[:, None])[:, :, None, None]  # fmt: skip
    count = len(corners)
    rows = np.broadcast_to((3 * np.arange(count)[:, None] + np.arange(3))[:, :, None, None], slopes.shape)
    columns = np.broadcast_to((2 * corners[:, :, None] + np.arange(2))[:, None], slopes.shape)
    of_seams, seam_values, seam_rows, seam_columns = _seam_strains(panels, flat)
    matrix = sparse.csr_matrix(
        (
            np.concatenate([slopes.ravel(), seam_values]),
            (np.concatenate([rows.ravel(), 3 * count + seam_rows]), np.concatenate([columns.ravel(), seam_columns])),
        ),
        shape=(3 * count + len(of_seams), 2 * len(flat)),
    )
    return np.concatenate([films.ravel(), of_seams]), matrix


def _seam_strains(panels: Panels, flat: Values) -> tuple[Values, Values, Any, Any]:
    """Return the differences between both sides of each seam's edge, and derivatives: values, rows and columns."""
    ends = flat[panels.seams]
    ways = ends[:, :, 1] - ends[:, :, 0]
    sewn = panels.mesh.points[panels.sewn_to[panels.seams[:, 0]]]
    length = np.linalg.norm(sewn[:, 1] - sewn[:, 0], axis=1)
    weight = SEAM_WEIGHT / (2.0 * length)
    squares = (ways**2).sum(axis=2)
    signs = np.array([1.0, -1.0])[:, None] * np.array([-1.0, 1.0])  # of sides and ends
    values = 2.0 * weight[:, None, None, None] * signs[:, :, None] * ways[:, :, None, :]
    rows = np.broadcast_to(np.arange(len(ways))[:, None, None, None], values.shape)
    columns = np.broadcast_to(2 * panels.seams[..., None] + np.arange(2), values.shape)
    return weight * (squares[:, 0] - squares[:, 1]), values.ravel(), rows.ravel(), columns.ravel()


def _cross(a: Values, b: Values) -> Values:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


APART = 0.03
"""Distance between panels, with room for the seam allowance [m]"""
WIDE = 1.5
"""Approximate width of the sheet over its height"""


def laid_out(panels: Panels, flat: Values) -> Values:
    """Turn and move panels so that none lies on another, shape (m, 2)."""
    places = flat.copy()
    own = [np.flatnonzero(panels.of_vertices == panel) for panel in range(panels.count)]
    for vertices in own:
        places[vertices] = _upright(flat[vertices])
    sizes = np.array([places[vertices].max(axis=0) for vertices in own]) + APART
    width = max(np.sqrt(WIDE * sizes.prod(axis=1).sum()), sizes[:, 0].max())
    x, y, high = 0.0, 0.0, 0.0
    for panel in np.argsort(-sizes[:, 1], kind="stable").tolist():
        if x > 0.0 and x + sizes[panel, 0] > 1.001 * width:
            x, y, high = 0.0, y - high, 0.0
        places[own[panel]] += [x, y - sizes[panel, 1]]
        x, high = x + sizes[panel, 0], max(high, float(sizes[panel, 1]))
    return places


def _upright(flat: Values) -> Values:
    """Return a panel as high as it is long, from 0 on."""
    centered = flat - flat.mean(axis=0)
    long = np.linalg.svd(centered, full_matrices=False)[2][0]
    turn = np.array([[long[1], long[0]], [-long[0], long[1]]])  # the long way becomes up
    turned = centered @ turn
    return turned - turned.min(axis=0)


SPACING = 0.06
"""Distance between marks along a seam [m]"""
LETTERS, NAMES = 0.005, 0.014
"""Height of the marks' numbers and of the panels' [m]"""
PIXELS = 1500
LOOKS = {"seam": (30, 90, 170), "cut": (40, 40, 40), "mark": (190, 70, 40), "panel": (120, 120, 120)}


@dataclass(frozen=True)
class Line:
    """Drawn line of a pattern."""

    kind: str
    places: Values
    """Places, shape (k, 2)"""
    closed: bool = True


@dataclass(frozen=True)
class Label:
    """Text at a place."""

    kind: str
    place: Values
    text: str
    height: float


@dataclass(frozen=True)
class PanelPattern:
    """Pattern of flat panels."""

    panels: Panels
    flat: Values
    """Flat places, laid out [m], shape (m, 2)"""

    @cached_property
    def drawn(self) -> tuple[list[Line], list[Label]]:
        """Lines and labels, in meters.

        Raises:
            InputError: a panel lies on itself.
        """
        lines, labels = [], []
        for number, border in enumerate(self.panels.borders, start=1):
            outline = require_simple(number, self.flat[border])
            lines.append(Line("seam", self.flat[border]))
            lines.append(Line("cut", np.asarray(outline.buffer(SEAM).exterior.coords)[:-1]))
            middle = np.array(outline.representative_point().coords[0])
            labels.append(Label("panel", middle, str(number), NAMES))
        for number, seam in enumerate(seam_lines(self.panels), start=1):
            places, out = seam.marks(self.flat, SPACING)
            for side in range(2):
                for mark, (place, way) in enumerate(zip(places[side], out[side], strict=True), start=1):
                    lines.append(Line("mark", np.array([place, place + SEAM * way]), closed=False))
                    labels.append(Label("mark", place - 0.8 * LETTERS * way, f"{number}.{mark}", LETTERS))
        return lines, labels

    @cached_property
    def _bounds(self) -> tuple[Values, Values]:
        places = np.concatenate([line.places for line in self.drawn[0]])
        return places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN

    def write(self, path: Path) -> None:
        """Write the drawing in millimeters."""
        lines, labels = self.drawn
        low, high = self._bounds
        width, height = 1000.0 * (high - low)
        parts = [_path(line, self._in(line.places, 1000.0)) for line in lines]
        parts += [_text(label, self._in(label.place[None], 1000.0)[0]) for label in labels]
        head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" height="{height:.2f}mm" '
        text = f'{head}viewBox="0 0 {width:.2f} {height:.2f}">\n' + "\n".join(parts) + "\n</svg>\n"
        with whole_file(path) as temporary:
            temporary.write_text(text, encoding="utf-8")

    def picture(self) -> Image.Image:
        """Draw the pattern as a picture."""
        lines, labels = self.drawn
        low, high = self._bounds
        scale = PIXELS / float(high[0] - low[0])
        image = Image.new("RGB", (PIXELS, round(scale * float(high[1] - low[1]))), (255, 255, 255))
        draw = ImageDraw.Draw(image)
        for line in lines:
            places = [tuple(place) for place in self._in(line.places, scale).tolist()]
            draw.line(places + places[:1] * line.closed, LOOKS[line.kind], 2)
        for label in labels:
            font = ImageFont.load_default(max(8.0, scale * label.height))
            draw.text(tuple(self._in(label.place[None], scale)[0].tolist()), label.text, LOOKS[label.kind], font, "mm")
        return image

    def _in(self, places: Values, scale: float) -> Values:
        """Return the places on the sheet, from its upper left corner, in a unit."""
        low, high = self._bounds
        return scale * np.stack([places[:, 0] - low[0], high[1] - places[:, 1]], axis=1)


def require_simple(number: int, border: Values):
    """Make sure that a panel does not lie on itself, and return its outline.

    Raises:
        InputError: it does, so that it cannot be cut.
    """
    outline = from_extra("shapely").Polygon(border)
    if not outline.is_valid:
        raise InputError(
            f"panels: panel {number} overlaps itself when flat and cannot be cut; expected more seams through it"
        )
    return outline


def _path(line: Line, places: Values) -> str:
    corners = " ".join(f"{x:.3f},{y:.3f}" for x, y in places.tolist())
    dashes = ' stroke-dasharray="3 2"' if line.kind == "seam" else ""
    name = "polygon" if line.closed else "polyline"
    return f'<{name} class="{line.kind}" points="{corners}" fill="none" stroke="black" stroke-width="0.3"{dashes}/>'


def _text(label: Label, place: Values) -> str:
    return (
        f'<text class="{label.kind}" x="{place[0]:.2f}" y="{place[1]:.2f}" font-family="sans-serif" '
        f'font-size="{1000.0 * label.height:g}" text-anchor="middle" dominant-baseline="central">'
        f"{escape(label.text)}</text>"
    )


MODULUS, DENSITY = 1.0e7, 1390.0
"""Shear modulus [Pa] and density [kg/m^3]: film far stiffer than the pressure needs, and soft enough for long steps"""
PRESSURE, FILL_SECONDS = 200.0, 0.2
DAMPING_RATE = 20.0
"""Damping rate of the whole [1/s]"""
EDGES = 16
"""Number of edges of gores in the size"""
SLACK = 0.9
"""Initial size over the target's: nothing pulls there"""
CORRECTIONS = 8
IDLE = 2
"""Number of corrections without gain after which the design ends"""
GAINED = 0.01
"""Least relative gain in error of a correction"""
EVENED = 10
"""Number of smoothing passes of a correction over neighbors: about a fifth of the size"""
FURTHEST = 0.03
"""Largest displacement of a vertex in a correction, over the size"""


@dataclass(frozen=True)
class Tried:
    """Progress of the corrections."""

    shape: Values
    """Shape that is laid flat next [m], shape (n, 3)"""
    flat: Values
    """Flat places of the best [m], shape (m, 2)"""
    points: Values
    """Simulated points of the best [m], shape (n, 3)"""
    plain: Values
    """Simulated points of the target shape laid flat [m], shape (n, 3)"""
    error: float
    """Mean error of the best"""
    steps: int
    idle: int

    def save(self, path: Path) -> None:
        """Write the progress to a file for `load`."""
        with whole_file(path) as temporary:
            np.savez(temporary, **vars(self))

    @classmethod
    def load(cls, path: Path) -> "Tried":
        """Read a file that `save` wrote."""
        with np.load(path, allow_pickle=False) as file:
            return cls(**{name: file[name] if file[name].ndim else file[name].item() for name in file.files})


def design_of_panels(job: Job, panels: Panels) -> Design:
    """Lay the panels flat, so that they become the shape once they are sewn and inflated.

    Raises:
        InputError: a panel cannot be laid flat, or the foil does not come to rest.
    """
    tried = job.saved(Tried.load)
    while tried is None or (tried.steps <= min(job.steps, CORRECTIONS) and tried.idle < IDLE):
        tried = _corrected(job, panels, tried)
        job.remember(tried)
        job.say(f"correction {tried.steps - 1}: {100.0 * tried.error:.2g}% of the size, in the mean, at best")
        job.watch(DesignStep(job.ruler, tried.steps - 1, tried.points, _stretch(panels, tried.flat)))
    flat = laid_out(panels, tried.flat)
    scene = _written(job, panels, flat)
    pattern = PanelPattern(panels, flat)
    pattern.write(job.folder / "pattern.svg")
    apart = float(np.abs(np.diff(seam_lengths(panels, flat), axis=1)).max())
    return job.proven(
        scene, Equilibrium(tried.points, tried.plain, _stretch(panels, flat)), rival="laid flat without corrections",
        below=pattern.picture(), panels=panels.count, seams_differ_by=apart,
    )  # fmt: skip


def panels_of(target: str | Path | MeshLike, said: int | str | Path, size: float | None) -> Panels:
    """Cut a shape into panels.

    Args:
        said: how many gores around its vertical axis, or its seams, as `seams_of` takes them.
        size: largest extent of the shape [m]; its own when missing.

    Raises:
        InputError: the shape or the seams cannot be.
    """
    require_size(size)
    read, shape = shape_of(target)
    gores = said if isinstance(said, int) else int(str(said)) if str(said).isdecimal() else None
    if gores is not None:
        whole = centered(shape, size)
        return cut_into_panels(*gores_of(whole, gores, float(np.ptp(whole.points, axis=0).max()) / EDGES))
    seams = seams_of(str(said), read, shape)
    triangles = triangles_of(shape)
    counts = np.full(len(triangles), 3, dtype=np.int32)
    mesh = replace(
        centered(shape, size), face_vertex_counts=counts, face_vertex_indices=triangles.ravel().astype(np.int32)
    )
    return cut_into_panels(mesh, seams)


def _corrected(job: Job, panels: Panels, before: Tried | None) -> Tried:
    """Return the progress after one more simulation; a correction that does not come to rest has no effect.

    Raises:
        InputError: the panels of the wanted shape cannot be laid flat, or do not come to rest.
    """
    shape = panels.mesh.points if before is None else before.shape
    try:
        flat = flattened(panels, shape)
        simulated = simulate_from_rest(_written(job, panels, flat), job.ruler.size, job.device, SLOW_FOIL)
        if isinstance(simulated, str):
            raise InputError(f"the foil does not come to rest: {simulated}; expected thicker foil")
    except InputError:
        if before is None:
            raise
        return replace(before, steps=before.steps + 1, idle=IDLE)
    points, error = simulated.points, job.ruler.error(simulated.points).mean
    shape = shape + _evened(panels, panels.mesh.points - job.ruler.aligned(points), FURTHEST * job.ruler.size)
    if before is None:
        return Tried(shape, flat, points, points, error, steps=1, idle=0)
    after = replace(before, shape=shape, steps=before.steps + 1, idle=before.idle + 1)
    return (
        after
        if error >= (1.0 - GAINED) * before.error
        else replace(after, flat=flat, points=points, error=error, idle=0)
    )


def _evened(panels: Panels, moves: Values, most: float) -> Values:
    """Smooth the moves of the sewn vertices over their neighbors: wrinkles and bulges are no fault of the outlines.

    Args:
        most: that one moves [m].
    """
    means = means_over_neighbors(panels.mesh)
    for _ in range(EVENED):
        moves = means @ moves
    return moves * np.minimum(1.0, most / np.maximum(np.linalg.norm(moves, axis=1, keepdims=True), 1e-30))


def _written(job: Job, panels: Panels, flat: Values) -> Scene:
    """Return the scene of a balloon that begins slack, with its files."""
    start = replace(panels.mesh, points=SLACK * panels.mesh.points)
    write_obj(job.folder / "balloon.obj", start)
    write_obj(job.folder / "panels.obj", panels.flat_mesh(flat))
    material = Material(
        kind="neo_hookean", shear_modulus=MODULUS, thickness=job.thickness, density=DENSITY, most_stretch=1.1,
        rest_mesh=job.folder / "panels.obj",
    )  # fmt: skip
    mass = total_area(panels.flat_mesh(flat)) * job.thickness * DENSITY
    fields = common_fields(job.folder / "balloon.obj", Inflation(pressure=[(0.0, 0.0), (FILL_SECONDS, PRESSURE)]))
    balloon = Balloon(**fields, material=material, look="foil", damping=float(f"{DAMPING_RATE * mass:.4g}"))
    return scene_of(balloon, f"{panels.count} panels of foil that become {panels.mesh.name}", MORE_FRAMES)


def _stretch(panels: Panels, flat: Values) -> float:
    """Return the mean stretch of the target shape over its panels."""
    return float(np.sqrt(total_area(panels.mesh) / total_area(panels.flat_mesh(flat))))
