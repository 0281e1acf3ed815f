"""Contact by impulses: a contact is a stencil of signed weights of up to four movers, and kinds differ in that alone.

Movers i are particles, and solids about their centers. A contact of weights w_i, arms r_i and couples g_i sees, with
the velocities v_i, the spins s_i and its unit normal n, the relative velocity

    u = sum w_i (v_i + s_i x r_i) + (n . v_i) g_i

and an impulse J gives mover i, by the transposed of that, the momentum w_i J + (g_i . J) n and the angular momentum
w_i r_i x J: both stay, and friction takes energy alone. All pairs of features are looked at. See docs/CONTACT.md.

Springs of contact between balloons, with damping and static friction, see `laws.touch`.

Every particle looks at all triangles of the others, or of its own balloon that are far from it at the start. It comes
to closed balloons from outside; open ones have two sides, as parts of one's own have across a gap.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from balloon_warp.lab.reference.laws import across, cross, dot, size, summed

CONTACT = np.dtype(
    [("ends", int, 4), ("weights", float, (4, 1)), ("arms", float, (4, 3)), ("couples", float, (4, 3)),
     ("normal", float, 3), ("gap", float, (1,)), ("kept", float, (1,)), ("left", float, (1,)),
     ("friction", float, (1,)), ("out", float, (1,))]
)  # fmt: skip
"""Contact: its movers, w, r, g, n, the gap, how much of that it keeps, approach that it leaves to the next step,
friction, and how far it moves them apart without speed, besides what is missing of the gap that it keeps"""
NEVER = 2.0
"""Part of a step after which something meets that does not in it"""


class Movers:
    """Particles, then the ground, obstacles, spheres and bodies: one array a quantity.

    Args:
        x, v: Places and velocities, shape (n, 3).
        inverse_mass: Inverse masses, shape (n, 1); `turning` are inverse inertia tensors.
    """

    inverse_mass: Any
    up: Any
    shapes: Any

    def __init__(self, x, v, inverse_mass):
        self.x, self.v, self.inverse_mass, self.spin, self.start = x, v, inverse_mass, np.zeros_like(x), x.copy()
        self.turning, self.turn = np.zeros((len(x), 3, 3)), np.tile(np.eye(3), (len(x), 1, 1))
        self.radius, self.restitution = np.zeros(len(x)), np.zeros(len(x))
        self.h, self.gravity, self.up, self.height, self.ground = 0.0, 0.0, np.zeros(3), -np.inf, -1
        """The step [s], gravity, axis up, and the height and the number of the ground"""
        self.around, self.shapes, self.tensors = [], {}, {}
        """The ground and obstacles, as functions from starts and ends of ways to `beside_obstacle`, with their numbers;
        shapes, and inverse inertia tensors in bodies' axes, by number"""
        self.friction, self.thing = np.zeros((1, 1)), np.zeros(len(x), int)
        """Coulomb's coefficient between things, and the thing that each mover is or is of"""

    def states(self, numbers):
        """Return the state of movers, each by name."""
        names = {"position": self.x, "velocity": self.v, "spin": self.spin, "turn": self.turn}
        return [{name: values[number].copy() for name, values in names.items()} for number in numbers]

    def rub(self, one, other):
        """Return Coulomb's coefficient between movers."""
        return self.friction[self.thing[one], self.thing[other]]

    def velocity(self, c):
        return relative(c, self.v[c["ends"]], self.spin[c["ends"]])

    def gain(self, c, impulse):
        """Return u that contacts gain, each alone: of N on a mover each has an Nth of its mass (Tonge et al. 2012)."""
        shares = np.bincount(c["ends"][c["weights"][..., 0] != 0.0], minlength=len(self.x))[c["ends"]][..., None]
        linear, angular = momenta(c, impulse)
        turned = (self.turning[c["ends"]] @ angular[..., None])[..., 0]
        return relative(c, shares * self.inverse_mass[c["ends"]] * linear, shares * turned)

    def push(self, c, impulse, seconds, speeds=1.0):
        """Apply impulses, which places follow for some seconds; or move by them, where `speeds` is 0."""
        linear, angular = (summed_at(len(self.x), c, each) for each in momenta(c, impulse))
        gain, twist = self.inverse_mass * linear, (self.turning @ angular[..., None])[..., 0]
        self.x, self.v, self.spin = self.x + seconds * gain, self.v + speeds * gain, self.spin + speeds * twist


