"""Solids: how particles and spheres leave the ground and obstacles, and exchange momentum with spheres and bodies.

Solids have rows of `contact.Movers`; a shape has a kind, size, thickness, and the axis up. See docs/CONTACT.md.

Free rigid bodies: how they turn, and their contact with each other, the ground, obstacles and spheres.

Bodies have rows of `contact.Movers`. See `laws.rigid`. Impulses act as a step begins, from where a
body's angular momentum stays.
"""

from typing import Any, NamedTuple

import numpy as np

from balloon_warp.lab.reference.contact import apart, contacts, resolve
from balloon_warp.lab.reference.laws import across, cross, dot, size


def turn_by(vectors):
    """Return the matrices of turns about vectors, by their lengths [rad] (Rodrigues)."""
    angles = size(vectors)[..., None]
    skew = np.cross(np.eye(3), vectors[..., None, :] / angles)
    return np.eye(3) + np.sin(angles) * skew + (1.0 - np.cos(angles)) * skew @ skew


def carried(velocity, spin, arm, seconds):
    """Return the velocity along the chord on which a place goes in a step, from its arm then, or before if negative."""
    return velocity + (arm @ turn_by(seconds * spin).T - arm) / seconds


def pose(shifts, turns, frame, part, frame_seconds):
    """Return an obstacle's shift, turn, velocity and spin at a part of a frame, between those at its ends."""
    first, last = (min(number, len(shifts) - 1) for number in (frame, frame + 1))
    way, turn = shifts[last] - shifts[first], turns[last] @ turns[first].T
    twice = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = 0.5 * np.linalg.norm(twice)
    turning = twice * 0.5 * (np.arctan2(sine, 0.5 * (np.trace(turn) - 1.0)) / sine if sine > 0.0 else 1.0)
    place, at = shifts[first] + part * way, turn_by(part * turning) @ turns[first]
    return place, at, way / frame_seconds, turning / frame_seconds


def surface(shape, up, x, radius):
    """Return the signed distance from a shape about its own origin, less a radius, and the normal."""
    if shape.kind == "plane":
        distance, normal = dot(x, up), np.broadcast_to(up, x.shape)
    elif shape.kind == "capsule":
        arm = x - np.clip(dot(x, up), -shape.size[1], shape.size[1]) * up
        distance, normal = size(arm) - shape.size[0], arm / size(arm)
    else:
        beyond, signs = np.abs(x) - shape.size, np.where(x < 0.0, -1.0, 1.0)
        most, out = beyond.max(axis=1, keepdims=True), np.maximum(beyond, 0.0)
        inward = np.eye(3)[beyond.argmax(axis=1)]
        distance, normal = np.where(most > 0.0, size(out), most), np.where(most > 0.0, out / size(out), inward) * signs
    return distance - shape.thickness - radius, normal


def path_past(shape, up, start, end, radius):
    """Narrow phase of ways past a convex shape: ends, contact normals or 0, remaining displacements, distances.

    Along a line the distance is convex: Newton's method comes to where a way enters, and never past it.
    """
    way, (distance, normal) = size(end - start), surface(shape, up, end, radius)
    ahead, near = (end - start) / way, 2e-6 * (way + size(start))
    straight = (distance < 0.0) & (dot(start - end, normal) + distance >= -near)
    gone = np.zeros_like(way)
    while True:
        here, out = surface(shape, up, start + gone * ahead, radius)
        falling = -dot(out, ahead)
        enters = here - falling * (way - gone) < -1e-12 * way  # or else all the rest is outside
        step = np.where(enters & (here > 1e-7 * near), here / np.where(enters, falling, 1.0), 0.0)
        if not step.any():
            break
        gone = gone + step
    place = start + gone * ahead - here * out
    slides = enters & ~straight
    slid = end + np.maximum(dot(place - end, out), 0.0) * out
    held = slides | (distance < 0.0)
    let = np.where(slides, slid, np.where(held, end - distance * normal, end))
    return let, np.where(slides, out, normal) * held, (slides, np.where(slides, 1.0 - gone / way, 1.0)), distance


def beside_obstacle(shape, up, poses, h, start, x, radius=0.0):
    """Return `path_past` an obstacle that moves between two poses in a step, and how fast its surface moves there."""
    (before, earlier, *_), (place, turn, velocity, spin) = poses
    let, normal, left, distance = path_past(shape, up, (start - before) @ earlier, (x - place) @ turn, radius)
    arm = let @ turn.T
    let = np.where(normal.any(axis=1, keepdims=True), place + arm, x)
    return let, normal @ turn.T, left, carried(velocity, spin, arm, -h), distance


