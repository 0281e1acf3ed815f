"""Free rigid bodies: their contact with each other, the ground and obstacles, and with spheres and particles.

A body is a dictionary: position of its center of mass, velocity, turn and spin as a step begins, mass, ease and
turning, its inverse inertia tensors of 1 kg in its axes and as a whole in the world's, solid, reach, samples and
restitution. See `laws.rigid` and `laws.grip`. Impulses act as a step begins, from where its angular momentum stays.
"""

import numpy as np

from balloon_warp.reference.contact import across, cross
from balloon_warp.reference.laws import dot, size
from balloon_warp.reference.solids import apart, carried, surface, turn_by, way_through


def momentum_of(body):
    return np.linalg.solve(body["turning"], body["spin"])


def turned(body, h):
    """Return a body's turn after a step, by the mean of its angular momenta as it sees them before and after."""
    turn, whole, ease = body["turn"], momentum_of(body), body["ease"] / body["mass"]
    parts = int(np.clip(np.ceil(h * np.linalg.norm(body["spin"]) / 0.5), 1, 16))
    for _ in range(parts):
        momentum = mean = whole @ turn
        for _ in range(8):
            spin, half = ease @ mean, 0.5 * h / parts
            angle = half * np.linalg.norm(spin)
            half *= np.tan(angle) / angle if angle else 1.0
            off = mean - momentum + half * np.cross(spin, mean)
            skews = [np.cross(each, np.eye(3)).T for each in (spin, mean)]
            mean = mean - np.linalg.solve(np.eye(3) + half * (skews[0] - skews[1] @ ease), off)
        turn = turn_by(h / parts * turn @ ease @ mean) @ turn
    return turn


def take_turn(body, turn):
    """Give a body another turn as a step begins, with the angular momentum that it has."""
    momentum = momentum_of(body)
    body["turn"], body["turning"] = turn, turn @ body["ease"] @ turn.T / body["mass"]
    body["spin"] = body["turning"] @ momentum


def push(body, impulse, torque, h, shift=0.0):
    """Give a body an impulse and a torque's, and its place follows."""
    gain = impulse / body["mass"]
    body["velocity"], body["spin"] = body["velocity"] + gain, body["spin"] + body["turning"] @ torque
    body["position"] = body["position"] + h * gain + shift


def carried_along(thing, body, arm, n, h):
    """Return the velocity of a thing's surface at a body's point, along the surface as the body's center goes."""
    center = body["position"] - thing["position"]
    along = carried(thing["velocity"], thing["spin"], center, h) + np.cross(thing["spin"], arm)
    return along + ((carried(thing["velocity"], thing["spin"], center + arm, h) - along) @ n) * n


def speed_of(thing):
    return np.linalg.norm(thing["velocity"]) + np.linalg.norm(thing["spin"]) * thing["reach"]


def grips(bodies, things, friction, h, fall):
    """Return contacts of samples, little balls, of each body with each thing, of an obstacle also at the body.

    Each has its key, body, other body or None, normal, arms, velocity of the other surface, gap, friction, restitution.

    Args:
        things: The ground, obstacles and bodies.
        friction: Between bodies and things.
        fall: Speed that a step of gravity gives.
    """
    found, first_body = [], len(things) - len(bodies)
    fastest = max(speed_of(thing) + fall * (place >= first_body) for place, thing in enumerate(things))
    for number, body in enumerate(bodies):
        within = 1.5 * h * (speed_of(body) + fall + fastest)
        for place, thing in enumerate(things):
            if thing is body:
                continue
            moves, samples = place - first_body if place >= first_body else None, body["samples"]
            most = len(samples.points) if moves is None else samples.at_edges
            own = samples.points[: samples.outermost if place == 0 else most]
            pairs = [(1.0, body, thing, own)]
            if place and moves is None:
                pairs.append((-1.0, thing, body, thing["samples"].points))
            first = 0
            for side, bearer, met, points in pairs:
                at = bearer["position"] + points[:, :3] @ bearer["turn"].T
                gap, normal = surface(met["solid"], (at - met["position"]) @ met["turn"], points[:, 3:])
                normal = normal @ met["turn"].T
                at = at - points[:, 3:] * normal
                for k in np.flatnonzero(gap[:, 0] < within):
                    arm, other, n = at[k] - body["position"], at[k] - thing["position"], side * normal[k]
                    moving = 0.0 * n if moves is not None else carried_along(thing, body, arm, n, h)
                    blurred = 1e-5 * body["reach"] + 4e-7 * np.linalg.norm(body["position"])
                    open_gap = 0.0 if abs(gap[k, 0]) <= blurred else float(gap[k, 0])
                    rebound = np.sqrt(body["restitution"] * thing["restitution"])
                    key, rub = (number, place, first + k), friction[number, place]
                    found.append((key, number, moves, n, arm, other, moving, open_gap, rub, rebound))
                first += len(points)
    return found


