"""Ground, obstacles and spheres, which particles leave with Coulomb's friction, or exchange momentum with.

An obstacle has a shape, size, thickness, friction by balloon, and places and turns by frame; a sphere is a dictionary.
"""

import numpy as np

from balloon_warp.reference.laws import dot, size


def turn_by(vector):
    """Return the matrix of a turn about a vector, by its length [rad]."""
    angle = np.linalg.norm(vector)
    x, y, z = vector / max(angle, 1e-150)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def carried(velocity, spin, arm, seconds):
    """Return the velocity along the chord on which a place goes in a step, from its arm then, or before if negative."""
    return velocity + (arm @ turn_by(seconds * spin).T - arm) / seconds


def vector_of(turn):
    """Return the vector of a turn of less than half a circle."""
    twice = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = 0.5 * np.linalg.norm(twice)
    return twice * 0.5 * (np.arctan2(sine, 0.5 * (np.trace(turn) - 1.0)) / sine if sine > 0.0 else 1.0)


def pose(obstacle, frame, part, frame_seconds):
    """Return an obstacle's place, turn, velocity and spin at a part of a frame, between those at its ends."""
    first, last = (min(number, len(obstacle.shifts) - 1) for number in (frame, frame + 1))
    way = obstacle.shifts[last] - obstacle.shifts[first]
    turning = vector_of(obstacle.turns[last] @ obstacle.turns[first].T)
    place = obstacle.position + obstacle.shifts[first] + part * way
    return place, turn_by(part * turning) @ obstacle.turns[first], way / frame_seconds, turning / frame_seconds


def surface(solid, x, radius):
    """Return the signed distance from a solid about its own origin, less a radius, and the normal."""
    if solid.shape == "plane":
        distance, normal = dot(x, solid.up), np.broadcast_to(solid.up, x.shape)
    elif solid.shape == "capsule":
        arm = x - np.clip(dot(x, solid.up), -solid.size[1], solid.size[1]) * solid.up
        distance, normal = size(arm) - solid.size[0], arm / size(arm)
    else:
        beyond, signs = np.abs(x) - solid.size, np.where(x < 0.0, -1.0, 1.0)
        most, out = beyond.max(axis=1, keepdims=True), np.maximum(beyond, 0.0)
        inward = np.eye(3)[beyond.argmax(axis=1)]
        distance, normal = np.where(most > 0.0, size(out), most), np.where(most > 0.0, out / size(out), inward) * signs
    return distance - solid.thickness - radius, normal


def way_through(solid, start, end, radius):
    """Narrow phase of ways past a convex solid: ends, contact normals or 0, remaining displacements, distances.

    Along a line the distance is convex: Newton's method comes to where a way enters, and never past it.
    """
    way, (distance, normal) = size(end - start), surface(solid, end, radius)
    ahead, near = (end - start) / way, 2e-6 * (way + size(start))
    straight = (distance < 0.0) & (dot(start - end, normal) + distance >= -near)

    def look(gone):
        here, out = surface(solid, start + gone * ahead, radius)
        falling = -dot(out, ahead)
        enters = here - falling * (way - gone) < -1e-12 * way  # or else all the rest is outside
        return here, out, enters, np.where(enters & (here > 1e-7 * near), here / np.where(enters, falling, 1.0), 0.0)

    gone = np.zeros_like(way)
    here, out, enters, step = look(gone)
    while step.any():
        gone = gone + step
        here, out, enters, step = look(gone)
    place = start + gone * ahead - here * out
    slides = enters & ~straight
    slid = end + np.maximum(dot(place - end, out), 0.0) * out
    held = slides | (distance < 0.0)
    let = np.where(slides, slid, np.where(held, end - distance * normal, end))
    return let, np.where(slides, out, normal) * held, (slides, np.where(slides, 1.0 - gone / way, 1.0)), distance


def beside_obstacle(obstacle, poses, h, start, x, radius=0.0):
    """Return `way_through` an obstacle that moves, and how fast its surface moves there.

    Args:
        poses: Its `pose` at the beginning and at the end of the step.
    """
    (before, earlier, *_), (place, turn, velocity, spin) = poses
    let, normal, left, distance = way_through(obstacle, (start - before) @ earlier, (x - place) @ turn, radius)
    arm = let @ turn.T
    let = np.where(normal.any(axis=1, keepdims=True), place + arm, x)
    return let, normal @ turn.T, left, carried(velocity, spin, arm, -h), distance


def stand(around, start, x, v, h, foreseen=False):
    """Return places and velocities beside obstacles and the ground, and the normals of the last contacts.

    Of an approach as much is stopped as has led behind the surface. Coulomb's friction takes at most its coefficient
    times that; the way is that of the velocity once all is stopped. Where two are near, one may push into the other,
    and both take turns; there all of an approach is stopped at once, as where a way passes an edge.

    Args:
        around: Functions from starts and ends of ways to `beside_obstacle`, each with its friction by particle.
        foreseen: whether only places are wanted, of particles that keep their velocities.
    """
    at_once = np.zeros((len(x), 1), dtype=bool)
    places, velocities, normals, several = _stand(around, start, x, v, h, at_once, foreseen)
    if several.any():
        again = _stand(around, start, x, v, h, several, foreseen)
        places, velocities, normals = (
            np.where(several, *both) for both in zip(again[:3], (places, velocities, normals), strict=True)
        )
    return places, velocities, normals


