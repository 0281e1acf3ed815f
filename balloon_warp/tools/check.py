"""Check of a stage for crossings, frame by frame.

Checks of written stages for interpenetration.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray
from pxr import Usd, UsdGeom, UsdPhysics

from balloon_warp.errors import InputError, did_you_mean_file
from balloon_warp.kernels.measure.crossings import (
    Things,
    find_boxes,
    find_crossings,
    measure_crossings,
    measure_rounds,
    signed_distances,
)
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import first_coincident
from balloon_warp.mesh.usd_open import open_meshes
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.studio.render.sampling import timing_of
from balloon_warp.studio.render.stage_reader import left_out
from balloon_warp.system.api import Shown, checked, described
from balloon_warp.system.warp_threads import launch, pick_device
from balloon_warp.usd import STAGE_SUFFIXES
from balloon_warp.usd.material import is_shown
from balloon_warp.usd.solids import HALF_SPACE

Kind = Literal["balloon", "obstacle", "body", "sphere", "ground"]
BOX_FACES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)], np.int32)
"""Corners of each face of a box, counter-clockwise from outside"""


@dataclass(frozen=True)
class Placed:
    """Placement of a prim at a time."""

    matrix: NDArray[np.float64]
    """Matrix to the world, for row vectors [m]"""

    def of(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return a prim's points in the world [m], shape (n, 3)."""
        return points.astype(np.float64) @ self.matrix[:3, :3] + self.matrix[3, :3]


def placed(prim: Usd.Prim, time: Usd.TimeCode, unit: float) -> Placed:
    """Find where a prim is; `unit` is the stage's [m]."""
    matrix = np.array(UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(time))
    matrix[:, :3] *= unit
    return Placed(matrix)


class Thing:
    """Thing of a stage.

    Args:
        prim: of the thing in the stage.
        group: those of one group do not meet.
    """

    def __init__(self, prim: Usd.Prim, kind: Kind, group: int):
        self.prim, self.kind, self.group = prim, kind, group
        self.name = prim.GetName()

    @property
    def said(self) -> str:
        """Name of the thing for people."""
        return "the ground" if self.kind == "ground" else f"{self.kind} {self.name}"

    def is_there(self, time: Usd.TimeCode) -> bool:
        """Return whether the thing is visible at a time."""
        return UsdGeom.Imageable(self.prim).ComputeVisibility(time) != UsdGeom.Tokens.invisible


