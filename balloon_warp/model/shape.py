"""The particles of a balloon that do not move, from the scene's numbers and groups.

Necks of balloons: the faces that close them in the mesh, and the particles that take the thrust.

Sentences on faces that a pressure does not push, with remedies.

A balloon of the scene as geometry: its mesh placed in the world, the springs over it, and files beside it.
"""

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import check_mesh
from balloon_warp.mesh.load import load_mesh, place_mesh, prepared
from balloon_warp.mesh.orientation import pushed_outward, there_and_back
from balloon_warp.mesh.polygon_mesh import with_unit_and_up
from balloon_warp.mesh.thickness import LEAST, RIBBONS, relative_thickness
from balloon_warp.mesh.topology import (
    LEAST_SIZE,
    border_edges,
    component_labels,
    corner_faces,
    face_areas,
    face_starts,
    face_volumes,
    is_closed,
    mesh_edges,
    next_corners,
    require_size,
    total_area,
    vertex_areas,
    vertex_components,
)
from balloon_warp.model.spectrum import pressure_bound
from balloon_warp.scene import Balloon, Material, Scene, Stiffness
from balloon_warp.springs import Springs
from balloon_warp.springs.build import Hinges, Membrane, SpringKind, build_hinges, build_membrane, no_membrane
from balloon_warp.springs.even import AT, balloon_springs, even_scales, film_tension, springs_across

MOST_NAMED = 20
"""Largest number of groups that an error lists"""


def fixed_particles(fixed: Sequence[int | str], mesh: PolygonMesh) -> list[int]:
    """Return the numbers of particles, including those of groups.

    Raises:
        InputError: the mesh has no such particle or group.
    """
    return particles_named(fixed, mesh, "fixed")


def particles_named(named: Sequence[int | str], mesh: PolygonMesh, field: str) -> list[int]:
    """Return the numbers of particles, including those of groups, that a field names.

    Raises:
        InputError: the mesh has no such particle or group.
    """
    particles: list[int] = []
    for each in named:
        if isinstance(each, int):
            if each >= mesh.vertex_count:
                raise InputError(f"{field}: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {each})")
            particles.append(each)
        else:
            particles += group_of(mesh, each, field).tolist()
    return particles


def group_of(mesh: PolygonMesh, name: str, field: str) -> NDArray[np.int32]:
    """Return the particles of a group of the mesh.

    Args:
        field: that names it.

    Raises:
        InputError: there is no such group.
    """
    if name in mesh.groups:
        return mesh.groups[name]
    known = ", ".join(list(mesh.groups)[:MOST_NAMED]) or "none"
    raise InputError(f"{field}: {mesh.name} has no group {name[:60]}; it has {known}")


class Neck(NamedTuple):
    """Neck of one balloon, whose particles are numbered within it."""

    edges: NDArray[np.int64]
    """Edges around the neck, in the order of the faces that close it, shape (n, 2); none if there is no neck"""
    weights: NDArray[np.float64]
    """Share of each particle in the thrust, by its mass among all moving particles at the neck, shape
    (particle_count,)"""


NO_NECK = Neck(np.zeros((0, 2), dtype=np.int64), np.zeros(0))


def neck_of(at: int | str, mesh: PolygonMesh, mass_share: NDArray[np.float64], up: NDArray[np.float64]) -> Neck:
    """Return the neck at a particle, or at the faces of a group.

    Args:
        at: the particle by the order of the file's vertices, "lowest" or "highest", or the group's name.
        mass_share: each particle's part of the balloon's mass.

    Raises:
        InputError: the mesh has no such particle, group, or faces there; or they are all of it.
    """
    faces = corner_faces(mesh)
    closing = _faces_at(at, mesh, up)
    corners = np.flatnonzero(closing[faces])
    if not len(corners):
        raise InputError(f"neck.at: {mesh.name} has no face at {at}; expected a vertex of a face, or a group of faces")
    begins = mesh.face_vertex_indices.astype(np.int64)
    edges = np.stack([begins, begins[next_corners(mesh)]], axis=1)[corners]
    keys, opposite = (edges @ [mesh.vertex_count, 1], edges @ [1, mesh.vertex_count])
    around = edges[~np.isin(keys, opposite)]
    if not len(around):
        raise InputError(f"neck.at: {at} covers all of {mesh.name}; expected a part")
    weights = np.zeros(mesh.vertex_count)
    particles = np.unique(begins[corners])
    weights[particles] = mass_share[particles]
    return Neck(around, weights / max(weights.sum(), np.finfo(float).tiny))


