"""Film of a lower modulus: as low as lets it stretch by a bound on the strain at the pressure that a scene plans.

Real film hardly stretches, and its modulus makes short steps: a letter of foil takes thousands in a frame, by which
nothing changes that one sees. Ten times as soft in frequency it takes a tenth of them.
"""

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.membrane import SHEAR_MODULUS
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    corner_faces,
    face_vector_areas,
    mesh_edges,
    signed_volume,
    total_area,
    vertex_areas,
)
from balloon_warp.model.parameters import KEYFRAME_VALUES, Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.timeline import DueChange
from balloon_warp.scene import Scene

Values = NDArray[np.float64]
YOUNG = 3.0
"""Young's modulus of an incompressible material over its shear modulus"""
FLAT = 0.02
"""Volume over area^(3/2) below which a mesh counts as flat: 0.094 for a sphere"""
RIM = -0.7
"""Cosine between the normals of two faces at an edge below which a flat sheet is sewn, or folded, there"""
FILLED = 1.22
"""Volume of a flat sheet once it is inflated, over the integral of the distance from the rim over one of its sides:
within 5% of 4 / pi for a strip, which becomes a cylinder, and of 1.16 for a disc, the mylar balloon (Paulsen 1994)"""
CUT = 1.3
"""Part by which softer film is cut smaller, over the bound on its strain: without, volumes grow by 0.9 to 2.4 times
three bounds, those of an I and of an &"""
FILL_TO_PRESSURE = "fill_to_pressure"
"""Name of the pressure at which a gas is filled in no further"""
OVER = 1.05
"""Mean strain over its bound from which on a run says so"""


@dataclass(frozen=True)
class BoundedFilm:
    """Film of a balloon whose modulus is lower than the material's, in the first world."""

    number: int
    """Index of the balloon in the scene"""
    balloon: str
    """Name of the balloon"""
    material: str
    """Name of the preset; "film" without one"""
    strain_bound: float
    """Mean strain at the planned pressure [1]"""
    pressure: float
    """Largest pressure that the scene plans [Pa]"""
    modulus: float
    """Young's modulus [Pa]"""
    exact_modulus: float
    """Young's modulus of the material [Pa]"""


@dataclass(frozen=True)
class StrainBound:
    """Films with a modulus of a bound on their strain, and the substeps with and without it."""

    films: tuple[BoundedFilm, ...]
    substeps: int
    """Number of substeps of a frame"""
    exact_substeps: int | None
    """Number of substeps that the materials' own moduli need; None where the scene says how many there are"""

    def __str__(self) -> str:
        most = max(self.films, key=lambda film: film.modulus)
        others = len(self.films) - 1
        alike = f" (and {others} more like it)" if others else ""
        moduli = f"modulus {_in_units(most.modulus)} instead of {_in_units(most.exact_modulus)}"
        spared = f", {self.substeps:,} substeps instead of {self.exact_substeps:,}" if self.exact_substeps else ""
        stretch = f"stretches by at most {100.0 * most.strain_bound:.2g}% on average at {most.pressure:.4g} Pa"
        return f"{most.material}{alike}: {stretch}: {moduli}{spared}"


def bounded_moduli(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    parameters: Parameters,
    changes: Sequence[DueChange],
    varied: Collection[str] = (),
) -> Values:
    """Return shear moduli of all balloons [Pa], shape (W, balloon_count), of film no higher than its bound asks for.

    By the virial theorem the sum of both principal stresses is 3 p V over the volume of the film itself, on average
    over the film, whatever its shape and its wrinkles. No principal strain exceeds that sum over E. So it is the bound
    on average where E = 3 p V / (A h bound), or p R / (2 h bound) with a radius R = 6 V / A: twice that of a sphere.
    The stress by which a film bears its own weight, hung by an end, is added.

    Args:
        varied: paths of values that differ between worlds: a modulus among them stays, unless a bound is asked for.

    Raises:
        InputError: a bound is asked for where no pressure is planned, or the balloon has no inside.
    """
    moduli = parameters[SHEAR_MODULUS.name]
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        bound = balloon.material.bound_on_strain
        told = balloon.material.strain_bound is None and any(path.endswith(SHEAR_MODULUS.path) for path in varied)
        if bound is None or told or not _has_plan(scene, shape, parameters, number):
            continue
        pressure = _planned_pressure(scene, parameters, changes, number)
        film = parameters["thickness"][:, number] * shape.membrane.areas.sum()
        stress = 3.0 * pressure * inflated_volume(shape) / film + _stress_of_weight(scene, shape, parameters, number)
        least = stress / (YOUNG * bound)
        own = np.where(pressure > 0.0, np.minimum(moduli[:, number], least), moduli[:, number])
        moduli = np.broadcast_to(moduli, (max(len(moduli), len(own)), moduli.shape[1])).copy()
        moduli[:, number] = own
    return moduli