def settle(a, b, n, least, friction, impulse, allowed, most):
    """Solve contacts' impulses one after the other, each with the latest of the others (projected Gauss-Seidel).

    All go on by a part of the last sweep's change (Nesterov; O'Donoghue and Candes 2015).

    Args:
        a, b: Velocities at contacts are b + a impulse, of shapes (k, 3, k, 3) and (k, 3).
        least: Speed that each is to have along its normal.
        allowed: Change of a speed in a sweep at which they agree.
    """
    ease = [n[i] @ a[i, :, i] @ n[i] for i in range(len(n))]
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


def groups_of(pairs, count):
    """Return a number for each body, which is that of all that it touches, by the pairs that touch."""
    group = np.arange(count)
    for one, other in pairs:
        if other is not None:
            group[group == max(group[one], group[other])] = min(group[one], group[other])
    return group


def push_each_other(a, b, before, n, least, closing, friction, impulse, group, allowed, most):
    """Return impulses that give no group of contacts energy, see `laws.grip`.

    Args:
        before: Velocities at contacts before gravity acts.
        closing: Speeds along normals without rebounds.
        group: Of each contact.
    """

    def in_group(each):
        return np.bincount(group, each[:, 0])[group, None]

    def work(pushed, after):
        return in_group(0.5 * dot(pushed, before + after))

    def after(pushed):
        return b + np.einsum("kxly,ly->kx", a, pushed)

    whole, agrees = settle(a, b, n, least, friction, impulse, allowed, most)
    rebounds = (least > 0.0).any()
    if not rebounds and agrees:
        return whole
    gain, exchanged = work(whole, after(whole)), in_group(0.5 * np.abs(dot(whole, before)))
    gains = gain > (1e-5 if agrees else 0.0) * exchanged
    if not gains.any():
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


