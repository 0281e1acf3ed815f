"""Free rigid bodies: how they turn, and their contact with each other, the ground, obstacles and spheres.

Bodies have rows of `contact.Movers`. See `laws.rigid`. Impulses act as a step begins, from where a
body's angular momentum stays.
"""

import numpy as np

from balloon_warp.reference.contact import contacts, resolve
from balloon_warp.reference.laws import across, cross, dot, size
from balloon_warp.reference.solids import passing_body, surface, turn_by


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


def settle(a, b, n, least, friction, impulse, allowed, most):
    """Solve contacts' impulses one after the other, each with the latest of the others (projected Gauss-Seidel).

    All go on by a part of the last sweep's change (Nesterov; O'Donoghue and Candes 2015). Velocities at contacts are
    b + a impulse, of shapes (k, 3) and (k, 3, k, 3), and are to be at least so along normals; they agree once a sweep
    changes none by more than is allowed.
    """
    ease = np.einsum("kx,kxky,ky->k", n, a, n)
    ahead, age, before = np.zeros_like(impulse), 0.0, np.inf
    for _ in range(most):
        impulse = impulse + ahead
        last = impulse.copy()
        for i in range(len(n)):
            u, pushed = b[i] + np.tensordot(a[i], impulse), impulse[i] @ n[i]
            slide = across(u, n[i])
            along = slide / size(slide)
            part = max(pushed + (least[i] - n[i] @ u) / ease[i], 0.0)
            rub = across(impulse[i], n[i]) - slide / max(along @ a[i, :, i] @ along, 1e-30)
            impulse[i] = part * n[i] + rub * np.minimum(friction[i] * part / size(rub), 1.0)
        added = impulse - last
        if (size(added)[:, 0] * ease <= allowed).all():
            return impulse, True
        turns_back, changed = ease @ dot(added, ahead + added) < 0.0, float((ease @ dot(added, added))[0])
        age, before = 0.0 if turns_back or changed > 2.0 * before else age + 1.0, changed
        ahead = max(age - 1.0, 0.0) / (age + 2.0) * (ahead + added)
    return impulse, False


def push_each_other(a, b, before, n, least, closing, friction, impulse, group, allowed, most):
    """Return impulses that give no group of contacts energy, see `laws.rigid`.

    A group is of bodies that touch; velocities before are those before gravity acts, `closing` is `least` without
    rebounds.
    """

    def in_group(each):
        return np.bincount(group, each[:, 0])[group, None]

    def after(pushed):
        return b + np.einsum("kxly,ly->kx", a, pushed)

    def work(pushed, after):
        return in_group(0.5 * dot(pushed, before + after))

    whole, agrees = settle(a, b, n, least, friction, impulse, allowed, most)
    rebounds = (least > 0.0).any()
    gain, exchanged = work(whole, after(whole)), in_group(0.5 * np.abs(dot(whole, before)))
    gains = gain > (1e-5 if agrees else 0.0) * exchanged
    if not gains.any() or (agrees and not rebounds):
        return whole
    jams, without = not agrees and (gains & (gain < 1e-2 * exchanged)).any(), whole
    if rebounds:
        without, _ = settle(a, b, n, closing, (not jams) * friction, impulse, allowed, most)
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
        ease = np.zeros((len(bodies), 6, 6))
        ease[:, :3, :3], ease[:, 3:, 3:] = m.ease[bodies, :, None] * np.eye(3), m.turning[bodies]
        gains = np.einsum("bxy,kzby->bxkz", ease, lever)
        return gains, np.einsum("kxby,bylz->kxlz", lever, gains)

    gains, a = eased()
    if (gap < 0.0).any():  # overlaps are moved apart by mass, without speed
        out = np.where(gap < 0.0, np.minimum(-0.2 * gap, 3.0 * h), -gap) - dot(n, moving)[:, 0]
        shifts, _ = settle(a, -moving, n, out, 0.0 * gap, np.zeros_like(n), 0.01 * -gap.min(), most)
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
    told = a, b, u, n, least, -away / h, rubs, grips.kept[rows], group[body], 3e-6 * fastest, most
    impulse = push_each_other(*told)
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
    m.push(c, out / (m.ease[ball] + m.ease[body]) * n[None], 1.0, 0.0)
