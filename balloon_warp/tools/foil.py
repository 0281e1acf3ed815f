"""Foil balloons: two flat sheets of quads with one outline, sewn at the rim.

An outline comes from letters (`letters`) or a drawing (`drawing`), as polygons of Shapely's (`outlines`). Each becomes
a sheet of even quads (`sheet`), of the squares of a grid (`grid`) and a row of quads around them (`rim`); two sheets
are sewn (`sew`), and `make` does all of it. The package needs the extra `foil`, which loads on demand.

Foil balloons of letters and drawings: two sheets, sewn at their rims.
"""

from collections.abc import Iterator, Sequence
from importlib import import_module
from math import isfinite
from pathlib import Path
from typing import Any, Literal
from xml.etree.ElementTree import ParseError

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.system.arguments import checked
from balloon_warp.tools.sheet import Sheet, sheet_of

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