def _faces_at(at: int | str, mesh: PolygonMesh, up: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return a mask of the faces around a particle, or with all corners in a group, shape (face_count,)."""
    faces = corner_faces(mesh)
    inside = np.zeros(mesh.vertex_count, dtype=bool)
    if isinstance(at, str) and at not in ("lowest", "highest"):
        inside[group_of(mesh, at, "neck.at")] = True
        return np.bincount(faces, ~inside[mesh.face_vertex_indices], mesh.face_count) == 0
    if isinstance(at, str):
        used = np.unique(mesh.face_vertex_indices)
        heights = mesh.points[used] @ up
        at = int(used[heights.argmax() if at == "highest" else heights.argmin()])
    elif at >= mesh.vertex_count:
        raise InputError(f"neck.at: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {at})")
    inside[mesh.stand_in(at)] = True
    return np.bincount(faces, inside[mesh.face_vertex_indices], mesh.face_count) > 0


NOTHING_HELD = (
    "Not inflated: the mesh is open and its border is not pinned, so it would fly away. {} "
    "--set balloon.inflation.pressure=100."
)
CLOSES = "Close it by `balloon-warp remesh`, pin the border by `fixed`, or give a pressure:"
HOLDS = "Pin the border by `fixed`, or give a pressure:"
NO_INSIDE = (
    "Not inflated: no face lies between an inside and an outside, as on a Moebius strip. `balloon-warp remesh` makes "
    "a closed surface of it; or give a pressure, such as --set balloon.inflation.pressure=100, which pushes each face "
    "along its normal."
)


def about_slack(mesh: PolygonMesh, slack: NDArray[np.bool_], moves: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return sentences on open parts that are carried along, and on walls; or one on a balloon without inflation.

    Args:
        slack: Faces that a pressure does not push, shape (face_count,).
        moves: Vertices that nothing holds, shape (vertex_count,).
    """
    if not slack.any():
        return ()
    edges = mesh_edges(mesh)
    border = edges.ends[border_edges(edges)]
    components = vertex_components(mesh, edges)
    ribbons = len(np.unique(components[border[:, 0]])) >= RIBBONS
    if slack.all():
        return (NOTHING_HELD.format(HOLDS if ribbons else CLOSES) if moves[border].any() else NO_INSIDE,)
    # Connected slack faces, and whether they have a border.
    faces = corner_faces(mesh)[edges.corners]
    first = np.repeat(edges.starts, edges.face_counts)
    both = slack[faces] & slack[faces[first]]
    pieces = component_labels(mesh.face_count, faces[both], faces[first][both])
    has_border = np.zeros(mesh.face_count, dtype=bool)
    has_border[pieces[faces[edges.starts[border_edges(edges)]]]] = True
    open_, walls = slack & has_border[pieces], slack & ~has_border[pieces]
    component = components[mesh.face_vertex_indices[face_starts(mesh)]]
    apart = not np.isin(component[open_], component[~slack]).any()
    thick = "." if ribbons else "; `balloon-warp remesh` thickens it."
    more = f" --parts closed leaves it out{thick}" if apart else ""
    if 2 * np.count_nonzero(open_) > mesh.face_count and not more and not ribbons:
        more = " `balloon-warp remesh` makes a closed surface of the mesh."
    return (
        *_sentence(mesh, open_, "open, like a pane, and has no inside: it is carried along, not inflated.", more),
        *_sentence(mesh, walls, "a wall with equal pressure on both sides, which does not push it.", ""),
    )


def _sentence(mesh: PolygonMesh, faces: NDArray[np.bool_], what: str, more: str) -> tuple[str, ...]:
    count = np.count_nonzero(faces)
    if not count:
        return ()
    corners = mesh.face_vertex_indices[faces[corner_faces(mesh)]]
    name = _group_of(mesh, corners)
    where = f"{name}, at vertex {corners[0] + 1}" if name else f"at vertex {corners[0] + 1}"
    return (f"A part of {count:,} of its {mesh.face_count:,} faces ({where}, counting from 1) is {what}{more}",)


def _group_of(mesh: PolygonMesh, vertices: NDArray[np.integer]) -> str | None:
    """Return the smallest of the mesh's groups that has all of these vertices, if there is one."""
    own = np.unique(vertices)
    having = [(len(group), name) for name, group in mesh.groups.items() if np.isin(own, group).all()]
    return min(having)[1] if having and min(having)[0] < mesh.vertex_count else None


Values = NDArray[np.float64]
COLUMNS = ("pairs", "rest_lengths", "constants")
"""Arrays in a file of springs"""


def springs_of_file(
    path: Path, own: Springs, mesh: PolygonMesh, constants: Values, unit: float
) -> tuple[Springs, Values]:
    """Return the springs of a file, and the scale of each one's constant over that of its kind.

    A spring between particles that the mesh would join has the kind of that; others are structural.

    Args:
        own: the springs of the mesh.
        constants: of the three kinds [N/m].
        unit: meters in the file's unit of length.

    Raises:
        InputError: the file cannot be read, or does not fit the mesh.
    """
    pairs, lengths, stiffness = _columns(path)
    _require_springs(path, pairs, lengths, stiffness, mesh.vertex_count)
    pairs = np.sort(pairs, axis=1).astype(np.int32)
    kind = _kinds(pairs, own)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], kind))
    of_kind = constants[kind]
    if (none := (of_kind == 0.0) & (stiffness > 0.0)).any():
        name = SpringKind(int(kind[none][0])).name.lower()
        raise InputError(f"stiffness.{name}: is 0, which {path} cannot scale; expected more than 0")
    scale = np.divide(stiffness, of_kind, out=np.zeros(len(kind)), where=of_kind > 0.0)
    return Springs(pairs[order], kind[order], unit * lengths[order]), scale[order]


