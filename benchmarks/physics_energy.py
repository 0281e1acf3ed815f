"""Energy, momentum and angular momentum of a run, in float64, by formulas of their own."""

from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from balloon_warp.benchmarks.physics_runs import Run
from balloon_warp.benchmarks.physics_twins import Array
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.lab.statics import Volume, film_of, springs_of
from balloon_warp.mesh.topology import is_closed, mesh_edges, next_corners
from balloon_warp.model import Model
from balloon_warp.scene import Scene

EPSILON = float(np.finfo(np.float32).eps)


def forces_rounding(model: Model, number: int) -> Array:
    """Return the rounding of the forces that the faces around each particle of a balloon add up to [N], shape (n,).

    At rest a force is a difference of terms as large as a stiffness times an edge, of which half an epsilon is lost. A
    membrane loses more by 1 / sin^2 of a triangle's smallest angle: its strain is told by the square of its area, a
    difference of products of its edges. Those on F faces lose sqrt(F) of it.
    """
    told, mesh = model.scene.balloon[number], model.shapes[number].mesh
    corners = mesh.face_vertex_indices
    triangles = np.stack([corners, corners[next_corners(mesh)], corners[np.argsort(next_corners(mesh))]], axis=1)
    sides = mesh.points[triangles] - mesh.points[np.roll(triangles, 1, axis=1)]
    lengths = np.sort(np.linalg.norm(sides, axis=2), axis=1)
    if told.material.shear_modulus:
        stiffness = told.material.shear_modulus * (told.material.thickness or 0.0)
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        sines = areas / np.maximum(lengths[:, 1] * lengths[:, 2], 1e-30)
        lost = stiffness * lengths[:, 2] / np.where(sines > 0.0, sines, np.inf) ** 2
    else:
        springs = (told.stiffness.structural, told.stiffness.shear, told.stiffness.flexion)
        lost = max(each or 0.0 for each in springs) * lengths[:, 2]
    squares = np.zeros(mesh.vertex_count)
    np.add.at(squares, triangles, lost[:, None] ** 2)
    return 0.5 * EPSILON * np.sqrt(squares)