def _stand(around, start, x, v, h, at_once, foreseen):
    """Return also which particles met several things, of which `at_once` says where all of an approach is stopped."""
    normals, takes = np.zeros_like(x), np.ones((len(x), 1), dtype=bool)
    met = np.zeros((len(x), len(around)), dtype=bool)
    for _ in range(1 if foreseen else 4):
        end, distances = x, []
        for number, (let_through, friction) in enumerate(around):
            let, normal, (slides, left), moving, distance = let_through(start, x)
            normal, distances = np.where(takes, normal, 0.0), [*distances, distance]
            held, beside = normal.any(axis=1, keepdims=True), v - moving
            met[:, [number]] |= held
            rise, depth = dot(beside, normal), np.maximum(dot(let - x, normal), 0.0)
            along, approach = beside - rise * normal, np.maximum(-rise, 0.0)
            once = at_once | slides
            stopped = np.where(once, approach, np.minimum(approach, depth / h))
            slid = np.where(once, left, stopped / np.maximum(approach, 1e-12))
            rubbed = [np.minimum(friction * part / size(along), 1.0) for part in (approach, stopped)]
            x, normals = np.where(held, let - h * slid * rubbed[0] * along, x), np.where(held, normal, normals)
            if not foreseen:
                v = np.where(held, v - rubbed[1] * along + stopped * normal, v)
        near = sum(distance < size(end - start) + size(x - end) for distance in distances)
        takes = (size(x - end) > 1e-3 * size(end - start) + 2e-6 * size(x)) & (near > 1)
        if not np.any(takes):
            break
    several = (met.sum(axis=1, keepdims=True) > 1) & (not foreseen)
    return x, v, normals, several


def rub(ball, moving, normal, stopped, friction, seconds):
    """Let a sphere rub on something immovable, at an arm of its radius, that has changed its speed along the normal."""
    if ball["radius"] == 0.0:
        return  # it has yet to begin
    arm = -ball["radius"] * normal
    slip = ball["velocity"] + np.cross(ball["spin"], arm) - moving
    slip = slip - (slip @ normal) * normal
    gain = -min(1.0 / 3.5, friction * stopped / max(np.linalg.norm(slip), 1e-150)) * slip
    ball["position"], ball["velocity"] = ball["position"] + seconds * gain, ball["velocity"] + gain
    ball["spin"] = ball["spin"] + 2.5 / ball["radius"] ** 2 * np.cross(arm, gain)


def stop_of(coming, depth, before, restitution, h):
    """Return how much a surface stops a sphere, which turns where it is with the speed that it had before the step."""
    excess = min(depth / h, coming)
    return max(excess, coming + restitution * before) if excess > 0.0 else 0.0


def apart(gap, h):
    """Return how far an overlap is resolved in a step: 10/s, at most a fifth."""
    return np.maximum(-gap, 0.0) * min(10.0 * h, 0.2)


def roll(ball, h, up, gravity, ground, momentum):
    """Move a sphere beside the ground, where it turns with the speed that it had before.

    Args:
        ground: Height, restitution and friction.
        momentum: Whether it exchanges momentum with particles, later; if not, its force moves it.
    """
    height, restitution, friction = ground
    pushed = np.zeros(3) if momentum else ball["force"] / ball["mass"]
    gap, rise = ball["position"] @ up - ball["radius"] - height, ball["velocity"] @ up
    ball["velocity"], ball["force"] = ball["velocity"] + h * (pushed - gravity * up), np.zeros(3)
    coming = -(ball["velocity"] @ up)
    stopped = stop_of(coming, h * coming - gap, -rise, restitution, h)
    ball["velocity"] = ball["velocity"] + stopped * up
    ball["position"] = ball["position"] + h * ball["velocity"] + apart(gap, h) * up
    rub(ball, np.zeros(3), up, stopped, friction, h)


def leave_ground(ball, h, up, ground):
    """Lift a sphere out of the ground, from which it bounces."""
    height, restitution, friction = ground
    depth = height + ball["radius"] - ball["position"] @ up
    if depth > 0.0:
        coming = -(ball["velocity"] @ up)
        stopped = stop_of(coming, h * coming, coming, restitution, h)
        ball["position"], ball["velocity"] = ball["position"] + depth * up, ball["velocity"] + stopped * up
        rub(ball, np.zeros(3), up, stopped, friction, h)


