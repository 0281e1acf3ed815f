"""A balloon of the scene as geometry: its mesh placed in the world, and the springs over it. Host side, float64."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.check import check_mesh
from balloon_warp.mesh.geometry import face_areas, total_area
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.placement import place_mesh
from balloon_warp.mesh.prepare import prepared
from balloon_warp.mesh.shells import pushed_outward, there_and_back
from balloon_warp.mesh.size import LEAST_SIZE, require_size
from balloon_warp.mesh.thickness import LEAST, relative_thickness
from balloon_warp.mesh.topology import is_closed, mesh_edges
from balloon_warp.mesh.units import as_told
from balloon_warp.model.fixed import fixed_particles, group_of
from balloon_warp.model.most_pressure import pressure_bound
from balloon_warp.model.neck import NO_NECK, Neck, neck_of
from balloon_warp.model.slack_remarks import about_slack
from balloon_warp.model.strung import constants_of, spring_sums, strung
from balloon_warp.model.told_shape import rest_shape, sewn_vertices, springs_told
from balloon_warp.scene import Balloon, Material, Scene, Stiffness
from balloon_warp.springs import SpringKind, Springs
from balloon_warp.springs.hinges import Hinges, build_hinges
from balloon_warp.springs.membrane import Membrane, build_membrane, no_membrane
from balloon_warp.springs.ties import balloon_springs


@dataclass(frozen=True)
class BalloonShape:
    """Shape of a balloon at the start."""

    name: str
    mesh: PolygonMesh
    """Mesh in the world: meters, the scene's up axis, placed"""
    springs: Springs
    stiffness_scale: NDArray[np.float64]
    """Spring constants over those of their kinds, shape (spring_count,)"""
    softness: NDArray[np.float64]
    """Factor of `stiffness_scale` that softens thin parts, shape (spring_count,); 1 elsewhere"""
    evenness: NDArray[np.float64]
    """Factor of `stiffness_scale` that makes the skin even, shape (spring_count,); 1 where it is not"""
    across: NDArray[np.bool_] | None
    """Mask of springs across thin parts, shape (spring_count,); None where thin parts are not tied"""
    mass_share: NDArray[np.float64]
    """Share of each particle in the balloon's mass, shape (particle_count,); 0 for a fixed particle"""
    membrane: Membrane
    """Membrane of rubber or film, with the weights' thickness, so that its areas are those at the balloon's thickness;
    empty for a balloon of springs"""
    slack: NDArray[np.bool_]
    """Faces that a pressure does not push, since both of their sides are on the same side of the balloon, or nothing
    holds them; shape (face_count,)"""
    resting: PolygonMesh
    """Stress-free shape [m]: the mesh itself, or another, which may be cut into panels"""
    neck: Neck = NO_NECK
    """Neck of the balloon"""
    remarks: tuple[str, ...] = ()
    """Warnings on the shape, besides those on its mesh, in sentences"""

    @cached_property
    def hinges(self) -> Hinges:
        """Hinges of the mesh, where torsion springs act."""
        return build_hinges(self.mesh)

    @cached_property
    def area(self) -> float:
        """Area of the surface at the start [m^2]."""
        return total_area(self.mesh)

    @cached_property
    def pressure_bound(self) -> float:
        """Largest gauge pressure of a gas, over the balloon's mass and times the step squared [1/m]."""
        return pressure_bound(self.skin, self.mass_share)

    @property
    def warnings(self) -> list[str]:
        """Warnings on the balloon and its treatment, in sentences that begin with its name."""
        return [f"{self.name}: {warning}" for warning in (*self.mesh.warnings, *self.remarks)]

    @cached_property
    def closed(self) -> bool:
        """Return whether no edge of the mesh is on a border."""
        return is_closed(mesh_edges(self.mesh))

    @property
    def encloses(self) -> bool:
        """Return whether the faces that a pressure pushes go all around something, beside fins and open parts."""
        return not self.flies_off and is_closed(mesh_edges(self.skin))

    @property
    def inflated(self) -> bool:
        """Return whether a pressure pushes most of the surface."""
        return bool(face_areas(self.mesh)[self.slack].sum() < 0.5 * self.area)

    @property
    def flies_off(self) -> bool:
        """Return whether a pressure would drive the balloon away: its mesh is open and not pinned."""
        return bool(self.slack.all())

    @cached_property
    def skin(self) -> PolygonMesh:
        """The faces as kernels have them: those that are slack have no area, where others are not slack."""
        return self.mesh if self.flies_off else there_and_back(self.mesh, self.slack)


