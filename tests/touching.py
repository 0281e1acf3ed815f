"""Scenes of balloons in contact, which tests share, and their conserved quantities."""

from typing import Any

import numpy as np
from conserved import masses, motion
from meshes import grid, mesh_of, quad_sphere
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Atmosphere, Balloon, Ground, Inflation, Scene, Stiffness, Touch
from balloon_warp.simulator import Simulator

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


def pile(**fields: Any) -> Scene:
    """Return a ball on another, on the ground, which keeps them where they are."""
    balls = [ball(0.0, 0.52, 0.0, damping=0.6), ball(0.0, 1.56, 0.0, damping=0.6)]
    return Scene(**{"balloon": balls, "ground": Ground(), "touch": Touch()} | fields)


def ramp(degrees: float, friction: float, **fields: Any) -> Scene:
    """Return a stiff block on a fixed tilted plane; it is viscous, as a rattling one creeps."""
    plane = grid(6, 6)
    plane = mesh_of(plane.points - (3.0, 3.0, 0.0), plane.face_vertex_indices.reshape(-1, 4).tolist())
    block = quad_box(2)
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    along = np.array([0.0, -sine, cosine]), np.array([0.0, cosine, sine])  # down the plane, and out of it
    start = 0.27 * along[1] - 0.5 * along[0]
    stiff = Stiffness(structural=2000.0, shear=2000.0, flexion=2000.0, viscosity=1e-3)
    return Scene(
        balloon=[
            Balloon(mesh=plane, rotation=(-90.0 + degrees, 0.0, 0.0), fixed=list(range(49)), inflation=SLACK),
            Balloon(
                mesh=block,
                scale=0.5,
                rotation=(degrees, 0.0, 0.0),
                position=tuple(start),
                damping=0.0,
                inflation=SLACK,
                stiffness=stiff,
                mass=1.0,
            ),
        ],
        **{"touch": Touch(friction=friction, thickness=0.02), "atmosphere": Atmosphere(density=0.0)} | fields,
    )


def quad_box(n: int) -> PolygonMesh:
    """Return the unit cube about the origin, n by n quads a side."""
    mesh = quad_sphere(n)
    points = mesh.points / np.abs(mesh.points).max(axis=1, keepdims=True)
    return mesh_of(0.5 * points, mesh.face_vertex_indices.reshape(-1, 4).tolist())


def horseshoe(around: int = 24, across: int = 8, gap_degrees: float = 50.0, tube: float = 0.2) -> PolygonMesh:
    """Return a tube of radius `tube` along a part of the unit circle about z, closed by polygons at both ends."""
    gap = np.radians(gap_degrees)
    turns = np.linspace(0.5 * gap, 2.0 * np.pi - 0.5 * gap, around + 1)
    rings = 2.0 * np.pi * np.arange(across) / across
    points = [
        ((1.0 + tube * np.cos(r)) * np.cos(a), (1.0 + tube * np.cos(r)) * np.sin(a), tube * np.sin(r))
        for a in turns
        for r in rings
    ]
    faces = []
    for i in range(around):
        for j in range(across):
            up = (j + 1) % across
            faces.append([i * across + j, (i + 1) * across + j, (i + 1) * across + up, i * across + up])
    first = list(range(across))
    return mesh_of(points, [*faces, first, [around * across + j for j in first[::-1]]])


def energy(simulator: Simulator) -> float:
    """Return the energy of motion and springs of all balloons [J], from the scene's own numbers."""
    points, velocities = motion(simulator)
    total = 0.5 * masses(simulator) @ (velocities**2).sum(axis=1)
    for number, (shape, balloon) in enumerate(zip(simulator.model.shapes, simulator.model.scene.balloon, strict=True)):
        stiffness = balloon.stiffness
        first, second = points[shape.springs.pairs + simulator.model.particle_offsets[number]].swapaxes(0, 1)
        strain = np.linalg.norm(second - first, axis=1) - shape.springs.rest_lengths
        constants = np.array([stiffness.structural, stiffness.shear, stiffness.flexion])[shape.springs.kind]
        total += 0.5 * constants @ strain**2
    return float(total)


def centers(simulator: Simulator, world: int = 0) -> NDArray[np.float64]:
    """Return the centers of the particles of each balloon [m], shape (balloon_count, 3)."""
    points = simulator.state.points.numpy()[world].astype(np.float64)
    return np.array([part.mean(axis=0) for part in np.split(points, simulator.model.particle_offsets[1:-1])])


def touching(simulator: Simulator) -> int:
    """Return the number of particles of all worlds that touch anything."""
    return int((simulator.state.holds.numpy()[..., 3] != 0.0).sum())


def run(scene: Scene, device: str, schedule: str, frames: int) -> Simulator:
    simulator = Simulator(scene, device, schedule=schedule)
    for _ in range(frames):
        simulator.step_unread()
    return simulator
