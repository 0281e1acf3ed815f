"""Contact by impulses: a contact is a row of signed weights of up to four movers, and kinds differ in their rows alone.

Movers i are particles, and solids about their centers. A contact of weights w_i, arms r_i and couples g_i sees, with
the velocities v_i, the spins s_i and its unit normal n, the relative velocity

    u = sum w_i (v_i + s_i x r_i) + (n . v_i) g_i

and an impulse J gives mover i, by the transposed of that, the momentum w_i J + (g_i . J) n and the angular momentum
w_i r_i x J: both stay, and friction takes energy alone. All pairs of features are looked at.
"""

import numpy as np

from balloon_warp.reference.laws import dot, size, summed
from balloon_warp.reference.solids import apart

CONTACT = np.dtype(
    [("ends", int, 4), ("weights", float, (4, 1)), ("arms", float, (4, 3)), ("couples", float, (4, 3)),
     ("normal", float, 3), ("gap", float, (1,)), ("kept", float, (1,)), ("left", float, (1,)),
     ("friction", float, (1,))]
)  # fmt: skip
"""Contact: its movers, w, r, g, n, the gap, how much of that it keeps, and approach that it leaves to the next step"""
NEVER = 2.0
"""Part of a step after which something meets that does not in it"""


def cross(a, b):
    """Return cross products, for few vectors in a third of the time of NumPy's."""
    after, before = [1, 2, 0], [2, 0, 1]
    return a[..., after] * b[..., before] - a[..., before] * b[..., after]


def across(vector, normal):
    return vector - dot(vector, normal) * normal


def point_triangle(x):
    """Return the weights of a point (0) and the place of a triangle (1, 2, 3) that is nearest, of x (k, 4, 3)."""
    point, corners = x[:, :1], x[:, 1:]
    sides, arms = np.roll(corners, -1, axis=1) - corners, point - corners
    area = cross(sides[:, :1], sides[:, 1:2])
    inner = np.roll(dot(cross(sides, arms), area), -1, axis=1) / np.maximum(dot(area, area), 1e-300)
    part = np.clip(dot(arms, sides) / size(sides) ** 2, 0.0, 1.0)
    on_sides = (1.0 - part) * np.eye(3) + part * np.roll(np.eye(3), 1, axis=1)
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


def contacts(ends, weights, x, **more):
    """Return contacts of features at x, shape (k, 4, 3): sum w x is the way between them."""
    rows, way = np.zeros(len(x), CONTACT), (weights * x).sum(axis=1)
    more |= {"ends": ends, "weights": weights, "gap": size(way), "normal": way / size(way)}
    for name, value in more.items():
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


class Movers:
    """Particles, and after them solids, as contacts move them; `put_back` returns particles and changes solids.

    Args:
        ease: Inverse masses of particles, shape (n, 1).
        solids: Dictionaries with position, velocity, spin, mass, and turning, the inverse inertia tensor.
        ground: Its height and the axis up, where it stops what is pushed.
    """

    def __init__(self, x, v, ease, solids=(), ground=None):
        self.solids, self.count, self.ground = solids, len(x), ground
        rows = [np.reshape([solid[name] for solid in solids], (-1, 3)) for name in ("position", "velocity", "spin")]
        self.x, self.v, self.spin = (np.concatenate(each) for each in zip((x, v, np.zeros_like(x)), rows, strict=True))
        self.ease = np.append(ease, [1.0 / solid["mass"] for solid in solids])[:, None]
        turning = np.reshape([solid["turning"] for solid in solids], (-1, 3, 3))
        self.turning = np.concatenate([np.zeros((len(x), 3, 3)), turning])

    def put_back(self):
        for number, solid in enumerate(self.solids, self.count):
            solid |= {"position": self.x[number], "velocity": self.v[number], "spin": self.spin[number]}
        return self.x[: self.count], self.v[: self.count]

    def velocity(self, c):
        return relative(c, self.v[c["ends"]], self.spin[c["ends"]])

    def gain(self, c, impulse):
        """Return u that contacts gain, each alone: of N on a mover each has an Nth of its mass (Tonge et al. 2012)."""
        shares = np.bincount(c["ends"][c["weights"][..., 0] != 0.0], minlength=len(self.x))[c["ends"]][..., None]
        linear, angular = momenta(c, impulse)
        turned = (self.turning[c["ends"]] @ angular[..., None])[..., 0]
        return relative(c, shares * self.ease[c["ends"]] * linear, shares * turned)

    def push(self, c, impulse, seconds, speeds=1.0):
        """Apply impulses, which places follow for some seconds; or move by them, where `speeds` is 0."""
        linear, angular = (summed_at(len(self.x), c, each) for each in momenta(c, impulse))
        gain, twist = self.ease * linear, (self.turning @ angular[..., None])[..., 0]
        self.x, self.v, self.spin = self.x + seconds * gain, self.v + speeds * gain, self.spin + speeds * twist
        if self.ground:
            (height, up), moved = self.ground, np.zeros((len(self.x), 1))
            moved[c["ends"][c["weights"][..., 0] != 0.0]] = 1.0
            rise = moved * np.maximum(height - dot(self.x, up), 0.0)
            stop = speeds * np.minimum(rise / seconds, np.maximum(-dot(self.v, up), 0.0))
            self.x, self.v = self.x + rise * up, self.v + stop * up