def point_triangle(x):
    """Return the weights of a point (0) and the place of a triangle (1, 2, 3) that is nearest, of x (k, 4, 3)."""
    point, corners = x[:, :1], x[:, 1:]
    sides, arms = corners[:, [1, 2, 0]] - corners, point - corners
    area = cross(sides[:, :1], sides[:, 1:2])
    inner = dot(cross(sides, arms), area)[:, [1, 2, 0]] / np.maximum(dot(area, area), 1e-300)
    part = np.clip(dot(arms, sides) / size(sides) ** 2, 0.0, 1.0)
    on_sides = (1.0 - part) * np.eye(3) + part * np.eye(3)[[1, 2, 0]]
    nearest = size(point - on_sides @ corners)[..., 0].argmin(axis=1)
    outer = on_sides[np.arange(len(x)), nearest][..., None]
    return np.insert(-np.where(inner.min(axis=1, keepdims=True) >= 0.0, inner, outer), 0, 1.0, axis=1)


def edge_edge(x):
    """Return the weights of the nearest places of two edges (0, 1) and (2, 3) (Ericson 2004, 5.1.9)."""
    first, second, start = x[:, 1] - x[:, 0], x[:, 3] - x[:, 2], x[:, 0] - x[:, 2]
    a, e, b = size(first) ** 2, size(second) ** 2, dot(first, second)
    c, f, sine = dot(first, start), dot(second, start), a * e - b**2
    skew = sine > 1e-4 * a * e
    s = np.where(skew, np.clip((b * f - c * e) / np.where(skew, sine, 1.0), 0.0, 1.0), 0.5)
    t = np.clip((b * s + f) / e, 0.0, 1.0)
    s = np.clip((b * t - c) / a, 0.0, 1.0)
    return np.stack([s - 1.0, -s, 1.0 - t, t], axis=1)


def contacts(ends, weights, way, **more):
    """Return contacts of features that are a way apart, shape (k, 3)."""
    rows = np.zeros(len(way), CONTACT)
    for name, value in ({"ends": ends, "weights": weights, "gap": size(way), "normal": way / size(way)} | more).items():
        rows[name] = value
    return rows


def relative(c, v, spin):
    """Return u of the ends' velocities and spins, shape (k, 4, 3)."""
    return (c["weights"] * (v + cross(spin, c["arms"])) + dot(v, c["normal"][:, None]) * c["couples"]).sum(axis=1)


def momenta(c, impulse):
    """Return the momenta and angular momenta of the ends by impulses, shape (k, 4, 3)."""
    j = impulse[:, None]
    return c["weights"] * j + dot(c["couples"], j) * c["normal"][:, None], c["weights"] * cross(c["arms"], j)


def summed_at(count, c, values):
    """Return the sums of values of the ends, shape (k, 4, ...), over all movers."""
    return summed(count, c["ends"].ravel(), values.reshape(-1, values.shape[-1]))


def resolve(m, c, excess):
    """Return the impulses by which contacts gain a speed along their normals, and those of Coulomb's friction [N s]."""
    n = c["normal"]
    push = excess / np.maximum(dot(m.gain(c, n), n), 1e-30)
    slide = across(m.velocity(c) + m.gain(c, push * n), n)
    along = slide / size(slide)
    stop = size(slide) / np.maximum(dot(m.gain(c, along), along), 1e-30)
    return push * n, -np.minimum(stop, c["friction"] * push) * along


def hold_above(m, c, seconds, speeds):
    """Put particles of contacts out of the ground, and stop them as far as that."""
    moved = np.zeros((len(m.x), 1))
    moved[c["ends"][c["weights"][..., 0] != 0.0]] = 1.0
    moved[m.ground :] = 0.0
    rise = moved * np.maximum(m.height - dot(m.x, m.up), 0.0)
    stop = speeds * np.minimum(rise / seconds, np.maximum(-dot(m.v, m.up), 0.0))
    m.x, m.v = m.x + rise * m.up, m.v + stop * m.up


def sweep(m, c, h, most, ground=False):
    """Let all contacts push at once, until none comes nearer than it may, so often at most; then restore gaps."""
    for _ in range(most):
        excess = -np.maximum(c["gap"] - c["kept"], 0.0) / h - dot(m.velocity(c), c["normal"])
        pushed = excess[:, 0] > 0.0
        m.push(c[pushed], sum(resolve(m, c[pushed], excess[pushed])), h)
        if ground:
            hold_above(m, c[pushed], h, 1.0)
        if not (pushed & (h * excess > c["left"])[:, 0]).any():
            break
    missing = c["out"] + 0.2 * np.maximum(0.5 * c["kept"] - c["gap"], 0.0)
    near = missing[:, 0] > 0.0
    m.push(c[near], resolve(m, c[near], missing[near])[0], 1.0, 0.0)
    if ground:
        hold_above(m, c[near], 1.0, 0.0)


