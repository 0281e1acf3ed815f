"""Tables of the host's plan that the reference takes from a scene, and parameters in float64 without rounding."""

from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np

from balloon_warp.kernels.laws.air import hashed, waves
from balloon_warp.kernels.laws.gas import NO_INSIDE
from balloon_warp.lab.reference.contact import Movers, Touch
from balloon_warp.lab.reference.laws import MEMBRANES, across, size
from balloon_warp.lab.reference.solids import Grips
from balloon_warp.mesh.load import rotation_matrix
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.topology import corner_faces, next_corners, signed_volume
from balloon_warp.model.obstacles import FRICTION, initial_centers, obstacle_motion, resolve_bodies, sample
from balloon_warp.model.parameters import rows_of
from balloon_warp.model.plan import ModelPlan, plan_model, resolved_parameters
from balloon_warp.model.pressure import pressure_bounds
from balloon_warp.model.stability import held_within, update_dependents, widest_opening
from balloon_warp.model.starts import inside_volume, may_be_crushed, start_of
from balloon_warp.model.timeline import values_over_time
from balloon_warp.model.touch import (
    APART,
    NO_RIDGES,
    STIFFNESSES,
    THICKNESS,
    Ridges,
    contacts_per_particle,
    edge_length,
    edges_meet,
    is_folded,
    kept_distance,
    meeting_edges,
)
from balloon_warp.scene import Scene
from balloon_warp.schedules.touch_table import ITSELF
from balloon_warp.springs.build import color_springs

Array = np.ndarray
CENTER = Ridges(np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), 0.0, np.ones(1, np.int32))
"""Ridge of a sphere, which has its radius"""


def planned(scene: Scene, values: dict[str, float]) -> tuple[ModelPlan, dict[str, Array]]:
    """Return the plan of a scene, and its parameters where some values are others, by their paths."""
    changes = [change.model_copy(update={"set": dict(change.set)}) for change in scene.change]
    for path in [path for path in values if path.startswith("change.")]:
        which, inner = path.removeprefix("change.").split(".set.")
        changes[int(which)].set[inner] = values.pop(path)
    plan = plan_model(scene.model_copy(update={"change": changes}))
    return plan, resolved_parameters(plan, {path: np.array([value]) for path, value in values.items()})


def changed(plan: ModelPlan, change: Any, before: dict[str, Array]) -> dict[str, Array]:
    """Return the parameters after a change that a scene plans, with their dependents."""
    after = before | {name: before[name].copy() for name in change.values}
    for name in change.values:
        change.apply(name, after[name])
    update_dependents(change.scene, plan.shapes, before, after)
    return after


def numbers(plan: ModelPlan, parameters: dict[str, Array], balloon: int) -> SimpleNamespace:
    """Return the parameters that a balloon sees by name: its own, and those of the world."""
    rows = [row for row in rows_of(plan.laws) if row.of in ("balloon", "world") and row.name in parameters]
    seen = {row.name: parameters[row.name][0] for row in rows}
    seen |= {row.name: seen[row.name][balloon] for row in rows if row.of == "balloon"}
    named = {name: float(np.ravel(value)[0]) if np.size(value) == 1 else value for name, value in seen.items()}
    return SimpleNamespace(**named | {"mass": float(parameters["mass"][0, balloon])})