def on_ground(height, up, start, x):
    """Return the same of a ground, which stops all that is below its height."""
    depth = height - dot(x, up)
    low = depth > 0.0
    return x + low * depth * up, low * up, (False, 1.0), np.zeros(3), np.where(low, 0.0, np.inf)


def stand(m, start, x, v, predicted=False, at_once=False):
    """Return places and velocities beside obstacles and the ground, and the normals of the last contacts.

    Of an approach as much is stopped as has led behind the surface. Coulomb's friction takes at most its coefficient
    times that; the way is that of the velocity once all is stopped. Where two are near, one may push into the other,
    and both take turns; there all of an approach is stopped at once, as where a way passes an edge.
    Where places are only foreseen, particles keep their velocities.
    """
    given, normals, takes = (x, v), np.zeros_like(x), np.ones((len(x), 1), dtype=bool)
    met, h = np.zeros((len(m.around), len(x), 1), dtype=bool), m.h
    for _ in range(1 if predicted else 4):
        end, distances = x, []
        for number, (let_through, thing) in enumerate(m.around):
            let, normal, (slides, left), moving, distance = let_through(start, x)
            normal, distances = np.where(takes, normal, 0.0), [*distances, distance]
            held, beside = normal.any(axis=1, keepdims=True), v - moving
            met[number] |= held
            along, approach = across(beside, normal), np.maximum(-dot(beside, normal), 0.0)
            stopped = np.minimum(approach, np.maximum(dot(let - x, normal), 0.0) / h)
            stopped = np.where(at_once | slides, approach, stopped)
            slid = np.where(at_once | slides, left, stopped / np.maximum(approach, 1e-12))
            friction = m.rub(np.arange(len(x)), thing)[:, None]
            rubbed = [np.minimum(friction * part / size(along), 1.0) for part in (approach, stopped)]
            x, normals = np.where(held, let - h * slid * rubbed[0] * along, x), np.where(held, normal, normals)
            if not predicted:
                v = np.where(held, v - rubbed[1] * along + stopped * normal, v)
        near = sum(distance < size(end - start) + size(x - end) for distance in distances)
        takes = (size(x - end) > 1e-3 * size(end - start) + 2e-6 * size(x)) & (near > 1)
        if not np.any(takes):
            break
    found, several = (x, v, normals), met.sum(axis=0) > 1
    if predicted or at_once is not False or not several.any():
        return found
    again = stand(m, start, *given, at_once=several)
    return [np.where(several, *both) for both in zip(again, found, strict=True)]


class Surface(NamedTuple):
    """Something immovable where a sphere meets it."""

    normal: np.ndarray
    velocity: np.ndarray | float
    friction: float


def ground_under(m, ball):
    """Return the ground as a sphere meets it."""
    return Surface(m.up, 0.0, m.rub(ball, m.ground))


def rub(m, ball, surface, stopped, seconds):
    """Let a sphere rub at its radius on a surface, which has changed its speed along the normal."""
    if m.radius[ball]:  # it has begun
        arm = -m.radius[ball] * surface.normal
        slip = across(m.v[ball] + cross(m.spin[ball], arm) - surface.velocity, surface.normal)
        gain = -min(1.0 / 3.5, surface.friction * stopped / size(slip).item()) * slip
        m.x[ball], m.v[ball] = m.x[ball] + seconds * gain, m.v[ball] + gain
        m.spin[ball] = m.spin[ball] + 2.5 / m.radius[ball] ** 2 * cross(arm, gain)


def bounce(m, ball, surface, stopped, out, seconds):
    """Let a sphere gain a speed and a way along the normal of a surface, on which it rubs."""
    m.x[ball], m.v[ball] = m.x[ball] + out * surface.normal, m.v[ball] + stopped * surface.normal
    rub(m, ball, surface, stopped, seconds)


def stop_of(coming, depth, before, restitution, h):
    """Return how much a surface stops a sphere, which turns where it is with the speed that it had before the step."""
    excess = min(depth / h, coming)
    return max(excess, coming + restitution * before) if excess > 0.0 else 0.0


