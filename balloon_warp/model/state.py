"""The state: arrays that change during a simulation, and the memory that they take.

Places and velocities of particles at the start.

Values that items keep from substep to substep, for phases of the step: see `kernels.phase.Phase.keeps`.
"""

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import warp as wp

from balloon_warp.errors import NoRoomError
from balloon_warp.kernels.frame import place_balloons
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.mesh.load import rotation_matrix
from balloon_warp.model.model import Model
from balloon_warp.model.obstacles import initial_centers, initial_turns, max_body_contacts
from balloon_warp.model.parameters import kept_values
from balloon_warp.system.warp_threads import launch

MIB = 2**20


class Limit(NamedTuple):
    """A limit on the memory of a process, and the memory left below it."""

    name: str
    """Name of the limit"""
    left: int
    """Free bytes"""


def lowest_limit(root: Path = Path("/"), environment: Mapping[str, str] = os.environ) -> Limit | None:
    """Find the limit that is met first, or None where there is none.

    Args:
        root: where `proc` and `sys` are.
        environment: of the process.
    """
    status = _text(root / "proc/self/status")
    limits = [*_of_cgroups(root), *_of_slurm(environment, status), *_of_ulimit(status)]
    return min(limits, key=lambda limit: limit.left, default=None)


def _of_cgroups(root: Path) -> Iterator[Limit]:
    """Iterate over the memory limits of the process's control group and its parents, of versions 1 and 2.

    The page cache of files that nobody works on is released on demand, and so counts as free.
    """
    for line in _text(root / "proc/self/cgroup").splitlines():
        _, controllers, own = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        old = bool(controllers)
        mount = root / "sys/fs/cgroup" / ("memory" if old else "")
        most, used, idle = (
            ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
            if old
            else ("memory.max", "memory.current", "inactive_file")
        )
        group = mount / own.strip("/")
        for folder in (group, *group.parents):
            if not folder.is_relative_to(mount):
                break
            with suppress(ValueError):  # "max", or no such file: a container sees its own group as the root
                limit = int(_text(folder / most))
                given_back = _field(_text(folder / "memory.stat"), rf"^{idle} (\d+)$")
                yield Limit(f"the cgroup's {most}", limit - int(_text(folder / used)) + given_back)


def _of_slurm(environment: Mapping[str, str], status: str) -> Iterator[Limit]:
    """Return the memory limits of a SLURM job [MiB]: of a node, or of each CPU on it.

    0 is all that the node has.
    """
    taken = 1024 * _field(status, r"^VmRSS:\s+(\d+) kB$")
    for name, count in (("SLURM_MEM_PER_NODE", "1"), ("SLURM_MEM_PER_CPU", environment.get("SLURM_CPUS_ON_NODE", ""))):
        with suppress(KeyError, ValueError):
            asked = MIB * int(count) * int(environment[name])
            if asked > 0:
                yield Limit(name, asked - taken)


def _of_ulimit(status: str) -> Iterator[Limit]:
    try:
        import resource
    except ModuleNotFoundError:  # Windows has none
        return
    for option, number, taken in (
        ("-v", resource.RLIMIT_AS, r"^VmSize:\s+(\d+) kB$"),
        ("-d", resource.RLIMIT_DATA, r"^VmData:\s+(\d+) kB$"),
    ):
        soft, _ = resource.getrlimit(number)
        if soft != resource.RLIM_INFINITY:
            yield Limit(f"ulimit {option}", soft - 1024 * _field(status, taken))


def _text(path: Path) -> str:
    """Read a file; nothing where it cannot be read."""
    with suppress(OSError):
        return path.read_text()
    return ""


def _field(text: str, pattern: str) -> int:
    found = re.search(pattern, text, re.MULTILINE)
    return int(found[1]) if found else 0


USABLE = 0.9
"""Fraction of the free memory that a batch may take; kernels, graphs and the allocator need some, too"""


class Room(Protocol):
    """Allocator of arrays.

    All code that allocates uses one, so that the memory can be counted in advance.
    """

    def array(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """Return an array of zeros."""


class Allocating:
    """The memory of a device."""

    def __init__(self, device: wp.Device):
        self.device = device

    def array(self, shape: int | tuple[int, ...], dtype: Any) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self.device)


class Counting:
    """Allocator that counts memory without allocating it."""

    def __init__(self) -> None:
        self.bytes = 0

    def array(self, shape: int | tuple[int, ...], dtype: Any) -> None:
        self.bytes += wp.types.type_size_in_bytes(dtype) * math.prod(shape if isinstance(shape, tuple) else (shape,))


