"""Blow-ups: detection of non-finite or runaway states, diagnosis, and recovery.

1. It is found on the device: after each frame a kernel looks at every particle and sphere, and notes the first one in
   each world that is where it cannot be (`check_particle`).
2. From that frame nothing is left to learn. So `Simulator` keeps `Origins`: a state of a while ago, and all that it
   takes to begin again from there.
3. `replay` simulates that one world again, its last frames substep by substep, until it goes bad.
4. `diagnose` looks at that substep: the farthest mover, the forces on it (`pulls`), and the largest stable step.
   It makes a `BlowUp`, whose text is a sentence.
5. `Simulator` raises a `BlowUpError` with it. A `policy` decides the fate of the run: it stops, ends at its last good
   frame, or begins again with half the step. A run does so in `run/job.py`, a batch in `batch/task.py`; the page
   offers its last good state.
"""

from dataclasses import asdict, dataclass, replace
from math import ceil, isfinite
from typing import Any, Protocol, Self, TypeVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.mesh.load import size_of
from balloon_warp.model import Model, State, copy_of, overwrite
from balloon_warp.model.pressure import borne_pressures, passed_limit_point
from balloon_warp.model.stability import AUTO_MARGIN, MOST_SUBSTEPS, Network
from balloon_warp.model.starts import ANCHORED, anchors_of
from balloon_warp.scene import Scene
from balloon_warp.schedules.choose import Schedule
from balloon_warp.schedules.frames import HealthCheck
from balloon_warp.solvers import PROJECTIVE

POLICIES = ("freeze", "stop", "restart")
"""Policies: keep the last good frame; end everything; restart with half the step"""
MOST_HALVINGS = 4
"""Largest number of halvings of a step before giving up: 16 times the substeps"""


def check_policy(on_blowup: str) -> None:
    """Check the name of a policy.

    Raises:
        InputError: there is not.
    """
    if on_blowup not in POLICIES:
        raise InputError(f"on_blowup {on_blowup}: expected {', '.join(POLICIES)}")


def with_half_the_step(scene: Scene, substeps: int) -> Scene:
    """Return the scene with twice its substeps, now and wherever it changes them.

    Args:
        substeps: that it has at the start, in a frame.
    """
    changes = []
    for change in scene.change:
        later = change.set.get("substeps")
        doubled = {**change.set, "substeps": 2 * later} if isinstance(later, int) else change.set
        changes.append(change.model_copy(update={"set": doubled}))
    return scene.model_copy(update={"substeps": 2 * substeps, "change": changes})


class Advancing(Protocol):
    """Simulator of a model that is advanced again."""

    frame_number: int
    state: State

    def advance(self) -> None: ...

    def make_due_changes(self) -> None: ...


Again = TypeVar("Again", bound=Advancing)


@dataclass(frozen=True)
class Origin:
    """Model, and its state at the start of a frame, from which the same simulation follows, bit for bit."""

    model: Model
    """Model with the planned changes that are still to come"""
    schedule: str
    frame: int = 0
    state: State | None = None
    """State of the worlds; the scene's start, when missing"""

    def __post_init__(self) -> None:
        if self.model.ages is not None:  # which frames count
            object.__setattr__(self, "model", replace(self.model, ages=wp.clone(self.model.ages)))

    def fill(self, state: State) -> None:
        """Copy the origin into a state, unless it is the scene's start."""
        if self.state is not None:
            overwrite(state, self.state)

    def of_world(self, world: int) -> Self:
        """Return one world of the origin by itself."""
        if self.model.world_count == 1:
            return replace(self)
        state = self.state.of_world(world) if self.state else None
        return replace(self, model=self.model.of_world(world), state=state)

    def advance(self, again: Again, frame: int) -> Again:
        """Advance a simulator of this model from here to the beginning of a frame."""
        again.frame_number = self.frame
        self.fill(again.state)
        while again.frame_number < frame - 1:
            again.advance()
        again.make_due_changes()
        return again


KEPT_FRAMES = 512
"""Number of frames between two kept states of a single world, from which a blow-up can be replayed: a copy costs less
than five frames, and so less than a hundredth of all"""


class Origins:
    """The start of a simulation, and of a single world the last state that was kept."""

    def __init__(self, start: Origin):
        self._start = start
        self._kept: Origin | None = None

    @property
    def last(self) -> Origin:
        """The latest to begin again from."""
        return self._kept or self._start

    def is_due(self, model: Model, frame: int) -> bool:
        """Return whether a state is to be kept at the start of a frame."""
        kept = self._kept
        alone = model.world_count == 1 and (kept is None or frame >= kept.frame + KEPT_FRAMES)
        return alone or bool(model.reach)  # values on the device are those of the last frame alone

    def keep(self, here: Origin) -> None:
        """Keep a copy of the state that a simulation is in."""
        kept = self._kept.state if self._kept else None
        if here.state is not None and kept is not None:  # its arrays are there already
            overwrite(kept, here.state)
        else:
            kept = copy_of(here.state) if here.state else None
        self._kept = replace(here, state=kept)

    def forget(self) -> None:
        """Drop the kept states: later frames do not follow from them."""
        self._kept = None


FRAMES = 2
"""Number of frames that are replayed: rounding differs between schedules, and may delay the end a little"""


