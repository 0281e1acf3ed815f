"""Crossings at one moment, found on a device."""

from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray
from pxr import Usd

from balloon_warp.checking.things import HalfSpace, Round, Surface, Thing, placed
from balloon_warp.kernels.measure.crossings import (
    Things,
    find_boxes,
    find_crossings,
    measure_crossings,
    measure_rounds,
)
from balloon_warp.kernels.measure.signed_distance import signed_distances
from balloon_warp.launching import launch

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