def balloons_of(plan: ModelPlan, parameters: dict[str, Array]) -> tuple[SimpleNamespace, list[SimpleNamespace]]:
    """Return the surroundings of all balloons, and their tables: springs, hinges, film, faces, neck, and the gas."""
    scene, firsts = plan.scene, np.cumsum([0, *(len(shape.mesh.points) for shape in plan.shapes)])
    world = SimpleNamespace(up=np.array(scene.up), water=scene.water is not None)
    crushes = may_be_crushed(scene, plan.shapes, list(values_over_time(plan, "keyframe_values")))
    bounds, balloons = pressure_bounds(scene, plan.shapes), []
    starts = ("initial_gas_amounts", "initial_free_volumes", "initial_pressures", "initial_loads")
    states = zip(*(parameters[name][0] for name in starts), strict=True)
    for number, (shape, told, state) in enumerate(zip(plan.shapes, scene.balloon, states, strict=True)):
        amount, free_volume, pressure, (load, rise) = state
        springs, hinges = shape.springs, shape.hinges
        wings, sizes = np.zeros((2 * len(hinges.ends), len(shape.mesh.points))), np.diff(hinges.wing_offsets)
        np.add.at(
            wings, (np.repeat(np.arange(len(sizes)), sizes), hinges.wing_particles), 1.0 / np.repeat(sizes, sizes)
        )
        lengths = np.float32(springs.rest_lengths).astype(float)
        order = np.lexsort([*springs.pairs.T[::-1], color_springs(springs.pairs, shape.mesh.points)])
        balloons.append(SimpleNamespace(
            world=world, number=number, part=slice(*firsts[number : number + 2]), share=shape.mass_share[:, None],
            kind=told.inflation.kind, curve=told.inflation.pump_curve, times=[t for t, _ in told.inflation.keyframes],
            amount=amount, free_volume=free_volume, pressure=pressure, load=load, rise=rise, along=0.0, vent=0.0,
            enclosed=inside_volume(shape) if crushes else NO_INSIDE, volume=signed_volume(shape.mesh),
            bound=bounds[number], neck=shape.neck, kinds=springs.kind, scales=shape.stiffness_scale,
            springs=SimpleNamespace(pairs=springs.pairs, lengths=lengths[:, None],
                                    corrected=[(*springs.pairs[n], lengths[n]) for n in order]),
            hinges=SimpleNamespace(ends=hinges.ends, first=wings[::2], second=wings[1::2],
                                   rest=hinges.angles(shape.mesh.points)[:, None]),
            film=film_of(shape.membrane, told.material.law), peak=np.zeros(shape.membrane.count),
            faces=faces_of(shape.skin, len(shape.mesh.points)),
        ))  # fmt: skip
    return world, balloons


def faces_of(mesh: Any, count: int) -> SimpleNamespace:
    """Return the corners of faces, those that follow, their faces, and how faces are the means of particles."""
    of, corners = corner_faces(mesh), mesh.face_vertex_indices.astype(int)
    means = np.zeros((len(mesh.face_vertex_counts), count))
    np.add.at(means, (of, corners), 1.0 / mesh.face_vertex_counts[of])
    return SimpleNamespace(corners=corners, nexts=corners[next_corners(mesh)], of=of, means=means)


def film_of(membrane: Any, law: str) -> SimpleNamespace | None:
    """Return triangles of a membrane with the inverse transposed of their flat edges; None for a balloon of springs."""
    if law not in MEMBRANES:
        return None
    first, second = membrane.edges[:, 0], membrane.edges[:, 1]
    along = first / size(first)
    beside = across(second, along) / size(across(second, along))
    flat = np.einsum("tex,tfx->tef", membrane.edges, np.stack([along, beside], axis=1))
    inverse = np.linalg.inv(flat).transpose(0, 2, 1)
    return SimpleNamespace(corners=membrane.corners, areas=membrane.areas, inverse=inverse, energy=MEMBRANES[law])


def waves_of(seed: int) -> SimpleNamespace:
    """Return the gusts' wave vectors, amplitudes and phases, which a seed draws."""
    vectors, amplitudes = np.array(waves(), dtype=np.float32).astype(float).transpose(1, 0, 2)
    phases = [(hashed(hashed((seed + hashed(number)) % 2**32)) >> 8) * 2.0**-24 for number in range(len(vectors))]
    return SimpleNamespace(vectors=vectors, amplitudes=amplitudes, phases=np.array(phases))


