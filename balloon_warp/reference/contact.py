"""Contact by impulses: a contact is a row of signed weights of up to four movers, and kinds differ in their rows alone.

Movers i are particles, and solids about their centers. A contact of weights w_i, arms r_i and couples g_i sees, with
the velocities v_i, the spins s_i and its unit normal n, the relative velocity

    u = sum w_i (v_i + s_i x r_i) + (n . v_i) g_i

and an impulse J gives mover i, by the transposed of that, the momentum w_i J + (g_i . J) n and the angular momentum
w_i r_i x J: both stay, and friction takes energy alone. All pairs of features are looked at.
"""

import numpy as np

from balloon_warp.reference.laws import dot, size, summed

CONTACT = np.dtype(
    [("ends", int, 4), ("weights", float, (4, 1)), ("arms", float, (4, 3)), ("couples", float, (4, 3)),
     ("normal", float, 3), ("gap", float, (1,)), ("kept", float, (1,)), ("left", float, (1,)),
     ("friction", float, (1,))]
)  # fmt: skip
"""Contact: its movers, w, r, g, n, the gap, how much of that it keeps, and approach that it leaves to the next step"""


def cross(a, b):
    """Return cross products, for few vectors in a third of the time of NumPy's."""
    after, before = [1, 2, 0], [2, 0, 1]
    return a[..., after] * b[..., before] - a[..., before] * b[..., after]


def across(vector, normal):
    return vector - dot(vector, normal) * normal


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
        ground: Its height and the axis up, where it stops pushed movers.
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
