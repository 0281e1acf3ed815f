"""Edges of balloons that meet, and faces that meet ridges of solids: contacts from where features are nearest."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from balloon_warp.reference.contact import CONTACT, Movers, contacts, cross, edge_edge, point_triangle, sweep
from balloon_warp.reference.laws import dot, size


@dataclass
class Edges:
    """Edges of balloons that meet, and particles that a spring would let through a triangle, see `laws.edges`."""

    edges: Any  # all pairs of two edges, shape (n, 4)
    points: Any  # all pairs of a particle and a triangle, shape (m, 4)
    owner: Any  # balloon of each particle
    skins: Any = None  # thickness, stiffness and friction between balloons, shape (balloons, balloons, 3)

    def sweep(self, x, v, ease, h, ground=None):
        """Return places and velocities after contact."""
        start, reach = x - h * v, self.skins[..., 0].max() + 4.0 * h * size(v).max()
        near = replace(self, edges=_near(self.edges, 2, start, reach), points=_near(self.points, 1, start, reach))
        c = np.concatenate([near._edges(start), near._points(start)])
        c = c[(c["gap"] < 2.0 * (c["kept"] + h * size((c["weights"] * v[c["ends"]]).sum(axis=1))))[:, 0]]
        m = Movers(x, v, ease, ground=ground)
        if len(c):
            sweep(m, c, h, 300)
        return m.put_back()

    def _rows(self, ends, weights, x):
        thickness, _, friction = self.skins[tuple(self.owner[ends[:, [0, 3]]].T)].T[..., None]
        c = contacts(ends, weights, x, kept=0.5 * thickness, friction=friction)
        c["left"] = np.minimum(0.01 * c["kept"], 0.2 * c["gap"])
        return c

    def _edges(self, start):
        """Friction acts at both places, whose torque couples along n at the ends balance; along edges there is none."""
        x = start[self.edges]
        weights, first, second = edge_edge(x), x[:, 1] - x[:, 0], x[:, 3] - x[:, 2]
        c = self._rows(self.edges, weights, x)
        span = dot(cross(first, second), c["normal"])
        rubs = (np.abs(span) > 0.3 * size(first) * size(second)) & (np.abs(weights) % 1.0 > 0.0).all(axis=1)
        scale = c["gap"] / np.where(rubs, span, np.inf)
        one, other = scale * cross(second, c["normal"]), scale * cross(c["normal"], first)
        c["couples"], c["friction"] = np.stack([-one, one, -other, other], axis=1), rubs * c["friction"]
        return c

    def _points(self, start):
        """Contacts without friction, of particles that are in front, or on either side of their own balloon."""
        x = start[self.points]
        c = self._rows(self.points, point_triangle(x), x)
        c["friction"], own = 0.0, self.owner[self.points]
        front = dot(c["normal"], cross(x[:, 2] - x[:, 1], x[:, 3] - x[:, 1]))[:, 0] >= 0.0
        return c[front | (own[:, 0] == own[:, 1])]


def _near(pairs, count, x, reach):
    """Return pairs of features, of which the first has so many particles, whose spheres are as near as that."""
    one, other = x[pairs[:, :count]], x[pairs[:, count:]]
    way = one.mean(axis=1) - other.mean(axis=1)
    radii = [size(part - part.mean(axis=1, keepdims=True)).max(axis=1) for part in (one, other)]
    return pairs[(size(way) - sum(radii) < reach)[:, 0]]


@dataclass
class Ridges:
    """Faces of balloons that meet ridges of solids, see `laws.ridges`; a sphere is a ridge of one place."""

    ridges: Any  # of each solid, as seen from that
    kept: Any  # gaps that faces keep of each solid, and last of any ridge [m]
    owner: Any
    triangles: Any
    friction: Any = None  # between balloons and solids, shape (balloons, solids)

    @cached_property
    def edges(self):
        """Ends of all sides of triangles."""
        sides = self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        return np.unique(np.sort(sides, axis=1), axis=0)

    def sweep(self, x, v, ease, h, solids):
        """Return places and velocities after contact; solids change, which have their start, turn and radius, too."""
        m, found = Movers(x, v, ease, solids), [np.zeros(0, CONTACT)]
        for number, solid in enumerate(solids):
            ridges = self.ridges[number]
            for ends, inward, tips in zip(ridges.ends, ridges.inward, ridges.tips, strict=True):
                found += self._near(number, solid, ends, inward, tips, x - h * v)
        c = np.concatenate(found)
        c = c[(c["gap"] < c["kept"] + h * (size(v).max() + size(m.v[len(x) :]).max(initial=0.0)))[:, 0]]
        if len(c):
            sweep(m, c, h, 24)
        return m.put_back()

    def _near(self, number, solid, ends, inward, tips, start):
        """Contacts of a ridge with edges, and with faces at the nearer of its tips."""
        line, inward, far = solid["start"] + ends @ solid["turn"].T, inward @ solid["turn"].T, np.zeros(3)
        own = [
            (line[[tip]], point_triangle, self.triangles, line[1 - tip] - line[tip])
            for tip in (0, 1)
            if tips >> tip & 1
        ]
        faces = [self._rows(number, solid, start, inward, *each) for each in own]
        nearest = np.argmin([c["gap"][:, 0] for c in faces], axis=0) if len(faces) == 2 else 0
        nearer = [np.stack(faces)[nearest, np.arange(len(self.triangles))]] if faces else []
        return [self._rows(number, solid, start, inward, line, edge_edge, self.edges, far), *nearer]

    def _rows(self, number, solid, start, inward, line, kind, features, away):
        """Contacts of a line or a tip with features; where they do not meet, with a gap without end."""
        count, own = len(features), len(line)
        x = np.concatenate([np.broadcast_to(line, (count, own, 3)), start[features]], axis=1)
        w = kind(x) * (1.0 if own == 2 else -1.0)
        ends = np.concatenate([np.full((count, own), len(start) + number), features], axis=1)
        friction = self.friction[self.owner[features[:, :1]], number]
        c = contacts(ends, w, x, kept=self.kept[number], left=0.02 * self.kept[-1], friction=friction)
        c["weights"][:, :own, 0] = [-1.0, 0.0][:own]
        c["arms"][:, 0] = (w * x)[:, own:].sum(axis=1) - solid["start"]
        within = (w[:, :own] < 0.0).all(axis=1) & (w.max(axis=1) <= 1.0 - 1e-4)
        above = c["normal"] @ np.vstack([inward, away]).T > 0.6 * np.append([1.0, 1.0], size(away))
        c["gap"] += np.where(
            within & ~above.any(axis=1, keepdims=True), -self.ridges[number].radius - solid["radius"], np.inf
        )
        return c