def shape_balloon(balloon: Balloon, scene: Scene, *, as_soft_as_can_be: bool = False) -> BalloonShape:
    """Read, repair, place and string the balloon's mesh.

    Args:
        as_soft_as_can_be: takes all of it for thin where thin parts are softer. That saves most of the time where only
            its size matters; a step that is stable is so for it, too.

    Raises:
        InputError: the mesh cannot be read or has no face, its size or place is too much for float32, a fixed
            particle is not in it, or its weights are not as many as its vertices.
    """
    mesh, source = _mesh_of(balloon)
    told = as_told(mesh, balloon.unit, balloon.up)
    placed = place_mesh(told, scene.up_axis, balloon.scale, balloon.rotation, balloon.position)
    require_size(placed, source)
    placed = replace(placed, name=balloon.name or mesh.name)
    placed, slack = _pushed(placed, balloon)
    material = balloon.material
    beside = [SpringKind[kind.upper()] for kind in material.springs] if material.is_membrane else list(SpringKind)
    resting = rest_shape(balloon, placed, told.meters_per_unit * balloon.scale)
    springs = balloon_springs(placed, balloon.parts, beside)
    if material.rest_mesh:
        springs = springs.resting_at(resting.points)
    membrane = _membrane(resting, placed, material) if material.is_membrane else no_membrane()
    if balloon.springs:
        if material.is_membrane:
            raise InputError(f'springs: {balloon.springs} needs material.kind = "springs" (got "{material.law}")')
        unit, across = told.meters_per_unit * balloon.scale, None
        springs, scale = springs_told(balloon.springs, springs, placed, constants_of(balloon.stiffness), unit)
    else:
        springs, scale, across = strung(placed, springs, balloon)
    if balloon.stiffness.thin != "softer" or balloon.springs:
        softness = np.ones(springs.count)
    else:
        softness = np.full(springs.count, LEAST) if as_soft_as_can_be else _softness(placed, springs)
    stiffness_scale = scale * softness * _stiffness_scale(placed, springs, balloon.stiffness)
    stiffness_sums = spring_sums(placed, springs, stiffness_scale, balloon.stiffness)
    mass_share = _mass_shares(placed, balloon, membrane, stiffness_sums)
    shape = BalloonShape(
        name=placed.name,
        mesh=placed,
        springs=springs,
        stiffness_scale=stiffness_scale,
        softness=softness,
        evenness=scale,
        across=across,
        mass_share=mass_share,
        membrane=membrane,
        slack=slack,
        resting=resting,
        neck=neck_of(balloon.neck.at, placed, mass_share, np.array(scene.up)) if balloon.neck else NO_NECK,
    )
    return replace(shape, remarks=about_slack(placed, slack, mass_share > 0.0))


def _pushed(mesh: PolygonMesh, balloon: Balloon) -> tuple[PolygonMesh, NDArray[np.bool_]]:
    """Return the mesh with pushed faces outward, and the mask of those that a pressure does not push.

    All are pushed by inflations other than pressure, by a given pressure where nothing has an inside, and where holes
    are torn, which kernels know of.
    """
    nothing = np.zeros(mesh.face_count, dtype=bool)
    if balloon.inflation.kind != "pressure" or mesh.face_vertex_counts.max() == 2:
        return mesh, nothing
    held = np.zeros(mesh.vertex_count, dtype=bool)
    held[[mesh.stand_in(particle) for particle in fixed_particles(balloon.fixed, mesh)]] = True
    mesh, slack = pushed_outward(mesh, held)
    pushed = not balloon.inflation.is_automatic if slack.all() else balloon.material.strength is not None
    return mesh, nothing if pushed else slack


