"""Step of the reference: its inputs from a scene, and one substep, in the order of the product's list.

It is written to be read, and the arbiter of all schedules: NumPy in float64, no Warp, and no thought of speed.
"""

from collections.abc import Mapping
from functools import partial
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np

from balloon_warp.kernels.laws.air import hashed, waves
from balloon_warp.kernels.laws.gas import NO_INSIDE
from balloon_warp.lab.reference import contact, laws, solids
from balloon_warp.lab.reference import laws as gas
from balloon_warp.lab.reference import solids as bodies
from balloon_warp.lab.reference.contact import Movers, Touch
from balloon_warp.lab.reference.laws import MEMBRANES, across, size
from balloon_warp.lab.reference.solids import Grips
from balloon_warp.mesh.load import rotation_matrix
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.topology import corner_faces, next_corners, signed_volume
from balloon_warp.model.obstacles import FRICTION, initial_centers, obstacle_motion, resolve_bodies, sample
from balloon_warp.model.parameters import rows_of, values_over_time
from balloon_warp.model.plan import ModelPlan, plan_model, resolved_parameters
from balloon_warp.model.pressure import pressure_bounds
from balloon_warp.model.stability import held_within, update_dependents, widest_opening
from balloon_warp.model.starts import anchors_of, inside_volume, may_be_crushed, start_of
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
from balloon_warp.scene.load import frame_at
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