def free_memory(device: wp.Device) -> int:
    """Return the bytes that can still be allocated: on a GPU, or of the host."""
    if device.is_cuda:
        return device.free_memory
    meminfo = Path("/proc/meminfo")
    if meminfo.exists() and (available := re.search(r"MemAvailable:\s+(\d+) kB", meminfo.read_text())):
        return 1024 * int(available[1])
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def require_memory(device: wp.Device, world_counts: Sequence[int], bytes_per_world: Sequence[int]) -> None:
    """Make sure that all worlds fit.

    Args:
        world_counts: of each kind of world.
        bytes_per_world: of each kind of world.

    Raises:
        NoRoomError: they do not; the message says how many would.
    """
    needed = sum(count * size for count, size in zip(world_counts, bytes_per_world, strict=True))
    usable, within = _usable(device)
    if needed > usable:
        worlds = sum(world_counts)
        raise NoRoomError(
            f"{worlds} worlds do not fit: they need {needed / 2**30:.2f} GiB, and {device} has "
            f"{usable / 2**30:.2f} GiB to spare{within}, enough for {usable * worlds // needed} worlds"
        )


def usable_memory(device: wp.Device) -> int:
    """Return the bytes that one may ask for."""
    return _usable(device)[0]


def _usable(device: wp.Device) -> tuple[int, str]:
    """Return the bytes that one may ask for, and within which limit, in words."""
    usable = int(USABLE * free_memory(device))
    if device.is_cpu and (limit := lowest_limit()) and int(USABLE * limit.left) < usable:
        return max(int(USABLE * limit.left), 0), f" within {limit.name}"
    return usable, ""


THREADS = 128
"""Number of threads that place the particles of a chosen world on a GPU"""


def place_particles(model: Model, points: wp.array, velocities: wp.array, mask: wp.array | None = None) -> None:
    """Place the particles of all worlds where they start, or of those for which a mask is not 0."""
    parameters = model.parameters
    world_count, particles = points.shape
    threads = 1 if model.device.is_cpu else particles if mask is None else THREADS
    launch(
        place_balloons,
        (world_count, threads),
        inputs=[
            *(model.initial_points, model.particle_balloon, model.particle_mass_share, model.balloon_origins),
            *(parameters[f"initial_{name}"] for name in ("turns", "shifts", "centers", "velocities", "spins")),
            *(mask, threads),
        ],
        outputs=[points, velocities],
        device=model.device,
    )


def kept_arrays(model: Model, room: Room) -> dict[str, Any]:
    """Return arrays for the values that items keep, by name."""
    counts = {
        "particle": model.particle_count, "face": model.face_count, "triangle": model.triangle_count,
        "balloon": model.balloon_count, "sphere": model.sphere_count, "world": 1,
    }  # fmt: skip
    return {
        each.name: room.array((model.world_count, counts[each.item]), wp.float32 if each.type is float else each.type)
        for each in kept_values(model)
    }


def start_kept(model: Model, kept: dict[str, Any]) -> None:
    """Fill in the values that items keep at the start."""
    for each in kept_values(model):
        kept[each.name].fill_(each.start)


def carry_kept_values(model: Model, kept: dict[str, Any]) -> dict[str, Any]:
    """Return the values that a model's items keep from here on: as they are, or as at the start."""
    fresh = kept_arrays(model, Allocating(model.device))
    start_kept(model, fresh)
    return {name: kept.get(name, array) for name, array in fresh.items()}


