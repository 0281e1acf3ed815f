"""Diagnosis of a blow-up: where, when, by which spring or contact, and the remedy."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.blow_ups.pulls import Pulls, name_of_particle
from balloon_warp.blow_ups.replay import LastSubstep, last_substep
from balloon_warp.blow_ups.report import BlowUp
from balloon_warp.kernels.measure.health import HEALTHY
from balloon_warp.mesh.seams import size_of
from balloon_warp.model import Model, State
from balloon_warp.model.limit_points import borne_pressures, passed_limit_point
from balloon_warp.model.stability import Network
from balloon_warp.schedules.choose import Schedule
from balloon_warp.solvers.choose import PROJECTIVE

BEYOND = 10.0
"""Factor on the largest load of a skin above which no springs hold it; and on the balloon's size, above which a
displacement within a frame, from rest, is more than intended"""


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
    pulls = Pulls(model, last.before, last.substep - 1)
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
    pressure, k_normal = _excess(last, particle)
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
        limit_point=_limit_point(last, particle),
        pressure=pressure,
        k_normal=k_normal,
    )


def _body(model: Model, bad: int) -> str | None:
    if bad == HEALTHY:
        return None
    if bad >= model.particle_count:
        return f"sphere {bad - model.particle_count}"
    return f"particle {name_of_particle(model, bad)}"


def _distances(last: LastSubstep, name: str) -> NDArray[np.float64]:
    """Return the displacement of each particle or sphere in the substep [m]; infinite where it is not finite."""
    before, after = (np.array(getattr(state, name).numpy()[0], dtype=np.float64) for state in (last.before, last.after))
    velocities = getattr(last.after, name.replace("points", "velocities").replace("positions", "velocities")).numpy()[0]
    moved = np.linalg.norm(after - before, axis=1)
    return np.where(np.isfinite(moved) & np.isfinite(velocities).all(axis=1), moved, np.inf)


def _push_on(last: LastSubstep, sphere: int) -> float:
    """Find the force that a sphere's speed in the substep shows [N]."""
    before, after = (
        state.sphere_velocities.numpy()[0, sphere].astype(np.float64) for state in (last.before, last.after)
    )
    mass = float(last.model.parameters["sphere_mass"].numpy()[0, sphere])
    return float(np.linalg.norm(after - before)) * mass / last.model.step_seconds


def _limit_point(last: LastSubstep, particle: int) -> str | None:
    """Describe the limit point that the balloon of a particle was past in that substep, if it was."""
    model, number = last.model, int(last.model.particle_balloon.numpy()[particle])
    parameters = {name: np.array(array.numpy(), dtype=np.float64) for name, array in model.parameters.items()}
    begin, end = model.particle_offsets[number : number + 2]
    points = last.before.points.numpy()[0, begin:end].astype(np.float64)
    given = float(last.before.pressures.numpy()[0, number])
    limit = passed_limit_point(model.scene, number, model.shapes[number], parameters, given, points)
    return str(limit) if limit else None


def _excess(last: LastSubstep, particle: int) -> tuple[float | None, float | None]:
    """Return the pressure or k_normal given to the balloon of a particle, where its skin bears far less."""
    model, number = last.model, int(last.model.particle_balloon.numpy()[particle])
    shape, kind = model.shapes[number], model.scene.balloon[number].inflation.kind
    if kind == "pressure":
        given = float(last.before.pressures.numpy()[0, number])
        push = given * shape.area
    elif kind == "normal_force":
        begin, slope = last.before.inflation_ramp.numpy()[0, number].tolist()
        given = begin + slope * (last.substep - 1) * model.step_seconds
        push = 100.0 * given  # on all particles together, as the paper has it
    else:
        return None, None
    parameters = {name: np.array(array.numpy(), dtype=np.float64) for name, array in model.parameters.items()}
    most = borne_pressures(model.scene, number, shape, parameters)[1].max() * shape.area
    thrown = 0.5 * abs(push) / parameters["mass"][0, number] * model.frame_seconds**2
    if abs(push) > BEYOND * most and thrown > BEYOND * size_of(shape.mesh):
        return (given, None) if kind == "pressure" else (None, given)
    return None, None


def _stable_step(last: LastSubstep) -> float | None:
    """Return the stable step with the parameters and the velocities of that substep [s]."""
    model = last.model
    if model.scene.solver == PROJECTIVE:
        return None
    parameters = {name: np.array(array.numpy(), dtype=np.float64) for name, array in model.parameters.items()}
    balloons = [string.balloon for string in model.scene.string]
    held = [
        particle - model.particle_offsets[balloon]
        for particle, balloon in zip(model.string_particle.numpy().tolist(), balloons, strict=True)
    ]
    velocities = np.split(last.before.velocities.numpy()[0].astype(np.float64), model.particle_offsets[1:-1])
    return Network(model.shapes, held, model.laws, model.bodies).stable_step(model.scene, parameters, velocities)