class Energies:
    """Conserved quantities of a run, by frame.

    Energies count motion, weight, springs, rubber, given pressures, gas and strings of no balloon, since these are only
    asked for where nothing else acts.
    """

    def __init__(self, run: Run):
        self.run, self.model, self.scene = run, run.model, run.model.scene
        self.up = np.array(self.scene.up)
        self.parameters = {name: np.asarray(array.numpy(), float) for name, array in self.model.parameters.items()}

    @staticmethod
    def knows(scene: Scene) -> bool:
        """Return whether all that acts has an energy here, or only takes some."""
        air = scene.atmosphere.density != 0.0 or scene.water
        weighs = any(balloon.inflation.kind == "gas" and balloon.inflation.molar_mass for balloon in scene.balloon)
        air = air or (weighs and scene.gravity != 0.0)  # a gas's weight acts at the center of its volume
        given = any(balloon.stiffness.torsion or balloon.material.strength for balloon in scene.balloon)
        given = given or any(balloon.inflation.kind == "normal_force" for balloon in scene.balloon)
        return not (
            air
            or given
            or scene.tube
            or scene.correction != "none"
            or scene.change
            or scene.string
            or any(each.motion for each in scene.obstacle)
        )

    @property
    def is_smooth(self) -> bool:
        """Return whether no contact acts."""
        scene = self.scene
        return not (scene.ground or scene.sphere or scene.obstacle or scene.body or scene.touches)

    @cached_property
    def masses(self) -> Array:
        """Masses of the particles with their shares of gas [kg], shape (n,)."""
        amounts, parts = self.run.states["gas_amounts"][0], []
        masses = self.parameters["mass"][0]
        for number, (balloon, shape) in enumerate(zip(self.scene.balloon, self.model.shapes, strict=True)):
            gas = amounts[number] * balloon.inflation.molar_mass if balloon.inflation.kind == "gas" else 0.0
            parts.append((masses[number] + gas) * shape.mass_share)
        return np.concatenate(parts)

    @cached_property
    def _all_masses(self) -> Array:
        spheres = self.parameters["sphere_mass"][0] if self.model.sphere_count else []
        bodies = self.parameters["body_mass"][0] if self.model.body_count else []
        return np.concatenate([self.masses, spheres, bodies])

    @cached_property
    def _velocities(self) -> Array:
        names = "velocities", "sphere_velocities", "body_velocities"
        return np.concatenate([self.run.states[name] for name in names], axis=1)

    def momenta(self) -> Array:
        """Return the momentum of everything [kg m/s], shape (frames + 1, 3)."""
        return self._all_masses @ self._velocities

    def weight_impulses(self) -> Array:
        """Return the momentum added by gravity since the start [kg m/s], shape (frames + 1, 3)."""
        times = np.arange(len(self.run.points)) * self.model.frame_seconds
        return -self.scene.gravity * self._all_masses.sum() * times[:, None] * self.up

    def angular_momenta(self) -> Array:
        """Return the angular momentum about the center of mass [kg m^2/s], shape (frames + 1, 3)."""
        share = self._all_masses / self._all_masses.sum()
        places = self.run.points - (share @ self.run.points)[:, None]
        speeds = self._velocities - (share @ self._velocities)[:, None]
        orbits = (self._all_masses[:, None] * np.cross(places, speeds)).sum(axis=1)
        return (
            orbits
            + self.run.states["body_momenta"].sum(axis=1)
            + self._sphere_inertias @ self.run.states["sphere_spins"]
        )

    @property
    def _sphere_inertias(self) -> Array:
        if not self.model.sphere_count:
            return np.zeros(0)
        return 0.4 * self.parameters["sphere_mass"][0] * self.parameters["sphere_radius"][0] ** 2

    def reach(self) -> float:
        """Return the largest distance from the origin [m]."""
        return float(np.linalg.norm(self.run.points, axis=2).max())

    def momentum_rounding(self) -> float:
        """Return the rounding of all velocities, and of the forces on balloons, in all substeps [kg m/s]."""
        substeps = self.model.substeps * (len(self.run.points) - 1)
        motion = float((self._all_masses * np.abs(self._velocities).max(axis=(0, 2))).sum())
        forces = sum(np.linalg.norm(forces_rounding(self.model, n)) for n in range(len(self.scene.balloon)))
        return substeps**0.5 * (0.5 * EPSILON * motion + self.model.step_seconds * forces)

    def rounding(self) -> float:
        """Return the rounding of the energies [J]: forces times that of places, and that of a gas's pressure.

        A gas's pressure is rounded as the volume is: by the products of a face, and by the partial sums over F faces,
        to either side, of sqrt(F) halves of an epsilon. Both count twice, as a sum of random signs may. It works along
        the path of the volume, which swings within a frame at the rate that is seen at its ends.
        """
        forces = np.abs(np.array([self._forces(frame) for frame in range(len(self.run.points))])).sum(axis=(1, 2)).max()
        weight = self.scene.gravity * self._all_masses.sum()
        swelling = 0.0
        for number, balloon in enumerate(self.scene.balloon):
            if balloon.inflation.kind == "gas":
                volumes = self._volumes(number)
                rounded = (4.0 + len(self.model.shapes[number].skin.face_vertex_counts) ** 0.5) * EPSILON
                path = max(np.abs(np.diff(volumes)).sum(), self._swinging(number))
                float64 = 1.0e-15 * volumes.max()  # of the air's work
                swelling += self.scene.atmosphere.pressure * (rounded * path + float64)
        return 4.0 * EPSILON * (forces + weight) * self.reach() + swelling

    def _volumes(self, number: int) -> Array:
        begin, end = self.model.particle_offsets[number : number + 2]
        volume = Volume(self.model.shapes[number].skin)
        return np.array([volume.of(points) for points in self.run.states["points"][:, begin:end]])

    def _swinging(self, number: int) -> float:
        """Return how far the volume of a balloon goes at its largest rate dV/dx . v [m^3]."""
        begin, end = self.model.particle_offsets[number : number + 2]
        volume = Volume(self.model.shapes[number].skin)
        states = zip(self.run.states["points"], self.run.states["velocities"], strict=True)
        rates = [abs((volume.slopes(points[begin:end]) * speeds[begin:end]).sum()) for points, speeds in states]
        return max(rates) * (len(rates) - 1) * self.model.frame_seconds

    def scale(self) -> float:
        """Return the energy that moves [J]: the largest of the motion's and of the changes of all others."""
        return float(self.kinetic().max() + np.ptp(self.weights()) + np.ptp(self.elastic()))

    def total(self) -> Array:
        """Return T + V + (h/2) v . F [J], shape (frames + 1,); at the start both halves are one."""
        work = [
            (self._forces(frame) * self.run.states["velocities"][frame]).sum() for frame in range(len(self.run.points))
        ]
        shadow = 0.5 * self.model.step_seconds * np.array(work)
        falling = self._velocities @ self.up @ self._all_masses * self.scene.gravity
        return self.kinetic() + self.weights() + self.elastic() + shadow - 0.5 * self.model.step_seconds * falling

    def kinetic(self) -> Array:
        """Return the energy of motion [J], shape (frames + 1,)."""
        moving = 0.5 * (self._velocities**2).sum(axis=2) @ self._all_masses
        spinning = 0.5 * (self.run.states["sphere_spins"] ** 2).sum(axis=2) @ self._sphere_inertias
        for number, shape in enumerate(self.model.bodies):
            turns = Rotation.from_quat(self.run.states["body_turns"][:, number]).as_matrix()
            own = np.einsum("fji,fj->fi", turns, self.run.states["body_momenta"][:, number])
            inertia = shape.inertia * self.parameters["body_mass"][0, number]
            spinning = spinning + 0.5 * (own * np.linalg.solve(inertia, own.T).T).sum(axis=1)
        return moving + spinning

    def weights(self) -> Array:
        """Return the energy of weight [J], shape (frames + 1,)."""
        return self.scene.gravity * (self.run.points @ self.up) @ self._all_masses

    def elastic(self) -> Array:
        """Return the energy of springs, rubber, pressure and gas [J], shape (frames + 1,)."""
        total = np.zeros(len(self.run.points))
        for number, skins in enumerate(self._skins):
            begin, end = self.model.particle_offsets[number : number + 2]
            places = self.run.states["points"][:, begin:end]
            total += [sum(skin.energy(points) for skin in skins) for points in places]
            total += self._inflation(number)
        return total

    def _inflation(self, number: int) -> Array:
        """Return the energy of a given pressure, -p V, or of a gas beside the air's [J]."""
        told = self.scene.balloon[number].inflation
        if not is_closed(mesh_edges(self.model.shapes[number].skin)):
            return np.zeros(len(self.run.points))
        volumes = np.maximum(self._volumes(number), 1e-30)
        if told.kind == "pressure":
            return -float(self.run.states["pressures"][0, number]) * volumes
        air = self.scene.atmosphere.pressure
        start, ratio = air + told.start_pressure, volumes / volumes[0]
        work = np.log(ratio) if told.gamma == 1.0 else (1.0 - ratio ** (1.0 - told.gamma)) / (told.gamma - 1.0)
        return air * volumes - start * volumes[0] * work

    def _forces(self, frame: int) -> Array:
        """Return the forces of springs, rubber and given pressures on particles [N], shape (n, 3)."""
        parts = []
        for number, skins in enumerate(self._skins):
            begin, end = self.model.particle_offsets[number : number + 2]
            points = self.run.states["points"][frame, begin:end]
            forces = sum(skin.forces(points) for skin in skins)
            if self.scene.balloon[number].inflation.kind == "pressure":
                slopes = Volume(self.model.shapes[number].skin).slopes(points)
                forces = forces + self.run.states["pressures"][0, number] * slopes
            parts.append(forces)
        return np.concatenate(parts)

    @cached_property
    def _skins(self) -> list:
        rows = {name: values[:1] for name, values in self.parameters.items()}
        constants = np.stack([self.parameters[row.name][0] for row in KINDS], axis=1)
        return [
            ([springs_of(shape, constants[number])] if shape.springs.count else [])
            + ([film_of(self.scene, number, shape, rows)] if shape.membrane.count else [])
            for number, shape in enumerate(self.model.shapes)
        ]