def cut_to_size(
    scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters, exact: Values
) -> list[BalloonShape]:
    """Return shapes in which softer film is smaller, so that at the planned pressure it has the size of its own.

    Film that hardly stretches has a volume that grows by twice its energy over its pressure and volume, as it gets
    softer: by 3 strains, if all of it bears the same stress one way, and by more where stress gathers in lines.

    Args:
        exact: shear moduli as the scene says them [Pa].
    """
    cut = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        softer = 1.0 - float((parameters[SHEAR_MODULUS.name][:, number] / exact[:, number]).max())
        part, already = CUT * softer * (balloon.material.bound_on_strain or 0.0), shape.membrane.cut
        if part != already:
            center, scale = shape.mesh.points.mean(axis=0), (1.0 - part) / (1.0 - already)
            mesh = replace(shape.mesh, points=center + scale * (shape.mesh.points - center))
            shape = replace(shape, mesh=mesh, membrane=shape.membrane.cut_by(part))
        cut.append(shape)
    return cut


def bounded_films(
    scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters, exact: Values, changes: Sequence[DueChange]
) -> tuple[BoundedFilm, ...]:
    """Return the films of the first world that have less than their own modulus.

    Args:
        exact: shear moduli as the scene says them [Pa].
    """
    films = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        modulus, own = float(parameters[SHEAR_MODULUS.name][0, number]), float(exact[0, number])
        bound = balloon.material.bound_on_strain
        if bound is not None and modulus < own:
            pressure = float(_planned_pressure(scene, parameters, changes, number)[0])
            material = balloon.material.preset or "film"
            films.append(BoundedFilm(number, shape.name, material, bound, pressure, YOUNG * modulus, YOUNG * own))
    return tuple(films)


def inflated_volume(shape: BalloonShape) -> float:
    """Return about the volume of a balloon of film once it is inflated [m^3].

    That of its mesh; or, of a flat sheet sewn at its rim, by how far its inside is from there; or of a sheet that is
    folded up the most that its area can enclose, that of a sphere.
    """
    mesh, own = shape.mesh, (1.0 - shape.membrane.cut) ** -3  # the size that it has before it is cut
    area, volume = total_area(mesh), abs(signed_volume(mesh))
    if volume > FLAT * area**1.5:
        return own * volume
    rim = _rim(mesh)
    from balloon_warp.model.touch import is_stacked  # both load SciPy

    if not len(rim) or is_stacked(mesh):
        return float(shape.membrane.areas.sum() ** 1.5 / (6.0 * np.sqrt(np.pi)))
    from scipy.spatial import KDTree

    distances, _ = KDTree(mesh.points[rim]).query(mesh.points)
    return own * max(volume, FILLED * 0.5 * float(distances @ vertex_areas(mesh)))


def mean_strain(shape: BalloonShape, points: Values) -> float:
    """Return how much a film is stretched, the more stretched way, on average over it; slack film not at all [1].

    Args:
        points: of the balloon's particles [m], shape (particle_count, 3).
    """
    corners = points[shape.membrane.corners]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    inverse = shape.membrane.rests
    a, b, c = (np.einsum("ij,ij->i", *pair) for pair in ((first, first), (first, second), (second, second)))
    trace = inverse[:, 0] * a + 2.0 * inverse[:, 1] * b + inverse[:, 2] * c
    determinant = (a * c - b * b) * (inverse[:, 0] * inverse[:, 2] - inverse[:, 1] ** 2)
    half = 0.5 * trace
    larger = np.sqrt(half + np.sqrt(np.maximum(half * half - determinant, 0.0)))
    return float(np.average(np.maximum(larger - 1.0, 0.0), weights=shape.membrane.areas))


class HasFilm(Protocol):
    """A plan, or a model, whose film may have a bound."""

    @property
    def strain_bound(self) -> StrainBound | None:
        """Films that have less than their own modulus, if there are any."""
        ...

    @property
    def shapes(self) -> list[BalloonShape]:
        """Shapes of the balloons."""
        ...


def strain_bound_sentence(plan: HasFilm) -> str | None:
    """Return a sentence on film that is softer than its material; None without such film."""
    return str(plan.strain_bound) if plan.strain_bound else None


