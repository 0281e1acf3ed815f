"""Springs of contact between balloons, with damping and static friction, see `laws.touch`.

Every particle looks at all triangles of the others, or of its own balloon that are far from it at the start. It comes
to closed balloons from outside; open ones have two sides, as parts of one's own have across a gap.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from balloon_warp.reference.contact import contacts, momenta, point_triangle, relative, summed_at
from balloon_warp.reference.laws import across, cross, dot, size


@dataclass
class Touch:
    """Contacts of particles that overlap the skins of triangles."""

    triangles: Any  # of each balloon
    owner: Any  # balloon of each particle
    far: Any  # of two particles, whether they were so far apart that their own balloon's touch; None if no balloon's do
    crowds: Any  # contacts on each particle that the step allows for
    reach: Any  # how far from each balloon particles look at it [m]
    closed: Any  # whether each balloon is
    skins: Any = None  # thickness, stiffness and friction between balloons, shape (balloons, balloons, 3)
    ease: Any = None  # inverse masses of particles, shape (n, 1)

    def __post_init__(self):
        self.holds = np.zeros((len(self.owner), 4))
        """Of each particle's contact the slip, and the overlap that pushes, with its side; by the root of its share"""
        self.counts = np.zeros((len(self.owner), 1))
        """Contacts of each particle in the step before"""

    def begin_frame(self, x, v, h):
        """Count contacts anew."""
        holds, self.counts = self.holds, 0.0 * self.counts
        self.forces(x, v, h)
        self.holds = holds

    def forces(self, x, v, h):
        """Return the forces as a step begins, and keep counts and holds."""
        count, balloons = len(x), range(len(self.triangles))
        force, counts, holds = np.zeros((count, 3)), np.zeros((count, 1)), np.zeros((count, 4))
        for first, second in ((i, j) for i in balloons for j in balloons if i != j or self.far is not None):
            corners, pad = self.triangles[second], self.skins[first, second, 0] + self.reach[second]
            box = x[corners].min(axis=(0, 1)) - pad, x[corners].max(axis=(0, 1)) + pad
            own = np.flatnonzero((self.owner == first) & ((x >= box[0]) & (x <= box[1])).all(axis=1))
            own = own[self._may(own, corners, first == second).any(axis=1)]
            if len(own):
                ends = np.insert(corners[self._nearest(x, own, corners, first == second)], 0, own, axis=1)
                c, side = self._beside(x, ends)
                coming = np.maximum(-dot(relative(c, v[ends], 0.0 * c["arms"]), c["normal"]), 0.0)
                near = c[(c["gap"] < c["kept"] + 2.0 * h * coming)[:, 0]]
                bears = near["weights"] * [[1.0], [-1.0], [-1.0], [-1.0]] + size(near["couples"])
                counts += summed_at(count, near, bears)
                touches = (c["gap"] < c["kept"])[:, 0]
                force += self._press(c[touches], side[touches], v, h, holds)
        self.counts, self.holds = counts, holds
        return force

    def _may(self, own, corners, itself):
        """Return whether each particle may touch each triangle."""
        return self.far[own][:, corners].all(axis=2) if itself else np.ones((len(own), len(corners)), bool)

    def _nearest(self, x, own, corners, itself):
        """Return the triangle to which each particle is nearest; of those that share a place, that which faces it."""
        means = x[corners].mean(axis=1)
        radii, away = size(x[corners] - means[:, None]).max(axis=1)[:, 0], size(x[own][:, None] - means)[..., 0]
        may = self._may(own, corners, itself)
        least = np.where(may, away + radii, np.inf).min(axis=1, keepdims=True)
        some, which = np.nonzero(may & (away - radii <= 1.001 * least))
        at = x[np.insert(corners[which], 0, own[some], axis=1)]
        arm, area = (point_triangle(at) * at).sum(axis=1), cross(at[:, 2] - at[:, 1], at[:, 3] - at[:, 1])
        squares, steep = np.full(away.shape, 1e30), np.zeros(away.shape)
        squares[some, which] = dot(arm, arm)[:, 0]
        steep[some, which] = (np.abs(dot(arm, area)) / (size(arm) * size(area)))[:, 0]
        return np.where(squares <= squares.min(axis=1, keepdims=True) * (1.0 + 1e-5), steep, -1.0).argmax(axis=1)

    def _beside(self, x, ends):
        """Return contacts, and the side: -1 behind triangles with two sides, through which no particle comes.

        Friction acts on a triangle as if it reached to the particle: the couples are the gap times the gradients of the
        weights.
        """
        at = x[ends]
        w, sides = point_triangle(at), at[:, [2, 3, 1]] - at[:, 1:]
        arm, area = (w * at).sum(axis=1), cross(sides[:, 0], sides[:, 1])
        inside = (w[:, 1:] < 0.0).all(axis=1) | (dot(arm, arm) <= 1e-6 * size(area))
        normal = np.where(inside, area / size(area), np.where(dot(arm, area) < 0.0, -arm, arm) / size(arm))
        gap, along = dot(arm, normal), dot(normal, area)
        flat = along > 0.3 * size(area)
        reach = cross(normal[:, None], sides[:, [1, 2, 0]]) * (flat / np.where(flat, along, 1.0))[:, None]
        more = dot(reach, across(arm, normal)[:, None])  # beside an edge, but so near that it is taken along the normal
        w[:, 1:] -= more * ((more**2).sum(axis=1, keepdims=True) < 1e-4)
        reach = reach * (gap**2 * dot(reach, reach).max(axis=1) < 1.0)[:, None]
        first, second = self.owner[ends[:, 0]], self.owner[ends[:, 1]]
        itself, closed, hold = (first == second)[:, None], self.closed[second][:, None], self.holds[ends[:, 0], 3:]
        behind = np.where((hold == 0.0) | itself, gap, hold) < 0.0
        side = np.where(behind & (itself | ~closed), -1.0, 1.0)
        thickness, _, friction = self.skins[first, second].T[..., None]
        c = contacts(ends, w, arm, kept=thickness, friction=friction * reach.any(axis=2).any(axis=1, keepdims=True))
        c["normal"], c["gap"] = side * normal, side * gap
        c["couples"][:, 1:] = c["gap"][:, None] * reach
        meets = ((side * gap > -thickness) | itself | closed)[:, 0]
        return c[meets], side[meets]

    def _press(self, c, side, v, h, holds):
        """Return the forces of contacts, and store holds; where more meet than the step allows for, each is softer."""
        ends, n, overlap, own = c["ends"], c["normal"], c["kept"] - c["gap"], c["ends"][:, 0]
        u = relative(c, v[ends], 0.0 * c["arms"])
        approach, slide = -dot(u, n), across(u, n)
        crowd = np.where(self.ease > 0.0, self.counts, 0.0)[ends][..., 0] / self.crowds[ends]
        share = 1.0 / np.maximum(crowd.max(axis=1, keepdims=True), 1.0)
        root, k = np.sqrt(share), share * self.skins[self.owner[own], self.owner[ends[:, 1]], 1][:, None]
        damping = 0.4 * np.sqrt(k * share / (c["weights"] ** 2 * self.ease[ends]).sum(axis=1))
        is_first, held = holds[own, 3:] == 0.0, self.holds[own] / root
        before = np.minimum(np.abs(held[:, 3:]), overlap)
        rest = overlap - before  # was there at the start, or is so since another triangle is the nearest
        pushed = before + h * approach + np.where(approach > -10.0 * rest, 10.0 * h * rest, 0.0)
        pushed = np.where(is_first, np.clip(pushed, 0.0, overlap), np.minimum(overlap, c["kept"]))
        push = np.maximum(k * pushed + damping * approach, 0.0)
        slip = np.where(is_first, held[:, :3], 0.0)
        stretch, most = across(slip, n) + h * slide, c["friction"] * push
        pull = -(k * stretch + damping * slide)
        pull = pull * np.minimum(most / size(pull), 1.0)
        stretch = stretch * np.minimum(most / np.maximum(k * size(stretch), 1e-150), 1.0)
        slip = np.where(c["friction"] > 0.0, stretch, slip)
        kept = np.append(slip * root, side * np.maximum(root * pushed, 1e-20), axis=1)
        holds[own[is_first[:, 0]]] = kept[is_first[:, 0]]
        return summed_at(len(v), c, momenta(c, push * n + pull)[0])