class Surface(Thing):
    """A mesh, or a box, as triangles."""

    def __init__(self, prim: Usd.Prim, kind: Kind, group: int, times: list[Usd.TimeCode]):
        super().__init__(prim, kind, group)
        self._mesh = UsdGeom.Mesh(prim)
        self._box = _box_of(prim) if kind != "balloon" else None
        self._start = Usd.TimeCode.EarliestTime()  # contact takes quads for two triangles, as they are then
        self._same = self._mesh.GetFaceVertexIndicesAttr().GetNumTimeSamples() == 0
        self.triangles = self._triangles_at(times[0])
        """Corners of each triangle, shape (triangle_count, 3), at the first time"""
        own = [self._own_points(time) for time in (times[0], times[len(times) // 2], times[-1])]
        self.vertices = first_coincident(np.concatenate(own, axis=1))
        """First point that is always at the same place, for each point: those of a seam count as one"""

    @property
    def soft(self) -> bool:
        """Return whether the surface is deformable."""
        return self.kind == "balloon"

    @property
    def is_closed(self) -> bool:
        """Return whether each edge has one triangle on either side, so that something can be inside."""
        ends = self.vertices[self.triangles]
        edges = np.concatenate([ends[:, [0, 1]], ends[:, [1, 2]], ends[:, [2, 0]]])
        across = edges[:, ::-1]
        forward, back = (np.unique(pairs, axis=0, return_counts=True) for pairs in (edges, across))
        return bool(len(forward[0])) and np.array_equal(forward[0], back[0]) and bool((forward[1] == 1).all())

    def at(self, time: Usd.TimeCode, unit: float) -> NDArray[np.float64]:
        """Return the surface's points in the world [m], shape (point_count, 3).

        Raises:
            InputError: they are others than at the first time, or not finite.
        """
        points = placed(self.prim, time, unit).of(self._own_points(time))
        if len(points) != len(self.vertices) or not np.isfinite(points).all():
            raise InputError(
                f"{self.prim.GetPath()}: has {len(points)} points at frame {time.GetValue():g}, or points that are not "
                f"finite; expected {len(self.vertices)} finite points at every frame"
            )
        if not self._same:
            self.triangles = self._triangles_at(time)
        return points

    def rest_points(self) -> NDArray[np.float64]:
        """Return the surface's points in its own frame."""
        return self._own_points(Usd.TimeCode.EarliestTime())

    def _own_points(self, time: Usd.TimeCode) -> NDArray[np.float64]:
        if self._box is not None:
            return self._box
        return np.asarray(self._mesh.GetPointsAttr().Get(time) or [], np.float64).reshape(-1, 3)

    def _triangles_at(self, time: Usd.TimeCode) -> NDArray[np.int32]:
        if self._box is not None:
            return np.concatenate([BOX_FACES[:, [0, 1, 2]], BOX_FACES[:, [0, 2, 3]]])
        counts, indices = (
            np.asarray(attribute.Get(time) or [], np.int32)
            for attribute in (self._mesh.GetFaceVertexCountsAttr(), self._mesh.GetFaceVertexIndicesAttr())
        )
        points = self._own_points(self._start)
        if (counts < 3).any() or counts.sum() != len(indices) or ((indices < 0) | (indices >= len(points))).any():
            raise InputError(f"{self.prim.GetPath()}: its faces do not match its {len(points)} points")
        return triangles_of(PolygonMesh(points, counts, indices)).astype(np.int32)


class Round(Thing):
    """A sphere or a capsule."""

    def at(self, time: Usd.TimeCode, unit: float) -> tuple[NDArray[np.float64], float]:
        """Return both ends of its axis, shape (2, 3), and its radius [m]."""
        place, shape = placed(self.prim, time, unit), UsdGeom.Sphere(self.prim) or UsdGeom.Capsule(self.prim)
        ends = np.zeros((2, 3))
        if capsule := UsdGeom.Capsule(self.prim):
            half = 0.5 * capsule.GetHeightAttr().Get(time)
            ends[:, "XYZ".index(capsule.GetAxisAttr().Get(time))] = -half, half
        scale = float(np.cbrt(abs(np.linalg.det(place.matrix[:3, :3]))))
        return place.of(ends), shape.GetRadiusAttr().Get(time) * scale


class HalfSpace(Thing):
    """The ground, or a plane: nothing should be below."""

    def at(self, time: Usd.TimeCode, unit: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a point of it, and its normal."""
        a, b, c = placed(self.prim, time, unit).of(np.asarray(UsdGeom.Mesh(self.prim).GetPointsAttr().Get(time)))[:3]
        normal = np.cross(b - a, c - a)
        return a, normal / np.linalg.norm(normal)


def things_of(stage: Usd.Stage, times: list[Usd.TimeCode]) -> list[Thing]:
    """Find the visible things of a stage, water excluded."""
    found: list[Thing] = []
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
        if UsdGeom.Imageable(prim) and is_shown(prim):
            kind = _kind_of(prim)
            group = len(found) + 1 if kind in ("balloon", "body", "sphere") else 0
            if UsdGeom.Sphere(prim) or UsdGeom.Capsule(prim):
                found.append(Round(prim, kind, group))
            elif UsdGeom.Mesh(prim) and (kind == "ground" or prim.HasCustomDataKey(HALF_SPACE)):
                found.append(HalfSpace(prim, kind, group))
            elif UsdGeom.Mesh(prim) and not prim.HasCustomDataKey(SCENERY):
                found.append(Surface(prim, kind, group, times))
    return found


def _kind_of(prim: Usd.Prim) -> Kind:
    if prim.GetCustomDataByKey(SCENERY) == "Ground":
        return "ground"
    body = UsdPhysics.RigidBodyAPI(prim) if prim.HasAPI("PhysicsRigidBodyAPI") else None
    if UsdGeom.Sphere(prim):
        return "sphere"
    if body and not body.GetKinematicEnabledAttr().Get():
        return "body"
    moves = UsdGeom.Mesh(prim) and UsdGeom.Mesh(prim).GetPointsAttr().GetNumTimeSamples() > 0
    return "balloon" if moves else "obstacle"


def _box_of(prim: Usd.Prim) -> NDArray[np.float64] | None:
    """Return the sharp corners of a box that is drawn with round edges; None of other things."""
    collider = UsdPhysics.MeshCollisionAPI(prim)
    if not prim.HasAPI("PhysicsMeshCollisionAPI"):
        return None
    if collider.GetApproximationAttr().Get() != UsdPhysics.Tokens.boundingCube:
        return None
    lower, upper = np.asarray(UsdGeom.Mesh(prim).GetExtentAttr().Get(), np.float64)
    sides = np.stack([lower, upper])
    return np.array([(sides[x, 0], sides[y, 1], sides[z, 2]) for x in (0, 1) for y in (0, 1) for z in (0, 1)])


FIRST_ROOM = 4096
"""Initial capacity for pairs of triangles"""
BLUR = 1e-6
"""Resolution of float32 over the size of everything"""
Arrays = tuple[Any, NDArray[np.int32]]
"""Triangles of all things, with a tree of their boxes, as `Things`; and the thing of each"""


class Met(NamedTuple):
    """Contact of two things at a moment."""

    first: Thing
    second: Thing
    depth: float
    """Depth of one in the other [m]"""
    place: NDArray[np.float64]
    """Place of the largest depth [m], shape (3,)"""


class Checker:
    """Looks at moments of a stage.

    Args:
        unit: of the stage [m].
    """

    def __init__(self, things: list[Thing], unit: float, device: wp.Device):
        self.surfaces = [each for each in things if isinstance(each, Surface)]
        self.rounds = [each for each in things if isinstance(each, Round)]
        self.half_spaces = [each for each in things if isinstance(each, HalfSpace)]
        self._unit, self._device = unit, device
        self._room = FIRST_ROOM
        self.blur = 0.0
        """Rounding of places, as of the last check [m]"""
        counts = [len(surface.vertices) for surface in self.surfaces]
        self._offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)

    @property
    def triangle_count(self) -> int:
        """Number of triangles at the first moment."""
        return sum(len(surface.triangles) for surface in self.surfaces)

    def look(self, time: Usd.TimeCode) -> list[Met]:
        """Return the pairs of things that are in each other, each at its deepest place."""
        there = [surface.is_there(time) for surface in self.surfaces]
        points = [surface.at(time, self._unit) for surface in self.surfaces]
        rounds = [each for each in self.rounds if each.is_there(time)]
        shown = [surface for surface, seen in zip(self.surfaces, there, strict=True) if seen]
        met: list[Met] = []
        if shown:
            arrays = self._arrays(points, there)
            met += self._crossing(arrays)
            met += self._in_rounds(arrays, points, rounds, time)
        met += self._rounds_in_rounds(rounds, time)
        met += self._below(dict(zip(self.surfaces, points, strict=True)), shown, rounds, time)
        met += self._inside(dict(zip(self.surfaces, points, strict=True)), shown, time)
        deepest: dict[tuple[int, int], Met] = {}
        for each in met:
            key = (id(each.first), id(each.second))
            if key not in deepest or deepest[key].depth < each.depth:
                deepest[key] = each
        return list(deepest.values())

    def _arrays(self, points: list[NDArray[np.float64]], there: list[bool]) -> Arrays:
        """Return all triangles that are there, with a tree of their boxes; and whose each is."""
        triangles = [surface.triangles for surface in self.surfaces]
        kept = [tri[:0] if not seen else tri for tri, seen in zip(triangles, there, strict=True)]
        owners = np.repeat(np.arange(len(kept), dtype=np.int32), [len(tri) for tri in kept])
        everywhere = np.concatenate(points)
        size = float(np.ptp(everywhere, axis=0).max(initial=0.0))
        things, device = Things(), self._device
        shifted = [tri + first for tri, first in zip(kept, self._offsets[:-1], strict=True)]
        things.points = wp.array(everywhere, dtype=wp.vec3d, device=device)
        things.triangles = wp.array(np.concatenate(shifted), dtype=wp.vec3i, device=device)
        things.owners = wp.array(owners, dtype=wp.int32, device=device)
        things.vertices, things.groups, things.soft = self._fixed
        self.blur = BLUR * size
        things.pad = self.blur
        count = len(owners)
        lowers, uppers = (wp.zeros((count,), dtype=wp.vec3, device=device) for _ in range(2))
        launch(find_boxes, count, [things, lowers, uppers], device=device)
        self._tree = wp.Bvh(lowers, uppers)
        things.tree = self._tree.id
        return things, owners

    @cached_property
    def _fixed(self) -> tuple[wp.array, wp.array, wp.array]:
        """Constants: points that count as one, groups of things, and which are deformable."""
        vertices = [surface.vertices + first for surface, first in zip(self.surfaces, self._offsets[:-1], strict=True)]
        groups = [surface.group for surface in self.surfaces]
        soft = [surface.soft for surface in self.surfaces]
        return self._integers(np.concatenate(vertices)), self._integers(groups), self._integers(soft)

    def _integers(self, row: ArrayLike) -> wp.array:
        return wp.array(np.asarray(row, np.int32), device=self._device)

    def _crossing(self, arrays: Arrays) -> Iterator[Met]:
        """Return the triangles that cross, the deepest of each pair of things."""
        things, owners = arrays
        count = wp.zeros(1, dtype=wp.int32, device=self._device)
        while True:
            pairs = wp.zeros(self._room, dtype=wp.vec2i, device=self._device)
            count.zero_()
            launch(find_crossings, len(owners), [things, count, pairs], device=self._device)
            number = int(count.numpy()[0])
            if number <= self._room:
                break
            self._room = 2 * number
        if number == 0:
            return
        depths = wp.zeros((number,), dtype=wp.float64, device=self._device)
        places = wp.zeros((number,), dtype=wp.vec3d, device=self._device)
        launch(measure_crossings, number, [things, pairs, wp.float64(self.blur), depths, places], device=self._device)
        deep, where = np.asarray(depths.numpy(), np.float64), np.asarray(places.numpy(), np.float64)
        both = np.sort(owners[np.asarray(pairs.numpy()[:number], np.int64)], axis=1)
        for pair in np.unique(both, axis=0):
            those = np.flatnonzero((both == pair).all(axis=1))
            worst = int(those[np.argmax(deep[those])])
            first, second = (self.surfaces[number] for number in pair)
            yield Met(first, second, float(deep[worst]), where[worst])

    def _in_rounds(
        self,
        arrays: Arrays,
        points: list[NDArray[np.float64]],
        rounds: list[Round],
        time: Usd.TimeCode,
    ) -> Iterator[Met]:
        """Return the triangles in spheres and capsules."""
        if not rounds:
            return
        things, owners = arrays
        ends, radii = zip(*(each.at(time, self._unit) for each in rounds), strict=True)
        begins = wp.array(np.stack(ends)[:, 0], dtype=wp.vec3d, device=self._device)
        lasts = wp.array(np.stack(ends)[:, 1], dtype=wp.vec3d, device=self._device)
        wide = wp.array(radii, dtype=wp.float64, device=self._device)
        groups = wp.array([each.group for each in rounds], dtype=wp.int32, device=self._device)
        depths = wp.zeros((len(owners), len(rounds)), dtype=wp.float64, device=self._device)
        launch(measure_rounds, depths.shape, [things, begins, lasts, wide, groups, depths], device=self._device)
        deep, triangles = depths.numpy(), things.triangles.numpy()
        everywhere = np.concatenate(points)
        for number, each in enumerate(rounds):
            for own in np.unique(owners[deep[:, number] > 0.0]):
                those = np.flatnonzero((owners == own) & (deep[:, number] > 0.0))
                worst = those[np.argmax(deep[those, number])]
                place = everywhere[triangles[worst]].mean(axis=0)
                yield Met(self.surfaces[own], each, float(deep[worst, number]), place)

    def _rounds_in_rounds(self, rounds: list[Round], time: Usd.TimeCode) -> Iterator[Met]:
        for number, first in enumerate(rounds):
            ends, radius = first.at(time, self._unit)
            for second in rounds[number + 1 :]:
                if first.group != second.group:
                    others, other_radius = second.at(time, self._unit)
                    place, gap = _between(ends, others)
                    if gap < radius + other_radius:
                        yield Met(first, second, radius + other_radius - gap, place)

    def _below(
        self,
        points: dict[Surface, NDArray[np.float64]],
        shown: list[Surface],
        rounds: list[Round],
        time: Usd.TimeCode,
    ) -> Iterator[Met]:
        """Find the things that reach below the ground, or a plane."""
        for space in self.half_spaces:
            origin, normal = space.at(time, self._unit)
            for each in (*shown, *rounds):
                if each.group != space.group:
                    ends, radius = (points[each], 0.0) if isinstance(each, Surface) else each.at(time, self._unit)
                    heights = (ends - origin) @ normal - radius
                    lowest = int(np.argmin(heights))
                    if heights[lowest] < 0.0:
                        yield Met(each, space, float(-heights[lowest]), ends[lowest])

    def _inside(
        self, points: dict[Surface, NDArray[np.float64]], shown: list[Surface], time: Usd.TimeCode
    ) -> Iterator[Met]:
        """Return the points of balloons and bodies in closed obstacles and bodies."""
        for solid in shown:
            if not solid.soft and solid in self._solids:
                mesh, lower, upper = self._solids[solid]
                place = placed(solid.prim, time, self._unit)
                back = np.linalg.inv(place.matrix)
                for each in shown:
                    if each.group != solid.group:
                        own = points[each] @ back[:3, :3] + back[3, :3]
                        near = np.flatnonzero(((own > lower) & (own < upper)).all(axis=1))
                        if len(near):
                            yield from self._deepest_inside(each, solid, mesh, own[near], points[each][near])

    def _deepest_inside(
        self, each: Surface, solid: Surface, mesh: wp.Mesh, own: NDArray[np.float64], there: NDArray[np.float64]
    ) -> Iterator[Met]:
        distances = wp.zeros(len(own), dtype=wp.float32, device=self._device)
        queried = wp.array(own, dtype=wp.vec3, device=self._device)
        launch(signed_distances, len(own), [mesh.id, queried, 1e10, distances], device=self._device)
        depths = -distances.numpy() * self._unit
        worst = int(np.argmax(depths))
        if depths[worst] > 0.0:
            yield Met(each, solid, float(depths[worst]), there[worst])

    @cached_property
    def _solids(self) -> dict[Surface, tuple[wp.Mesh, NDArray[np.float64], NDArray[np.float64]]]:
        """Rigid things with an inside, and their boxes, in their own frames."""
        found = {}
        for surface in self.surfaces:
            if not surface.soft and surface.is_closed and _volume(surface) > 0.0:
                points = surface.rest_points()
                mesh = wp.Mesh(
                    wp.array(points, dtype=wp.vec3, device=self._device),
                    wp.array(surface.triangles.ravel(), dtype=wp.int32, device=self._device),
                    support_winding_number=True,
                )
                found[surface] = mesh, points.min(axis=0), points.max(axis=0)
        return found


def _volume(surface: Surface) -> float:
    """Return the volume of a closed surface; negative where its faces look inward, as those of a room."""
    a, b, c = (surface.rest_points()[surface.triangles[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def _between(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the middle between the nearest places of two segments, and how far these are apart."""
    a, b, start = first[1] - first[0], second[1] - second[0], first[0] - second[0]
    least = 1e-60
    aa, bb, along = max(a @ a, least), max(b @ b, least), a @ b
    sine = aa * bb - along * along
    s = np.clip((along * (b @ start) - (a @ start) * bb) / sine, 0.0, 1.0) if sine > 1e-12 * aa * bb else 0.0
    t = np.clip((along * s + b @ start) / bb, 0.0, 1.0)
    s = np.clip((along * t - a @ start) / aa, 0.0, 1.0)
    here, there = first[0] + s * a, second[0] + t * b
    return 0.5 * (here + there), float(np.linalg.norm(here - there))


THICKNESS = 0.05
"""Default thickness of a balloon's skin over its mean edge, to which depth it may be in a solid; see `[touch]`"""
BLURS = 10.0
"""Depth over the rounding of places below which balloons only touch"""


@dataclass(frozen=True)
class Crossing:
    """Crossing of two things at a frame, with its deepest place."""

    frame: int
    first: str
    """Name of a thing, such as "balloon ball"; for parts of one balloon both are the same"""
    second: str
    place: tuple[float, float, float]
    """Place of the largest depth [m]"""
    depth: float
    """Depth: displacement along a face's normal that frees it from the other thing [m]"""

    def __str__(self) -> str:
        place = ", ".join(f"{number:.4g}" for number in self.place)
        other = "itself" if self.first == self.second else self.second
        return f"frame {self.frame}: {self.first} penetrates {other} by {self.depth:.3g} m at ({place})"


@described
@dataclass(frozen=True, repr=False)
class CheckReport(Shown):
    """Result of a check."""

    stage: str
    frames: int
    """Number of frames checked"""
    things: tuple[str, ...]
    """Things that were checked"""
    triangles: int
    within: float
    """Tolerated depth of balloons in solids [m]"""
    crossings: tuple[Crossing, ...]
    """Crossings of each frame and each pair of things, by frame"""

    @property
    def passed(self) -> bool:
        """Return whether nothing crosses."""
        return not self.crossings


@checked
def check_stage(
    path: str | Path,
    *,
    frames: tuple[int | None, int | None] | None = None,
    within: float | None = None,
    device: str | wp.Device | None = None,
    on_frame: Callable[[int, int], None] | None = None,
    on_note: Callable[[str], None] = lambda sentence: None,
) -> CheckReport:
    """Check a stage for interpenetration of balloons, their parts, obstacles, bodies, spheres and the ground.

    Args:
        path: Any file that USD opens. Deformable meshes count as balloons.
        frames: First and last frame to check; all if not given.
        within: Tolerated depth of a balloon in a solid [m]; a twentieth of its mean edge if not given.
        device: Device for the check, such as "cpu".
        on_frame: Called with the number of frames done, and of all.
        on_note: Called with sentences on missing files and images of the stage, and on shapes that are not checked.

    Raises:
        InputError: The stage cannot be read, or has nothing that could cross.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected a USD stage{did_you_mean_file(path, STAGE_SUFFIXES)}")
    if within is not None and not 0.0 <= within < np.inf:
        raise InputError(f"within: {within:g}; expected at least 0 m")
    opened = open_meshes(path, rounds=False)
    for sentence in (*opened.warnings, *left_out(opened.stage)):
        on_note(sentence)
    stage, first, last, _rate = timing_of(opened.stage, path)
    numbers = _chosen(path, range(first, last + 1), frames)
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    things = things_of(stage, [Usd.TimeCode(number) for number in numbers])
    if len(things) < 2 and not any(isinstance(each, Surface) for each in things):
        raise InputError(f"{path}: has nothing to check; expected meshes or solid shapes")
    checker = Checker(things, unit, pick_device(device))
    allowed = within if within is not None else _thickness(checker, Usd.TimeCode(numbers[0]), unit)
    found: list[Crossing] = []
    for done, number in enumerate(numbers):
        met = checker.look(Usd.TimeCode(number))
        found += [_crossing(number, each) for each in met if each.depth > _allowed(each, allowed, checker.blur)]
        if on_frame:
            on_frame(done + 1, len(numbers))
    return CheckReport(
        str(path), len(numbers), tuple(thing.said for thing in things), checker.triangle_count, allowed, tuple(found)
    )


def _chosen(path: Path, known: range, frames: tuple[int | None, int | None] | None) -> range:
    """Return the requested ones of the known frames."""
    first, last = frames or (None, None)
    begin = known.start if first is None else first
    end = known[-1] if last is None else last
    if begin not in known or end not in known or begin > end:
        span = f"{known.start} to {known[-1]}"
        raise InputError(f"{path}: has frames {span}; expected a range within (got {begin}:{end})")
    return range(begin, end + 1)


def _thickness(checker: Checker, time: Usd.TimeCode, unit: float) -> float:
    """Return a twentieth of the mean edge of all balloons [m]; 0 without any."""
    lengths = [np.zeros(0)]
    for surface in checker.surfaces:
        if surface.soft:
            corners = surface.at(time, unit)[surface.triangles]
            lengths += [np.linalg.norm(corners[:, end] - corners[:, end - 1], axis=1) for end in range(3)]
    edges = np.concatenate(lengths)
    return THICKNESS * float(edges.mean()) if len(edges) else 0.0


def _allowed(met: Met, thickness: float, blur: float) -> float:
    """Return the tolerated depth of two things in each other [m]."""
    balloons = [each.kind == "balloon" for each in (met.first, met.second)]
    return BLURS * blur if all(balloons) else max(thickness, blur)


def _crossing(frame: int, met: Met) -> Crossing:
    x, y, z = met.place.tolist()
    return Crossing(frame, met.first.said, met.second.said, (x, y, z), met.depth)
