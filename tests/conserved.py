"""Conserved quantities of a simulation's first world, in float64; scenes of balloons in contact."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from meshes import box, grid, mesh_of, quad_sphere, with_tips
from numpy.typing import NDArray
from trajectories import stepped

from balloon_warp import Atmosphere, Balloon, Frame, Inflation, PolygonMesh, Scene, Simulator, Stiffness, Touch
from balloon_warp.benchmarks.overlap import Points, deepest_overlap, dot, surface
from balloon_warp.schedules.gather import ScatterSchedule


def masses(simulator: Simulator) -> NDArray[np.float64]:
    """Return the moving mass of each particle [kg], with its share of the balloon's gas, shape (particle_count,)."""
    model = simulator.model
    skins, amounts = model.parameters["mass"].numpy()[0], simulator.state.gas_amounts.numpy()[0]
    parts = []
    for balloon, shape, skin, amount in zip(model.scene.balloon, model.shapes, skins, amounts, strict=True):
        gas = amount * balloon.inflation.molar_mass if balloon.inflation.kind == "gas" else 0.0
        parts.append((skin + gas) * shape.mass_share)
    return np.concatenate(parts)


def motion(simulator: Simulator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points [m] and velocities [m/s] of the particles, shape (particle_count, 3)."""
    state = simulator.state
    return state.points.numpy()[0].astype(np.float64), state.velocities.numpy()[0].astype(np.float64)


def momentum(simulator: Simulator) -> NDArray[np.float64]:
    """Return the momentum of the balloons [kg m/s], shape (3,)."""
    _, velocities = motion(simulator)
    return masses(simulator) @ velocities


def angular_momentum(simulator: Simulator) -> NDArray[np.float64]:
    """Return the angular momentum of the balloons about the origin [kg m^2/s], shape (3,)."""
    points, velocities = motion(simulator)
    return masses(simulator) @ np.cross(points, velocities)


def energy(simulator: Simulator) -> float:
    """Return the energy of motion and springs of all balloons [J], from the scene's own numbers."""
    points, velocities = motion(simulator)
    total = 0.5 * masses(simulator) @ (velocities**2).sum(axis=1)
    for number, (shape, balloon) in enumerate(zip(simulator.model.shapes, simulator.model.scene.balloon, strict=True)):
        kinds = np.array([balloon.stiffness.structural, balloon.stiffness.shear, balloon.stiffness.flexion])
        first, second = points[shape.springs.pairs + simulator.model.particle_offsets[number]].swapaxes(0, 1)
        strain = np.linalg.norm(second - first, axis=1) - shape.springs.rest_lengths
        total += 0.5 * kinds[shape.springs.kind] @ strain**2
    return float(total)


def put(simulator: Simulator, points: NDArray | None = None, velocities: NDArray | None = None) -> None:
    """Set the places of the particles, all worlds alike, shape (particle_count, 3)."""
    for array, values in ((simulator.state.points, points), (simulator.state.velocities, velocities)):
        if values is not None:
            rows = np.broadcast_to(values, (*array.shape, 3))
            wp.copy(array, wp.array(rows, dtype=wp.vec3, device=simulator.model.device))


def advanced(simulator: Simulator, frames: int) -> Frame:
    """Return the frame after so many more."""
    return stepped(simulator, frames).read_frame()


def after_each(simulator: Simulator, frames: int, measure: Callable[[Simulator], Any]) -> list[Any]:
    """Return measurements after each of so many more frames."""
    found = []
    for _ in range(frames):
        simulator.step_unread()
        found.append(measure(simulator))
    return found


def most_in(simulator: Simulator, frames: int, *measures: Callable[[Simulator], float]) -> list[float]:
    """Return the most of each measurement after any of so many more frames."""
    return np.max(after_each(simulator, frames, lambda each: [measure(each) for measure in measures]), axis=0).tolist()


def speed(simulator: Simulator) -> float:
    """Return the speed of the fastest particle [m/s]."""
    return float(np.linalg.norm(motion(simulator)[1], axis=1).max())


def forces_by_scatter(simulator: Simulator) -> NDArray[np.float32]:
    """Return the net forces on the particles [N], as `scatter` sums them, shape (particle_count, 3)."""
    scatter = ScatterSchedule(simulator.model)
    scatter.sum_forces(simulator.state)
    return scatter.forces.numpy()[0]


def assert_goes_on_alike(one: Simulator, other: Simulator, frames: int) -> None:
    """Require that another simulator that gets the state of one goes on to the same bits."""
    other.restore({name: array.numpy().copy() for name, array in one.state.arrays.items()})
    for simulator in (one, other):
        advanced(simulator, frames)
    for name, array in one.state.arrays.items():
        np.testing.assert_array_equal(array.numpy(), other.state.arrays[name].numpy(), err_msg=name)


def sphere_momenta(simulator: Simulator) -> NDArray[np.float64]:
    """Return the momenta of the spheres [kg m/s], with their next push by the paper's rule, shape (sphere_count, 3)."""
    model, state = simulator.model, simulator.state
    velocities, forces = (a.numpy()[0].astype(np.float64) for a in (state.sphere_velocities, state.sphere_forces))
    coming = model.step_seconds * forces if model.scene.contact == "penalty" else 0.0
    return model.parameters["sphere_mass"].numpy()[0, :, None] * velocities + coming


def sphere_spins(simulator: Simulator) -> NDArray[np.float64]:
    """Return the spins of the spheres [rad/s], shape (sphere_count, 3)."""
    return simulator.state.sphere_spins.numpy()[0].astype(np.float64)


def sphere_inertias(simulator: Simulator) -> NDArray[np.float64]:
    """Return the inertias of the spheres 2/5 M R^2 [kg m^2], shape (sphere_count, 1)."""
    mass, radius = (simulator.model.parameters[f"sphere_{name}"].numpy()[0, :, None] for name in ("mass", "radius"))
    return 0.4 * mass.astype(np.float64) * radius.astype(np.float64) ** 2


def sphere_turning(simulator: Simulator) -> NDArray[np.float64]:
    """Return the angular momentum of all spheres about the origin [kg m^2/s], shape (3,)."""
    centers = simulator.state.sphere_positions.numpy()[0].astype(np.float64)
    own = sphere_inertias(simulator) * sphere_spins(simulator)
    return (np.cross(centers, sphere_momenta(simulator)) + own).sum(axis=0)


def sphere_energies(simulator: Simulator) -> NDArray[np.float64]:
    """Return the energies of the spheres' motion and spin [J], shape (sphere_count,)."""
    masses = simulator.model.parameters["sphere_mass"].numpy()[0].astype(np.float64)
    spinning = 0.5 * (sphere_inertias(simulator) * sphere_spins(simulator) ** 2).sum(axis=1)
    return (sphere_momenta(simulator) ** 2).sum(axis=1) / (2.0 * masses) + spinning


def whole(simulator: Simulator) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return momentum, angular momentum and energy of balloons and spheres together."""
    total, turning = momentum(simulator) + sphere_momenta(simulator).sum(axis=0), angular_momentum(simulator)
    return total, turning + sphere_turning(simulator), energy(simulator) + float(sphere_energies(simulator).sum())


RADIUS = 0.5
SLACK = Inflation(pressure=0.0)
"""no pressure at all"""
VACUUM: dict[str, Any] = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0)}


def ball(*position: float, **fields: Any) -> Balloon:
    """Return a balloon of 386 particles."""
    return Balloon(**{"mesh": quad_sphere(8, RADIUS), "position": position, "mass": 0.3, "damping": 0.0} | fields)


def collision(speed: float = 2.0, touch: Touch | None = None, **fields: Any) -> Scene:
    """Return two equal balls that collide off their centers in empty space, one turning."""
    firm = {"inflation": SLACK, "stiffness": Stiffness(flexion=50.0)}
    balls = [
        ball(-0.7, 0.0, 0.0, velocity=(speed, 0.0, 0.0), angular_velocity=(0.0, 0.0, speed), **firm),
        ball(0.7, 0.2, 0.1, velocity=(-speed, 0.0, 0.0), **firm),
    ]
    return Scene(**{"balloon": balls, "touch": touch or Touch(), "substeps": 48} | VACUUM | fields)


def fast() -> Scene:
    """Return two balls of air at 20 m/s towards each other, nearly along their centers, a twentieth of their radius in
    a substep."""
    air = Inflation(kind="gas", start_pressure=30.0)
    balls = [ball(x, 0.1 * x, 0.0, velocity=(-10.0 * x, 0.0, 0.0), inflation=air) for x in (-1, 1)]
    return Scene(balloon=balls, touch=Touch(), **VACUUM)


def square(cells: int, size: float, axis: int = 2) -> PolygonMesh:
    """Return a flat square of so many cells a side about the origin, across an axis."""
    flat = grid(cells, cells)
    points = size * (flat.points / cells - (0.5, 0.5, 0.0))
    return replace(flat, points=np.roll(points, axis - 2, axis=1))


def ramp(degrees: float, friction: float) -> Scene:
    """Return a stiff block on a fixed tilted plane; it is viscous, as a rattling one creeps."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    along = np.array([0.0, -sine, cosine]), np.array([0.0, cosine, sine])  # down the plane, and out of it
    plane = {"mesh": square(6, 6.0), "rotation": (-90.0 + degrees, 0.0, 0.0), "fixed": list(range(49))}
    block = {"mesh": box((0, 0, 0), (1, 1, 1)), "scale": 0.5, "mass": 1.0, "damping": 0.0, "inflation": SLACK}
    place = tuple(0.27 * along[1] - 0.5 * along[0])
    stiff = Stiffness(structural=2000.0, shear=2000.0, flexion=2000.0, viscosity=1e-3)
    return Scene(
        balloon=[
            Balloon(inflation=SLACK, **plane),
            Balloon(position=place, rotation=(degrees, 0.0, 0.0), stiffness=stiff, **block),
        ],
        touch=Touch(friction=friction, thickness=0.02), atmosphere=Atmosphere(density=0.0),
    )  # fmt: skip


def cushion(cells: int) -> PolygonMesh:
    """Return two flat sheets of 30 cm, joined at their rims."""
    top = grid(cells, cells)
    rim = ((top.points[:, :2] == 0.0) | (top.points[:, :2] == cells)).any(axis=1)
    below = np.where(rim, np.arange(len(rim)), len(rim) + np.cumsum(~rim) - 1)
    faces = top.face_vertex_indices.reshape(-1, 4)
    points = np.concatenate([top.points, top.points[~rim]]) - np.array([cells / 2.0, cells / 2.0, 0.0])
    return mesh_of(0.3 / cells * points, [*faces.tolist(), *below[faces][:, ::-1].tolist()])


def tube(rings: int, around: int) -> PolygonMesh:
    """Return a closed tube of 2 m along x, 16 cm wide."""
    along, angles = np.linspace(-1.0, 1.0, rings), 2.0 * np.pi * np.arange(around) / around
    circles = np.array([[(x, 0.08 * np.cos(a), 0.08 * np.sin(a)) for a in angles] for x in along])
    return with_tips(circles, [(-1.04, 0.0, 0.0), (1.04, 0.0, 0.0)])


def centers(simulator: Simulator, world: int = 0) -> NDArray[np.float64]:
    """Return the centers of the particles of each balloon [m], shape (balloon_count, 3)."""
    points = simulator.state.points.numpy()[world].astype(np.float64)
    return np.array([part.mean(axis=0) for part in np.split(points, simulator.model.particle_offsets[1:-1])])


def touching(simulator: Simulator) -> int:
    """Return the number of particles of all worlds that touch anything."""
    return int((simulator.state.holds.numpy()[..., 3] != 0.0).sum())


def deepest(simulator: Simulator, world: int = 0) -> float:
    """Return the largest distance of a particle within another balloon from its surface [m]; 0 if none is in any."""
    points = simulator.state.points.numpy()[world].astype(np.float64)
    parts = [points[begin:end] for begin, end in pairwise(simulator.model.particle_offsets)]
    return deepest_overlap(parts, [shape.mesh for shape in simulator.model.shapes])


def edges_through(points: Points, ends: NDArray[np.int64], mesh: PolygonMesh) -> int:
    """Return the number of edges of one balloon that pierce faces of another (Möller and Trumbore 1997).

    Args: points: particles of the first balloon. ends: its edges, shape (E, 2). mesh: the other balloon."""
    triangles, count = surface(mesh), 0
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    for begin, end in points[ends]:
        across, start = np.cross(end - begin, second), begin - triangles[:, 0]
        whole = dot(first, across)
        whole = np.where(np.abs(whole) > 1e-15, whole, np.inf)
        beside = np.cross(start, first)
        u, v, part = dot(start, across) / whole, (beside @ (end - begin)) / whole, dot(beside, second) / whole
        count += bool(((u > 0.0) & (v > 0.0) & (u + v < 1.0) & (part > 0.0) & (part < 1.0)).any())
    return count