def roll(m, ball, lift):
    """Move a sphere that its lift accelerates beside the ground, where it turns with the speed that it had before."""
    gap, rise = m.x[ball] @ m.up - m.radius[ball] - m.height, m.v[ball] @ m.up
    m.v[ball] = m.v[ball] + m.h * (lift - m.gravity * m.up)
    m.x[ball], coming = m.x[ball] + m.h * m.v[ball], -(m.v[ball] @ m.up)
    stopped = stop_of(coming, m.h * coming - gap, -rise, m.restitution[m.ground], m.h)
    bounce(m, ball, ground_under(m, ball), stopped, m.h * stopped + apart(gap, m.h), m.h)


def put_beside(m, ball):
    """Lift a sphere out of the ground, from which it bounces, and then out of obstacles, which take turns."""
    depth, coming = m.height + m.radius[ball] - m.x[ball] @ m.up, -(m.v[ball] @ m.up)
    if depth > 0.0:
        stopped = stop_of(coming, m.h * coming, coming, m.restitution[m.ground], m.h)
        bounce(m, ball, ground_under(m, ball), stopped, depth, m.h)
    leave_obstacles(m, ball)


def leave_obstacles(m, ball):
    """Move a sphere out of obstacles, which take turns."""
    start, around = m.start[ball], [each for each in m.around if each[1] != m.ground]
    for _ in range(4):
        end = m.x[ball].copy()
        for let_through, obstacle in around:
            let, (n,), (_, left), moving, _ = let_through(start[None], m.x[[ball]], m.radius[ball])
            if n.any():
                coming, depth = (moving[0] - m.v[ball]) @ n, (let[0] - m.x[ball]) @ n
                before = coming - m.h * m.gravity * m.up @ n
                stopped = stop_of(coming, depth, before, m.restitution[obstacle], m.h)
                surface = Surface(n, moving[0], m.rub(ball, obstacle))
                bounce(m, ball, surface, stopped, max(m.h * stopped, depth), m.h * left[0, 0])
        moved, way = np.linalg.norm(m.x[ball] - end), np.linalg.norm(end - start)
        if len(around) == 1 or moved <= 1e-3 * way + 2e-6 * np.linalg.norm(m.x[ball]):
            break


def leave_sphere(m, ball, x, v):
    """Return places and velocities outside of a sphere, and the normals of particles that were in it.

    Of an approach as much is stopped as has led inside.
    """
    arm, radius = x - m.x[ball], m.radius[ball]
    normal = np.where(size(arm) < radius, arm / size(arm), 0.0)
    approach = np.maximum(dot(m.v[ball] - v, normal), 0.0)
    v = v + np.minimum(approach, (radius - dot(arm, normal)) / m.h) * normal
    return np.where(normal.any(axis=1, keepdims=True), m.x[ball] + radius * normal, x), v, normal


def may_meet(m, ball, count):
    """Return which particles may meet a sphere on twice their ways in a step, shape (count, 1)."""
    way = m.h * (m.v[:count] - m.v[ball])
    arm = m.x[:count] - m.x[ball] - way
    part = np.clip(-dot(arm, way) / np.maximum(dot(way, way), 1e-150), 0.0, 2.0)
    return size(arm + part * way) < 65.0 / 64.0 * m.radius[ball]


def passing_sphere(m, ball, mass):
    """Return which particles are near a sphere, and the normals, arms, excess speeds and ways out of all."""
    near, (x, v), h = may_meet(m, ball, len(mass)) & (mass > 0.0), (m.x[: len(mass)], m.v[: len(mass)]), m.h
    arm = x - h * v - (m.x[ball] - h * m.v[ball])
    n, gap = arm / size(arm), size(arm) - m.radius[ball]
    excess = -dot(v - m.v[ball], n) - np.maximum(gap, 0.0) / h
    return near, n, arm, excess, np.where(near, apart(gap, h), 0.0)


def passing_body(m, body, turn, start, end, v, radius=0.0):
    """Return which points pass a body on its way to another turn, and the same of them; normals are 0 of the others."""
    (shape, up), arm, h = m.shapes[body], start - m.start[body], m.h
    let, normal, _, _ = path_past(shape, up, arm @ m.turn[body], (end - m.x[body]) @ turn, radius)
    back, normal = let @ turn.T - (end - m.x[body]), normal @ turn.T
    depth, held = size(back), normal.any(axis=1, keepdims=True)
    normal = np.where(held & (dot(back, normal) < 0.99 * depth), back / depth, normal)
    approach = -dot(v - m.v[body] - cross(m.spin[body], arm), normal)
    excess = np.where(held, np.minimum(depth / h, approach), -1e30)
    return held, normal, arm, excess, apart(h * np.maximum(approach, 0.0) - depth, h) * held