@dataclass
class State:
    """Device arrays of all worlds at one time."""

    frame: wp.array
    """Number of frames that have passed, shape (1,), int32"""
    points: wp.array
    """Positions of particles [m], shape (world_count, particle_count), vec3"""
    velocities: wp.array
    """Velocities of particles [m/s], shape (world_count, particle_count), vec3"""
    sphere_positions: wp.array
    """Positions of spheres [m], shape (world_count, sphere_count), vec3"""
    sphere_velocities: wp.array
    """Velocities of spheres [m/s], shape (world_count, sphere_count), vec3"""
    sphere_spins: wp.array
    """Angular velocities of spheres, by friction [rad/s], shape (world_count, sphere_count), vec3"""
    sphere_forces: wp.array
    """Penalty forces since the spheres last moved, which are still to act, or contact forces of particles in the last
    substep, where spheres exchange momentum [N], shape (world_count, sphere_count), vec3"""
    inflation_ramp: wp.array
    """Keyframed value, such as k_normal, at the start of the frame, and its slope [1/s], shape (world_count,
    balloon_count), vec2"""
    inflation_loads: wp.array
    """Gauge pressure at height 0 [Pa], and its gradient with height [Pa/m], under pressure or gas, shape (world_count,
    balloon_count), vec2"""
    pressures: wp.array
    """Gauge pressures of balloons with pressure or gas [Pa], shape (world_count, balloon_count), float32"""
    pressure_slopes: wp.array
    """Derivative of the pressure by the amount of gas within a substep [Pa/m^3 of free volume], for balloons whose gas
    flows, shape (world_count, balloon_count), float32"""
    gas_amounts: wp.array
    """Amounts of gas [mol], shape (world_count, balloon_count), float64"""
    free_volumes: wp.array
    """Free volumes of gas, the volume at one atmosphere after adiabatic expansion [m^3], see `kernels.laws.gas`, shape
    (world_count, balloon_count), float64"""
    air_along: wp.array
    """Added mass of a balloon of gas in the frame [kg], see `kernels.laws.gas`, shape (world_count,
    balloon_count), float32"""
    airs: wp.array
    """Air at balloons of gas that is pumped or flows, where air differs with height, as the frame begins: pressure
    [Pa], temperature [K] and density [kg/m^3], shape (world_count, balloon_count), vec3"""
    tube_flows: wp.array
    """Flow from a tube's first balloon to its second in the last substep [mol/s], shape (world_count, tube_count),
    float32"""
    vent_flows: wp.array
    """Flow out of a balloon through its neck and its leak in the last substep, negative inwards [mol/s], shape
    (world_count, balloon_count), float32"""
    thrusts: wp.array
    """Thrust of the jet of a balloon's neck by the pressure of the last substep [N], shape (world_count,
    balloon_count), float32"""
    holds: wp.array
    """Friction state of particles where balloons touch: slip from where they took hold of another surface [m], and the
    part of the overlap that pushes [m], negative behind it, 0 without contact; shape as of `deep`, vec4"""
    deep: wp.array
    """1 of particles that may be deep in another balloon, where nothing is near them: at the start that is not known of
    any; shape (world_count, particle_count), or (world_count, 0) where balloons do not touch, int8"""
    seen_points: wp.array
    """Positions when balloons that touch themselves were looked at last [m], like `points`, or (world_count, 0)"""
    rooms: wp.array
    """Relative motion since then from which on particles may touch [m], like `pressures`, or (world_count, 0)"""
    torn: wp.array
    """Distance that a tear may have run from each face, at rest [m], negative where the face is whole, shape
    (world_count, face_count), float32, or (world_count, 0) where none may tear"""
    bursts: wp.array
    """Bursts of balloons: the time [s], or negative; the area of the hole [m^2], or negative once nothing encloses the
    gas any more; the face where it burst, and the stress there [Pa]; shape (world_count, balloon_count), vec4, or
    (world_count, 0)"""
    tear_planes: wp.array
    """Planes along which the tears of torn faces run, see `laws.membrane`: unit normal and distance from the origin [m]
    on the unstretched skin, shape (world_count, face_count), vec4, or (world_count, 0)"""
    contact_impulses: wp.array
    """Impulse [N s] and contact time [s] of each thing that balloons may touch, and each particle, in the last frame,
    shape (world_count, thing_count, particle_count), vec4, or (world_count, 0, particle_count) unless the scene asks
    for `contacts`"""
    contact_forces: wp.array
    """Net force of each thing on each balloon, averaged over the last frame [N], shape (world_count, balloon_count,
    thing_count), vec3; things are numbered as `balloon_warp.frame.things_of` names them"""
    contact_torques: wp.array
    """Net torque of each thing on each balloon about the mean of the balloon's points [N m], of that shape, vec3"""
    contact_areas: wp.array
    """Contact area of the balloon with each thing [m^2], of that shape, float32"""
    contact_pressures: wp.array
    """Largest contact pressure at a particle, its force over its own area, between two balloons summed over both [Pa],
    of that shape, float32"""
    contact_places: wp.array
    """Center of pressure, the mean of the pressed places weighted by force [m], of that shape, vec3"""
    body_positions: wp.array
    """Centers of mass of bodies [m], shape (world_count, body_count), vec3"""
    body_turns: wp.array
    """Orientations of bodies, shape (world_count, body_count), quat"""
    body_velocities: wp.array
    """Velocities of bodies [m/s], shape (world_count, body_count), vec3"""
    body_momenta: wp.array
    """Angular momenta of bodies about their centers of mass [kg m^2/s], shape (world_count, body_count), vec3"""
    body_touches: wp.array
    """Contacts of points of bodies in the last substep, in ascending order until the first -1, see
    `kernels.loops.holding`, shape (world_count, max_body_contacts), int32"""
    body_impulses: wp.array
    """Normal and friction impulses of these contacts [N s], of that shape, vec3d"""
    unsettled: wp.array
    """Convergence of the projective solver: the frame whose iterations were the farthest from converged of those worth
    a warning, 0 if there is none, and the last iteration's change over that of springs, shape (world_count,), vec2"""
    overstretched: wp.array
    """First frame, 0 if there is none, after which a face of rubber that locks was stretched beyond its `most_stretch`,
    shape (world_count,), int32"""
    pressed: wp.array
    """First frame, 0 if there is none, at whose end a balloon's gas was pressed harder than its skin bears at the step,
    shape (world_count, balloon_count), int32"""
    first_bad: wp.array
    """Lowest particle, or sphere, numbered after the particles, of each world that was ever where it cannot be; or
    `HEALTHY`, shape (world_count,), int32"""
    kept: dict[str, wp.array]
    """Values that phases keep, by their names, see `kernels.phase.Phase.keeps`, shape (world_count, count of items)"""

    @property
    def arrays(self) -> dict[str, Any]:
        """Arrays by name."""
        return {name: array for name, array in vars(self).items() if name != "kept"} | self.kept

    def made_of(self, copied: Callable[[str, Any], Any]) -> Self:
        """Return a state of other arrays, each made of the one of that name."""
        kept = {name: copied(name, array) for name, array in self.kept.items()}
        others = {name: copied(name, array) for name, array in vars(self).items() if name != "kept"}
        return replace(self, **others, kept=kept)

    def of_world(self, world: int) -> Self:
        """Return the state of one world, as views."""

        def row(name: str, array: Any) -> Any:
            return array[world : world + 1] if name != "frame" and array.size and array.shape[0] > 1 else array

        return self.made_of(row)