@dataclass(frozen=True)
class LastSubstep:
    """Last substep of a world, which is alone in its model: the one in which it went bad."""

    model: Model
    frame: int
    substep: int
    """Number of the substep in the frame, from 1"""
    before: State
    """State before the substep, all of it finite"""
    after: State
    first_bad: int
    """Lowest particle, or sphere, numbered after the particles, at a place that it cannot have; or `HEALTHY` if all are
    fine, and something else is not finite"""


def last_substep(model: Model, state: State, schedule: Schedule, frame: int) -> LastSubstep | None:
    """Simulate a world from the start of the frame in which it blew up, in place.

    The readable reference does it, which can be watched. None if it does not blow up there: its state was written to
    meanwhile.
    """
    from balloon_warp.schedules.gather import ScatterSchedule
    from balloon_warp.schedules.launched import LaunchedSchedule  # the kernels of these load when first needed

    # The implicit solver can be watched itself, and takes steps at which the reference would not be stable.
    watched = schedule if isinstance(schedule, LaunchedSchedule) and schedule.watchable else ScatterSchedule(model)
    check, before = HealthCheck(model), copy_of(state)
    for number in range(frame, frame + FRAMES):
        for substep in watched.substeps(state):
            check.look(state)
            bad = int(state.first_bad.numpy()[0])
            if bad != HEALTHY or not _is_finite(state):
                return LastSubstep(model, number, substep + 1, before, state, bad)
            overwrite(before, state)
    return None


def _is_finite(state: State) -> bool:
    return all(np.isfinite(array.numpy()).all() for array in state.arrays.values())


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
        from balloon_warp.frame import ForceReader  # its kernels load when first needed

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


@dataclass(frozen=True)
class BlowUp:
    """Blow-up of a world; as text, a sentence. Fields that are None are not known, or have no part in it."""

    world: int
    frame: int
    substeps: int
    """Number of substeps in a frame"""
    step: float
    """Step [s]"""
    body: str | None
    """First particle or sphere that went bad, such as "particle 7": by the order of the vertices in its balloon's
    file"""
    substep: int | None = None
    """Number of the substep in the frame, from 1"""
    moved: float | None = None
    """Displacement in that substep [m]; infinite if its place is no longer finite"""
    spring: Pull | None = None
    """Spring of the particle with the largest tension or compression just before"""
    other: Pull | None = None
    """Larger force of another source"""
    touched: tuple[str, ...] = ()
    """Things that the particle touched"""
    stable_step: float | None = None
    """Stable step for springs, damping and speeds just before [s]; None for an implicit solver, or a sphere"""
    is_sphere: bool = False
    """Whether it is a sphere, not a particle"""
    limit_point: str | None = None
    """Limit point that the balloon has passed, under a given pressure: no step helps there"""
    pressure: float | None = None
    """Given pressure [Pa], where it alone would throw its balloon away within a frame: no step helps there, either"""
    k_normal: float | None = None
    """Given k_normal, where it alone would throw its balloon away within a frame"""

    def __str__(self) -> str:
        when = f"frame {self.frame}, world {self.world}"
        if self.substep is not None:
            when += f", substep {self.substep} of {self.substeps}"
        clauses = [f"the simulation blew up in {when}: {self.body or 'something'} {self._fate}"]
        clauses += [str(pull) for pull in (self.other, self.spring) if pull]
        clauses += [f"it touched {' and '.join(self.touched)}"] if self.touched else []
        return "; ".join([*clauses, self._advice])

    @property
    def _fate(self) -> str:
        if self.moved is not None and isfinite(self.moved):
            return f"flew off, {self.moved:.2g} m in one step"
        return "has a position that is not finite"

    @property
    def _advice(self) -> str:
        """The step beside the stable one, and the remedy."""
        if self.pressure:
            return f"its pressure of {self.pressure:.3g} Pa alone blows it up within a frame: less pressure helps"
        if self.k_normal:
            return (
                f"its k_normal of {self.k_normal:.3g}, {100.0 * self.k_normal:.3g} N in all, alone blows it up within "
                "a frame: less force helps"
            )
        if self.limit_point:
            return self.limit_point
        if self.is_sphere:
            return 'a heavier sphere, contact = "impulse", less inflation or more substeps help'
        if self.stable_step is None:
            return "more substeps, more damping or softer springs help"
        if self.stable_step == 0.0:
            return "forward Euler without damping is unstable at any step; symplectic Euler helps"
        if self.step > self.stable_step:
            enough = ceil(self.step * self.substeps / (AUTO_MARGIN * self.stable_step))
            helps = f"{enough:,} substeps a frame" if enough <= MOST_SUBSTEPS else "less force"
            return (
                f"the step of {self.step:.2e} s exceeds the largest stable step, then {self.stable_step:.2e} s: "
                f"{helps}, more damping or softer springs help"
            )
        return (
            f"the step of {self.step:.2e} s is stable for its springs (up to {self.stable_step:.2e} s): less force or "
            "more substeps help"
        )

    def as_json(self) -> dict[str, Any]:
        """Return the report as JSON, with its sentence."""
        moved = self.moved if self.moved is not None and isfinite(self.moved) else None
        return {**asdict(self), "moved": moved, "sentence": str(self)}


BEYOND = 10.0
"""Factor on the largest load of a skin above which no springs hold it; and on the balloon's size, above which a
displacement within a frame, from rest, is more than intended"""


def diagnose(model: Model, state: State, schedule: Schedule, world: int, frame: int, bad: int = HEALTHY) -> BlowUp:
    """Replay the frame in which a world blew up, and diagnose it.

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