def exchange(m, ball, mass, passing):
    """Let a sphere and particles exchange momentum: to the nearest velocities at which n . (v - V) >= -gap / h.

    They pass as `passing_sphere` says; those of no mass are fixed. By the inverse mass of the sphere's surface over
    that of its center, friction gives no energy. The ground takes part, of a great mass, where the sphere is pressed
    to it.
    """
    (near, n, arm, excess, out), h = passing, m.h
    count, heavy, radius = len(mass), 1.0 / m.inverse_mass[ball].item(), m.radius[ball]
    near, over, change = near & (mass > 0.0), mass * (out > 0.0), np.zeros(3)
    if not (near & (excess > 0.0) | (over > 0.0)).any():
        return
    x, v, center = m.x[:count], m.v[:count], m.x[ball] - h * m.v[ball]
    sinking = -(m.v[ball] @ m.up) - max(center @ m.up - radius - m.height, 0.0) / h
    pressed, grounded = near & (excess > 0.0), sinking > 0.0
    for _ in range(16):
        w = mass * pressed
        earth = 1e6 * (heavy + w.sum()) * grounded
        lost = (w * excess * n).sum(axis=0) - earth * sinking * m.up
        change = -np.linalg.solve(heavy * np.eye(3) + (n * w).T @ n + earth * np.outer(m.up, m.up), lost)
        before, pressed = pressed, near & (n @ change[:, None] + excess > 0.0)
        stood, grounded = grounded, sinking - m.up @ change > 0.0
        if (pressed == before).all() and grounded == stood:
            break
    w = mass * pressed
    shift = -np.linalg.solve(heavy * np.eye(3) + (n * over).T @ n, (over * out * n).sum(axis=0))
    gain = np.where(pressed, n @ change[:, None] + excess, 0.0) * n
    x, v = x + h * gain + np.where(over > 0.0, n @ shift[:, None] + out, 0.0) * n, v + gain
    m.v[ball], m.x[ball] = m.v[ball] + change, m.x[ball] + h * change + shift
    share = 1.0 / (1.0 + w.sum() * (1.0 + 2.5 * dot(arm, arm) / radius**2) / heavy)
    slip = across(v - m.v[ball] - cross(m.spin[ball], arm), n)
    rubs = -np.minimum(share, m.rub(np.arange(count), ball)[:, None] * size(gain) / size(slip)) * slip * pressed
    m.x[:count], m.v[:count] = x + h * rubs, v + rubs
    slowed = -(mass * rubs).sum(axis=0) / heavy
    m.x[ball], m.v[ball] = m.x[ball] + h * slowed, m.v[ball] + slowed
    m.spin[ball] = m.spin[ball] - m.turning[ball] @ cross(arm, mass * rubs).sum(axis=0)
    if grounded:
        pushed = max(m.up @ (heavy * change + (w * gain).sum(axis=0)), 0.0)
        rub(m, ball, ground_under(m, ball), pushed / heavy, h)


def turned(m, body):
    """Return a body's turn after a step, by the mean of its angular momenta as it sees them before and after."""
    turn, spin, tensor, h = m.turn[body], m.spin[body], m.tensors[body], m.h
    whole, parts = np.linalg.solve(m.turning[body], spin), int(np.clip(np.ceil(h * np.linalg.norm(spin) / 0.5), 1, 16))
    for _ in range(parts):
        momentum = mean = whole @ turn
        for _ in range(8):
            spin, half = tensor @ mean, 0.5 * h / parts
            angle = half * np.linalg.norm(spin)
            half *= np.tan(angle) / angle if angle else 1.0
            off = mean - momentum + half * np.cross(spin, mean)
            skews = [np.cross(each, np.eye(3)).T for each in (spin, mean)]
            mean = mean - np.linalg.solve(np.eye(3) + half * (skews[0] - skews[1] @ tensor), off)
        turn = turn_by(h / parts * turn @ tensor @ mean) @ turn
    return turn


