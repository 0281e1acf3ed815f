"""Design of a foil balloon: from a target outline to its pattern, simulated."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.folder import write_picture, write_report
from balloon_warp.designing.measure import Error
from balloon_warp.designing.outline import Part, corrected
from balloon_warp.designing.pattern import outline_picture, write_pattern
from balloon_warp.designing.result import Design
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
CORRECTIONS = 4
GOOD = 0.01
"""Local error over the size above which it is reported"""


@dataclass(frozen=True)
class Foil:
    """All parts of a foil balloon."""

    parts: Sequence[Part]
    size: float
    thickness: float
    device: str | None

    def scene(self, meshes: Sequence[PolygonMesh | Path], areas: Sequence[float]) -> Scene:
        """Return the scene of its parts, each a balloon that a pressure inflates."""
        material = Material(
            kind="neo_hookean", shear_modulus=MODULUS, thickness=self.thickness, density=DENSITY, most_stretch=1.1
        )
        inflation = Inflation(pressure=[(0.0, 0.0), (FILL_SECONDS, PRESSURE)])
        balloons = [
            Balloon(
                mesh=mesh, holes="keep", weld=False, material=material, inflation=inflation, look="foil",
                damping=float(f"{DAMPING_RATE * area * self.thickness * DENSITY:.4g}"),
            )
            for mesh, area in zip(meshes, areas, strict=True)
        ]  # fmt: skip
        return Scene(description="Foil of a wanted outline", balloon=balloons, gravity=0.0, frames=FRAMES)

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
    foil = Foil(_parts(source, size), size, thickness, device)
    patterns = [part.wanted for part in foil.parts]
    best, first = None, None
    for number in range(min(steps, CORRECTIONS) + 1):
        meshes = [part.with_rim(pattern) for part, pattern in zip(foil.parts, patterns, strict=True)]
        points = foil.inflated(foil.scene(meshes, [total_area(mesh) for mesh in meshes]))
        rims = [part.rim_of(each) for part, each in zip(foil.parts, points, strict=True)]
        error = foil.error(rims)
        say(f"correction {number}: {error} of the size")
        first = first or (error, rims)
        if best is None or error.mean < best[0].mean:
            best = error, patterns, meshes, rims, points
        patterns = [corrected(*each) for each in zip(foil.parts, patterns, rims, strict=True)]
    assert best is not None
    assert first is not None
    return _written(foil, best, first, folder)


def _written(foil: Foil, best: tuple, first: tuple, folder: Path) -> Design:
    """Write the best pattern, its scene, picture and report."""
    error, patterns, meshes, rims, points = best
    paths = [folder / f"balloon_{number}.obj" for number in range(1, len(meshes) + 1)]
    for path, mesh in zip(paths, meshes, strict=True):
        write_obj(path, mesh)
    scene = foil.scene(paths, [total_area(mesh) for mesh in meshes])
    write_scene(scene, folder / "balloon.toml")
    loops = [part.loops for part in foil.parts]
    write_pattern(folder / "pattern.svg", patterns, loops)
    wanted = [part.wanted for part in foil.parts]
    lines = {"wanted": wanted, "without design": first[1], "inflated": rims, "pattern": patterns}
    write_picture(folder / "error.png", outline_picture(lines, loops))
    cannot = []
    if error.worst > GOOD:
        cannot.append(f"the rim is {100.0 * error.worst:.2g}% of the size off at its worst place: it wrinkles there")
    design = Design(scene, folder, error, error, first[0], 1.0, cannot, np.concatenate(points))
    write_report(folder / "report.json", {"of": "foil", "size": foil.size, **design.report()})
    return design


def _parts(source: str, size: float) -> list[Part]:
    """Return the flat parts, as large as they are to be when they are inflated."""
    meshes = foil_parts(source, size, size / EDGES)
    points = np.concatenate([mesh.points for mesh in meshes])
    scale = size / np.ptp(points, axis=0)[:2].max()
    middle = 0.5 * (points.max(axis=0) + points.min(axis=0)) * [1.0, 1.0, 0.0]
    return [Part(replace(mesh, points=(mesh.points - middle) * scale)) for mesh in meshes]