def skin_contacts(ends, weights, x, owner, skins):
    """Return contacts of two features of balloons at x, which keep half a thickness."""
    thickness, _, friction = skins[tuple(owner[ends[:, [0, 3]]].T)].T[..., None]
    c = contacts(ends, weights, (weights * x).sum(axis=1), kept=0.5 * thickness, friction=friction)
    c["left"] = np.minimum(0.01 * c["kept"], 0.2 * c["gap"])
    return c


def edge_contacts(ends, x, owner, skins):
    """Return contacts of edges, whose friction acts at both places.

    Its torque couples along n at the ends balance; along edges there is none.
    """
    x = x[ends]
    weights, first, second = edge_edge(x), x[:, 1] - x[:, 0], x[:, 3] - x[:, 2]
    c = skin_contacts(ends, weights, x, owner, skins)
    span = dot(cross(first, second), c["normal"])
    rubs = (np.abs(span) > 0.3 * size(first) * size(second)) & (np.abs(weights) % 1.0 > 0.0).all(axis=1)
    scale = c["gap"] / np.where(rubs, span, np.inf)
    one, other = scale * cross(second, c["normal"]), scale * cross(c["normal"], first)
    c["couples"], c["friction"] = np.stack([-one, one, -other, other], axis=1), rubs * c["friction"]
    return c


def point_contacts(ends, x, owner, skins):
    """Return contacts without friction, of particles in front of triangles, or on either side of their own balloon."""
    x = x[ends]
    c = skin_contacts(ends, point_triangle(x), x, owner, skins)
    c["friction"], own = 0.0, owner[ends]
    front = dot(c["normal"], cross(x[:, 2] - x[:, 1], x[:, 3] - x[:, 1]))[:, 0] >= 0.0
    return c[front | (own[:, 0] == own[:, 1])]


def near_pairs(pairs, count, x, reach):
    """Return pairs of features, of which the first has so many particles, whose spheres are as near as that."""
    one, other = x[pairs[:, :count]], x[pairs[:, count:]]
    way = one.mean(axis=1) - other.mean(axis=1)
    radii = [size(part - part.mean(axis=1, keepdims=True)).max(axis=1) for part in (one, other)]
    return pairs[(size(way) - sum(radii) < reach)[:, 0]]


def contacts_of_body(m, body, reach, mass, passing):
    """Return contacts of particles that would come into a body, as `solids.passing_body` says."""
    held, n, arm, excess, out = passing
    rows = np.flatnonzero((held & (mass > 0.0))[:, 0])
    ends = np.stack([np.full(len(rows), body), rows, rows, rows], axis=1)
    c = contacts(ends, np.array([[-1.0], [1.0], [0.0], [0.0]]), n[rows], friction=m.rub(rows, body)[:, None])
    c["arms"][:, 0], c["out"] = arm[rows], out[rows]
    c["gap"] = m.h * (-dot(m.velocity(c), c["normal"]) - excess[rows])
    c["left"] = 1e-3 * m.h * np.maximum(excess[rows], 0.0) + 1e-7 * reach
    return c


def contacts_of_skins(m, pairs, owner, skins):
    """Return contacts of edges, and of particles that a spring would let through a triangle; given all pairs."""
    x, h = m.x - m.h * m.v, m.h
    reach = skins[..., 0].max() + 4.0 * h * size(m.v).max()
    edges, points = (near_pairs(each, count, x, reach) for each, count in zip(pairs, (2, 1), strict=True))
    c = np.concatenate([edge_contacts(edges, x, owner, skins), point_contacts(points, x, owner, skins)])
    return c[(c["gap"] < 2.0 * (c["kept"] + h * size((c["weights"] * m.v[c["ends"]]).sum(axis=1))))[:, 0]]


