"""Foil balloons of letters and drawings: two flat sheets of even quads, sewn at their rims.

An outline comes from letters or a drawing, as polygons of Shapely's. The squares of a grid that lie well within it are
kept; a row of quads joins them to the outline all around, and then each quad pulls its corners towards those of a
square. Where the outline runs aslant to the grid, vertices have three or five neighbors instead of four. The extra
`foil` loads on demand.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from math import isfinite
from pathlib import Path
from typing import Any, Literal
from xml.etree.ElementTree import ParseError

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import component_labels
from balloon_warp.system.api import checked

MARGIN = 0.5
"""Least distance of the kept squares from the outline [squares]; at most one more, so that a square fits between"""
AROUND = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
"""Corners of a square, counterclockwise"""


@dataclass(frozen=True)
class Squares:
    """Squares that hang together by their edges, as a mesh of quads."""

    points: NDArray[np.float64]
    """Points, shape (vertex_count, 2)"""
    quads: NDArray[np.int64]
    """Quads, counterclockwise, shape (quad_count, 4)"""
    loops: list[NDArray[np.int64]]
    """Vertices along each border, with the squares on the left"""


def squares_within(outline: Any, edge: float, shift: tuple[float, float]) -> Squares | None:
    """Return the squares of a grid within a polygon of Shapely's; None where there are none.

    Args:
        edge: of a square.
        shift: of the grid, in squares, from where its middle is the outline's.
    """
    lower, upper = np.reshape(outline.bounds, (2, 2))
    count = np.ceil((upper - lower) / edge).astype(int) + 2
    first = 0.5 * (lower + upper) - 0.5 * count * edge + edge * np.array(shift)
    kept = _largest_part(_without_pinches(_kept(outline, first, count, edge)))
    if not kept.any():
        return None
    corners = np.argwhere(kept)[:, None] + AROUND
    numbers = corners @ [count[1] + 1, 1]
    used, quads = np.unique(numbers, return_inverse=True)
    points = first + edge * np.stack(np.divmod(used, count[1] + 1), axis=1)
    quads = quads.reshape(-1, 4)
    return Squares(points, quads, border_loops(quads))


def _kept(outline: Any, first: NDArray[np.float64], count: NDArray[np.int64], edge: float) -> NDArray[np.bool_]:
    """Return a mask of the grid's squares that lie within the outline by the margin, shape of `count`."""
    import shapely

    within = outline.buffer(-MARGIN * edge)
    shapely.prepare(within)
    lower = first + edge * np.argwhere(np.ones(count, dtype=bool))
    boxes = shapely.box(*lower.T, *(lower + edge).T)
    return np.asarray(shapely.contains_properly(within, boxes)).reshape(count)