def move(bodies, things, friction, kept, h, gravity, up, tugs):
    """Move bodies by a step, and return the impulses of their contacts, from which the next one begins.

    Args:
        tugs: Velocity and spin that strings have given each body in it.
    """
    found = grips(bodies, things, friction, h, h * abs(gravity))
    columns = list(zip(*found, strict=True)) or [()] * 10
    n, arms, others, moving = (np.reshape(column, (-1, 3)) for column in columns[3:7])
    gap, frictions, restitutions = (np.array(column) for column in columns[7:])
    lever, ease = np.zeros((len(found), 3, len(bodies), 6)), np.zeros((len(bodies), 6, 6))
    for k, (number, other) in enumerate(zip(*columns[1:3], strict=True)):
        for body, sign, arm in ((number, 1.0, arms[k]), (other, -1.0, others[k])):
            if body is not None:
                lever[k, :, body] += sign * np.hstack([np.eye(3), -np.cross(np.eye(3), arm)])

    def eased():
        for body, inverse in zip(bodies, ease, strict=True):
            inverse[:3, :3], inverse[3:, 3:] = np.eye(3) / body["mass"], body["turning"]
        gains = np.einsum("bxy,kzby->bxkz", ease, lever)
        return gains, np.einsum("kxby,bylz->kxlz", lever, gains)

    most = int(np.clip(100_000 // max(len(found), 1), 50, 1000))
    gains, a = eased()
    if (gap < 0.0).any():  # overlaps are moved apart by mass, without speed
        out = np.where(gap < 0.0, np.minimum(-0.2 * gap, 3.0 * h), -gap) - (n * moving).sum(axis=1)
        none = np.zeros_like(n)
        shifts, _ = settle(a, -moving, n, out, 0.0 * gap, none, 0.01 * -gap.min(), most)
        gap, ways = gap + (n * np.einsum("kxly,ly->kx", a, shifts)).sum(axis=1), np.einsum("bxkz,kz->bx", gains, shifts)
        for body, way in zip(bodies, ways, strict=True):  # a turn of it turns its momentum, too
            body["position"], turn = body["position"] + way[:3], turn_by(way[3:])
            body["spin"], body["turn"] = turn @ body["spin"], turn @ body["turn"]
            body["turning"] = turn @ body["turning"] @ turn.T
        gains, a = eased()
    for body in bodies:
        body["start"] = body["position"]
    speeds = np.array([[*body["velocity"], *body["spin"]] for body in bodies])
    u = np.einsum("kxby,by->kx", lever, speeds - tugs) - moving
    tug = (n * np.einsum("kxby,by->kx", lever, tugs)).sum(axis=1)
    approach = -(n * u).sum(axis=1)
    pull = np.where([other is None for other in columns[2]], gravity * (n @ up), 0.0) - tug / h
    away, kick, e = np.maximum(gap, 0.0), h * pull, restitutions**2
    squared = 0.25 * kick**2 + e * approach * (approach + kick) - 2.0 * (1.0 - e) * pull * away
    rebounds = (approach > 2.0 * (h * abs(gravity) + np.abs(tug))) & (approach + kick > away / h)
    least = np.where(rebounds, np.maximum(-away / h, np.sqrt(np.maximum(squared, 0.0)) - 0.5 * kick), -away / h)
    speeds[:, :3] -= h * gravity * up
    b = np.einsum("kxby,by->kx", lever, speeds) - moving
    fastest = max(h * abs(gravity), approach.max(initial=0.0), np.abs(tug).max(initial=0.0))
    impulse = np.reshape([kept.get(key, np.zeros(3)) for key in columns[0]], (-1, 3))
    group = groups_of(zip(*columns[1:3], strict=True), len(bodies))[[*columns[1]]]
    impulse = push_each_other(a, b, u, n, least, -away / h, frictions, impulse, group, 3e-6 * fastest, most)
    speeds += np.einsum("bxkz,kz->bx", gains, impulse)
    for body, speed in zip(bodies, speeds, strict=True):
        body["velocity"], body["spin"], body["position"] = speed[:3], speed[3:], body["start"] + h * speed[:3]
    return {key: each for key, each, rises in zip(columns[0], impulse, least > 0.0, strict=True) if not rises}


def stop(body, start, end, v, radius, h):
    """Return normals, arms, excess speeds and ways out of points that pass a body; normals are 0 where it lets them."""
    arm, turn = start - body["start"], turned(body, h)
    let, normal, _, _ = way_through(body["solid"], arm @ body["turn"], (end - body["position"]) @ turn, radius)
    back, normal = let @ turn.T - (end - body["position"]), normal @ turn.T
    depth = size(back)
    normal = np.where(normal.any(axis=1, keepdims=True) & (dot(back, normal) < 0.99 * depth), back / depth, normal)
    u = v - body["velocity"] - cross(body["spin"], arm)
    excess = np.where(normal.any(axis=1, keepdims=True), np.minimum(depth / h, -dot(u, normal)), -1e30)
    return normal, arm, excess, apart(h * np.maximum(excess, 0.0) - depth, h) * normal.any(axis=1, keepdims=True)


def exchange(body, x, v, mass, friction, h):
    """Let a body and particles exchange momentum: to the nearest velocities that are allowed, then by friction."""
    n, arm, excess, out = stop(body, x - h * v, x, v, 0.0, h)
    c, m, change = np.hstack([n, cross(arm, n)]), np.where(n.any(axis=1, keepdims=True), mass, 0.0), np.zeros(6)
    pressed = pressing = 0.0 * m
    inertia = np.zeros((6, 6))
    inertia[:3, :3], inertia[3:, 3:] = body["mass"] * np.eye(3), np.linalg.inv(body["turning"])
    for _ in range(16):
        pressed = (m > 0.0) & (c @ change[:, None] + excess > 0.0)
        pressing, last = m * pressed, change
        lost = (pressing * excess * c).sum(axis=0)
        change = -np.linalg.solve(inertia + (c * pressing).T @ c, lost)
        if np.abs(change - last).max() <= 1e-6 * np.abs(change).max():
            break
    over = m * (out > 0.0)
    if not (pressed.any() or over.any()):
        return x, v
    shift = -np.linalg.solve(body["mass"] * np.eye(3) + (n * over).T @ n, (over * out * n).sum(axis=0))
    gain = np.where(pressed, c @ change[:, None] + excess, 0.0) * n
    x, v = x + h * gain + np.where(over > 0.0, n @ shift[:, None] + out, 0.0) * n, v + gain
    push(body, body["mass"] * change[:3], inertia[3:, 3:] @ change[3:], h, shift)
    widest = 1.0 + body["reach"] ** 2 * np.linalg.norm(body["ease"])
    share = 1.0 / (1.0 + pressing.sum() * widest / body["mass"])  # all together give no energy
    arm = x - h * v - (body["position"] - h * body["velocity"])
    slip = across(v - body["velocity"] - cross(body["spin"], arm), n)
    rub = -np.minimum(share, friction * size(gain) / size(slip)) * slip * pressed
    push(body, -(m * rub).sum(axis=0), -cross(arm, m * rub).sum(axis=0), h)
    return x + h * rub, v + rub


def meet_sphere(body, ball, friction, h, gravity, up):
    """Let a body and a sphere that have moved collide."""
    (n,), (arm,), ((excess,),), ((out,),) = stop(
        body, ball["start"][None], ball["position"][None], ball["velocity"][None], ball["radius"], h
    )
    if not n.any():
        return
    torque = cross(arm, n)
    ease = 1.0 / ball["mass"] + 1.0 / body["mass"] + torque @ body["turning"] @ torque
    approach = -(ball["velocity"] - body["velocity"] - cross(body["spin"], arm)) @ n - h * abs(gravity * (n @ up))
    gain = max(excess, 0.0)
    if gain > 0.0 and approach > 2.0 * h * abs(gravity):
        gain = max(gain, (1.0 + np.sqrt(body["restitution"] * ball["restitution"])) * approach)
    impulse, own = gain / ease * n, -ball["radius"] * n
    place = arm + own
    u = ball["velocity"] + impulse / ball["mass"] + cross(ball["spin"], own) - body["velocity"] + impulse / body["mass"]
    slip = across(u - cross(body["spin"] - body["turning"] @ cross(arm, impulse), place), n)
    along = slip / size(slip)
    torque = cross(place, along)
    ease = 3.5 / ball["mass"] + 1.0 / body["mass"] + torque @ body["turning"] @ torque
    rub = -np.minimum(size(slip) / ease, friction * np.linalg.norm(impulse)) * along
    impulse = impulse + rub
    shift = out / (1.0 / ball["mass"] + 1.0 / body["mass"]) * n
    ball["spin"] = ball["spin"] + ball["turning"] @ cross(own, rub)
    ball["velocity"] = ball["velocity"] + impulse / ball["mass"]
    ball["position"] = ball["position"] + (h * impulse + shift) / ball["mass"]
    push(body, -impulse, -cross(arm, impulse) - cross(own, impulse), h, -shift / body["mass"])
