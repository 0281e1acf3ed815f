"""Motion of balloons of springs that touch, in NumPy and double precision, written from the formulas of `laws.touch`.

Every particle looks at all triangles of the others, or of its own balloon that are far from it at the start. Balloons
are closed and come from outside, or their parts face each other across a gap."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from float64_edges import MeetingEdges, cross, dots

from balloon_warp.kernels.laws.touch import DAMPING_RATIO, NEAR, STEEPEST
from balloon_warp.kernels.loops.meeting import APART_RATE, AS_NEAR, LITTLE, SOON
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model import plan_model
from balloon_warp.model.folded import is_folded
from balloon_warp.model.friction import FRICTION
from balloon_warp.model.meeting_edges import edges_meet, meeting_edges
from balloon_warp.model.plan import settled_parameters
from balloon_warp.model.starts import start_of
from balloon_warp.model.touch import APART, STIFFNESSES, THICKNESS, crowd_of, edge_length
from balloon_warp.scene import Scene
from balloon_warp.schedules.touch_table import ITSELF
from balloon_warp.statics.volume import Volume

Array = np.ndarray


def touching_motion(
    scene: Scene, values: Mapping[str, float] | None = None, shifts: tuple[Any, Any] = (0.0, 0.0)
) -> tuple[list[Array], list[Array]]:
    """Return places and velocities of each balloon in all frames, shape (frames + 1, n, 3).

    Args: shifts: offsets of places and velocities of all particles at the start."""
    return _Touching(scene, values or {}).frames(*shifts)


class _Touching:
    def __init__(self, scene: Scene, values: Mapping[str, float]):
        plan = plan_model(scene)
        self.plan, self.scene = plan, plan.scene
        self.p = settled_parameters(plan, {path: np.array([value]) for path, value in values.items()})
        self.shapes = plan.shapes
        self.h = 1.0 / scene.frames_per_second / plan.substeps
        self.offsets = np.cumsum([0, *(len(shape.mesh.points) for shape in plan.shapes)])
        self.owner = np.repeat(np.arange(len(plan.shapes)), np.diff(self.offsets))
        self.shares = np.concatenate([shape.mass_share for shape in plan.shapes])
        self.mass = self.shares * self.p["mass"][0][self.owner]
        self.ease = np.where(self.mass > 0.0, 1.0 / np.maximum(self.mass, 1e-30), 0.0)
        self.volumes = [Volume(shape.mesh) for shape in plan.shapes]
        itself = self.scene.touches_itself
        self.crowds = np.array([crowd_of(plan.shapes, number, itself) for number in range(len(plan.shapes))])
        self.edges = np.array([edge_length(shape.mesh) for shape in plan.shapes])
        triangles = [triangles_of(shape.mesh) + first for shape, first in zip(plan.shapes, self.offsets, strict=False)]
        rest = np.concatenate([shape.mesh.points for shape in plan.shapes])
        self.pairs = []
        """Balloons, triangles of the second, and which of them each particle of the first may touch"""
        for first in range(len(plan.shapes)):
            own = np.arange(self.offsets[first], self.offsets[first + 1])
            for second, corners in enumerate(triangles):
                if first == second and not itself:
                    continue
                ways = np.linalg.norm(rest[corners][None] - rest[own][:, None, None], axis=-1)
                apart = ITSELF if itself and is_folded(plan.shapes[first].mesh) else APART
                far = (ways >= apart * self.edges[first]).all(axis=-1)
                may = far if first == second else np.ones((len(own), len(corners)), dtype=bool)
                self.pairs.append((first, second, own, corners, may))

        self.ground = float(np.ravel(self.p["ground_height"])[0]) if self.scene.ground is not None else -1e9
        self.meeting = self._meeting_edges(triangles) if edges_meet(self.scene, plan.shapes) else None

    def _meeting_edges(self, triangles: list[Array]) -> MeetingEdges:
        def weights_in(point: Array, a: Array, b: Array, c: Array) -> Array:
            return barycentric(nearest_places(point, a, b, c), a, b, c, cross(b - a, c - a))

        edges = [
            own + first for own, first in zip(meeting_edges(self.scene, self.shapes), self.offsets[:-1], strict=True)
        ]
        return MeetingEdges(edges, triangles, self.owner, self.ease, self.h, self._skins, weights_in, self.ground)

    def frames(self, shift: Any, push: Any) -> tuple[list[Array], list[Array]]:
        starts = [
            start_of(self.scene, self.p, number, shape.mesh.points)[0] for number, shape in enumerate(self.shapes)
        ]
        x = np.concatenate(starts)
        v = np.concatenate(
            [
                self.p["initial_velocities"][0, number]
                + cross(self.p["initial_spins"][0, number], at - self.p["initial_centers"][0, number])
                for number, at in enumerate(starts)
            ]
        )
        x, v = x + shift, v * (self.mass > 0.0)[:, None] + push
        self.holds = np.zeros((len(x), 4))
        found = [(x, v)]
        for _ in range(self.scene.frames):
            self.contacts = np.zeros(len(x))
            self.contacts = self._touch(x, v)[1]
            for _ in range(self.plan.substeps):
                x, v = self._substep(x, v)
            found.append((x, v))
        points, velocities = (np.array(each) for each in zip(*found, strict=True))
        parts = [slice(*each) for each in zip(self.offsets[:-1], self.offsets[1:], strict=True)]
        return [points[:, part] for part in parts], [velocities[:, part] for part in parts]

    def _substep(self, x: Array, v: Array) -> tuple[Array, Array]:
        push, counts, self.holds = self._touch(x, v)
        self.contacts = counts
        up = np.array(self.scene.up)
        force = push - self.mass[:, None] * float(np.ravel(self.p["gravity"])[0]) * up
        for outer in self.scene.force:
            own = self.offsets[outer.balloon] + np.array(outer.particles)
            force[own] += np.outer(self.shares[own] / self.shares[own].sum(), outer.newtons)
        for number, shape in enumerate(self.shapes):
            part = slice(self.offsets[number], self.offsets[number + 1])
            force[part] += self._springs(number, shape, x[part])
            force[part] += self.p["keyframe_values"][0, number, 0] * self.volumes[number].slopes(x[part])
            force[part] -= self.p["damping"][0, number] * self.shares[part, None] * v[part]
        v = v + self.h * self.ease[:, None] * force
        x = x + self.h * v
        depth = np.maximum(self.ground - x[:, 1], 0.0)[:, None]  # on ground without friction
        x, v = x + depth * up, np.where(depth > 0.0, v + np.maximum(-(v @ up), 0.0)[:, None] * up, v)
        return self.meeting.meet(x, v) if self.meeting else (x, v)

    def _springs(self, number: int, shape: Any, x: Array) -> Array:
        springs = shape.springs
        constants = np.array([self.p[kind][0, number] for kind in ("structural", "shear", "flexion")])[springs.kind]
        ends, lengths = springs.pairs, np.float32(springs.rest_lengths).astype(float)
        d = x[ends[:, 1]] - x[ends[:, 0]]
        pull = d * (constants * (1.0 - lengths / np.linalg.norm(d, axis=1)))[:, None]
        force = np.zeros_like(x)
        np.add.at(force, ends[:, 0], pull)
        np.add.at(force, ends[:, 1], -pull)
        return force

    def _touch(self, x: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return contact forces, counts of contacts, and the state of each particle's contact."""
        force, counts, holds = np.zeros_like(x), np.zeros(len(x)), np.zeros((len(x), 4))
        for first, second, own, corners, may in self.pairs:
            pad = self._skins(first, second)[0] + 0.5 * self.edges[second]
            low, high = x[corners].min(axis=(0, 1)) - pad, x[corners].max(axis=(0, 1)) + pad
            near = ((x[own] >= low) & (x[own] <= high)).all(axis=1) & may.any(axis=1)
            if near.any():
                triangle = corners[self._nearest(x, own[near], corners, may[near])]
                self._press(x, v, first, second, own[near], triangle, force, counts, holds)
        return force, counts, holds

    def _nearest(self, x: Array, own: Array, corners: Array, may: Array) -> Array:
        """Return the triangle to which each particle is nearest; of those that share a place, that which faces it."""
        places, means = x[corners], x[corners].mean(axis=1)
        radii = np.linalg.norm(places - means[:, None], axis=-1).max(axis=1)
        away = np.linalg.norm(x[own][:, None] - means, axis=-1)
        least = np.where(may, away + radii, np.inf).min(axis=1, keepdims=True)
        some, which = np.nonzero(may & (away - radii <= 1.001 * least))
        a, b, c = (places[which, corner] for corner in range(3))
        arms, areas = x[own][some] - nearest_places(x[own][some], a, b, c), cross(b - a, c - a)
        distances, sizes = np.linalg.norm(arms, axis=-1), np.linalg.norm(areas, axis=-1)
        squares, steep = np.full(may.shape, 1e30), np.zeros(may.shape)
        squares[some, which] = distances**2
        steep[some, which] = np.abs(dots(arms, areas)) / np.maximum(distances * sizes, 1e-30)
        as_near = squares <= squares.min(axis=1, keepdims=True) * (1.0 + float(AS_NEAR))
        return np.where(as_near, steep, -1.0).argmax(axis=1)

    def _press(
        self, x: Array, v: Array, first: int, second: int, own: Array, corners: Array, force: Array, counts: Array,
        holds: Array,
    ) -> None:  # fmt: skip
        thickness, stiffness, friction = self._skins(first, second)
        point, places, moving = x[own], x[corners], v[corners]
        a, b, c = (places[:, n] for n in range(3))
        met = nearest_places(point, a, b, c)
        arm, area = point - met, cross(b - a, c - a)
        size, distance = np.linalg.norm(area, axis=1), np.linalg.norm(arm, axis=1)
        weights = barycentric(met, a, b, c, area)
        inside = (weights > 1e-9).all(axis=1) | (distance**2 <= float(NEAR) ** 2 * size)
        towards = arm * (np.where(dots(arm, area) < 0.0, -1.0, 1.0) / np.maximum(distance, 1e-30))[:, None]
        outward = np.where(inside[:, None], area / size[:, None], towards)
        gap = dots(arm, outward)
        along = dots(outward, area)
        reach = cross(outward[:, None], np.stack([c - b, a - c, b - a], axis=1))
        reach /= np.maximum(along, 1e-30)[:, None, None]
        reach *= (along > float(STEEPEST) * size)[:, None, None]
        beyond = arm - gap[:, None] * outward
        more = (reach * beyond[:, None]).sum(axis=-1)
        weights = weights + more * (dots(more, more) < float(LITTLE) ** 2)[:, None]
        tall = gap**2 * dots(reach, reach).max(axis=1) >= 1.0
        reach = reach * ~tall[:, None, None]

        side = np.ones(len(own))
        if first == second:  # no particle comes through
            side = np.where(gap < 0.0, -1.0, 1.0)
        overlap = thickness - side * gap
        across = v[own] - (weights[:, :, None] * moving).sum(axis=1)
        comes = overlap + float(SOON) * self.h * np.maximum(-side * dots(across, outward), 0.0) > 0.0
        np.add.at(counts, own, 1.0 * comes)
        shares = weights + np.abs(gap)[:, None] * np.linalg.norm(reach, axis=-1)
        np.add.at(counts, corners, shares * comes[:, None])

        normal, gap = side[:, None] * outward, side * gap
        rises = (moving * normal[:, None]).sum(axis=-1)
        relative = across + gap[:, None] * (rises[:, :, None] * reach).sum(axis=1)
        approach = -dots(relative, normal)
        busy = np.where(self.ease > 0.0, self.contacts, 0.0)
        crowd = np.maximum(busy[own] / self.crowds[first], busy[corners].max(axis=1) / self.crowds[second])
        share = 1.0 / np.maximum(crowd, 1.0)
        root, k = np.sqrt(share), share * stiffness
        mass = share / (self.ease[own] + (weights**2 * self.ease[corners]).sum(axis=1))
        is_first = holds[own, 3] == 0.0
        before = np.minimum(np.abs(self.holds[own, 3]) / root, overlap)
        rest = overlap - before
        slow = np.where(approach > -float(APART_RATE) * rest, float(APART_RATE) * self.h * rest, 0.0)
        pushed = np.clip(before + self.h * approach + slow, 0.0, np.maximum(overlap, 0.0))
        pushed = np.where(is_first, pushed, np.minimum(overlap, thickness))
        damping = 2.0 * float(DAMPING_RATIO) * np.sqrt(k * mass)
        push = np.maximum(k * pushed + damping * approach, 0.0)
        slip = np.where(is_first[:, None], self.holds[own, :3] / root[:, None], 0.0)
        slide = relative - dots(relative, normal)[:, None] * normal
        grips = (reach**2).sum(axis=(1, 2)) > 0.0
        held = slip - dots(slip, normal)[:, None] * normal + self.h * slide
        pull = -(k[:, None] * held + damping[:, None] * slide)
        pull *= np.minimum(friction * push / np.maximum(np.linalg.norm(pull, axis=1), 1e-30), 1.0)[:, None]
        held = held * np.minimum(friction * push / np.maximum(k * np.linalg.norm(held, axis=1), 1e-30), 1.0)[:, None]
        pull, slip = np.where(grips[:, None], pull, 0.0), np.where(grips[:, None], held, slip)
        whole = push[:, None] * normal + pull
        turning = (gap[:, None] * (reach * pull[:, None]).sum(axis=-1))[:, :, None] * normal[:, None]
        on_corners = -weights[:, :, None] * whole[:, None] + turning
        touches = overlap > 0.0
        np.add.at(force, corners, on_corners * touches[:, None, None])
        np.add.at(force, own, -(on_corners * touches[:, None, None]).sum(axis=1))
        kept = np.concatenate([slip * root[:, None], (side * np.maximum(root * pushed, 1e-20))[:, None]], axis=1)
        new = touches & is_first
        holds[own[new]] = kept[new]

    def _skins(self, first: int, second: int) -> tuple[float, float, float]:
        """Return thickness, stiffness and friction between two balloons."""
        thickness = 0.5 * float(np.float32(THICKNESS * self.edges[first]) + np.float32(THICKNESS * self.edges[second]))
        said, a, b = float(np.ravel(self.p["touch_thickness"])[0]), *self.p[STIFFNESSES][0, [first, second]]
        stiff = float(np.ravel(self.p["touch_stiffness"])[0])
        things = self.p[FRICTION].shape[1] - len(self.shapes)
        friction = self.p[FRICTION][0, things + first, things + second]
        return said if said >= 0.0 else thickness, stiff if stiff >= 0.0 else 2.0 * a * b / (a + b), friction


def barycentric(met: Array, a: Array, b: Array, c: Array, area: Array) -> Array:
    """Return the weights of the corners in places of triangles."""
    squared = np.maximum(dots(area, area), 1e-300)
    parts = (cross(c - b, met - b), cross(a - c, met - c), cross(b - a, met - a))
    return np.stack([dots(part, area) / squared for part in parts], axis=-1)


def nearest_places(point: Array, a: Array, b: Array, c: Array) -> Array:
    """Return the places of triangles that are nearest to points: within, or on one of the edges."""
    area = cross(b - a, c - a)
    flat = point - (dots(point - a, area) / np.maximum(dots(area, area), 1e-300))[..., None] * area
    weights = barycentric(flat, a, b, c, area)
    best, squares = flat, np.where((weights >= 0.0).all(axis=-1), dots(point - flat, point - flat), np.inf)
    for begin, end in ((a, b), (b, c), (c, a)):
        way = end - begin
        part = np.clip(dots(point - begin, way) / np.maximum(dots(way, way), 1e-300), 0.0, 1.0)
        place = begin + part[..., None] * way
        square = dots(point - place, point - place)
        best = np.where((square < squares)[..., None], place, best)
        squares = np.minimum(square, squares)
    return best