def _without_pinches(kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask without one of each two squares that touch at a corner alone, until there are none."""
    kept = np.pad(kept, 1)
    while True:
        here, right, above, across = kept[:-1, :-1], kept[1:, :-1], kept[:-1, 1:], kept[1:, 1:]
        rising = here & across & ~right & ~above
        falling = right & above & ~here & ~across
        if not (rising | falling).any():
            return kept[1:-1, 1:-1]
        kept[:-1, :-1] &= ~rising
        kept[:-1, 1:] &= ~falling


def _largest_part(kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the squares alone that hang together with most others, by edges."""
    number = np.arange(kept.size).reshape(kept.shape)
    beside, above = kept[1:] & kept[:-1], kept[:, 1:] & kept[:, :-1]
    first = np.concatenate([number[1:][beside], number[:, 1:][above]])
    second = np.concatenate([number[:-1][beside], number[:, :-1][above]])
    labels = component_labels(kept.size, first, second).reshape(kept.shape)
    return kept & (labels == np.bincount(labels[kept], minlength=1).argmax())


def border_loops(quads: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the vertices along each border of counterclockwise quads, with the quads on the left.

    No vertex is in two.
    """
    begin, end = quads.ravel(), np.roll(quads, -1, axis=1).ravel()
    inner = {(b, a) for a, b in zip(begin.tolist(), end.tolist(), strict=True)}
    following = {a: b for a, b in zip(begin.tolist(), end.tolist(), strict=True) if (a, b) not in inner}
    loops = []
    while following:
        start, vertex = following.popitem()
        loop = [start]
        while vertex != start:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop))
    return loops


SHARP = np.radians(35.0)
"""Least turn of an outline at a corner that the rim keeps"""
EVENINGS = 30
"""Number of initial smoothing passes of vertices along a ring"""
REACH = 2
"""Number of vertices along a loop within which one is sought that turns as the corner of its ring does"""


@dataclass
class Ring:
    """A closed line of an outline, and where the rim's vertices are along it."""

    corners: NDArray[np.float64]
    """Corners of the line, the first at the end again, shape (corner_count + 1, 2)"""
    vertices: NDArray[np.int64]
    """Vertices of the rim, in the order in which they lie along the line"""
    places: NDArray[np.float64]
    """Distance of each from the line's start along it, ascending, within one length from the first to the last"""
    pinned: NDArray[np.bool_]
    """Mask of the vertices that stay, at corners"""

    def __post_init__(self):
        steps = np.diff(self.corners, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        self._along = np.append(0.0, np.cumsum(lengths))
        self._headings = steps / lengths[:, None]

    @property
    def length(self) -> float:
        """Length of the line."""
        return float(self._along[-1])

    def points(self) -> NDArray[np.float64]:
        """Return the points of the vertices, shape (count, 2)."""
        return np.stack([np.interp(self.places % self.length, self._along, each) for each in self.corners.T], axis=1)

    def slide_towards(self, wanted: NDArray[np.float64]) -> None:
        """Move each vertex along the line towards its wanted place, past none of its neighbors.

        The move is a little to the middle between them, too: a notch attracts many.
        """
        segments = np.searchsorted(self._along, self.places % self.length, side="right") - 1
        headings = self._headings[np.minimum(segments, len(self._headings) - 1)]
        moves = ((wanted - self.points()) * headings).sum(axis=1)
        ahead = np.roll(self.places, -1) - self.places
        ahead[-1] += self.length
        most = 0.4 * np.minimum(ahead, np.roll(ahead, 1))
        self.places += np.where(self.pinned, 0.0, np.clip(moves, -most, most))
        self.even(1)

    def even(self, times: int) -> None:
        """Move each towards the middle between its neighbors."""
        for _ in range(times):
            before, after = np.roll(self.places, 1), np.roll(self.places, -1)
            before[0] -= self.length
            after[-1] += self.length
            self.places = np.where(self.pinned, self.places, 0.5 * self.places + 0.25 * (before + after))


def ring_around(
    line: Any, loop: NDArray[np.int64], points: NDArray[np.float64], squares: NDArray[np.int64], first: int
) -> tuple[Ring, NDArray[np.int64]]:
    """Return the ring that a loop of vertices grows onto, and the quads between.

    Each vertex of the loop gets one of the ring. At a corner of the outline one that turns outward gets three, so that
    a quad ends in the corner; and one that turns inward has none of its own, nor have its neighbors, but that in the
    corner.

    Args:
        line: runs around as the loop does.
        points: of the loop's vertices, shape (count, 2).
        squares: that meet in each of them, 1 to 3.
        first: number of the ring's first vertex.
    """
    corners = _corners_at(line, _places_along(line, points), squares)
    inward = {at for at in corners if squares[at] == 3}
    center = {(at + side) % len(loop): at for at in inward for side in (-1, 1)}
    begins, pins, count = np.zeros(len(loop), dtype=np.int64), {}, first
    for number in range(len(loop)):
        if number not in center:
            begins[number] = count
            outward = number in corners and squares[number] == 1
            if number in corners:
                pins[count - first + outward] = corners[number]
            count += 3 if outward else 1
    ends = begins + np.array([2 * (number in corners and squares[number] == 1) for number in range(len(loop))])
    for number, at in center.items():
        begins[number] = ends[number] = begins[at]

    quads = []
    for number, vertex in enumerate(loop):
        after = (number + 1) % len(loop)
        if number in inward:
            quads.append([loop[after], vertex, loop[number - 1], begins[number]])
        elif ends[number] > begins[number]:
            quads.append([vertex, *range(begins[number], ends[number] + 1)])
        if number not in inward and after not in inward:
            quads.append([loop[after], vertex, ends[number], begins[after]])
    places, pinned = _spread(line, count - first, pins, points)
    ring = Ring(np.asarray(line.coords), np.arange(first, count), places, pinned)
    ring.even(EVENINGS)
    return ring, np.array(quads)


def _places_along(line: Any, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the places along a line of each of the points around it, ascending."""
    import shapely

    nearest = shapely.line_locate_point(line, shapely.points(points))
    steps = np.roll(nearest, -1) - nearest
    steps = np.maximum(steps - line.length * np.round(steps / line.length), 1e-3 * line.length / len(points))
    return nearest[0] + np.append(0.0, np.cumsum(steps * (line.length / steps.sum()))[:-1])


def _corners_at(line: Any, places: NDArray[np.float64], squares: NDArray[np.int64]) -> dict[int, float]:
    """Return the vertices of the loop at sharp corners of a line, with the corners' places along it.

    At each corner it is the nearest vertex that turns as the corner does, if there is one for it alone.
    """
    count, taken = len(places), np.zeros(len(places), dtype=bool)
    found: dict[int, float] = {}
    for place, outward in zip(*_corners_of(line), strict=True):
        apart = np.abs(places - place - line.length * np.round((places - place) / line.length))
        near = int(apart.argmin())
        around = sorted(range(near - REACH, near + REACH + 1), key=lambda number: apart[number % count])
        for at in around:
            span = np.arange(at - 2, at + 3) % count
            if squares[at % count] == (1 if outward else 3) and not taken[span].any():
                found[at % count] = place
                taken[np.arange(at - 1, at + 2) % count] = True
                break
    return found


def _corners_of(line: Any) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the sharp corners of a ring of Shapely's: places along it, and whether they turn outward, to the left."""
    corners = np.asarray(line.coords)[:-1]
    steps = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(steps, axis=1)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = headings - np.roll(headings, 1)
    turns -= 2.0 * np.pi * np.round(turns / (2.0 * np.pi))
    sharp = np.abs(turns) > SHARP
    return (np.cumsum(lengths) - lengths)[sharp], turns[sharp] > 0.0


def _spread(
    line: Any, count: int, pins: dict[int, float], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the places of so many vertices along a line, evenly from pin to pin, and which are pinned."""
    import shapely

    pinned = np.zeros(count, dtype=bool)
    if not pins:
        begin = float(shapely.line_locate_point(line, shapely.points(points[0])))
        return begin + line.length * np.arange(count) / count, pinned
    numbers = sorted(pins)
    pinned[numbers] = True
    at = np.array([pins[number] for number in numbers])
    at = at[0] + np.append(0.0, np.cumsum(np.diff(at) % line.length))
    numbers, at = [*numbers, numbers[0] + count], np.append(at, at[0] + line.length)
    places = np.interp(np.arange(numbers[0], numbers[0] + count), numbers, at)
    places[count - numbers[0] :] -= line.length
    return np.roll(places, numbers[0]), pinned


DETAIL = 1e-3
"""Tolerance to which an outline is followed [edges]"""
TRIES = 9
"""Number of edge lengths tried, from the given one to half of it"""
SHIFTS = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
"""Shifts of the grid [squares]"""
GOOD, BAD = 0.1, 0.01
"""Quality from which a sheet is taken at once, and up to which it is rejected"""
SAME_AREA, LONGEST = 0.005, 2.0
"""Largest relative difference of a sheet's area from its outline's, and longest edge [edges]"""
ROUNDS = 40
"""Number of rounds in which quads pull at their corners"""
WEAKEST = 0.1
"""Least area at a corner of a quad over a square's, below which it pulls no harder"""
IN_PLANE = np.array([1.0, 1.0j])
"""Map of x and y to a complex number, where a product turns"""
QUARTER_TURNS = np.array([1.0, 1.0j, -1.0, -1.0j])


@dataclass(frozen=True)
class Sheet:
    """Quads in a plane."""

    points: NDArray[np.float64]
    """Points, shape (vertex_count, 2)"""
    quads: NDArray[np.int64]
    """Quads, counterclockwise, shape (quad_count, 4)"""
    rim: NDArray[np.bool_]
    """Mask of the vertices on the outline, shape (vertex_count,)"""

    def quality(self, outline: Any, edge: float) -> float:
        """Return the least area of the parallelogram at a quad's corner over a square's.

        1 is best, and less than 0 is a quad that is turned over. As bad as can be where a part of the outline was left
        out.
        """
        corners = np.asarray((self.points @ IN_PLANE)[self.quads], dtype=np.complex128)
        areas = corner_areas(corners)
        if abs(areas.sum() / 4.0 / outline.area - 1.0) > SAME_AREA or longest_edge(corners) > LONGEST * edge:
            return -np.inf
        return float(areas.min()) / edge**2


def sheet_of(outline: Any, edge: float) -> Sheet | None:
    """Return a sheet with the outline of a polygon of Shapely's, or None.

    There is none where the polygon has parts that are too narrow for quads of such edges.

    Args:
        edge: how long edges are, about; they are shorter, by up to a half, where that makes better quads.
    """
    from shapely.geometry.polygon import orient

    outline = orient(outline.simplify(DETAIL * edge))  # around, clockwise around holes: with the inside on the left
    best, best_quality = None, BAD
    for size in edge * 0.5 ** np.linspace(0.0, 1.0, TRIES):
        for shift in SHIFTS:
            sheet = _sheet_on_grid(outline, size, shift)
            quality = sheet.quality(outline, size) if sheet else -np.inf
            if quality > best_quality:
                best, best_quality = sheet, quality
            if quality > GOOD:
                return best
    return best


def _sheet_on_grid(outline: Any, edge: float, shift: tuple[float, float]) -> Sheet | None:
    """Return a sheet on a shifted grid, or None where its squares are not connected as the outline is."""
    squares = squares_within(outline, edge, shift)
    lines = [outline.exterior, *outline.interiors]
    if squares is None or len(squares.loops) != len(lines):
        return None
    points, quads, rings = squares.points, squares.quads, []
    meeting = np.bincount(quads.ravel())
    for line, loop in _matched(lines, squares.loops, points):
        ring, between = ring_around(line, loop, points[loop], meeting[loop], len(points))
        points, quads = np.concatenate([points, ring.points()]), np.concatenate([quads, between])
        rings.append(ring)
    points = _relaxed(points, quads, rings, edge)
    return Sheet(points, quads, np.arange(len(points)) >= len(squares.points))


def _matched(
    lines: list[Any], loops: list[NDArray[np.int64]], points: NDArray[np.float64]
) -> Iterator[tuple[Any, NDArray[np.int64]]]:
    """Return each line of an outline with the loop of squares beside it: the outer one, and then those around holes."""
    import shapely

    left = list(loops)
    for line in lines:
        apart = [shapely.hausdorff_distance(line, shapely.LineString(points[loop])) for loop in left]
        yield line, left.pop(int(np.argmin(apart)))


def _relaxed(
    points: NDArray[np.float64], quads: NDArray[np.int64], rings: list[Ring], edge: float
) -> NDArray[np.float64]:
    """Return the points after relaxation toward squares.

    Each quad pulls its corners towards the nearest square of such edges, round after round, the worse ones harder;
    those of the rim along their rings.
    """
    place = points @ IN_PLANE
    for _ in range(ROUNDS):
        corners = place[quads]
        spoke = (corners * QUARTER_TURNS.conj()).mean(axis=1, keepdims=True)  # from the middle to the first corner
        spoke *= np.sqrt(0.5) * edge / np.maximum(np.abs(spoke), 1e-9 * edge)
        wanted = corners.mean(axis=1, keepdims=True) + spoke * QUARTER_TURNS
        pull = np.repeat(1.0 / np.maximum(corner_areas(corners).min(axis=1) / edge**2, WEAKEST), 4)
        real, imaginary, total = (
            np.bincount(quads.ravel(), values)
            for values in (pull * wanted.real.ravel(), pull * wanted.imag.ravel(), pull)
        )
        place = (real + 1.0j * imaginary) / total
        for ring in rings:
            there = place[ring.vertices]
            ring.slide_towards(np.stack([there.real, there.imag], axis=1))
            place[ring.vertices] = ring.points() @ IN_PLANE
    return np.stack([place.real, place.imag], axis=1)


def longest_edge(corners: NDArray[np.complex128]) -> float:
    """Return the longest edge of any quad; corners in the complex plane, shape (quad_count, 4)."""
    return float(np.abs(np.roll(corners, -1, axis=1) - corners).max())


def corner_areas(corners: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the areas of the parallelograms at each corner of each quad, negative where turned over.

    The two edges at the corner span it; their sum over a quad is four times its area.

    Args:
        corners: in the complex plane, shape (quad_count, 4), like the result.
    """
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    return (after.conj() * before).imag


FillRule = Literal["nonzero", "evenodd"]
CRUMB = 1e-6
"""Area over that of all polygons below which a polygon is dropped"""


def from_extra(module: str) -> Any:
    """Return a module of a package that foil balloons need.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise MissingExtraError(f"foil balloons need {package}: pip install 'balloon-warp[foil]'") from None


def enclosed(loops: Sequence[NDArray[np.float64]], rule: FillRule = "nonzero") -> list[Any]:
    """Return the polygons of Shapely's that closed lines enclose together, which may run and cross in any way.

    Args:
        loops: points of each, shape (count, 2).
        rule: inside are points that lines wind around, or, "evenodd", wind around an odd number of times.
    """
    shapely = from_extra("shapely")
    loops = [loop for loop in loops if len(np.unique(loop, axis=0)) > 2]
    if not loops:
        return []
    crossed = shapely.union_all([shapely.linearrings(loop) for loop in loops])
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(crossed)))
    within = shapely.get_coordinates(shapely.point_on_surface(faces))
    turns = np.sum([_turns_around(loop, within) for loop in loops], axis=0)
    return united(faces[turns != 0 if rule == "nonzero" else turns % 2 == 1])


def united(polygons: Sequence[Any] | NDArray[Any]) -> list[Any]:
    """Return the polygons with touching ones merged, without crumbs, from left to right."""
    shapely = from_extra("shapely")
    parts = shapely.get_parts(shapely.union_all(polygons))
    areas = shapely.area(parts)
    kept = parts[areas > CRUMB * areas.sum()]
    return kept[np.lexsort(shapely.bounds(kept).T[[1, 0]])].tolist()


def _turns_around(loop: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the winding number of a closed line around each place, counterclockwise, shape (place_count,)."""
    spokes = (loop - places[:, None]) @ [1.0, 1.0j]
    angles = np.angle(np.roll(spokes, -1, axis=1) * spokes.conj())
    return np.round(angles.sum(axis=1) / (2.0 * np.pi)).astype(np.int64)


WIDTH = 0.24
"""Width of a neck, over the horizontal overlap of the parts"""
ABOVE = 0.5
"""Least overlap of two parts, one above the other, over the narrower one's width"""


def with_necks(outlines: Sequence[Any]) -> list[Any]:
    """Join polygons of Shapely's that are above each other to one each, from left to right.

    A neck is straight and upright. Parts beside each other, as those of a percent sign, stay apart.
    """
    lowest_first = sorted(outlines, key=lambda outline: outline.bounds[1])
    necks = [
        neck
        for number, lower in enumerate(lowest_first)
        for upper in lowest_first[number + 1 :]
        if (neck := _neck(lower, upper)) is not None
    ]
    return united([*outlines, *necks]) if necks else list(outlines)


def _neck(lower: Any, upper: Any) -> Any | None:
    """Return the rectangle that joins two parts; None where neither is above the other."""
    box, line = (getattr(from_extra("shapely"), name) for name in ("box", "LineString"))
    left, right = max(lower.bounds[0], upper.bounds[0]), min(lower.bounds[2], upper.bounds[2])
    narrower = min(part.bounds[2] - part.bounds[0] for part in (lower, upper))
    if right - left < ABOVE * narrower or upper.bounds[1] < lower.bounds[3]:
        return None
    middle, half = 0.5 * (left + right), 0.5 * WIDTH * (right - left)
    upright = line([(middle, lower.bounds[1]), (middle, upper.bounds[3])])
    begin, end = lower.intersection(upright), upper.intersection(upright)
    if begin.is_empty or end.is_empty:
        return None
    return box(middle - half, begin.bounds[3] - half, middle + half, end.bounds[1] + half)


FONT = "DejaVu Sans"
"""Font that Matplotlib brings with it; bold"""
FONT_SUFFIXES = (".ttf", ".otf", ".ttc")
FINE = 100.0
"""Factor on the size at which Matplotlib divides the curves of letters finely"""


def outlines_of_text(text: str, font: str | None = None) -> list[Any]:
    """Return polygons of Shapely's of a line of text, from left to right, one for each letter with its dot.

    Args:
        font: a file, or the name of a family of the machine's.

    Raises:
        InputError: the text has nothing to be seen, or there is no such font, or it lacks a character.
        MissingExtraError: Matplotlib or Shapely is not installed.
    """
    line = "".join(" " if character.isspace() else character for character in text)
    if not line.strip():
        raise InputError(f"text: has no visible character (got {text!r}); expected letters, or an .svg file")
    properties, face = _font(font)
    for character in line.replace(" ", ""):
        if not face.get_char_index(ord(character)):
            raise InputError(f"text: the font {face.family_name} has no {character!r}; expected another font")
    path = from_extra("matplotlib.path").Path
    paths = from_extra("matplotlib.textpath").TextToPath()
    vertices, codes = paths.get_text_path(properties, line, ismath=False)
    loops = path(FINE * np.asarray(vertices), codes).to_polygons(closed_only=True) if len(vertices) else []
    outlines = with_necks(enclosed([np.asarray(loop) for loop in loops]))
    if not outlines:
        raise InputError(f"text: its characters have no outlines in the font {face.family_name} (got {text!r})")
    return outlines


def _font(font: str | None) -> tuple[Any, Any]:
    """Return a font as Matplotlib asks for it, and its face."""
    manager = from_extra("matplotlib.font_manager")
    path = font or FONT
    is_file = path.lower().endswith(FONT_SUFFIXES)
    if is_file and not Path(path).is_file():
        raise InputError(f"font {path}: no such file")
    try:
        if not is_file:
            wanted = manager.FontProperties(family=path, weight="bold")
            path = str(manager.findfont(wanted, fallback_to_default=False))
        return manager.FontProperties(fname=path), manager.get_font(path)
    except ValueError:
        raise InputError(
            f"font {font}: no such font family; expected an installed one, or a file of {', '.join(FONT_SUFFIXES)}"
        ) from None
    except (RuntimeError, OSError):
        raise InputError(f"font {font}: cannot be read as a font") from None


PARTS_OF_CURVE = 32
"""Number of straight lines that a curve is divided into, between two of its points in the file"""
DAMAGED = (
    ParseError,
    ValueError,
    TypeError,
    AttributeError,
    LookupError,
    ArithmeticError,
    RecursionError,
    AssertionError,
)
"""Errors of svgelements for a file that is not as it expects"""


def outlines_of_drawing(path: Path) -> list[Any]:
    """Return polygons of Shapely's of all closed paths and shapes of a drawing together.

    From left to right, y up, in some unit. Paint does not matter; polygons of one path cut holes into each other by its
    fill rule.

    Raises:
        InputError: the file cannot be read, or has none.
        MissingExtraError: svgelements or Shapely is not installed.
    """
    svg = from_extra("svgelements")
    try:
        shapes = [(list(_closed_loops(svg, shape)), shape.values.get("fill-rule")) for shape in _shapes(svg, path)]
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except DAMAGED:
        raise InputError(f"{path}: is no SVG drawing, or a damaged one") from None
    if not all(np.isfinite(loop).all() for loops, _ in shapes for loop in loops):
        raise InputError(f"{path}: has a coordinate that is not finite")
    outlines = [
        each for loops, rule in shapes for each in enclosed(loops, "evenodd" if rule == "evenodd" else "nonzero")
    ]
    if not outlines:
        raise InputError(f"{path}: has no closed path with an area; expected one (convert text to paths)")
    return united(outlines)


def _shapes(svg: Any, path: Path) -> Iterator[Any]:
    for element in svg.SVG.parse(str(path), reify=True).elements():
        if isinstance(element, svg.Shape):
            yield element


def _closed_loops(svg: Any, shape: Any) -> Iterator[NDArray[np.float64]]:
    """Return the points along each closed path of a shape, shape (count, 2), y up."""
    for part in svg.Path(shape.segments(transformed=True)).as_subpaths():
        segments = [segment for segment in svg.Path(part) if not isinstance(segment, svg.Move)]
        if not segments or not _is_closed(svg, segments):
            continue
        points: list[complex] = []
        for segment in segments:
            straight = isinstance(segment, svg.Line | svg.Close)
            for part_of_one in [1.0] if straight else np.linspace(0.0, 1.0, PARTS_OF_CURVE + 1)[1:]:
                point = segment.end if straight else segment.point(float(part_of_one))
                if point is not None:
                    points.append(complex(point.real, point.imag))
        yield np.array([[point.real, -point.imag] for point in points]).reshape(-1, 2)


def _is_closed(svg: Any, segments: list[Any]) -> bool:
    if isinstance(segments[-1], svg.Close):
        return True
    begin, end = complex(segments[0].start or 0.0), complex(segments[-1].end or 0.0)
    return abs(begin - end) < 1e-9 * (1.0 + abs(end))


SLACK = 0.05
"""Distance of either sheet from the plane of the rim, so that there is an inside [edges]; edges are 0.1% longer"""
DIGITS = 4
"""Number of digits of coordinates after the first of an edge"""


def sewn(sheets: Sequence[Sheet], edge: float, name: str) -> PolygonMesh:
    """Return a closed mesh of two of each of these sheets, back to back, which share the rim's vertices.

    It has y up and faces z.

    Args:
        edge: about how long edges are [m].
    """
    points, quads, count = [], [], 0
    for sheet in sheets:
        inner = np.flatnonzero(~sheet.rim)
        lift = np.where(sheet.rim, 0.0, SLACK * edge)
        front = np.column_stack([sheet.points, lift])
        back = np.arange(len(front))
        back[inner] = len(front) + np.arange(len(inner))
        points += [front, front[inner] * [1.0, 1.0, -1.0]]
        quads += [count + sheet.quads, count + back[sheet.quads[:, ::-1]]]
        count += len(front) + len(inner)
    corners = np.concatenate(quads).astype(np.int32)
    decimals = DIGITS - int(np.floor(np.log10(edge)))
    return PolygonMesh(
        points=np.asarray(np.round(np.concatenate(points), decimals) + 0.0, dtype=np.float64),  # turns -0.0 into 0.0
        face_vertex_counts=np.full(len(corners), 4, dtype=np.int32),
        face_vertex_indices=corners.ravel(),
        name=name,
        unit_known=True,
    )


HEIGHT = 0.35
"""Height [m]"""
EDGES = 32
"""Number of edges in the height, where no edge is given"""
MOST_QUADS = 1_000_000
FINEST = 4
"""Largest number of halvings of an edge, until no part is too narrow for it"""


@checked
def foil_mesh(
    source: str | Path, height: float = HEIGHT, edge: float | None = None, font: str | None = None
) -> PolygonMesh:
    """Make the mesh of a foil balloon that is not inflated yet: two flat sheets of even quads, sewn at the rim.

    Each letter, or part of a drawing, is a component of its own; `foil_parts` has them apart. It stands in the plane of
    x and y, on y = 0, about x = 0.

    Args:
        source: Line of text; or the path of a drawing, an `.svg` file.
        height: Height of the whole [m].
        edge: Approximate edge length [m]; a 32nd of the height, and less where it is narrow, if not given.
        font: Font of text: a file, or a family of the machine's; DejaVu Sans Bold if not given.

    Raises:
        InputError: nothing is drawn, or it cannot be read, or is too narrow for the edge.
        MissingExtraError: a package of the extra `foil` is not installed.
    """
    return sewn(*_sheets(source, height, edge, font))


@checked
def foil_parts(
    source: str | Path, height: float = HEIGHT, edge: float | None = None, font: str | None = None
) -> list[PolygonMesh]:
    """Make a foil mesh for each letter or part of a drawing, as `foil_mesh`.

    They come from left to right, each in its place, so that each can be a balloon of its own.
    """
    sheets, size, name = _sheets(source, height, edge, font)
    return [sewn([sheet], size, f"{name} {number}") for number, sheet in enumerate(sheets, start=1)]


def joined(meshes: Sequence[PolygonMesh], name: str) -> PolygonMesh:
    """Return the parts as one mesh of several components."""
    firsts = np.cumsum([0, *(mesh.vertex_count for mesh in meshes)])[:-1]
    numbers = [mesh.face_vertex_indices + first for mesh, first in zip(meshes, firsts.tolist(), strict=True)]
    return PolygonMesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.face_vertex_counts for mesh in meshes]),
        np.concatenate(numbers).astype(np.int32),
        name,
    )


def _sheets(source: str | Path, height: float, edge: float | None, font: str | None) -> tuple[list[Sheet], float, str]:
    """Make the sheets, and say about how long their edges are [m], and a name."""
    for name, value in (("height", height), ("edge", edge)):
        if value is not None and not (isfinite(value) and value > 0.0):
            raise InputError(f"{name}: must be a number greater than 0 (got {value})")
    is_drawing = Path(source).suffix.lower() == ".svg"
    if is_drawing:
        outlines, name = outlines_of_drawing(Path(source)), Path(source).stem
    else:
        outlines, name = outlines_of_text(str(source), font), str(source)
    outlines = _placed(outlines, height)
    size = edge or height / EDGES
    count = 2.0 * sum(outline.area for outline in outlines) / size**2
    if count > MOST_QUADS:
        raise InputError(
            f"edge: {size:g} m makes {count:.2g} quads; expected at most {MOST_QUADS:,}, with longer edges"
        )
    parts = enumerate(outlines, start=1)
    sheets = [_sheet(outline, size, edge is not None, f"{name}, part {part}") for part, outline in parts]
    return sheets, size, name


def _placed(outlines: list[Any], height: float) -> list[Any]:
    """Return the outlines at the given height, standing on y = 0, about x = 0."""
    shapely = from_extra("shapely")
    left, low, right, high = shapely.total_bounds(outlines)
    scale, origin = height / (high - low), (0.5 * (left + right), low)
    return [shapely.transform(outline, lambda places: (places - origin) * scale) for outline in outlines]


def _sheet(outline: Any, edge: float, as_asked: bool, what: str) -> Sheet:
    """Make a sheet of such edges; of shorter ones if it is too narrow, unless they are asked for."""
    for halvings in range(FINEST + 1):
        finer = edge * 0.5**halvings
        if sheet := sheet_of(outline, finer):
            if halvings and as_asked:
                raise InputError(f"edge: {what} is too narrow for {edge:g} m; expected {finer:g} or less")
            return sheet
    raise InputError(f"{what} is too narrow for even quads; expected a bolder shape, or blunter corners")