def rest_shape(balloon: Balloon, placed: PolygonMesh, unit: float) -> PolygonMesh:
    """Return the stress-free mesh: the balloon's own, the vertices of another, or its faces cut into panels.

    Raises:
        InputError: the other mesh cannot be read, or has neither the same vertices nor, of a film, the same faces.
    """
    path = balloon.material.rest_mesh
    if path is None:
        return placed
    other = load_mesh(path)
    if len(other.points) == placed.vertex_count:
        return replace(placed, points=unit * other.points)
    sewn_vertices(other, placed, path, balloon.material.is_membrane)
    return replace(other, points=unit * other.points)


def sewn_vertices(panels: PolygonMesh, sewn: PolygonMesh, source: object, film: bool = True) -> NDArray[np.int64]:
    """Return the vertex of a mesh that each vertex of its panels is sewn to, shape (panels.vertex_count,).

    Args:
        panels: the same faces in the same order, of which some do not share their vertices any longer.
        film: whether panels are taken at all: springs go from panel to panel.

    Raises:
        InputError: the panels are no cut mesh.
    """
    told = f"material.rest_mesh: {source} has {panels.vertex_count} vertices"
    same = f"expected the {sewn.vertex_count} of {sewn.name}, in its order"
    if not film:
        raise InputError(f"{told}; {same}")
    if not np.array_equal(panels.face_vertex_counts, sewn.face_vertex_counts):
        raise InputError(
            f"{told} and {panels.face_count} faces; {same}, or panels: its {sewn.face_count} faces, in its order, cut "
            "along seams"
        )
    sewn_to = np.zeros(panels.vertex_count, dtype=np.int64)
    sewn_to[panels.face_vertex_indices] = sewn.face_vertex_indices
    if (wrong := sewn_to[panels.face_vertex_indices] != sewn.face_vertex_indices).any():
        vertex = panels.face_vertex_indices[wrong][0] + 1
        raise InputError(
            f"material.rest_mesh: vertex {vertex} of {source}, counted from 1, would be sewn to several of "
            f"{sewn.name}; expected one"
        )
    return sewn_to