def things_of(plan: ModelPlan, owner: Array) -> SimpleNamespace:
    """Return the numbers of all things among movers, their shapes, and how obstacles move."""
    up, first = np.array(plan.scene.up), len(owner)
    counts = 1, len(plan.obstacles), len(plan.scene.sphere), len(plan.bodies)
    (ground,), obstacles, spheres, bodies = np.split(first + np.arange(sum(counts)), np.cumsum(counts)[:-1])
    flat = SimpleNamespace(kind="plane", size=np.zeros(3), thickness=0.0, reach=0.0)
    solid = {ground: flat} | dict(zip(obstacles, plan.obstacles, strict=True))
    solid |= {number: body.solid for number, body in zip(bodies, plan.bodies, strict=True)}
    motion, turns = obstacle_motion(plan.scene), []
    for x, y, z, w in motion[:, :, 3:].reshape(-1, 4):
        skew = np.cross(np.eye(3), (x, y, z))
        turns.append(np.eye(3) + 2.0 * w * skew + 2.0 * skew @ skew)
    samples = {number: sample(each, up) for number, each in zip(obstacles, plan.obstacles, strict=True)}
    samples |= {number: body.samples for number, body in zip(bodies, plan.bodies, strict=True)}
    shapes = {number: (each, up) for number, each in solid.items()}
    reach = {number: min(each.reach, 1e30) for number, each in solid.items()}
    return SimpleNamespace(
        ground=ground, obstacles=obstacles, spheres=spheres, bodies=bodies, count=first + sum(counts),
        shapes=shapes, reach=reach,
        shifts=motion[:, :, :3].transpose(1, 0, 2),
        turns=np.reshape(turns, (*motion.shape[:2], 3, 3)).transpose(1, 0, 2, 3),
        tensors={number: np.linalg.inv(body.inertia) for number, body in zip(bodies, plan.bodies, strict=True)},
        grips=Grips(shapes, bodies, samples, reach) if len(bodies) else None,
    )  # fmt: skip


def movers_of(
    plan: ModelPlan, parameters: dict[str, Array], things: SimpleNamespace, owner: Array, shifts: Any
) -> Movers:
    """Return all movers at the start, whose particles are shifted by places and velocities."""
    x = [start_of(plan.scene, parameters, k, shape.mesh.points)[0] for k, shape in enumerate(plan.shapes)]
    told = zip(*(parameters[f"initial_{name}"][0] for name in ("velocities", "spins", "centers")), x, strict=True)
    v = np.concatenate([velocity + np.cross(spin, each - center) for velocity, spin, center, each in told]) + shifts[1]
    v[np.concatenate([shape.mass_share for shape in plan.shapes]) == 0.0] = 0.0
    x, none = np.concatenate(x) + shifts[0], np.zeros((things.count - len(v), 3))
    m, spheres, bodies = Movers(np.vstack([x, none]), np.vstack([v, none]), 0.0), things.spheres, things.bodies
    m.up, m.ground, m.shapes = np.array(plan.scene.up), things.ground, things.shapes
    m.thing = np.append(len(none) + owner, np.arange(len(none)))
    m.inverse_mass, masses = (
        np.zeros((len(m.x), 1)),
        resolve_bodies(plan.scene, plan.bodies, parameters)["body_mass"][0],
    )
    m.x[spheres], m.v[spheres], m.spin[spheres] = starts_of_spheres(parameters)
    m.x[bodies] = initial_centers(plan.scene, plan.bodies, parameters["initial_body_positions"])[0]
    m.v[bodies], m.spin[bodies] = (parameters[f"initial_body_{name}"][0] for name in ("velocities", "spins"))
    for body, told, mass in zip(bodies, plan.scene.body, masses, strict=True):
        m.tensors[body] = things.tensors[body] / mass
        m.inverse_mass[body], m.turn[body] = 1.0 / mass, rotation_matrix(told.rotation)
        m.turning[body] = m.turn[body] @ m.tensors[body] @ m.turn[body].T
    return m


def starts_of_spheres(parameters: dict[str, Array]) -> list[Array]:
    """Return the places, velocities and spins of spheres at the start."""
    return [parameters[f"initial_sphere_{name}"][0] for name in ("positions", "velocities", "spins")]