def leave_obstacles(ball, start, around, kick, h):
    """Move a sphere out of obstacles, which take turns.

    Args:
        kick: Velocity that a step of gravity gives.
        around: `beside_obstacle` of each, with the restitution and the friction.
    """
    for _ in range(4):
        end = ball["position"]
        for let_through, restitution, friction in around:
            let, normal, (_, left), moving, _ = let_through(start[None], ball["position"][None], ball["radius"])
            if normal.any():
                n, coming = normal[0], (moving[0] - ball["velocity"]) @ normal[0]
                depth = (let[0] - ball["position"]) @ n
                stopped = stop_of(coming, depth, coming + kick @ n, restitution, h)
                ball["position"] = let[0] + max(h * stopped - depth, 0.0) * n
                ball["velocity"] = ball["velocity"] + stopped * n
                rub(ball, moving[0], n, stopped, friction, h * left[0, 0])
        moved, way = np.linalg.norm(ball["position"] - end), np.linalg.norm(end - start)
        if len(around) == 1 or moved <= 1e-3 * way + 2e-6 * np.linalg.norm(ball["position"]):
            break


def leave_sphere(ball, x, v, h):
    """Return places and velocities outside of a sphere, and the normals of particles that were in it.

    Of an approach as much is stopped as has led inside.
    """
    arm = x - ball["position"]
    normal = np.where(size(arm) < ball["radius"], arm / size(arm), 0.0)
    held = normal.any(axis=1, keepdims=True)
    approach = np.maximum(dot(ball["velocity"] - v, normal), 0.0)
    v = v + np.minimum(approach, (ball["radius"] - dot(arm, normal)) / h) * normal
    return np.where(held, ball["position"] + ball["radius"] * normal, x), v, normal


def may_meet(ball, x, v, h):
    """Return which particles may meet a sphere on twice their ways in a step."""
    way = h * (v - ball["velocity"])
    arm = x - ball["position"] - way
    part = np.clip(-dot(arm, way) / np.maximum(dot(way, way), 1e-150), 0.0, 2.0)
    return size(arm + part * way)[:, 0] < 65.0 / 64.0 * ball["radius"]


def exchange(ball, x, v, mass, friction, h, up, ground):
    """Let a sphere and particles exchange momentum: to the nearest velocities at which n . (v - V) >= -gap / h.

    Particles of no mass are fixed; the ground, of a great mass, takes part where it is pressed.
    """
    heavy, radius = ball["mass"], ball["radius"]
    center, before = ball["position"] - h * ball["velocity"], ball["velocity"]
    arm = x - h * v - center
    n, gap = arm / size(arm), size(arm)[:, 0] - radius
    excess = -dot(v - before, n)[:, 0] - np.maximum(gap, 0.0) / h
    near = may_meet(ball, x, v, h) & (mass > 0.0)
    out = np.where(near, apart(gap, h), 0.0)
    sinking = -(before @ up) - max(center @ up - radius - ground[0], 0.0) / h
    pressed, grounded, change = near & (excess > 0.0), sinking > 0.0, np.zeros(3)
    for _ in range(16):
        m, earth = mass * pressed, 1e6 * (heavy + (mass * pressed).sum()) * grounded
        inertia = heavy * np.eye(3) + (n * m[:, None]).T @ n + earth * np.outer(up, up)
        change = -np.linalg.solve(inertia, (m * excess) @ n - earth * sinking * up)
        before_that, pressed = pressed, near & (n @ change + excess > 0.0)
        stood, grounded = grounded, sinking - up @ change > 0.0
        if (pressed == before_that).all() and grounded == stood:
            break
    m = mass * pressed
    over = mass * (out > 0.0)
    if not (pressed.any() or over.any()):
        return x, v
    shift = -np.linalg.solve(heavy * np.eye(3) + (n * over[:, None]).T @ n, (over * out) @ n)
    gain = np.where(pressed, n @ change + excess, 0.0)[:, None] * n
    ease = (1.0 + 2.5 * dot(arm, arm) / radius**2) / heavy  # all together give no energy, see `laws.sliding`
    slip = v + gain - before - change - np.cross(ball["spin"], arm)
    slip = slip - dot(slip, n) * n
    rubs = -np.minimum(1.0 / (1.0 + m.sum() * ease), friction * size(gain) / size(slip)) * slip * pressed[:, None]
    x = x + h * (gain + rubs) + np.where(out > 0.0, n @ shift + out, 0.0)[:, None] * n
    slowed = -(mass[:, None] * rubs).sum(axis=0) / heavy
    ball["spin"] = ball["spin"] - 2.5 / (heavy * radius**2) * np.cross(arm, mass[:, None] * rubs).sum(axis=0)
    ball["position"], ball["velocity"] = ball["position"] + h * (change + slowed) + shift, before + change + slowed
    ball["force"] = ball["force"] + heavy / h * change
    if grounded:
        pushed = max(up @ (heavy * change + (m[:, None] * gain).sum(axis=0)), 0.0)
        rub(ball, np.zeros(3), up, pushed / heavy, ground[2], h)
    return x, v + gain + rubs