def _columns(path: Path) -> list[NDArray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return [np.asarray(file[name], dtype=np.int64 if name == "pairs" else np.float64) for name in COLUMNS]
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected the .npz file of springs") from None
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile):
        expected = "a .npz file with pairs, rest_lengths and constants"
        raise InputError(f"{path}: cannot be read as springs; expected {expected}") from None


def _require_springs(path: Path, pairs: NDArray, lengths: Values, constants: Values, count: int) -> None:
    """Raise unless the springs fit so many particles."""
    if pairs.ndim != 2 or pairs.shape[1] != 2 or lengths.shape != constants.shape or lengths.shape != pairs.shape[:1]:
        shapes = f"{pairs.shape}, {lengths.shape} and {constants.shape}"
        raise InputError(f"{path}: expected pairs of shape (m, 2), and m rest_lengths and constants (got {shapes})")
    if len(pairs) and (pairs.min() < 0 or pairs.max() >= count or (pairs[:, 0] == pairs[:, 1]).any()):
        raise InputError(f"{path}: pairs: expected two of the mesh's {count} particles each, counted from 0")
    if len(np.unique(np.sort(pairs, axis=1), axis=0)) != len(pairs):
        raise InputError(f"{path}: pairs: two springs join the same particles; expected each pair once")
    for name, values in (("rest_lengths", lengths), ("constants", constants)):
        if not np.isfinite(values).all() or (values < 0.0).any():
            raise InputError(f"{path}: {name}: expected numbers of at least 0")


def _kinds(pairs: NDArray[np.int32], own: Springs) -> NDArray[np.int32]:
    """Return the kind of each pair among the mesh's own springs; structural where there is none."""
    keys = (own.pairs[:, 0].astype(np.int64) << 32) + own.pairs[:, 1]
    order = np.argsort(keys)
    wanted = (pairs[:, 0].astype(np.int64) << 32) + pairs[:, 1]
    at = np.minimum(np.searchsorted(keys[order], wanted), max(len(keys) - 1, 0))
    if not len(keys):
        return np.zeros(len(pairs), dtype=np.int32)
    found = keys[order][at] == wanted
    return np.where(found, own.kind[order][at], int(SpringKind.STRUCTURAL)).astype(np.int32)


LEAST_RADIUS = 0.12
"""Mean radius of a shape over that of the sphere of equal area, below which springs across it bear the pressure"""
LEAST_SUM = 0.25
"""Least sum of a particle's springs for its mass, over that of the mean particle: contacts are as stiff at light
particles as at others"""


