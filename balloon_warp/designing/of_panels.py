"""Design of a foil balloon of panels: from a target shape to its sewn panels, simulated.

Panels laid flat lose the double curvature of a surface, and the film between seams bulges. So the shape that is laid
flat is corrected by the error of the simulated balloon, a few times.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.designing.flatten import flattened, seam_lengths
from balloon_warp.designing.gores import gores_of
from balloon_warp.designing.job import Job
from balloon_warp.designing.panel_layout import laid_out
from balloon_warp.designing.panel_pattern import PanelPattern
from balloon_warp.designing.panels import Panels, cut_into_panels
from balloon_warp.designing.proof import MORE_FRAMES, SLOW_FOIL, common_fields, scene_of, simulate_from_rest
from balloon_warp.designing.result import Design
from balloon_warp.designing.seams import seams_of
from balloon_warp.designing.step import DesignStep
from balloon_warp.designing.target import centered, require_size, shape_of
from balloon_warp.errors import InputError
from balloon_warp.files import whole_file
from balloon_warp.mesh.from_python import MeshLike
from balloon_warp.mesh.geometry import total_area
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.mesh.uncrossed import means_over_neighbors
from balloon_warp.scene import Balloon, Inflation, Material, Scene

Values = NDArray[np.float64]
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
        scene, tried.points, tried.plain, _stretch(panels, flat), rival="laid flat without corrections",
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
