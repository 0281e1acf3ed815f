"""Why a world blew up: where, when, by which spring or contact, and what would have helped."""

from dataclasses import asdict, dataclass
from math import ceil, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.health import HEALTHY
from balloon_warp.model import Model, State
from balloon_warp.model.parameters import scene_parameters
from balloon_warp.model.stability import AUTO_MARGIN, MOST_SUBSTEPS, stable_step
from balloon_warp.pulls import Pull, Pulls, name_of_particle
from balloon_warp.replay import LastSubstep, last_substep
from balloon_warp.schedules.choose import Schedule
from balloon_warp.solvers.choose import PROJECTIVE


@dataclass(frozen=True)
class BlowUp:
    """A world's end; as text, a sentence. What is None is not known, or has no part in it."""

    world: int
    frame: int
    substeps: int
    """in a frame"""
    step: float
    """[s]"""
    body: str | None
    """what went bad, such as "particle 7": by the order of the vertices in its balloon's file"""
    substep: int | None = None
    """of the frame, from 1"""
    moved: float | None = None
    """in that substep [m]; infinite if it is no longer at a finite place"""
    spring: Pull | None = None
    """of the particle's springs the one that pulled hardest just before"""
    other: Pull | None = None
    """what pushed or pulled harder than that"""
    touched: tuple[str, ...] = ()
    """what the particle lay on"""
    stable_step: float | None = None
    """for springs, damping and speeds as they were just before [s]; None for an implicit solver, or a sphere"""
    is_sphere: bool = False
    """and no particle"""

    def __str__(self) -> str:
        when = f"frame {self.frame}, world {self.world}"
        if self.substep is not None:
            when += f", substep {self.substep} of {self.substeps}"
        clauses = [f"the simulation blew up in {when}: {self.body or 'something'} {self._fate}"]
        clauses += [str(pull) for pull in (self.other, self.spring) if pull]
        clauses += [f"it lay on {' and '.join(self.touched)}"] if self.touched else []
        return "; ".join([*clauses, self._advice])

    @property
    def _fate(self) -> str:
        if self.moved is not None and isfinite(self.moved):
            return f"flew off, {self.moved:.2g} m in one step"
        return "is no longer at a finite place"

    @property
    def _advice(self) -> str:
        """The step beside the stable one, and what helps."""
        if self.is_sphere:
            return 'a heavier sphere, contact = "impulse", less inflation or more substeps help'
        if self.stable_step is None:
            return "more substeps, more damping or softer springs help"
        if self.stable_step == 0.0:
            return "with forward Euler and no damping no step is stable; symplectic Euler's are"
        if self.step > self.stable_step:
            enough = ceil(self.step * self.substeps / (AUTO_MARGIN * self.stable_step))
            helps = f"{enough:,} substeps a frame" if enough <= MOST_SUBSTEPS else "less force"
            return (
                f"the step of {self.step:.2e} s is longer than the {self.stable_step:.2e} s that were stable then: "
                f"{helps}, more damping or softer springs help"
            )
        return (
            f"the step of {self.step:.2e} s is stable for its springs, up to {self.stable_step:.2e} s: "
            "less force helps, or more substeps"
        )

    def as_json(self) -> dict[str, Any]:
        """All of it, and the sentence."""
        moved = self.moved if self.moved is not None and isfinite(self.moved) else None
        return {**asdict(self), "moved": moved, "sentence": str(self)}


def diagnose(model: Model, state: State, schedule: Schedule, world: int, frame: int, bad: int = HEALTHY) -> BlowUp:
    """Look again at the frame in which a world blew up.

    Args:
        model: of this world alone.
        state: at the frame's start; it is simulated from there.
        schedule: that it was simulated with.
        world: its number, which the report names.
        frame: after which it was found bad.
        bad: its particle, or sphere, numbered after the particles, that was found bad; or `HEALTHY`.
    """
    last = last_substep(model, state, schedule, frame)
    if last is None:
        return BlowUp(world, frame, model.substeps, model.step_seconds, _body(model, bad))
    model = last.model
    pulls = Pulls(model, last.before, (last.substep - 1) * model.step_seconds)
    when = (world, frame, model.substeps, model.step_seconds)
    substep = last.substep if last.frame == frame else None  # the reference's rounding made it last longer
    if last.first_bad != HEALTHY and last.first_bad >= model.particle_count:
        sphere = last.first_bad - model.particle_count
        moved = float(_distances(last, "sphere_positions")[sphere])
        push = pulls.contact_at(sphere, _push_on(last, sphere))
        return BlowUp(*when, _body(model, last.first_bad), substep, moved, other=push, is_sphere=True)
    moved = _distances(last, "points")
    farthest = np.flatnonzero(moved == moved.max())
    particle = int(farthest[pulls.strengths[farthest].argmax()])
    spring = pulls.spring_at(particle)
    other = max(pulls.others_at(particle), key=lambda pull: pull.newtons)
    return BlowUp(
        *when,
        body=_body(model, particle),
        substep=substep,
        moved=float(moved[particle]),
        spring=spring,
        other=other if spring is None or other.newtons > spring.newtons else None,
        touched=tuple(pulls.touched_by(particle)),
        stable_step=_stable_step(last),
    )


def _body(model: Model, bad: int) -> str | None:
    if bad == HEALTHY:
        return None
    if bad >= model.particle_count:
        return f"sphere {bad - model.particle_count}"
    return f"particle {name_of_particle(model, bad)}"


def _distances(last: LastSubstep, name: str) -> NDArray[np.float64]:
    """How far each particle or sphere moved in the substep [m]; infinite where its place or speed is no number."""
    before, after = (np.array(getattr(state, name).numpy()[0], dtype=np.float64) for state in (last.before, last.after))
    velocities = getattr(last.after, name.replace("points", "velocities").replace("positions", "velocities")).numpy()[0]
    moved = np.linalg.norm(after - before, axis=1)
    return np.where(np.isfinite(moved) & np.isfinite(velocities).all(axis=1), moved, np.inf)


def _push_on(last: LastSubstep, sphere: int) -> float:
    """The force that a sphere's speed in the substep shows [N]."""
    before, after = (
        state.sphere_velocities.numpy()[0, sphere].astype(np.float64) for state in (last.before, last.after)
    )
    mass = float(last.model.sphere_mass.numpy()[0, sphere])
    return float(np.linalg.norm(after - before)) * mass / last.model.step_seconds


def _stable_step(last: LastSubstep) -> float | None:
    """With the parameters and the speed through the air of that substep [s]."""
    model = last.model
    if model.scene.solver == PROJECTIVE:
        return None
    names = scene_parameters(model.scene).keys() - {"initial_balloon_positions"}
    parameters = {name: np.array(getattr(model, name).numpy(), dtype=np.float64) for name in names}
    balloons = [string.balloon for string in model.scene.string]
    held = [
        particle - model.particle_offsets[balloon]
        for particle, balloon in zip(model.string_particle.numpy().tolist(), balloons, strict=True)
    ]
    through_air = last.before.velocities.numpy()[0].astype(np.float64) - parameters["wind"][0]
    air_speed = float(np.linalg.norm(through_air, axis=1).max())
    return stable_step(model.scene, model.shapes, held, parameters, air_speed)