def take_turn(m, body):
    """Give a body its turn after a step, with the angular momentum that it has."""
    momentum = np.linalg.solve(m.turning[body], m.spin[body])
    m.turn[body] = turn = turned(m, body)
    m.turning[body] = turn @ m.tensors[body] @ turn.T
    m.spin[body] = m.turning[body] @ momentum


class Grips:
    """Contacts of bodies: little balls, samples of each, that come near another thing, of an obstacle also at the body.

    Shapes, samples and reaches [m] of the ground, obstacles and bodies are by their numbers among movers.
    """

    def __init__(self, shapes, bodies, samples, reach):
        rows, self.shapes, self.bodies, self.reach = [], shapes, bodies, np.zeros(1 + max(shapes))
        self.reach[[*reach]] = [*reach.values()]
        for body in bodies:
            for thing in shapes:
                own, moves = samples[body], thing in bodies
                most = own.outermost if thing not in samples else own.at_edges if moves else len(own.points)
                pairs = [(body, thing, own.points[:most])] * bool(thing != body)
                if thing in samples and not moves:
                    pairs.append((thing, body, samples[thing].points))
                rows += [(body, thing, bearer, met, *point) for bearer, met, points in pairs for point in points]
        table = np.array(rows)
        self.ends, self.points = table[:, :4].astype(int), table[:, 4:]
        self.kept = np.zeros((len(rows), 3))
        """Impulses of the step before, from which the next one begins"""

    def near(self, m, fall):
        """Return contacts: the rows, normals, arms at both, velocities of the other surface, and gaps."""
        (body, thing, bearer, met), h = self.ends.T, m.h
        moves = np.isin(thing, self.bodies)[:, None]
        at = m.x[bearer] + np.einsum("kxy,ky->kx", m.turn[bearer], self.points[:, :3])
        seen = np.einsum("kyx,ky->kx", m.turn[met], at - m.x[met])
        gap, n = np.zeros((len(at), 1)), np.zeros_like(at)
        for number, (shape, up) in self.shapes.items():
            of = met == number
            gap[of], n[of] = surface(shape, up, seen[of], self.points[of, 3:])
        n = np.einsum("kxy,ky->kx", m.turn[met], n)
        at, n = at - self.points[:, 3:] * n, np.where((met == thing)[:, None], n, -n)
        speed = (size(m.v) + size(m.spin) * self.reach[:, None])[:, 0]
        fastest = (speed + fall * np.isin(np.arange(len(speed)), self.bodies))[[*self.shapes]].max()
        within = 1.5 * h * (speed[body] + fall + fastest)
        arm, other, center = at - m.x[body], at - m.x[thing], m.x[body] - m.x[thing]
        turns = turn_by(h * m.spin)[thing]

        def carried(place):
            return m.v[thing] + (np.einsum("kxy,ky->kx", turns, place) - place) / h

        along = carried(center) + cross(m.spin[thing], arm)  # as the body's center goes
        moving = np.where(moves, 0.0, along + dot(carried(center + arm) - along, n) * n)
        blurred = 1e-5 * self.reach[body] + 4e-7 * size(m.x[body])[:, 0]
        rows = np.flatnonzero(gap[:, 0] < within)
        gap = np.where(np.abs(gap[:, 0]) <= blurred, 0.0, gap[:, 0])
        return rows, *(each[rows] for each in (n, arm, other, moving, gap))


class Contacts(NamedTuple):
    """Contacts that impulses of each other change, k of them; the reference has no types of arrays."""

    a: Any
    """Velocities by impulses, shape (k, 3, k, 3)"""
    b: Any
    """Velocities without them, shape (k, 3)"""
    n: Any
    """Normals, shape (k, 3)"""
    friction: Any
    """Coefficients, shape (k,)"""
    impulse: Any
    """Impulses to begin with, shape (k, 3)"""