def spring_layout(
    mesh: PolygonMesh, springs: Springs, balloon: Balloon
) -> tuple[Springs, NDArray[np.float64], NDArray[np.bool_] | None]:
    """Spring layout: springs with those across tied thin parts, scales of their constants, and a mask of the latter.

    Scales and mask have shape (spring_count,); the mask is None where none is asked for.

    Args:
        springs: over the surface, and between parts.
    """
    stiffness = balloon.stiffness
    constants = constants_of(stiffness)
    scale = even_scales(mesh, springs, constants) if stiffness.even else np.ones(springs.count)
    structural = constants[SpringKind.STRUCTURAL]
    if stiffness.thin != "tied" or balloon.material.is_membrane:
        return springs, scale, None
    if not structural:
        return springs, scale, np.zeros(springs.count, dtype=bool)
    found = springs_across(mesh, between_parts=balloon.parts == "held")
    more = ~springs.has(found.pairs)
    pressure = pressure_of_stretch(AT) * 2.0 * film_tension(constants) / max(mean_radius(mesh), 1e-30)
    both = springs.with_structural(found.pairs, mesh.points)
    across = np.zeros(both.count, dtype=bool)
    if more.any():
        across = Springs(found.pairs[more].astype(np.int32), both.kind[:0], both.rest_lengths[:0]).has(both.pairs)
    scales = np.empty(both.count)
    scales[~across] = scale  # in the same order
    scales[across] = pressure * found.loads[more] / structural
    return both, scales, across


def constants_of(stiffness: Stiffness) -> NDArray[np.float64]:
    """Return the constants of the three kinds of springs [N/m]."""
    return np.array([getattr(stiffness, row.name) for row in KINDS])


def spring_sums(
    mesh: PolygonMesh, springs: Springs, scales: NDArray[np.float64], stiffness: Stiffness
) -> NDArray[np.float64]:
    """Return the sum of each particle's spring constants [N/m], bounded below, shape (vertex_count,).

    Masses in proportion to it allow the longest step.
    """
    each = np.repeat(constants_of(stiffness)[springs.kind] * scales, 2)
    sums = np.bincount(springs.pairs.ravel(), each, mesh.vertex_count)
    mean = sums.sum() / max(np.count_nonzero(sums), 1)
    return np.maximum(sums, LEAST_SUM * mean or 1.0)


def pressure_of_stretch(stretch: float) -> float:
    """Return the pressure at a stretch of a sphere's skin over 2 K / R.

    K is its tension per unit strain, R its radius.
    """
    return stretch / (1.0 + stretch) ** 2


def mean_radius(mesh: PolygonMesh) -> float:
    """Return 3 V / A of the part with the largest area [m].

    It is a sphere's radius, and three halves of a tube's. It is at least `LEAST_RADIUS` of that of the sphere of equal
    area. An open mesh may become half a sphere, and has the radius of that.
    """
    edges, areas = mesh_edges(mesh), vertex_areas(mesh)
    parts = vertex_components(mesh, edges)
    of_parts = np.bincount(parts, areas, mesh.vertex_count)
    largest = int(of_parts.argmax())
    area = of_parts[largest]
    if not is_closed(edges):
        return float(np.sqrt(area / (2.0 * np.pi)))
    least = LEAST_RADIUS * np.sqrt(area / (4.0 * np.pi))
    volume = face_volumes(mesh)[(parts == largest)[mesh.face_vertex_indices[face_starts(mesh)]]].sum()
    return float(max(3.0 * abs(volume) / max(area, 1e-30), least))


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
    told = with_unit_and_up(mesh, balloon.unit, balloon.up)
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
        springs, scale = springs_of_file(balloon.springs, springs, placed, constants_of(balloon.stiffness), unit)
    else:
        springs, scale, across = spring_layout(placed, springs, balloon)
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
        return np.where(moves, membrane.lumped_areas(mesh.vertex_count), 0.0) / membrane.areas.sum()
    shares = np.where(moves, stiffness_sums if balloon.stiffness.even else 1.0, 0.0)
    return shares / max(shares.sum(), 1e-30)


