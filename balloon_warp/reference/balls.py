"""Spheres that meet in a step, wherever on their ways: small ones faces of balloons, and all of them each other."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from balloon_warp.reference.contact import Movers, contacts, point_triangle, resolve
from balloon_warp.reference.laws import dot, size
from balloon_warp.reference.solids import apart

NEVER = 2.0
"""Part of a step after which something meets that does not in it"""


def impact(m, c, gain, shift, seconds):
    """Let a contact gain a speed and a way along its normal; friction acts on the way in the seconds that are left."""
    push, rub = resolve(m, c, np.array([[gain]]))
    m.push(c, push + rub, 0.0)
    m.push(c, shift * resolve(m, c, 1.0)[0] + seconds * rub, 1.0, 0.0)


@dataclass
class SmallSpheres:
    """Small spheres that meet faces, the soonest first, see `laws.face_contact`."""

    small: Any  # their numbers
    owner: Any  # balloon of each particle
    triangles: Any
    friction: Any = None  # between balloons and spheres, shape (balloons, spheres)
    contacts: int = 0
    lumped: int = 0  # contacts in which a sphere has moved on with faces as one

    def sweep(self, starts, x, v, ease, h, spheres):
        """Return places and velocities after contact, of particles that were at `starts`; spheres change."""
        m, moved, sweeps = Movers(x, v, ease, spheres), True, 0
        starts = np.concatenate([starts, [ball["start"] for ball in spheres]])
        while moved and sweeps < 4:
            moved, sweeps = False, sweeps + 1
            for number in self.small:
                lump = [m.count + number]
                for meeting in range(16 + 48):
                    ends, part = self._soonest(m, starts, number, max(1.0 - 0.03 * meeting, 0.5))
                    if part > 1.0:
                        break
                    moved = True
                    if meeting < 16:
                        self._meet(m, starts, number, ends, part, h)
                    else:  # it moves on with them as one, or not at all if one of them is fixed
                        lump += [end for end in ends if end not in lump]
                        mass = 1.0 / np.maximum(m.ease[lump, 0], 1e-150) * (m.ease[lump] > 0.0).all()
                        mean = mass / max(mass.sum(), 1e-150)
                        m.x[lump], m.v[lump] = starts[lump] + mean @ (m.x - starts)[lump], mean @ m.v[lump]
                        self.lumped += 1
        return m.put_back()

    def _radius(self, m, number, x):
        """Return the radius with which a sphere meets triangles, by the resolution of float32."""
        return np.maximum(m.solids[number]["radius"], 1e-3 * size(x[:, 2:] - x[:, 1:2]).sum(axis=1))

    def _soonest(self, m, starts, number, nearest):
        """Return the ends of the first contact, and its part of the step, by conservative advancement."""
        ends = np.insert(self.triangles, 0, m.count + number, axis=1)
        x, ways = starts[ends], (m.x - starts)[ends]
        radius, longest = self._radius(m, number, x), size(ways[:, :1] - ways[:, 1:]).max(axis=1)
        little, part, found = 1e-4 * radius + 5e-7 * size(x[:, 0]), 0.0 * radius, NEVER + 0.0 * radius
        for look in range(256):
            at = x + part[:, None] * ways
            weights = point_triangle(at)
            arm = (weights * at).sum(axis=1)
            distance, nearer = size(arm), (part - 1.0) * dot((weights * ways).sum(axis=1), arm)
            goes_on = (part <= 1.0) & (found > 1.0)
            meets = (distance < nearest * radius) & (nearer > little * distance) | (look == 255)
            found = np.where(goes_on & meets, part, found)
            ahead = np.maximum(distance - (1.0 - 0.5e-3) * nearest * radius, 0.5 * distance)
            further = np.where(ahead < longest, part + ahead / np.maximum(longest, 1e-300), NEVER)
            part = np.where(goes_on, further, part)
            if not ((part <= 1.0) & (found > 1.0)).any():
                break
        return ends[found.argmin()], float(found.min())

    def _meet(self, m, starts, number, ends, part, h):
        before, seconds = starts[ends][None], (1.0 - part) * h
        at = before + part * (m.x[ends] - before)
        c = contacts(ends, point_triangle(at), at, friction=self.friction[self.owner[ends[1]], number])
        n, radius = c["normal"][0], float(self._radius(m, number, before)[0, 0])
        way, beside = ((c["weights"][0] * each[ends]).sum(axis=0) for each in (m.x, m.v))
        bent = way - seconds * beside  # where an earlier impact has bent the ways, they would be there in this moment
        if bent @ n > 0.5 * np.linalg.norm(bent):
            n = bent / np.linalg.norm(bent)
        c["normal"], c["arms"][:, 0] = n, -bent
        gain = max(-(beside @ n), 0.0)
        gap = way @ n + seconds * gain - 0.8 * radius
        out = max(apart(gap, h), 0.5 * min(float(c["gap"][0, 0]), radius) - 0.8 * radius - gap) if gap < 0.0 else 0.0
        impact(m, c, gain, seconds * gain + out, seconds)
        self.contacts += 1


def part_until(start, way, reach):
    """Return after which part of its way something is so near: 0 where it begins there, `NEVER` where it never is."""
    a, b, c = way @ way, start @ way, start @ start - reach**2
    if c > 0.0 and (b >= 0.0 or b * b <= a * c):
        return NEVER
    part = float(c / (-b + np.sqrt(b * b - a * c))) if c > 0.0 else 0.0
    return part if part <= 1.0 else NEVER


def collide(spheres, friction, slow, h, put_beside):
    """Let spheres that have moved meet each other, pair after pair, until nothing moves, see `laws.collision`.

    Args:
        slow: Speed up to which nothing rebounds, of two steps of gravity.
        put_beside: Takes a sphere out of the ground and obstacles.
    """
    for _ in range(24):
        moved = False
        for second in range(1, len(spheres)):
            for first in range(second):
                if _meet(spheres[first], spheres[second], friction[first, second], slow, h):
                    put_beside(first)
                    put_beside(second)
                    moved = True
        if not moved:
            break


def _meet(one, other, friction, slow, h):
    start, reach = other["start"] - one["start"], one["radius"] + other["radius"]
    way = other["position"] - one["position"]
    part = part_until(start, way - start, reach) if min(one["radius"], other["radius"]) > 0.0 else NEVER
    if part > 1.0:
        return False
    m, x = Movers(np.zeros((0, 3)), np.zeros((0, 3)), [], (one, other)), np.zeros((1, 4, 3))
    x[0, 1] = start + part * (way - start)
    c = contacts([0, 1, 0, 0], np.array([-1.0, 1.0, 0.0, 0.0])[:, None], x, friction=friction)
    n = c["normal"][0]
    c["arms"][0, :2] = one["radius"] * n, -other["radius"] * n
    gap, approach = min(np.linalg.norm(start) - reach, 0.0), max(-float(m.velocity(c)[0] @ n), 0.0)
    rebound = 1.0 + (np.sqrt(one["restitution"] * other["restitution"]) if approach > slow else 0.0)
    shift = (1.0 if gap < 0.0 else rebound) * max(reach + gap + apart(gap, h) - way @ n, 0.0)
    if shift + h * rebound * approach <= 1e-6 * reach:
        return False
    impact(m, c, rebound * approach, shift, (1.0 - part) * h)
    m.put_back()
    return True