def resolve(m, c, excess):
    """Return the impulses by which contacts gain a speed along their normals, and those of Coulomb's friction [N s]."""
    n = c["normal"]
    push = excess / np.maximum(dot(m.gain(c, n), n), 1e-30)
    slide = across(m.velocity(c) + m.gain(c, push * n), n)
    along = slide / size(slide)
    stop = size(slide) / np.maximum(dot(m.gain(c, along), along), 1e-30)
    return push * n, -np.minimum(stop, c["friction"] * push) * along


def sweep(m, c, h, most):
    """Let all contacts push at once, until none comes nearer than it may, so often at most; then restore gaps."""
    for _ in range(most):
        excess = -np.maximum(c["gap"] - c["kept"], 0.0) / h - dot(m.velocity(c), c["normal"])
        pushed = excess[:, 0] > 0.0
        m.push(c[pushed], sum(resolve(m, c[pushed], excess[pushed])), h)
        if not (pushed & (h * excess > c["left"])[:, 0]).any():
            break
    missing = 0.2 * np.maximum(0.5 * c["kept"] - c["gap"], 0.0)
    near = missing[:, 0] > 0.0
    m.push(c[near], resolve(m, c[near], missing[near])[0], 1.0, 0.0)


class Edges:
    """Edges of balloons that meet, and particles that a spring would let through a triangle, see `laws.edges`.

    Args:
        edges: All pairs of two edges, shape (n, 4).
        points: All pairs of a particle and a triangle, shape (m, 4).
        owner: Balloon of each particle.
        skins: Thickness, stiffness and friction between balloons, shape (balloons, balloons, 3).
    """

    def __init__(self, edges, points, owner, skins):
        self.edges, self.points, self.owner, self.skins = edges, points, owner, skins

    def sweep(self, x, v, ease, h, ground=None):
        """Return places and velocities after contact."""
        c = np.concatenate([self._edges(x - h * v), self._points(x - h * v)])
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


class Ridges:
    """Faces of balloons that meet ridges of solids, see `laws.ridges`; a sphere is a ridge of one place.

    Args:
        ridges: Those of each solid, as seen from that.
        kept: Gap that faces keep of each solid, and of ridges.
        friction: Between balloons and solids, shape (balloons, solids).
    """

    def __init__(self, ridges, kept, friction, owner, triangles):
        self.ridges, self.kept, self.friction, self.owner, self.triangles = ridges, kept, friction, owner, triangles
        sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
        self.edges = np.unique(sides, axis=0)

    def sweep(self, x, v, ease, h, solids):
        """Return places and velocities after contact; solids change, which have their start, turn and radius, too."""
        m, found = Movers(x, v, ease, solids), [np.zeros(0, CONTACT)]
        for number, solid in enumerate(solids):
            for ridge in zip(*self.ridges[number][:2], self.ridges[number].tips, strict=True):
                found += self._near(number, solid, *ridge, x - h * v)
        c = np.concatenate(found)
        c = c[(c["gap"] < c["kept"] + h * (size(v).max() + size(m.v[len(x) :]).max(initial=0.0)))[:, 0]]
        if len(c):
            sweep(m, c, h, 24)
        return m.put_back()

    def _near(self, number, solid, ends, inward, tips, start):
        """Contacts of a ridge with edges, and with faces at the nearer of its tips."""
        line, inward, far = solid["start"] + ends @ solid["turn"].T, inward @ solid["turn"].T, np.zeros(3)
        of_tips = [(line[[tip]], point_triangle, self.triangles, line[1 - tip] - line[tip]) for tip in (0, 1)]
        faces = [self._rows(number, solid, start, inward, *of_tips[tip]) for tip in (0, 1) if tips >> tip & 1]
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
        outside = (c["normal"] @ np.vstack([inward, away]).T <= 0.6 * np.append([1.0, 1.0], size(away))).all(axis=1)
        c["gap"] += np.where(within & outside[:, None], -self.ridges[number].radius - solid["radius"], np.inf)
        return c


def impact(m, c, gain, shift, seconds):
    """Let a contact gain a speed and a way along its normal; friction acts on the way in the seconds that are left."""
    push, rub = resolve(m, c, np.array([[gain]]))
    m.push(c, push + rub, 0.0)
    m.push(c, shift * resolve(m, c, 1.0)[0] + seconds * rub, 1.0, 0.0)


class SmallSpheres:
    """Small spheres that meet faces, the soonest first, see `laws.face_contact`.

    Args:
        small: Their numbers.
        friction: Between balloons and spheres, shape (balloons, spheres).
    """

    def __init__(self, small, friction, owner, triangles):
        self.small, self.friction, self.owner, self.triangles = small, friction, owner, triangles
        self.contacts, self.lumped = 0, 0

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