def strain_bound_described(plan: HasFilm) -> dict[str, dict[str, Any]]:
    """Return a table for each film that is softer than its material, by its balloon, as JSON and stages have them."""
    films = plan.strain_bound.films if plan.strain_bound else ()
    return {
        f"balloon.{film.number}": {name: value for name, value in asdict(film).items() if name != "number"}
        for film in films
    }


def overstretched_films(plan: HasFilm, points: Sequence[NDArray[np.floating]]) -> list[str]:
    """Return a sentence for each film that is stretched beyond its bound, and by how much.

    Args:
        points: of each balloon's particles [m], shape (particle_count, 3).
    """
    said = []
    for film in plan.strain_bound.films if plan.strain_bound else ():
        strain = mean_strain(plan.shapes[film.number], points[film.number].astype(np.float64))
        if strain > OVER * film.strain_bound:
            said.append(
                f"{film.balloon}: is stretched by {100.0 * strain:.2g}% on average, and not at most by "
                f"{100.0 * film.strain_bound:.2g}%, since more than the planned {film.pressure:.4g} Pa pulls it; "
                "material.exact = true, or a smaller strain_bound, helps"
            )
    return said


def _has_plan(scene: Scene, shape: BalloonShape, parameters: Parameters, number: int) -> bool:
    """Return whether a scene plans the pressure within a balloon.

    Raises:
        InputError: it does not, and asks for a bound.
    """
    balloon = scene.balloon[number]
    kind = balloon.inflation.kind
    lacks = ""
    if kind == "gas" and not (_ends_filling(scene, parameters, number) > 0.0).all():
        lacks = 'a planned pressure (got inflation.kind = "gas" without fill_to_pressure and pump_curve)'
    elif kind == "normal_force":
        lacks = f'a planned pressure (got inflation.kind = "{kind}")'
    if not shape.encloses:
        lacks = "a closed balloon (got an open mesh)"
    if lacks and balloon.material.strain_bound is not None:
        raise InputError(f"balloon.{number}.material.strain_bound: needs {lacks}; expected none, or exact = true")
    return not lacks


def _stress_of_weight(scene: Scene, shape: BalloonShape, parameters: Parameters, number: int) -> Values:
    """Return the stress of a film that hangs by its highest end [Pa], shape (W,)."""
    height = float(np.ptp(shape.mesh.points @ np.asarray(scene.up))) / (1.0 - shape.membrane.cut)
    return parameters["initial_density"][:, number] * abs(scene.gravity) * height


def _planned_pressure(scene: Scene, parameters: Parameters, changes: Sequence[DueChange], number: int) -> Values:
    """Return the largest pressure at any keyframe, or up to which gas is filled in, at any time [Pa], shape (W,)."""
    of_gas = scene.balloon[number].inflation.kind == "gas"
    name = FILL_TO_PRESSURE if of_gas else KEYFRAME_VALUES.name
    most = _ends_filling(scene, parameters, number) if of_gas else parameters[name][:, number].max(axis=-1)
    for change in changes:
        if name in change.values:
            which, values = change.values[name]
            most = np.maximum(most, np.where(which[number], values[number], -np.inf).max())
    return most


def _ends_filling(scene: Scene, parameters: Parameters, number: int) -> Values:
    """Return the pressure at which no more gas is filled in, 0 where there is none [Pa], shape (W,)."""
    curve = scene.balloon[number].inflation.pump_curve
    said = parameters[FILL_TO_PRESSURE][:, number]
    return np.where(said > 0.0, said, curve[-1][0] if curve else 0.0)


def _rim(mesh: PolygonMesh) -> NDArray[np.integer]:
    """Return the vertices at edges where two faces lie on each other."""
    edges = mesh_edges(mesh)
    first = edges.starts[edges.face_counts == 2]
    faces = corner_faces(mesh)[edges.corners]
    areas = face_vector_areas(mesh)
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), np.finfo(float).tiny)
    folded = np.einsum("ij,ij->i", normals[faces[first]], normals[faces[first + 1]]) < RIM
    return np.unique(edges.ends[edges.face_counts == 2][folded])


def _in_units(pascals: float) -> str:
    """Return a modulus in two digits, with its unit."""
    for unit, size in (("GPa", 1.0e9), ("MPa", 1.0e6), ("kPa", 1.0e3)):
        if pascals >= size:
            return f"{float(f'{pascals / size:.2g}'):g} {unit}"
    return f"{pascals:.2g} Pa"