def meetings_of(plan: ModelPlan, things: SimpleNamespace, owner: Array) -> SimpleNamespace:
    """Return the features that may meet: skins, pairs of edges and of points and triangles, ridges, small spheres."""
    scene, shapes = plan.scene, plan.shapes
    firsts = np.searchsorted(owner, np.arange(len(shapes)))
    of_each = [triangles_of(shape.mesh) + first for shape, first in zip(shapes, firsts, strict=True)]
    triangles = np.concatenate(of_each)
    touch = touch_of(plan, owner, of_each) if scene.touches else None
    pairs = None
    if edges_meet(scene, shapes):
        edges = [own + first for own, first in zip(meeting_edges(scene, shapes), firsts, strict=True)]
        pairs = pairs_of(edges, of_each, owner, touch)
    sizes = [widest_opening(shape.mesh) for shape in shapes]
    most = held_within(scene) * max(sizes) if scene.touches_spheres else 0.0
    is_small = [ball.radius < most for ball in scene.sphere]
    meets = scene.touches_spheres and scene.contact == "impulse" and (plan.ridges or scene.faces is True)
    balls = [CENTER if meets and not small else NO_RIDGES for small in is_small]
    count, own = len(things.obstacles), plan.ridges or [NO_RIDGES] * (len(things.obstacles) + len(things.bodies))
    numbers = range(things.ground + 1, things.count)
    ridges = dict(zip(numbers, [*own[:count], *balls, *own[count:]], strict=True))
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return SimpleNamespace(
        touch=touch, pairs=pairs, triangles=triangles, edges=np.unique(sides, axis=0),
        ridges=ridges if any(len(each.ends) for each in ridges.values()) else None,
        kept=kept_distance(shapes) * np.insert(np.ones(len(own) + 1), [count] * len(balls), 0.0),
        small=[ball for ball, small in zip(things.spheres, is_small, strict=True) if small],
    )  # fmt: skip


def touch_of(plan: ModelPlan, owner: Array, triangles: list[Array]) -> Touch:
    far, scene, shapes = None, plan.scene, plan.shapes
    sizes = np.array([edge_length(shape.mesh) for shape in shapes])
    if scene.touches_itself:
        rest = np.concatenate([shape.mesh.points for shape in shapes])
        away = sizes * [ITSELF if is_folded(shape.mesh) else APART for shape in shapes]
        far = np.linalg.norm(rest[:, None] - rest, axis=-1) >= away[owner][:, None]
    crowds = np.array([contacts_per_particle(shapes, number, scene.touches_itself) for number in range(len(shapes))])
    return Touch(triangles, owner, far, crowds[owner], 0.5 * sizes, np.array([shape.closed for shape in shapes]))


def pairs_of(edges: list[Array], triangles: list[Array], owner: Array, touch: Any) -> tuple[Array, Array]:
    """Return all pairs of edges, and of particles and triangles, of balloons, or far from each other in one."""

    def pairs(one: Array, other: Array) -> Array:
        i, j = np.divmod(np.arange(len(one) * len(other)), max(len(other), 1))
        return np.concatenate([one[i], other[j]], axis=1)

    def that_may(found: list[Array], count: int) -> Array:
        ends = np.concatenate(found)
        may = owner[ends[:, 0]] != owner[ends[:, -1]]
        if touch.far is not None:
            may |= touch.far[ends[:, :count, None], ends[:, None, count:]].all(axis=(1, 2))
        return ends[may]

    balloons = range(len(edges))
    own = [np.flatnonzero(owner == number)[:, None] for number in balloons]
    of_edges = [pairs(edges[i], edges[j]) for i in balloons for j in balloons[i:]]
    of_points = [pairs(own[i], triangles[j]) for i, j in product(balloons, repeat=2)]
    return that_may(of_edges, 2), that_may(of_points, 1)


def skins_of(plan: ModelPlan, parameters: dict[str, Array]) -> Array:
    """Return thickness, stiffness and friction between balloons, shape (balloons, balloons, 3)."""
    own = np.array([float(np.float32(THICKNESS * edge_length(shape.mesh))) for shape in plan.shapes])
    thickness, stiffness = (float(np.ravel(parameters[f"touch_{name}"])[0]) for name in ("thickness", "stiffness"))
    k, friction = parameters[STIFFNESSES][0], parameters[FRICTION][0][-len(own) :, -len(own) :]
    thick = 0.5 * (own[:, None] + own) if thickness < 0.0 else np.full(friction.shape, thickness)
    stiff = 2.0 * k[:, None] * k / (k[:, None] + k) if stiffness < 0.0 else np.full(friction.shape, stiffness)
    return np.stack([thick, stiff, friction], axis=-1)