def contacts_of_ridges(m, ridges, kept, count, triangles, edges):
    """Return contacts of faces of balloons with ridges of solids, see `laws.touch`; a sphere is a ridge of one place.

    Ridges are as seen from each solid; `kept` are the gaps that faces keep of each, and last of any ridge [m].
    """
    x, found, h = m.x - m.h * m.v, [], m.h
    for column, (solid, of) in enumerate(ridges.items()):
        told = m, solid, of.radius, (kept[column], 0.02 * kept[-1]), x
        found += ridge_contacts(told, of, triangles, edges) if len(of.ends) else []
    c = np.concatenate(found)
    return c[(c["gap"] < c["kept"] + h * (size(m.v[:count]).max() + size(m.v[count:]).max()))[:, 0]]


def ridge_contacts(told, ridges, triangles, edges):
    """Return contacts of ridges with edges, and with faces at the nearer of their tips."""
    place, turn = told[0].start[told[1]], told[0].turn[told[1]]
    line, inward = place + ridges.ends @ turn.T, ridges.inward @ turn.T
    number, tip = np.nonzero(ridges.tips[:, None] >> np.arange(2) & 1)
    of_edges = line_contacts(told, edge_edge, edges, line, inward, 0.0 * line[:, 0])
    away = line[number, 1 - tip] - line[number, tip]
    of_tips = line_contacts(told, point_triangle, triangles, line[number, tip, None], inward[number], away)
    gaps = np.full((len(line), 2, len(triangles)), np.inf)
    gaps[number, tip] = of_tips["gap"].reshape(-1, len(triangles))
    return [of_edges, of_tips[(gaps.argmin(axis=1)[number] == tip[:, None]).ravel()]]


def line_contacts(told, kind, features, own, inward, away):
    """Return contacts of lines or tips with all features; where they do not meet, with a gap without end."""
    (m, solid, radius, keeps, start), count, ends = told, own.shape[1], np.tile(features, (len(own), 1))
    x = np.concatenate([np.repeat(own, len(features), axis=0), start[ends]], axis=1)
    w = kind(x) * (1.0 if count == 2 else -1.0)
    c = contacts(
        np.insert(ends, [0] * count, solid, axis=1), w, (w * x).sum(axis=1), friction=m.rub(ends[:, :1], solid)
    )
    (c["kept"], c["left"]), c["weights"][:, :count, 0] = keeps, [-1.0, 0.0][:count]
    c["arms"][:, 0] = (w * x)[:, count:].sum(axis=1) - m.start[solid]
    within = (w[:, :count] < 0.0).all(axis=1) & (w.max(axis=1) <= 1.0 - 1e-4)
    sides = np.concatenate([inward, away[:, None]], axis=1)
    along = c["normal"].reshape(len(own), -1, 3) @ sides.transpose(0, 2, 1)
    above = (along > 0.6 * np.insert(size(away), 0, [[1.0], [1.0]], axis=1)[:, None]).any(axis=2).reshape(-1, 1)
    c["gap"] += np.where(within & ~above, -radius - m.radius[solid], np.inf)
    return c


def impact(m, c, gain, shift, seconds):
    """Let a contact gain a speed and a way along its normal; friction acts on the way in the seconds that are left."""
    push, rub = resolve(m, c, np.array([[gain]]))
    m.push(c, push + rub, 0.0)
    m.push(c, shift * resolve(m, c, 1.0)[0] + seconds * rub, 1.0, 0.0)


def small_spheres_meet(m, small, triangles):
    """Let small spheres meet faces, the soonest first, see `laws.touch`.

    Return the numbers of contacts, and of those in which a sphere moves on with faces as one.
    """
    counts, sweeps, before = np.zeros(2, int), 0, -1
    while counts.sum() > before and sweeps < 4:
        before, sweeps = counts.sum(), sweeps + 1
        for ball in small:
            merged = [ball]
            for meeting in range(16 + 48):
                ends, part, radius = first_face(m, ball, triangles, max(1.0 - 0.03 * meeting, 0.5))
                if part > 1.0:
                    break
                counts[int(meeting >= 16)] += 1
                if meeting < 16:
                    meet_face(m, ends, part, radius)
                    continue
                merged += [
                    end for end in ends if end not in merged
                ]  # they move on as one, or not at all if one is fixed
                mass = 1.0 / np.maximum(m.inverse_mass[merged, 0], 1e-150) * (m.inverse_mass[merged] > 0.0).all()
                mean = mass / max(mass.sum(), 1e-150)
                m.x[merged], m.v[merged] = m.start[merged] + mean @ (m.x - m.start)[merged], mean @ m.v[merged]
    return counts


