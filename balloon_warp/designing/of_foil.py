"""Design of a foil balloon: from a target outline to its pattern, simulated."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.folder import REPORT, SCENE, write_picture, write_report
from balloon_warp.designing.measure import Error
from balloon_warp.designing.outline import Part, corrected
from balloon_warp.designing.pattern import outline_picture, write_pattern
from balloon_warp.designing.result import Design
from balloon_warp.designing.target import require_size
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.foil.make import foil_parts
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import total_area
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.scene.write import write_scene
from balloon_warp.simulator import Simulator

Values = NDArray[np.float64]
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