def settle(contacts, least, allowed, most):
    """Solve contacts' impulses one after the other, each with the latest of the others (projected Gauss-Seidel).

    All go on by a part of the last sweep's change (Nesterov; O'Donoghue and Candes 2015). Velocities at contacts are
    b + a impulse, and are to be at least so along normals; they agree once a sweep changes none by more than is
    allowed.
    """
    a, b, n, friction, impulse = contacts
    inverse_mass = np.einsum("kx,kxky,ky->k", n, a, n)
    ahead, age, before = np.zeros_like(impulse), 0.0, np.inf
    for _ in range(most):
        impulse = impulse + ahead
        last = impulse.copy()
        for i in range(len(n)):
            u, pushed = b[i] + np.tensordot(a[i], impulse), impulse[i] @ n[i]
            slide = across(u, n[i])
            along = slide / size(slide)
            part = max(pushed + (least[i] - n[i] @ u) / inverse_mass[i], 0.0)
            rub = across(impulse[i], n[i]) - slide / max(along @ a[i, :, i] @ along, 1e-30)
            impulse[i] = part * n[i] + rub * np.minimum(friction[i] * part / size(rub), 1.0)
        added = impulse - last
        if (size(added)[:, 0] * inverse_mass <= allowed).all():
            return impulse, True
        turns_back, changed = (
            inverse_mass @ dot(added, ahead + added) < 0.0,
            float((inverse_mass @ dot(added, added))[0]),
        )
        age, before = 0.0 if turns_back or changed > 2.0 * before else age + 1.0, changed
        ahead = max(age - 1.0, 0.0) / (age + 2.0) * (ahead + added)
    return impulse, False


def apply_contact_impulses(contacts, before, least, closing, group, allowed, most):
    """Return impulses that give no group of contacts energy, see `laws.rigid`.

    A group is of bodies that touch; velocities before are those before gravity acts, `closing` is `least` without
    rebounds.
    """
    a, b = contacts.a, contacts.b

    def in_group(each):
        return np.bincount(group, each[:, 0])[group, None]

    def after(pushed):
        return b + np.einsum("kxly,ly->kx", a, pushed)

    def work(pushed, after):
        return in_group(0.5 * dot(pushed, before + after))

    whole, agrees = settle(contacts, least, allowed, most)
    rebounds = (least > 0.0).any()
    gain, exchanged = work(whole, after(whole)), in_group(0.5 * np.abs(dot(whole, before)))
    gains = gain > (1e-5 if agrees else 0.0) * exchanged
    if not gains.any() or (agrees and not rebounds):
        return whole
    jams, without = not agrees and (gains & (gain < 1e-2 * exchanged)).any(), whole
    if rebounds:
        slippery = contacts._replace(friction=(not jams) * contacts.friction)
        without, _ = settle(slippery, closing, allowed, most)
    more, own, free = whole - without, work(without, after(without)), work(without, b)
    curve = in_group(0.5 * dot(more, after(whole) - after(without)))
    slope, lost = gain - own - curve, np.maximum(-own, 0.0)
    root = np.sqrt(slope**2 + 4.0 * curve * lost)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(slope > 0.0, 2.0 * lost / (slope + root), (root - slope) / (2.0 * curve))
        agreed = np.where(own > 0.0, np.clip(free / (free - own), 0.0, 1.0), 1.0)
    share = np.where(gain > own + lost, share, 1.0)
    return agreed * (without + np.where(jams & (gain > 0.0), 0.0, share) * more)


def levers_of(body, other, arm, at_other, bodies):
    """Return the velocities at contacts by those and the spins of bodies, shape (k, 3, bodies, 6)."""
    lever, k = np.zeros((len(body), 3, len(bodies), 6)), np.arange(len(body))
    for ends, arms, sign in ((body, arm, 1.0), (other, at_other, -1.0)):
        of = np.isin(ends, bodies)
        turns = -np.cross(np.eye(3), arms[of, None])
        lever[k[of], :, np.searchsorted(bodies, ends[of])] += sign * np.concatenate(
            [np.broadcast_to(np.eye(3), turns.shape), turns], axis=2
        )
    return lever