def new_state(model: Model, room: Room) -> State:
    """Return a state of zeros, taken of a room."""
    worlds = model.world_count
    particles, spheres = (worlds, model.particle_count), (worlds, model.sphere_count)
    touching = (worlds, model.particle_count if model.scene.touches else 0)
    balloons, bodies = (worlds, model.balloon_count), (worlds, model.body_count)
    touches = (worlds, max_body_contacts(model.bodies))
    pairs = (worlds, model.balloon_count, contact_shape(model)[1])
    bursting = (worlds, model.balloon_count if model.bursts else 0)
    return State(
        frame=room.array(1, wp.int32),
        points=room.array(particles, wp.vec3),
        velocities=room.array(particles, wp.vec3),
        sphere_positions=room.array(spheres, wp.vec3),
        sphere_velocities=room.array(spheres, wp.vec3),
        sphere_spins=room.array(spheres, wp.vec3),
        sphere_forces=room.array(spheres, wp.vec3),
        inflation_ramp=room.array(balloons, wp.vec2),
        inflation_loads=room.array(balloons, wp.vec2),
        pressures=room.array(balloons, wp.float32),
        pressure_slopes=room.array(balloons, wp.float32),
        gas_amounts=room.array(balloons, wp.float64),
        free_volumes=room.array(balloons, wp.float64),
        air_along=room.array(balloons, wp.float32),
        airs=room.array(balloons, wp.vec3),
        tube_flows=room.array((worlds, model.tube_count), wp.float32),
        vent_flows=room.array(balloons, wp.float32),
        thrusts=room.array(balloons, wp.float32),
        holds=room.array(touching, wp.vec4),
        deep=room.array(touching, wp.int8),
        seen_points=room.array(particles if model.scene.touches_itself else (worlds, 0), wp.vec3),
        rooms=room.array(balloons if model.scene.touches_itself else (worlds, 0), wp.float32),
        torn=room.array((worlds, model.face_count if model.bursts else 0), wp.float32),
        bursts=room.array(bursting, wp.vec4),
        tear_planes=room.array((worlds, model.face_count if model.bursts else 0), wp.vec4),
        contact_impulses=room.array(contact_shape(model), wp.vec4),
        contact_forces=room.array(pairs, wp.vec3),
        contact_torques=room.array(pairs, wp.vec3),
        contact_areas=room.array(pairs, wp.float32),
        contact_pressures=room.array(pairs, wp.float32),
        contact_places=room.array(pairs, wp.vec3),
        body_positions=room.array(bodies, wp.vec3),
        body_turns=room.array(bodies, wp.quat),
        body_velocities=room.array(bodies, wp.vec3),
        body_momenta=room.array(bodies, wp.vec3),
        body_touches=room.array(touches, wp.int32),
        body_impulses=room.array(touches, wp.vec3d),
        unsettled=room.array(worlds, wp.vec2),
        overstretched=room.array(worlds, wp.int32),
        pressed=room.array(balloons, wp.int32),
        first_bad=room.array(worlds, wp.int32),
        kept=kept_arrays(model, room),
    )