def first_face(m, ball, triangles, nearest):
    """Return ends of a sphere's first contact, its part of the step by conservative advancement, and the radius.

    A sphere meets triangles with a radius of float32's resolution at least.
    """
    ends = np.insert(triangles, 0, ball, axis=1)
    x, ways = m.start[ends], (m.x - m.start)[ends]
    radius = np.maximum(m.radius[ball], 1e-3 * size(x[:, 2:] - x[:, 1:2]).sum(axis=1))
    longest = size(ways[:, :1] - ways[:, 1:]).max(axis=1)
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
    first = found.argmin()
    return ends[first], float(found.min()), float(radius[first, 0])


def meet_face(m, ends, part, radius):
    """Let a sphere meet a face after a part of a step."""
    before, h, seconds = m.start[ends][None], m.h, (1.0 - part) * m.h
    at = before + part * (m.x[ends] - before)
    weights = point_triangle(at)
    c = contacts(ends, weights, (weights * at).sum(axis=1), friction=m.rub(*ends[:2]))
    n = c["normal"][0]
    way, beside = ((c["weights"][0] * each[ends]).sum(axis=0) for each in (m.x, m.v))
    bent = way - seconds * beside  # where an earlier impact has bent the ways, they would be there in this moment
    if bent @ n > 0.5 * np.linalg.norm(bent):
        n = bent / np.linalg.norm(bent)
    c["normal"], c["arms"][:, 0] = n, -bent
    gain = max(-(beside @ n), 0.0)
    gap = way @ n + seconds * gain - 0.8 * radius
    out = max(apart(gap, h), 0.5 * min(float(c["gap"][0, 0]), radius) - 0.8 * radius - gap) if gap < 0.0 else 0.0
    impact(m, c, gain, seconds * gain + out, seconds)


def apart(gap, h):
    """Return how far an overlap is resolved in a step: 10/s, at most a fifth."""
    return np.maximum(-gap, 0.0) * min(10.0 * h, 0.2)


def spheres_meet(m, balls, put_beside):
    """Let spheres that have moved meet each other, pair after pair, until nothing moves, see `laws.contact`.

    Up to the speed of two steps of gravity nothing rebounds; `put_beside` takes one out of what stands around.
    """
    balls = [ball for ball in balls if m.radius[ball]]  # others have yet to begin
    pairs = [(one, other) for number, other in enumerate(balls) for one in balls[:number]]
    for _ in range(24):
        if not sum(meet_sphere(m, *pair, put_beside) for pair in pairs):
            break


def meet_sphere(m, one, other, put_beside):
    """Let two spheres collide where they do on their ways, and return whether that moves them."""
    start, x, reach = m.start[other] - m.start[one], m.x[other] - m.x[one], m.radius[one] + m.radius[other]
    way, h = x - start, m.h
    a, b, c = way @ way, start @ way, start @ start - reach**2
    if c > 0.0 and (b >= 0.0 or b * b <= a * c):
        return False
    part = float(c / (-b + np.sqrt(b * b - a * c))) if c > 0.0 else 0.0
    if part > 1.0:
        return False
    weights = np.array([-1.0, 1.0, 0.0, 0.0])[:, None]
    c = contacts([one, other, 0, 0], weights, (start + part * way)[None], friction=m.rub(one, other))
    n = c["normal"][0]
    c["arms"][0, :2] = m.radius[one] * n, -m.radius[other] * n
    gap, approach = min(np.linalg.norm(start) - reach, 0.0), max(-float(m.velocity(c)[0] @ n), 0.0)
    rebound = 1.0 + (np.sqrt(m.restitution[one] * m.restitution[other]) if approach > 2.0 * h * abs(m.gravity) else 0.0)
    shift = (1.0 if gap < 0.0 else rebound) * max(reach + gap + apart(gap, h) - x @ n, 0.0)
    if shift + h * rebound * approach <= 1e-6 * reach:
        return False
    impact(m, c, rebound * approach, shift, (1.0 - part) * h)
    put_beside(m, one)
    put_beside(m, other)
    return True


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
    inverse_mass: Any = None  # inverse masses of particles, shape (n, 1)

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
        crowd = np.where(self.inverse_mass > 0.0, self.counts, 0.0)[ends][..., 0] / self.crowds[ends]
        share = 1.0 / np.maximum(crowd.max(axis=1, keepdims=True), 1.0)
        root, k = np.sqrt(share), share * self.skins[self.owner[own], self.owner[ends[:, 1]], 1][:, None]
        damping = 0.4 * np.sqrt(k * share / (c["weights"] ** 2 * self.inverse_mass[ends]).sum(axis=1))
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