def move(m, grips, tugs):
    """Move bodies by a step, in which strings have given each a velocity and spin by tugs."""
    bodies, h, fall = grips.bodies, m.h, m.h * abs(m.gravity)
    rows, n, arm, other, moving, gap = grips.near(m, fall)
    body, thing = grips.ends[rows, :2].T
    lever, most = levers_of(body, thing, arm, other, bodies), int(np.clip(100_000 // max(len(rows), 1), 50, 1000))

    def eased():
        inverse_mass = np.zeros((len(bodies), 6, 6))
        inverse_mass[:, :3, :3], inverse_mass[:, 3:, 3:] = (
            m.inverse_mass[bodies, :, None] * np.eye(3),
            m.turning[bodies],
        )
        gains = np.einsum("bxy,kzby->bxkz", inverse_mass, lever)
        return gains, np.einsum("kxby,bylz->kxlz", lever, gains)

    gains, a = eased()
    if (gap < 0.0).any():  # overlaps are moved apart by mass, without speed
        out = np.where(gap < 0.0, np.minimum(-0.2 * gap, 3.0 * h), -gap) - dot(n, moving)[:, 0]
        overlaps = Contacts(a, -moving, n, 0.0 * gap, np.zeros_like(n))
        shifts, _ = settle(overlaps, out, 0.01 * -gap.min(), most)
        gap, ways = gap + dot(n, np.einsum("kxly,ly->kx", a, shifts))[:, 0], np.einsum("bxkz,kz->bx", gains, shifts)
        turn = turn_by(ways[:, 3:])  # a turn of it turns its momentum, too
        m.x[bodies], m.turn[bodies] = m.x[bodies] + ways[:, :3], turn @ m.turn[bodies]
        m.spin[bodies] = np.einsum("bxy,by->bx", turn, m.spin[bodies])
        m.turning[bodies] = turn @ m.turning[bodies] @ turn.transpose(0, 2, 1)
        gains, a = eased()
    m.start[bodies], speeds = m.x[bodies], np.hstack([m.v[bodies], m.spin[bodies]])
    u = np.einsum("kxby,by->kx", lever, speeds - tugs) - moving
    tug, approach = dot(n, np.einsum("kxby,by->kx", lever, tugs))[:, 0], -dot(n, u)[:, 0]
    pull = np.where(np.isin(thing, bodies), 0.0, m.gravity * (n @ m.up)) - tug / h
    away, kick, rebound = np.maximum(gap, 0.0), h * pull, m.restitution[body] * m.restitution[thing]
    squared = 0.25 * kick**2 + rebound * approach * (approach + kick) - 2.0 * (1.0 - rebound) * pull * away
    rebounds = (approach > 2.0 * (fall + np.abs(tug))) & (approach + kick > away / h)
    least = np.where(rebounds, np.maximum(-away / h, np.sqrt(np.maximum(squared, 0.0)) - 0.5 * kick), -away / h)
    speeds[:, :3] -= h * m.gravity * m.up
    b = np.einsum("kxby,by->kx", lever, speeds) - moving
    fastest, rubs = max(fall, approach.max(initial=0.0), np.abs(tug).max(initial=0.0)), m.rub(body, thing)
    group = np.arange(len(m.x))
    for one, another in zip(body, thing, strict=True):
        if another in bodies:
            group[group == max(group[one], group[another])] = min(group[one], group[another])
    contacts = Contacts(a, b, n, rubs, grips.kept[rows])
    impulse = apply_contact_impulses(contacts, u, least, -away / h, group[body], 3e-6 * fastest, most)
    speeds += np.einsum("bxkz,kz->bx", gains, impulse)
    m.v[bodies], m.spin[bodies], m.x[bodies] = speeds[:, :3], speeds[:, 3:], m.start[bodies] + h * speeds[:, :3]
    grips.kept[:] = 0.0
    grips.kept[rows] = np.where((least > 0.0)[:, None], 0.0, impulse)


def meet_sphere(m, body, ball):
    """Let a body and a sphere that have moved collide."""
    way = m.start[[ball]], m.x[[ball]], m.v[[ball]], m.radius[ball]
    _, (n,), (arm,), ((excess,),), ((out,),) = passing_body(m, body, turned(m, body), *way)
    if not n.any():
        return
    c = contacts([ball, body, 0, 0], np.array([1.0, -1.0, 0.0, 0.0])[:, None], n[None], friction=m.rub(body, ball))
    own = -m.radius[ball] * n
    c["normal"], c["arms"][0, :2] = n, (own, arm + own)
    approach, gain = -float(m.velocity(c)[0] @ n) - m.h * abs(m.gravity * (n @ m.up)), max(excess, 0.0)
    if gain > 0.0 and approach > 2.0 * m.h * abs(m.gravity):
        gain = max(gain, (1.0 + np.sqrt(m.restitution[body] * m.restitution[ball])) * approach)
    m.push(c, sum(resolve(m, c, np.array([[gain]]))), m.h)
    m.push(c, out / (m.inverse_mass[ball] + m.inverse_mass[body]) * n[None], 1.0, 0.0)