def contact_shape(model: Model) -> tuple[int, int, int]:
    """Return the shape of the contact arrays: worlds, things, particles.

    Things are the ground, obstacles, spheres, bodies and balloons.
    """
    things = 1 + len(model.obstacles) + model.sphere_count + model.body_count + model.balloon_count
    return model.world_count, things if model.scene.contacts else 0, model.particle_count


def frames_of(model: Model, state: State) -> wp.array:
    """Return how many frames have passed in each world, shape (world_count,), or in all, shape (1,), int32."""
    return state.frame if model.ages is None else model.ages


def initial_state(model: Model) -> State:
    """Return the initial state of every world: the shape of the meshes, and each balloon's velocity as a rigid body."""
    state, parameters = new_state(model, Allocating(model.device)), model.parameters
    place_particles(model, state.points, state.velocities)
    for array, name in (
        (state.sphere_positions, "initial_sphere_positions"),
        (state.sphere_velocities, "initial_sphere_velocities"),
        (state.sphere_spins, "initial_sphere_spins"),
        (state.inflation_loads, "initial_loads"),
        (state.pressures, "initial_pressures"),
        (state.gas_amounts, "initial_gas_amounts"),
        (state.free_volumes, "initial_free_volumes"),
    ):
        row = parameters[name].numpy()
        array.assign(np.broadcast_to(row, (model.world_count, *row.shape[1:])))
    start_kept(model, state.kept)
    state.deep.fill_(1)
    state.torn.fill_(-1.0)
    state.bursts.fill_(wp.vec4(-1.0, 0.0, 0.0, 0.0))
    if model.bodies:
        _place_bodies(model, state)
    state.body_touches.fill_(-1)
    state.first_bad.fill_(HEALTHY)
    return state


def _place_bodies(model: Model, state: State) -> None:
    """Place bodies as the scene says, with the angular momenta of their given spins."""
    positions, velocities, spins, masses = (
        np.asarray(model.parameters[name].numpy(), dtype=np.float64)
        for name in ("initial_body_positions", "initial_body_velocities", "initial_body_spins", "body_mass")
    )
    matrices = [rotation_matrix(body.rotation) for body in model.scene.body]
    tensors = np.array(
        [turn @ shape.inertia @ turn.T for turn, shape in zip(matrices, model.bodies, strict=True)]
    ).reshape(-1, 3, 3)
    for array, rows in (
        (state.body_positions, initial_centers(model.scene, model.bodies, positions)),
        (state.body_turns, initial_turns(model.scene)[None]),
        (state.body_velocities, velocities),
        (state.body_momenta, masses[..., None] * np.einsum("bij,wbj->wbi", tensors, spins)),
    ):
        array.assign(np.broadcast_to(rows, (model.world_count, *rows.shape[1:])).astype(np.float32))


def carried_over(model: Model, before: State, spheres: Sequence[int | None]) -> State:
    """Return a state of a model that goes on from another of the same balloons.

    Args:
        spheres: for each sphere of the model its number in the one before, or None if the model says where it starts.
    """
    state = initial_state(model)
    now_has = state.arrays
    for name, array in before.arrays.items():
        if name.startswith("contact_"):
            continue  # of the frame before, in which there were other things
        if not name.startswith("sphere_"):
            if name in now_has:
                wp.copy(now_has[name], array)
            continue
        for now, until_now in enumerate(spheres):
            if until_now is not None:
                wp.copy(now_has[name][:, now], array[:, until_now])
    return state


def world_bytes(model: Model) -> int:
    """Return the device memory of one world's state."""
    room = Counting()
    new_state(replace(model, world_count=1), room)
    return room.bytes


def copy_of(state: State) -> State:
    """Return a copy of a state."""
    return state.made_of(lambda name, array: wp.clone(array))


def overwrite(state: State, other: State) -> None:
    """Overwrite a state's arrays with those of another of the same shapes."""
    arrays = state.arrays
    for name, array in other.arrays.items():
        wp.copy(arrays[name], array)