class Reference:
    """A scene in float64, advanced by substeps or by frames.

    Args:
        values: Values of the scene that are others, by their paths.
        shifts: Offsets of all particles' places [m] and velocities [m/s] at the start, numbers or (particles, 3).
    """

    def __init__(self, scene: Scene, values: Mapping[str, float] | None = None, shifts: tuple[Any, Any] = (0.0, 0.0)):
        self.plan, self.parameters = planned(scene, dict(values or {}))
        self.scene, self.up = self.plan.scene, np.array(scene.up)
        self.substeps: Any = self.plan.substeps
        self.frame_number, self.substep_number = 0, 0
        self.world, self.balloons = balloons_of(self.plan, self.parameters)
        self.share = np.concatenate([b.share for b in self.balloons])
        self.owner = np.repeat(np.arange(len(self.balloons)), [len(b.share) for b in self.balloons])
        self.things = things_of(self.plan, self.owner)
        self.m = movers_of(self.plan, self.parameters, self.things, self.owner, shifts)
        self.meetings = meetings_of(self.plan, self.things, self.owner)
        self.pushes = np.zeros((len(self.things.spheres), 3))
        """Forces of penalties on spheres [N]"""
        self.small_contacts = np.zeros(2, int)
        """Numbers of contacts of small spheres, and of those in which one moves on with faces as one"""
        self._take_parameters()

    x = property(lambda self: self.m.x[: len(self.owner)])
    v = property(lambda self: self.m.v[: len(self.owner)])
    points = property(lambda self: [self.x[b.part].copy() for b in self.balloons])
    velocities = property(lambda self: [self.v[b.part].copy() for b in self.balloons])
    pressures = property(lambda self: np.array([b.pressure for b in self.balloons]))
    gas_amounts = property(lambda self: np.array([b.amount for b in self.balloons]))
    volumes = property(lambda self: np.array([laws.volume(self.x[b.part], b.faces)[0] for b in self.balloons]))
    spheres = property(lambda self: self.m.states(self.things.spheres))
    bodies = property(lambda self: self.m.states(self.things.bodies))
    time = property(lambda self: (self.frame_number + self.part) / self.scene.frames_per_second)
    part = property(lambda self: self.substep_number / self.substeps)
    h = property(lambda self: 1.0 / self.scene.frames_per_second / self.substeps)

    @staticmethod
    def lacks(scene: Scene) -> list[str]:
        """Name the features of a scene that the reference does not have."""
        asked = {
            "projective": scene.solver == "projective",
            "tears": any(balloon.material.strength is not None for balloon in scene.balloon),
            "solids of meshes": any(solid.shape == "mesh" for solid in (*scene.obstacle, *scene.body)),
            "changes of gamma": any(path.endswith("gamma") for change in scene.change for path in change.set),
        }
        return [name for name, is_asked in asked.items() if is_asked]

    def frame(self) -> None:
        """Advance by the substeps that are left of a frame."""
        number = self.frame_number
        while self.frame_number == number:
            self.substep()

    def substep(self) -> None:
        """Advance by a substep."""
        if self.substep_number == 0:
            self._begin_frame()
        h, m, count = self.h, self.m, len(self.owner)
        m.h, m.start, self.world.time = h, m.x.copy(), self.time
        pulls = self._pull_strings()
        self._move_obstacles()
        self._move_spheres_and_bodies()
        self._pump()
        moving = [b.share * (b.p.mass + b.amount * b.p.molar_mass + b.along) for b in self.balloons]
        mass, damping = np.concatenate(moving), np.concatenate([b.share * b.p.damping for b in self.balloons])
        gain = np.where(mass > 0.0, h / np.where(mass > 0.0, mass + h * damping, 1.0), 0.0)
        force, k = self._forces(pulls)
        area = np.concatenate([laws.volume(self.x[b.part], b.faces)[1] for b in self.balloons])
        free, gain = laws.resisted(self.v, force, self._inflate(area), k, gain)
        self._find_pressures(free, area, gain)
        inflation, old = self._inflate(area), self.v.copy()
        m.v[:count] = free + gain * inflation
        m.x[:count] = self.x + h * (old if self.scene.solver == "forward_euler" else self.v)
        for b in self.balloons * self.scene.correction_sweeps if self.scene.correction != "none" else ():
            m.x[b.part], m.v[b.part] = laws.shortened(m.x[b.part], m.v[b.part], b, h)
        x, v = self.x.copy(), self.v.copy()
        self._meet(mass, inflation)
        m.x[:count], m.v[:count] = np.where(gain > 0.0, self.x, x), np.where(gain > 0.0, self.v, v)
        self.substep_number += 1
        if self.substep_number == self.substeps:
            self.frame_number, self.substep_number = self.frame_number + 1, 0
            starts = starts_of_spheres(self.parameters)
            for ball, sphere, *start in zip(self.things.spheres, self.scene.sphere, *starts, strict=True):
                if self.frame_number <= frame_at(self.scene, sphere.start) > 0:  # it has yet to appear
                    m.x[ball], m.v[ball], m.spin[ball] = start

    def _take_parameters(self) -> None:
        """Take parameters from the scene's, which change over time."""
        m, things, touch = self.m, self.things, self.meetings.touch
        for number, b in enumerate(self.balloons):
            b.p = numbers(self.plan, self.parameters, number)
            stiffnesses = np.array([b.p.structural, b.p.shear, b.p.flexion])
            b.springs.constants = (stiffnesses[b.kinds] * b.scales)[:, None]
        p = self.balloons[0].p
        self.world.waves, self.world.correction = waves_of(int(p.gust_seed)), self.scene.correction
        m.friction = self.parameters[FRICTION][0]
        mass, radius = (self.parameters[f"sphere_{name}"][0] for name in ("mass", "radius"))
        m.inverse_mass[things.spheres, 0], m.radius[things.spheres] = 1.0 / mass, radius
        stiff = np.where(radius > 0.0, 2.5 / (mass * np.where(radius > 0.0, radius, 1.0) ** 2), 0.0)
        m.turning[things.spheres] = stiff[:, None, None] * np.eye(3)
        rebounds = (self.parameters[f"{thing}_restitution"][0] for thing in ("obstacle", "sphere", "body"))
        m.restitution[len(self.owner) :] = np.concatenate([[p.ground_restitution], *rebounds])
        m.gravity, m.height, m.x[m.ground] = p.gravity, p.ground_height, p.ground_height * self.up
        if touch:
            mass = self.share * self.parameters["mass"][0, self.owner][:, None]
            touch.inverse_mass = np.where(mass > 0.0, 1.0 / np.where(mass > 0.0, mass, 1.0), 0.0)
            touch.skins = skins_of(self.plan, self.parameters)

    def _begin_frame(self) -> None:
        """Make the changes that the scene plans, and find the air around balloons."""
        for change in self.plan.due_changes:
            if change.frame == self.frame_number:
                self.parameters = changed(self.plan, change, self.parameters)
                self.scene = self.scene.model_copy(update={n: getattr(change.scene, n) for n in change.methods})
                self.substeps = self.scene.substeps if "substeps" in change.methods else self.substeps
                self._take_parameters()
        for b in self.balloons:
            gas.begin_frame(b, self.x[b.part][0] @ self.up)
        if self.meetings.touch:
            self.meetings.touch.begin_frame(self.x, self.v, self.h)

    def _given(self, b: Any, part: float) -> float:
        """Interpolate keyframes over a frame, between their values at its ends."""
        ends = [(self.frame_number + end) / self.scene.frames_per_second for end in (0, 1)]
        first, last = np.interp(ends, b.times, self.parameters["keyframe_values"][0, b.number, : len(b.times)])
        return first + part * (last - first)

    def _pump(self) -> None:
        """Pump gas in or out, and open necks."""
        for b in self.balloons:
            if b.kind == "gas":
                gas.fill(b, self.h, self.h * self._given(b, (self.substep_number + 0.5) / self.substeps))
            is_open = len(b.neck.edges) and b.p.neck_opens <= self.time < b.p.neck_closes
            b.opening = 0.25 * np.pi * b.p.neck_diameter**2 * b.p.neck_discharge if is_open else 0.0

    def _forces(self, pulls: Array) -> tuple[Array, Array]:
        """Return the forces on particles but for inflation and the water's drag -k |v| v, and k."""
        each = [sum(law(self.x[b.part], self.v[b.part], b) for law in laws.LAWS) for b in self.balloons]
        driven = self.plan.driven
        newtons = driven.shares[:, None] * self.parameters["force_newtons"][0][driven.forces]
        force = np.concatenate(each) + pulls + laws.summed(len(self.x), driven.particles, newtons)
        if self.meetings.touch:
            force += self.meetings.touch.forces(self.x, self.v, self.h)
        return force, np.concatenate([laws.resistance(self.x[b.part], b) for b in self.balloons])

    def _inflate(self, area: Array) -> Array:
        """Return the forces of the inflation: a pressure times area vectors, or the paper's normal forces."""
        found = []
        for b in self.balloons:
            if b.kind == "normal_force":
                if self.substep_number == 0 or self.scene.normals == "fresh":
                    b.directions = laws.normal_directions(self.x[b.part], b.faces)
                found.append(100.0 * self._given(b, self.part) * b.directions)
            else:
                found.append((b.load + b.rise * laws.dot(self.x[b.part], self.up)) * area[b.part])
        return np.concatenate(found)

    def _find_pressures(self, free: Array, area: Array, gain: Array) -> None:
        """Find the pressures of balloons over the step, from velocities without inflation, and let gas flow."""
        of_gas = [b for b in self.balloons if b.kind != "normal_force"]
        if not of_gas:
            return
        heights = laws.dot(self.x, self.up)
        before = np.concatenate([b.load + b.rise * heights[b.part] for b in self.balloons])
        predicted_velocity = free + gain * before * area
        end = self.x + self.h * predicted_velocity
        stood, normals = self._predict_deflection(end, predicted_velocity)
        deflection = np.where(gain > 0.0, (stood - end) / self.h, 0.0)
        along = laws.across(area, normals)
        swings = gain * laws.dot(along, along)
        for b in of_gas:
            damping = 1.0 if self.scene.solver == "forward_euler" else b.p.breathing_damping
            k = (1.0 - damping) / (1.0 + 3.0 * damping)
            rates = (laws.dot(area, predicted_velocity + deflection - k * self.v) - before * swings)[b.part, 0]
            swing, height = swings[b.part, 0], heights[b.part, 0]
            volume = laws.volume(self.x[b.part], b.faces)[0]
            breath = gas.Breath(volume, swing.sum(), rates.sum(), b.share[:, 0] @ height, swing @ height)
            if b.kind == "gas":
                gas.implicit_pressure(b, self.h, damping, breath)
            else:
                gas.given_pressure(b, self.h, self._given(b, self.part), breath)
        ends = ([self.balloons[number] for number in tube.balloons] for tube in self.scene.tube)
        tubes = zip(ends, self.parameters["tube_conductance"][0], strict=True)
        gas.flow(self.balloons, [(*pair, conductance) for pair, conductance in tubes], self.h)

    def _pull_strings(self) -> Array:
        """Return the forces of strings on particles, and pull at the bodies to which they are tied."""
        m, held = self.m, self.plan.held + np.searchsorted(self.owner, [each.balloon for each in self.scene.string])
        told = [self.parameters[f"string_{name}"][0][:, None] for name in ("length", "stiffness")]
        anchors = anchors_of(self.scene, self.plan.bodies, self.parameters, self.frame_number + self.part)[0]
        tied = [(number, string.body) for number, string in enumerate(self.scene.string) if string.body is not None]
        for number, body in tied:
            arm = self.parameters["string_anchor"][0, number] - self.plan.bodies[body].center
            anchors[number] = m.x[self.things.bodies[body]] + m.turn[self.things.bodies[body]] @ arm
        pulls = laws.strings(self.x[held.astype(int)], anchors, *told)
        self.tugs = np.zeros((len(self.things.bodies), 6))
        for number, body in tied:
            row, impulse = self.things.bodies[body], -self.h * pulls[number]
            spin = m.turning[row] @ np.cross(anchors[number] - m.x[row], impulse)
            self.tugs[body] += [*(m.inverse_mass[row] * impulse), *spin]
        m.v[self.things.bodies] += self.tugs[:, :3]
        m.spin[self.things.bodies] += self.tugs[:, 3:]
        return laws.summed(len(self.x), held.astype(int), pulls)

    def _move_obstacles(self) -> None:
        """Move obstacles over the substep, and find how they let particles and spheres through."""
        m, things, seconds, m.around = self.m, self.things, 1.0 / self.scene.frames_per_second, []
        each = zip(things.obstacles, things.shifts, things.turns, self.parameters["obstacle_position"][0], strict=True)
        for row, shifts, turns, position in each:
            parts = ((self.substep_number + end) / self.substeps for end in (0, 1))
            poses = [solids.pose(position + shifts, turns, self.frame_number, part, seconds) for part in parts]
            m.x[row], m.turn[row], m.v[row], m.spin[row] = poses[0]
            m.start[row] = m.x[row]
            m.around.append((partial(solids.beside_obstacle, *m.shapes[row], poses, m.h), row))
        if self.scene.ground is not None:
            m.around.append((partial(solids.on_ground, m.height, m.up), m.ground))

    def _move_spheres_and_bodies(self) -> None:
        """Move spheres and bodies beside the ground, obstacles and their likes, and let them meet."""
        m, things = self.m, self.things
        for ball, push in zip(things.spheres, self.pushes, strict=True):
            solids.roll(m, ball, m.inverse_mass[ball] * push)
            solids.leave_obstacles(m, ball)
        self.pushes[:] = 0.0
        contact.spheres_meet(m, things.spheres, solids.put_beside)
        if things.grips:
            bodies.move(m, things.grips, self.tugs)
        for ball in things.spheres[m.radius[things.spheres] > 0.0]:
            for body in things.bodies:
                bodies.meet_sphere(m, body, ball)

    def _predict_deflection(self, end: Array, predicted_velocity: Array) -> tuple[Array, Array]:
        """Return foreseen places of particles beside spheres, obstacles and the ground, and the normals there."""
        normals, stood, m = np.zeros_like(end), end, self.m
        for ball in self.things.spheres:
            stood, _, normal = solids.leave_sphere(m, ball, stood, predicted_velocity)
            normals = np.where(normal.any(axis=1, keepdims=True), normal, normals)
        stood, _, normal = solids.stand(m, self.x, stood, predicted_velocity, predicted=True)
        return stood, np.where(normal.any(axis=1, keepdims=True), normal, normals)

    def _meet(self, mass: Array, inflation: Array) -> None:
        """Let particles that have moved meet all."""
        m, h, things, meetings = self.m, self.h, self.things, self.meetings
        count = len(mass)
        m.inverse_mass[:count] = np.where(mass == 0.0, 0.0, 1.0 / np.where(mass == 0.0, 1.0, mass))
        told = m, meetings.ridges, meetings.kept, count, meetings.triangles, meetings.edges
        first = len(things.obstacles) > 0 or not len(things.bodies)
        if meetings.ridges and first:
            contact.sweep(m, contact.contacts_of_ridges(*told), h, 24)
        near = np.zeros((count, 1), dtype=bool)
        for ball, penalty, push in zip(things.spheres, self.parameters["sphere_penalty"][0], self.pushes, strict=True):
            if self.scene.contact == "impulse":
                near |= solids.may_meet(m, ball, count)
                continue
            m.x[:count], m.v[:count], normal = solids.leave_sphere(m, ball, self.x, self.v)
            push -= penalty * (laws.size(inflation) * normal * (m.inverse_mass[:count] > 0.0)).sum(axis=0)
        self._stand(~near)
        if near.any():  # they leave the ground and obstacles once they have met spheres
            for ball in things.spheres:
                solids.exchange(m, ball, mass, solids.passing_sphere(m, ball, mass))
            self._stand(near)
        if meetings.small:
            self.small_contacts += contact.small_spheres_meet(m, meetings.small, meetings.triangles)
        found, way = [], (self.x - h * self.v, self.x, self.v)
        for body in things.bodies:
            passing = solids.passing_body(m, body, bodies.turned(m, body), *way)
            found.append(contact.contacts_of_body(m, body, things.reach[body], mass, passing))
        if meetings.ridges and not first:
            found.append(contact.contacts_of_ridges(*told))
        if meetings.pairs:
            found.append(contact.contacts_of_skins(m, meetings.pairs, self.owner, meetings.touch.skins))
        if found:
            most = 300 if meetings.pairs else 50
            contact.sweep(m, np.concatenate(found), h, most, any(thing == m.ground for _, thing in m.around))
        for body in things.bodies:
            bodies.take_turn(m, body)

    def _stand(self, of: Array) -> None:
        """Let some particles leave obstacles and the ground."""
        out, after, _ = solids.stand(self.m, self.x - self.h * self.v, self.x, self.v)
        self.m.x[: len(of)], self.m.v[: len(of)] = np.where(of, out, self.x), np.where(of, after, self.v)