@dataclass(frozen=True)
class Surroundings:
    """Surroundings of the moving particles of a balloon."""

    mass_share: NDArray[np.float64]
    """Share of the balloon's mass, shape (P,)"""
    area: NDArray[np.float64]
    """Share of the balloon's area [m^2], shape (P,): twice that at the start, since it may grow"""
    spring_counts: NDArray[np.float64]
    """Number of springs by kind, shape (P, 3)"""
    spring_scales: NDArray[np.float64]
    """Sums of spring constants over those of their kinds, shape (P, 3)"""
    strings: NDArray[np.float64]
    """1 where the string holds it, shape (P, count of the balloon's strings)"""
    hinges: NDArray[np.float64]
    """Half the row sums of the stiffness matrix of hinges with a constant of 1 N m/rad [1/m^2], shape (P,)"""
    membrane: NDArray[np.float64]
    """Half the absolute row sums of the membrane's Laplacian, shape (P,)"""
    velocity: NDArray[np.float64]
    """Velocities [m/s], shape (P, 3)"""

    @property
    def particle_count(self) -> int:
        return len(self.mass_share)

    def different(self) -> "Surroundings":
        """Return the distinct ones."""
        parts = [part[:, None] if part.ndim == 1 else part for part in vars(self).values()]
        rows = np.unique(np.concatenate(parts, axis=1), axis=0)
        columns = np.split(rows, np.cumsum([part.shape[1] for part in parts])[:-1], axis=1)
        shapes = [(len(rows), *part.shape[1:]) for part in vars(self).values()]
        return Surroundings(*(part.reshape(shape) for part, shape in zip(columns, shapes, strict=True)))


def surroundings_of(
    shape: BalloonShape, held: Sequence[int], with_hinges: bool, velocities: NDArray[np.float64] | None
) -> Surroundings:
    """Return the surroundings of all moving particles, in their order.

    Args:
        held: Particle that each string of the balloon holds.
        with_hinges: Whether any hinge has a constant; otherwise they are left out, which saves time.
        velocities: Velocities of all particles [m/s]; at rest, when missing.
    """
    count, pairs = shape.mesh.vertex_count, shape.springs.pairs
    counts, scales = np.zeros((count, len(KINDS))), np.zeros((count, len(KINDS)))
    for kind in range(len(KINDS)):
        of_kind = shape.springs.kind == kind
        for end in (0, 1):
            counts[:, kind] += np.bincount(pairs[:, end], of_kind, count)
            scales[:, kind] += np.bincount(pairs[:, end], np.where(of_kind, shape.stiffness_scale, 0.0), count)
    moves = shape.mass_share > 0.0
    return Surroundings(
        mass_share=shape.mass_share[moves],
        area=2.0 * vertex_areas(shape.mesh)[moves],
        spring_counts=counts[moves],
        spring_scales=scales[moves],
        strings=(np.flatnonzero(moves)[:, None] == np.asarray(held, dtype=np.int64)).astype(np.float64),
        hinges=_hinges(shape)[moves] if with_hinges else np.zeros(int(moves.sum())),
        membrane=_membrane_around(shape)[moves],
        velocity=np.zeros((count, 3))[moves] if velocities is None else velocities[moves],
    )


def _hinges(shape: BalloonShape) -> NDArray[np.float64]:
    """Return a hinge has k g_p g_q for particles p and q in the matrix, where g is the gradient of its angle."""
    hinges = shape.hinges
    sizes = hinges.wing_sizes
    gradients = hinges.gradients(shape.mesh.points)
    rows = 0.5 * gradients * gradients.sum(axis=1, keepdims=True)
    sums = np.zeros(shape.mesh.vertex_count)
    np.add.at(sums, hinges.ends, rows[:, :2])
    np.add.at(sums, hinges.wing_particles, np.repeat((rows[:, 2:] / sizes).ravel(), sizes.ravel()))
    return sums


def _membrane_around(shape: BalloonShape) -> NDArray[np.float64]:
    """Return row sums, twice which bound the eigenvalues, by Gershgorin's theorem."""
    count = shape.mesh.vertex_count
    pairs, between = shape.membrane.laplacian
    rows, which = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    total = np.bincount(which.ravel(), between, len(rows))
    sums = np.zeros(count)
    for end in (0, 1):
        sums += np.bincount(rows[:, end], 0.5 * (total + np.abs(total)), count)
    return sums
