"""Forces on a particle or a sphere of one world, and their sources."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.model import Model, State
from balloon_warp.model.strings import ANCHORED, anchors_of

TOUCH = 1.001
"""Distance within which a particle touches a sphere, over its radius"""


@dataclass(frozen=True)
class Pull:
    """Force on a particle just before the end."""

    by: str
    """Source of the force, such as "the structural spring to particle 7" """
    newtons: float
    stretch: float | None = None
    """Length of a spring over its rest length"""

    def __str__(self) -> str:
        if self.stretch is None:
            return f"{self.by} pushed it with {self.newtons:.2g} N"
        length = f"at {self.stretch:.3g} times its rest length"
        return f"{self.by}, {length}, {'pulled' if self.stretch > 1.0 else 'pushed'} it with {self.newtons:.2g} N"


class Pulls:
    """The forces in a world that is alone in its model, as its laws give them.

    Args:
        state: whose inflation is refreshed.
        substep: number of substeps of its frame that are done.
    """

    def __init__(self, model: Model, state: State, substep: int):
        self.model = model
        self._points = _row(state.points)
        self._spheres = _row(state.sphere_positions)
        self._holds = _row(state.holds)
        pairs = np.asarray(model.spring_particles.numpy(), dtype=np.int64).reshape(-1, 2)
        kinds = np.asarray(model.spring_kind.numpy(), dtype=np.int64)
        rest = np.asarray(model.spring_rest_length.numpy(), dtype=np.float64)
        lengths = np.linalg.norm(self._points[pairs[:, 1]] - self._points[pairs[:, 0]], axis=1)
        self._pairs, self._kinds = pairs, kinds
        self._stretches = lengths / np.maximum(rest, 1.0e-30)
        from balloon_warp.schedules.readout import ForceReader  # its kernels load when first needed

        forces = ForceReader(model)
        forces.refresh(state)
        time = float(state.frame.numpy()[0]) * model.frame_seconds + substep * model.step_seconds
        places = {name: array.numpy() for name, array in model.parameters.items() if name in ANCHORED}
        poses = np.concatenate([state.body_positions.numpy(), state.body_turns.numpy()], axis=-1)
        self._anchors = anchors_of(model.scene, model.bodies, places, time / model.frame_seconds, poses)[0]
        self._tensions = _row(forces.spring_pulls(state, time)) if model.spring_count else np.zeros(0)
        self._strings = _row(forces.string_pulls(state, time)) if model.string_count else np.zeros(0)
        inflation = np.linalg.norm(_row(forces.inflation_forces(state, substep)), axis=1)
        by_law = {name: _row(pulls) for name, pulls in forces.pulls_by_law(state, time).items()}
        self._pushes = {"inflation": inflation, **by_law, **self._outer_forces()}

    @property
    def strengths(self) -> NDArray[np.float64]:
        """The hardest pull of a spring, the inflation or another law on each particle [N], shape (particle_count,)."""
        strengths = np.max(list(self._pushes.values()), axis=0)
        for end in (0, 1):
            np.maximum.at(strengths, self._pairs[:, end], np.abs(self._tensions))
        return strengths

    def _outer_forces(self) -> dict[str, NDArray[np.float64]]:
        """Return the magnitude of the outer forces on each particle [N], shape (particle_count,), if any."""
        newtons, driven = _row(self.model.parameters["force_newtons"]), self.model.driven
        if not newtons.any():
            return {}
        pushes = np.zeros((self.model.particle_count, 3))
        np.add.at(pushes, driven.particles, driven.shares[:, None] * newtons[driven.forces])
        return {"outer forces": np.linalg.norm(pushes, axis=1)}

    def spring_at(self, particle: int) -> Pull | None:
        """Return the spring of a particle with the largest tension or compression; None if it has none."""
        springs = np.flatnonzero((self._pairs == particle).any(axis=1))
        if not len(springs):
            return None
        spring = springs[np.abs(self._tensions[springs]).argmax()]
        other = int(self._pairs[spring].sum()) - particle
        return Pull(
            f"the {KINDS[self._kinds[spring]].name} spring to particle {self._of_balloon(other)}",
            float(abs(self._tensions[spring])),
            float(self._stretches[spring]),
        )

    def others_at(self, particle: int) -> list[Pull]:
        """Find the inflation, other laws, and taut strings."""
        parameters = self.model.parameters
        pulls = [Pull(name.replace("_", " "), float(newtons[particle])) for name, newtons in self._pushes.items()]
        for number in np.flatnonzero(self.model.string_particle.numpy() == particle).tolist():
            distance = float(np.linalg.norm(self._anchors[number] - self._points[particle]))
            if self._strings[number] > 0.0:
                stretch = distance / float(_row(parameters["string_length"])[number])
                pulls.append(Pull(f"string {number}", float(self._strings[number]), stretch))
        return pulls

    def touched_by(self, particle: int) -> list[str]:
        """Name the spheres that it lies on, balloons, and the ground."""
        model, point = self.model, self._points[particle]
        distances = np.linalg.norm(self._spheres - point, axis=1)
        spheres = np.flatnonzero(distances < TOUCH * _row(model.parameters["sphere_radius"])).tolist()
        on_ground = point @ np.array(model.scene.up) <= model.parameters["ground_height"].numpy()[0]
        on_balloon = len(self._holds) > 0 and self._holds[particle, 3] != 0.0
        named = [f"sphere {sphere}" for sphere in spheres] + ["a balloon"] * bool(on_balloon)
        return named + ["the ground"] * bool(on_ground)

    def contact_at(self, sphere: int, newtons: float) -> Pull | None:
        """Find the particle that pushes hardest of those that lie on a sphere; None if it is free.

        Where they exchange momentum, it is all of them.

        Args:
            newtons: with which all of them push it.
        """
        distances = np.linalg.norm(self._points - self._spheres[sphere], axis=1)
        touching = np.flatnonzero(distances < TOUCH * _row(self.model.parameters["sphere_radius"])[sphere])
        if not len(touching):
            return None
        if self.model.scene.contact == "impulse":
            return Pull(f"{len(touching):,} particles in contact with it", newtons)
        particle = int(touching[self._pushes["inflation"][touching].argmax()])
        return Pull(f"particle {self._of_balloon(particle)} in contact with it", newtons)

    def _of_balloon(self, particle: int) -> str:
        return name_of_particle(self.model, particle)


def name_of_particle(model: Model, particle: int) -> str:
    """Return a particle's number by the order of the file's vertices, and its balloon if there are several."""
    balloon = int(model.particle_balloon.numpy()[particle])
    number = str(particle - model.particle_offsets[balloon])
    return number if model.balloon_count == 1 else f"{number} of {model.shapes[balloon].name}"


def _row(array: wp.array) -> NDArray[np.float64]:
    """Return the row of the one world."""
    return np.array(array.numpy()[0], dtype=np.float64)