def _stiffness_scale(mesh: PolygonMesh, springs: Springs, stiffness: Stiffness) -> NDArray[np.float64]:
    """Return each spring's constant over that of its kind: drawn, and changing along an axis."""
    along = mesh.points[:, "XYZ".index(stiffness.gradient_axis)]
    used = along[mesh.face_vertex_indices]
    lowest, size = used.min(), max(float(np.ptp(used)), LEAST_SIZE)
    place = (along[springs.pairs].mean(axis=1) - lowest) / size
    low, high = stiffness.gradient
    weights = vertex_weights(mesh, stiffness.weights, "stiffness.weights")[springs.pairs].mean(axis=1)
    return _drawn(springs, stiffness) * (low + (high - low) * place) * weights


def _drawn(springs: Springs, stiffness: Stiffness) -> NDArray[np.float64]:
    """Return the random factor on each spring's constant.

    Without variation NumPy's generators need not load.
    """
    if not stiffness.variation:
        return np.ones(springs.count)
    return 1.0 + stiffness.variation * np.random.default_rng(stiffness.seed).uniform(-1.0, 1.0, springs.count)


def _membrane(resting: PolygonMesh, mesh: PolygonMesh, material: Material) -> Membrane:
    """Return the membrane, with the vertices' thickness, stress-free in a shape that may consist of panels.

    Raises:
        InputError: the mesh has no triangle.
    """
    membrane = build_membrane(resting)
    if not membrane.count:
        raise InputError(
            f"material: {mesh.name} has no face with an area, which {material.law.replace('_', '-')} material needs; "
            'expected one, or kind = "springs"'
        )
    if resting.vertex_count != mesh.vertex_count:
        membrane = replace(membrane, corners=sewn_vertices(resting, mesh, material.rest_mesh)[membrane.corners])
    weights = vertex_weights(mesh, material.weights, "material.weights")
    return replace(membrane, areas=membrane.areas * weights[membrane.corners].mean(axis=1))


def _softness(mesh: PolygonMesh, springs: Springs) -> NDArray[np.float64]:
    """Return the softness of each spring, from the balloon's thickness at its ends."""
    return relative_thickness(mesh)[springs.pairs].mean(axis=1)


def vertex_weights(mesh: PolygonMesh, said: object, field: str) -> NDArray[np.float64]:
    """Return a field's value at each vertex: 1 where it has none."""
    weights = np.ones(mesh.vertex_count)
    if said is None:
        return weights
    if isinstance(said, dict):
        for name, weight in said.items():
            weights[group_of(mesh, name, field)] = weight
        return weights
    assert isinstance(said, list)  # a balloon's are no function
    if len(said) != mesh.vertex_count:
        raise InputError(
            f"{field}: {mesh.name} has {mesh.vertex_count} vertices; expected a number for each (got {len(said)})"
        )
    return np.array(said, dtype=np.float64)


def _mesh_of(balloon: Balloon) -> tuple[PolygonMesh, object]:
    """Return the balloon's mesh as it is simulated, with warnings of its defects, and its source."""
    if isinstance(balloon.mesh, Path):
        mesh, source = load_mesh(balloon.mesh, balloon.prim), balloon.mesh
    else:
        if balloon.prim is not None:
            raise InputError(f"balloon.prim {balloon.prim}: selects an object of a file; expected a file as mesh")
        mesh, source = balloon.mesh, balloon.mesh.name
        check_mesh(mesh, source, least_corners=2)
    if balloon.print is not None:
        if not balloon.print.is_file():
            raise InputError(f"{balloon.print}: no such file; expected an image to print on {mesh.name}")
        if mesh.texture_coordinates is None:
            raise InputError(f"{source}: has no texture coordinates to print {balloon.print.name} by")
    return prepared(mesh, source, balloon.treatment), source


def _mass_shares(
    mesh: PolygonMesh, balloon: Balloon, membrane: Membrane, stiffness_sums: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the mass shares of particles.

    Equal shares for moving particles: those of a face, and not fixed; or, where springs are even, in proportion to the
    given sums. For rubber and film, the shares of its volume, of which fixed particles keep theirs.
    """
    moves = np.zeros(mesh.vertex_count, dtype=bool)
    moves[mesh.face_vertex_indices] = True
    for particle in fixed_particles(balloon.fixed, mesh):
        moves[mesh.stand_in(particle)] = False
    if membrane.count:
        return np.where(moves, membrane.lumps(mesh.vertex_count), 0.0) / membrane.areas.sum()
    shares = np.where(moves, stiffness_sums if balloon.stiffness.even else 1.0, 0.0)
    return shares / max(shares.sum(), 1e-30)
