"""The picture of a design: the wanted shape, and those that result from the design and its rival, error as color."""

import io
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.comparison.sheet import Tile, compose_sheet
from balloon_warp.designing.measure import Ruler
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.looks import Looks
from balloon_warp.scene import Balloon, Scene
from balloon_warp.simulator import Simulator

Values = NDArray[np.float64]
SIZE = (480, 420)
FULL = 0.02
"""Error over the size from which on the color is the last"""
BANDS = np.array([[0.10, 0.42, 0.62], [0.55, 0.75, 0.72], [0.95, 0.85, 0.45], [0.85, 0.35, 0.12], [0.45, 0.02, 0.08]])
"""Linear RGB from zero error to `FULL`"""
SAMPLES = 4


def error_picture(
    ruler: Ruler, shapes: Sequence[tuple[str, Values]], plain: Sequence[tuple[str, Values]] = ()
) -> Image.Image:
    """Draw the wanted shape and others beside it, each colored by how far it is off.

    Args:
        ruler: of the wanted shape.
        shapes: label above each, and its points, shape (n, 3).
        plain: the same of shapes that are drawn as they are, as large as the wanted one.
    """
    tiles = [Tile(["wanted"], _drawn(ruler, ruler.mesh.points, None), "")]
    for label, points in plain:
        larger = points * (ruler.size / float(np.ptp(points, axis=0).max()))
        tiles.append(Tile([label], _drawn(ruler, larger, None), ""))
    for label, points in shapes:
        off = ruler.distances(points)[: len(points)]
        line = f"{ruler.error(points)}; blue 0, red {100.0 * FULL:g}% and more"
        tiles.append(Tile([label, line], _drawn(ruler, points, off), ""))
    return Image.fromarray(compose_sheet(tiles, len(tiles), SIZE))


def colored(mesh: PolygonMesh, off: Values) -> PolygonMesh:
    """Return the mesh with the color of each vertex's error, a fraction of the size, shape (n,)."""
    colors = linear_colors(off)
    none = np.full(len(mesh.face_vertex_indices), -1, dtype=np.int32)
    return replace(mesh, looks=Looks((), none, colors[mesh.face_vertex_indices].astype(np.float32)))


def linear_colors(off: Values) -> Values:
    """Return the color of each error, linear RGB, shape (n, 3)."""
    place = np.clip(off / FULL, 0.0, 1.0) * (len(BANDS) - 1)
    return np.stack([np.interp(place, np.arange(len(BANDS)), band) for band in BANDS.T], axis=1)


def error_colors(off: Values) -> Values:
    """Return the color of each error in sRGB, shape (n, 3)."""
    linear = linear_colors(off)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1.0 / 2.4) - 0.055)


def stacked(above: Image.Image, below: Image.Image) -> Image.Image:
    """Stack one picture above another of the same width."""
    height = round(below.height * above.width / below.width)
    image = Image.new("RGB", (above.width, above.height + height), (255, 255, 255))
    image.paste(above, (0, 0))
    image.paste(below.resize((above.width, height), Image.Resampling.LANCZOS), (0, above.height))
    return image


def _drawn(ruler: Ruler, points: Values, off: Values | None) -> NDArray[np.uint8]:
    mesh = replace(ruler.mesh, points=ruler.aligned(points))
    if off is not None:
        mesh = colored(mesh, off)
    balloon = Balloon(mesh=mesh, parts="free", holes="keep", weld=False)
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, touch=False), "cpu")
    with Image.open(io.BytesIO(simulator.picture(size=SIZE, samples=SAMPLES))) as image:
        return np.asarray(image.convert("RGB"))
