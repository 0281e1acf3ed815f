"""Derivatives of a loss by values of a scene: in one call, on one device or many workers, or frame by frame.

Frame by frame the state at the start of each is handed out and taken back as device arrays; a caller that keeps them
can run the frame backwards. So a scene is a function of PyTorch: values in, frames out, derived by autograd, a policy
within the loop or not.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.batch.recorder import Group, plan_groups
from balloon_warp.batch.trajectories import Trajectories
from balloon_warp.blow_ups import BlowUp
from balloon_warp.errors import BlowUpError, InputError, MissingExtraError
from balloon_warp.farm.cluster import Cluster, Work, connect, modules_of, require_laws_that_travel, run_shares
from balloon_warp.farm.workers import UNSENT, pack
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.lab.gradients.chain import (
    KEYFRAMES,
    OBSTACLES,
    Chain,
    by_keyframes,
    by_start,
    bytes_by_launches,
    chains_of,
    columns_of_names,
    made_backward,
    names_in,
    product,
    schedule_for,
    taken_numbers,
    value_in_worlds,
    wanted_of,
)
from balloon_warp.lab.gradients.derive import (
    DerivativeRequest,
    Gradient,
    derive,
    require_differentiable,
    require_paths,
    require_room_for_bounces,
    require_room_for_frames,
)
from balloon_warp.lab.gradients.losses import Loss
from balloon_warp.model import ModelPlan, Vary, initial_state, lay_out, worlds_of
from balloon_warp.model.parameters import scene_to_vary
from balloon_warp.model.plan import resolved_parameters
from balloon_warp.model.state import require_memory
from balloon_warp.scene import SceneLike
from balloon_warp.scene.load import Override
from balloon_warp.schedules.backward_contact import STATE_OF_SPHERES, STATE_OF_TOUCH
from balloon_warp.schedules.backward_launched import backwards_of, bytes_backwards, forward_of
from balloon_warp.simulator import Simulator
from balloon_warp.system.api import Shown, checked
from balloon_warp.system.warp_threads import lock_of, pick_device

Values = NDArray[np.float64]


def sampled(plan: ModelPlan, asked: DerivativeRequest, smooth: Mapping[str, float], samples: int) -> DerivativeRequest:
    """Return the request for `samples` worlds in place of each, whose values scatter around its own.

    Values are normally distributed: quantiles of equal weight, in another order by each path (Latin hypercube).

    Args:
        smooth: standard deviations by paths.

    Raises:
        InputError: a deviation is not positive, there are too few samples, or a path is not that of a number.
    """
    if samples < 2:
        raise InputError(f"samples: expected at least 2 (got {samples})")
    vary = {path: np.repeat(np.asarray(values, dtype=np.float64), samples) for path, values in asked.vary.items()}
    for path, (deviation, column) in zip(smooth, _columns(smooth, samples), strict=True):
        if not (np.isfinite(deviation) and deviation > 0.0):
            raise InputError(f"smooth: {path}: expected a standard deviation above 0 (got {deviation:g})")
        values = value_in_worlds(plan, path, asked.vary)
        vary[path] = np.repeat(values, samples) + deviation * np.tile(column, asked.world_count)
    return asked._replace(world_count=asked.world_count * samples, vary=vary)


def averaged(found: Gradient, smooth: Mapping[str, float], samples: int) -> Gradient:
    """Return the means over the samples of each world, and the slopes of the loss over them.

    The trajectories stay those of all samples.
    """
    losses = found.loss.reshape(-1, samples)
    slopes = {}
    for path, (deviation, column) in zip(smooth, _columns(smooth, samples), strict=True):
        slopes[path] = losses @ column / (deviation * (column @ column))
    gradients = {path: values.reshape(-1, samples) for path, values in found.gradients.items()}

    def means(arrays: list[Values]) -> list[Values]:
        each = [array.reshape(-1, samples, *array.shape[1:]).mean(axis=1) for array in arrays]
        return [array[0] for array in each] if len(losses) == 1 else each

    return replace(
        found,
        loss=losses.mean(axis=1),
        gradients={path: values.mean(axis=1) for path, values in gradients.items()},
        by_points=means(found.by_points),
        by_velocities=means(found.by_velocities),
        by_each={name: means(arrays) for name, arrays in found.by_each.items()},
        errors={path: values.std(axis=1, ddof=1) / samples**0.5 for path, values in gradients.items()},
        slopes=slopes,
    )


def _columns(smooth: Mapping[str, float], samples: int) -> list[tuple[float, Values]]:
    """Return each path's deviation, and the offsets of its samples in that unit, shape (samples,)."""
    from scipy.special import ndtri

    quantiles, order = np.array(ndtri((np.arange(samples) + 0.5) / samples)), np.random.default_rng(0)
    return [(deviation, quantiles[order.permutation(samples)]) for deviation in smooth.values()]


TRACKS = ("pressures", "gas_amounts", "sphere_positions", "sphere_velocities")
"""Arrays of trajectories with a row for each world; so have `points` and `velocities`, by balloon"""


def derive_on_workers(
    group: Group, asked: DerivativeRequest, cluster: Cluster, on_frame: Callable[[int], None]
) -> tuple[Gradient, bool]:
    """Return a gradient, as `derive` does: each worker derives the loss of an equal part of the worlds.

    Raises:
        InputError: as `derive`; or a law or the loss cannot be sent to a worker.
        BlowUpError, MissingExtraError, WorkersLostError: as `gradient`.
    """
    require_laws_that_travel(asked.laws, cluster)
    _require_that_it_travels(asked, cluster)
    with connect(cluster, __name__) as workers:
        devices = workers.devices(asked.device, [__name__, *modules_of(asked.laws)])
        parts = [rows for rows in np.array_split(np.arange(asked.world_count), len(devices)) if len(rows)]
        work = Work(
            _derive_and_count,
            {number: (group.part(rows), _of_worlds(asked, rows)) for number, rows in enumerate(parts)},
            [len(rows) / asked.world_count for rows in parts],
            2 * group.plan.scene.frames + 1,
        )
        results = dict(filter(None, run_shares(workers, work, len(devices), on_frame)))
    found: list[tuple[Gradient, bool]] = [results[number] for number in sorted(results)]
    gradients = [each for each, _ in found]
    return (_joined(gradients) if len(gradients) > 1 else gradients[0]), any(depends for _, depends in found)


def _require_that_it_travels(asked: DerivativeRequest, cluster: Cluster) -> None:
    try:
        pack(asked.loss)
    except UNSENT as error:
        raise InputError(f"loss: cannot be sent to other processes ({cluster.option}): {error}") from None


def _of_worlds(asked: DerivativeRequest, rows: NDArray[np.integer]) -> DerivativeRequest:
    """Return the arguments for some of the worlds."""
    vary = {path: np.asarray(values)[rows] for path, values in asked.vary.items()}
    return asked._replace(world_count=len(rows), vary=vary)


def _derive_and_count(group: Group, asked: DerivativeRequest, on_frame: Callable[[int], None]) -> tuple[Gradient, bool]:
    """Derive a part on a worker; `on_frame` takes the number of frames that are done, both ways."""
    done = 0

    def count(_: int) -> None:
        nonlocal done
        done += 1
        on_frame(done)

    try:
        return derive(group, asked, count)
    except BlowUpError as failure:
        if isinstance(report := failure.report, BlowUp):  # which numbers the worlds of this part
            raise BlowUpError(replace(report, world=int(group.worlds[report.world]))) from None
        raise


def _joined(parts: Sequence[Gradient]) -> Gradient:
    """Return the gradient of all worlds, from those of parts in their order."""
    counts = [len(part.loss) for part in parts]

    def rows(arrays: Sequence[NDArray]) -> NDArray:
        """Join arrays, of which that of a single world has no dimension for worlds."""
        return np.concatenate([each[None] if one == 1 else each for one, each in zip(counts, arrays, strict=True)])

    def by_balloon(lists: Sequence[list[NDArray]]) -> list[NDArray]:
        return [rows(arrays) for arrays in zip(*lists, strict=True)]

    moved = [part.trajectories for part in parts]
    trajectories: Trajectories = replace(
        moved[0],
        points=by_balloon([each.points for each in moved]),
        velocities=by_balloon([each.velocities for each in moved]),
        worlds=np.concatenate([each.worlds for each in moved]),
        **{name: rows([getattr(each, name) for each in moved]) for name in TRACKS},
    )
    return Gradient(
        loss=np.concatenate([part.loss for part in parts]),
        gradients={path: np.concatenate([part.gradients[path] for part in parts]) for path in parts[0].gradients},
        trajectories=trajectories,
        by_points=by_balloon([part.by_points for part in parts]),
        by_velocities=by_balloon([part.by_velocities for part in parts]),
        by_each={name: by_balloon([part.by_each[name] for part in parts]) for name in parts[0].by_each},
        spring_pairs=parts[0].spring_pairs,
    )


@checked
def gradient(
    scene: SceneLike,
    overrides: Mapping[str, Any] | Iterable[Override] = (),
    *,
    of: Sequence[str] = (),
    each: Sequence[str] = (),
    loss: Loss,
    world_count: int | None = None,
    vary: Vary | None = None,
    every: int = 1,
    checkpoints: int | None = None,
    device: str | None = None,
    schedule: str = "auto",
    cluster: Cluster | None = None,
    laws: Sequence[Law] = (),
    smooth: Mapping[str, float] | None = None,
    samples: int = 32,
    on_frame: Callable[[int], None] = lambda number: None,
) -> Gradient:
    """Simulate a scene, and differentiate a loss with respect to values of the scene.

    The frames are those of `simulate`, to the bit, in schedule "octets" on a CPU and "block" on a GPU; or "gather",
    where frames run backwards as launches. Then they run backwards, from the last. On a CPU several worlds move side by
    side, each as it does alone.

    Args:
        scene: Scene, name of a bundled one, scene file, or mesh, as a file or in memory.
        overrides: Dotted paths and values, as in `load_scene`.
        of: Dotted paths of the values to differentiate by: "balloon.stiffness.structural", "balloon.inflation.amount".
        each: Values of each spring, face or vertex, to derive by: "rest_lengths" [m] and "spring_constants" [N/m], of
            springs; "thicknesses" [m], of the faces of rubber or film; "rest_points" [m], of the vertices of the
            stress-free shape. Masses, and all else that follows from these, stay as they are. Found by launches.
        loss: Function of the `Trajectories`. It returns a number for each world, and its derivatives by the arrays
            that it used: {"points": [...]}, one for each balloon, as `velocities`; or {"volumes": ...}, as `pressures`.
            Or a kernel of Warp, which derives it; `losses.of_torch` and `losses.of_jax` take functions of these.
        world_count: Number of worlds, copies of the scene side by side; as many as `vary` has values, if not given.
        vary: Values that differ between worlds: dotted paths, and a value for each world.
        every: Interval of the frames that the loss sees, as for `simulate`: 2 for every second one, `scene.frames` for
            the first and the last. The trajectories of others are not kept.
        checkpoints: Number of frames from which others are simulated again on the way back. All are kept that there is
            room for, if not given.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Schedule of frames that run backwards: "lanes", on a CPU eight worlds side by side, or eight
            particles of one; "block", a block of threads a world; "launched", a launch for each piece of a substep; or
            "auto", the fastest one that can.
        cluster: Workers that take some of the worlds each, as for `run_batch`: `Cluster(gpus=8)`. Each evaluates the
            loss of its own, whose numbers are `worlds` of the trajectories. The result is the same to the bit.
        laws: User-defined laws beside the built-in ones, which Warp differentiates; on a cluster, global names that
            workers can import.
        smooth: Standard deviations by dotted paths: each world becomes `samples` worlds, in a row, whose values there
            are normally distributed around its own, and losses and derivatives are their means. For motion that is
            chaotic. `errors` and `slopes` of the result say what the means are worth.
        samples: Number of worlds for each, with `smooth`.
        on_frame: Called with the number of each frame when it is simulated, and again when it has run backwards; on a
            cluster now and then, with the number of frames that are done both ways, on average.

    Raises:
        InputError: The scene cannot be simulated or differentiated, or a path not; or the loss is no number a world.
        BlowUpError: a world blew up.
        MissingExtraError: a scheduler is given and dask.distributed is not installed.
        WorkersLostError: the cluster's workers or its scheduler end.
    """
    device = cluster.device(device) if cluster else device
    asked = DerivativeRequest(
        of, loss, worlds_of(world_count, vary), vary or {}, device, schedule, laws, each, every, checkpoints
    )
    if smooth:
        plan = _group_of(scene, overrides, asked).plan
        asked = sampled(plan, asked, smooth, samples)
    found, depends = derived(scene, overrides, asked, on_frame, cluster)
    if depends:
        _require_effect(found)
    return averaged(found, smooth, samples) if smooth else found


def derived(
    scene: SceneLike,
    overrides: Mapping[str, Any] | Iterable[Override],
    asked: DerivativeRequest,
    on_frame: Callable[[int], None] = lambda number: None,
    cluster: Cluster | None = None,
) -> tuple[Gradient, bool]:
    """Return a gradient, even if it is zero, and whether the loss depends on anything that moves.

    Raises:
        InputError: as `gradient`, but for values without an effect.
        BlowUpError: a world blew up.
        MissingExtraError, WorkersLostError: as `gradient`.
    """
    group = _group_of(scene, overrides, asked)
    require_differentiable(group.plan)
    require_room_for_frames(group.plan, asked.every, asked.checkpoints)
    if not cluster:
        return derive(group, asked, on_frame)

    return derive_on_workers(group, asked, cluster, on_frame)


def _group_of(scene: SceneLike, overrides: Mapping[str, Any] | Iterable[Override], asked: DerivativeRequest) -> Group:
    """Return the plan of all worlds.

    Raises:
        InputError: the scene cannot be simulated, or its worlds are of several models.
    """
    groups = plan_groups(scene_to_vary(scene, asked.vary, overrides), asked.world_count, asked.vary, asked.laws)
    if len(groups) > 1:
        raise InputError("vary: gradients need one mesh and its springs; expected values that keep the model")
    return groups[0]


def _require_effect(found: Gradient) -> None:
    """Make sure that each value has an effect on the loss.

    Raises:
        InputError: one has none, in any world.
    """
    of_each = ((name, any(values.any() for values in arrays)) for name, arrays in found.by_each.items())
    for path, has in (*((path, values.any()) for path, values in found.gradients.items()), *of_each):
        if not has:
            raise InputError(
                f"{path}: no path leads from it to the loss: what the loss looks at does not depend on it, or its law "
                "is left out at the value that it has"
            )


AT_START = "initial_"
"""Names of parameters that count at the start alone"""


class Moving(NamedTuple):
    """Hold the start state of a frame: arrays of the device, worlds first."""

    points: Any
    """Places of particles [m], shape (W, P, 3)"""
    velocities: Any
    """[m/s], shape (W, P, 3)"""
    loads: Any
    """Pressure at height 0 [Pa], and its rise with height [Pa/m], shape (W, B, 2)"""
    pressures: Any
    """Gauge pressures [Pa], shape (W, B)"""
    gas: Any
    """Amounts [mol] and free volumes [m^3] of gas, shape (W, B, 2)"""
    sphere_positions: Any
    """Places of spheres [m], shape (W, S, 3)"""
    sphere_velocities: Any
    """[m/s], shape (W, S, 3)"""
    sphere_spins: Any
    """[rad/s], shape (W, S, 3)"""
    sphere_forces: Any
    """Forces of particles on spheres that are still to act [N], shape (W, S, 3)"""
    holds: Any
    """Friction state of particles where balloons touch, see `State.holds`, shape (W, P, 4), or (W, 0, 4)"""
    deep: Any
    """1 of particles that may be deep in another balloon, shape (W, P), or (W, 0); nothing is derived by it"""


IN_STATE = {"points": "points", "velocities": "velocities", "loads": "inflation_loads", "pressures": "pressures"} | {
    name: name for name in (*STATE_OF_SPHERES, "sphere_forces", *STATE_OF_TOUCH)
}
"""Names of a frame's start state, and of its arrays in the state; gas has two there"""


class Steps:
    """Advance a scene frame by frame, and run each frame backwards.

    Args:
        of: dotted paths of the values to derive by.

    Raises:
        InputError: The scene cannot be simulated or differentiated, or a path not.
    """

    def __init__(
        self,
        scene: SceneLike,
        of: Sequence[str],
        world_count: int,
        device: str | None,
        schedule: str,
        laws: Sequence[Law],
    ):
        groups = plan_groups(scene_to_vary(scene, {}, ()), world_count, {}, laws)
        self.plan = groups[0].plan
        require_differentiable(self.plan)
        if self.plan.due_changes:
            raise InputError("rollout: expected a scene without [[change]]; `step` takes other values in each frame")
        self.paths = list(of)
        chains = chains_of(self.plan, of, {})
        model = lay_out(self.plan, pick_device(device))
        require_paths(self.plan, model, chains)
        self.columns = columns_of_names(model.columns, names_in(chains))
        self.model = model.with_rows_of_worlds()
        wanted = wanted_of(self.plan, chains)
        if KEYFRAMES in names_in(chains):
            raise InputError(f"rollout: {wanted[OBSTACLES]}: cannot be set; expected a path as in `vary`")
        schedule = schedule_for(wanted, schedule)
        with lock_of(model.device):
            needed = bytes_backwards(model, self.columns, 1, schedule) + bytes_by_launches(model, wanted)
            require_memory(model.device, [world_count], [needed])
            runs_back = backwards_of(self.model, schedule)
            self._simulator = Simulator.of_model(self.model, forward_of(self.model, runs_back))
            given = self.plan, self.model, self._simulator.state, runs_back, self.columns, wanted
            self._make_backward = partial(made_backward, *given)
            self._backward, self._beside = self._make_backward()
        self._room = dict(self.model.contact_room)
        self._set: Values | None = None
        self._chains: list[Chain] = []

    # ---- values

    def set_values(self, values: Values) -> None:
        """Set the values at all paths from now on, shape (world_count, path_count).

        Raises:
            InputError: they have another shape, or cannot be.
        """
        expected = (self.model.world_count, len(self.paths))
        if values.shape != expected:
            raise InputError(f"rollout: expected values of shape {expected}, worlds and paths (got {values.shape})")
        if not np.isfinite(values).all():
            raise InputError("rollout: values must be finite")
        if self._set is not None and np.array_equal(values, self._set):
            return
        vary = dict(zip(self.paths, values.T, strict=True))
        self._chains = chains_of(self.plan, self.paths, vary)
        changed = names_in(self._chains)
        parameters = resolved_parameters(self.plan, vary)
        self._simulator.set_parameters({name: parameters[name] for name in changed if name in self.model.parameters})
        self._set = values.copy()

    # ---- forward

    def start(self, values: Values) -> Moving:
        """Return where the scene begins, with these values."""
        self.set_values(values)
        with lock_of(self.model.device):
            state = initial_state(self.model)
            for field in fields(state):
                array = getattr(self._simulator.state, field.name)
                if isinstance(array, wp.array) and array.size:
                    wp.copy(array, getattr(state, field.name))
            return self._now()

    def advance(self, begin: Moving, frame: int, values: Values) -> Moving:
        """Simulate a frame, and return where it ends.

        Raises:
            BlowUpError: a world blew up.
        """
        self.set_values(values)
        self._fill(begin, frame)
        self._simulator.frame_number = frame
        self._simulator.advance()
        bad = np.asarray(self._simulator.state.first_bad.numpy())
        if (worlds := np.flatnonzero(bad != HEALTHY)).size:
            raise BlowUpError(self._simulator.diagnose(int(worlds[0]), frame + 1, int(bad[worlds[0]])))
        with lock_of(self.model.device):
            return self._now()

    def _now(self) -> Moving:
        state = self._simulator.state
        gas = np.stack([state.gas_amounts.numpy(), state.free_volumes.numpy()], axis=-1)
        return Moving(
            **{name: wp.clone(getattr(state, array)) for name, array in IN_STATE.items()},
            gas=wp.array(gas, dtype=wp.vec2d, device=self.model.device),
        )

    def _fill(self, begin: Moving, frame: int) -> None:
        state = self._simulator.state
        with lock_of(self.model.device):
            for name, array in IN_STATE.items():
                wp.copy(getattr(state, array), getattr(begin, name))
            gas = begin.gas.numpy()
            state.gas_amounts.assign(np.ascontiguousarray(gas[..., 0]))
            state.free_volumes.assign(np.ascontiguousarray(gas[..., 1]))
            state.frame.assign(np.array([frame], dtype=np.int32))

    # ---- backwards

    def turn_back(self, begin: Moving, frame: int, values: Values, bars: Moving) -> tuple[Moving, Values]:
        """Return the derivatives by where a frame begins, and by the values, from those by where it ends."""
        self.set_values(values)
        self._fill(begin, frame)
        model = self.model
        with lock_of(model.device):
            if model.contact_room != self._room:  # lists of contacts have grown on the way
                self._room = dict(model.contact_room)
                self._backward, self._beside = self._make_backward()
            back = self._backward
            self._put(bars)
            back.turn_back(back.checkpoint(self._simulator.state))
            if back.spheres:
                require_room_for_bounces(back.spheres.crowded_worlds())
            keyed = np.asarray(back.bars.keyed_totals.numpy(), dtype=np.float64)
            self._beside.note(frame)
            numbers = taken_numbers(model, back, self._beside)
            found = back.by_gas()
            if not back.step.features.gas:  # as a frame ends, the given pressure of its last substep is noted
                noted = np.asarray(bars.pressures.numpy(), dtype=np.float64)
                keyed = keyed + np.stack([noted, noted * (model.substeps - 1) * model.step_seconds], axis=-1)
            gas = np.asarray(back.bars.gas_totals.numpy(), dtype=np.float64)
            if not back.step.features.gas_changes:
                gas = gas + np.asarray(bars.gas.numpy(), dtype=np.float64)
            by_begin = self._taken(found, gas)
        numbers["keyframe_values"] = by_keyframes(model, frame, keyed)
        return by_begin, self._by_values(numbers)

    def turn_start_back(self, values: Values, bars: Moving) -> Values:
        """Return the derivatives by the values, from those by where the scene begins."""
        self.set_values(values)
        of = {name: np.asarray(array.numpy(), dtype=np.float64) for name, array in bars._asdict().items()}
        return self._by_values(
            {
                **by_start(self.plan, self.model, of["points"], of["velocities"]),
                **{f"initial_{name}": of[name] for name in STATE_OF_SPHERES},
                "initial_loads": of["loads"], "initial_pressures": of["pressures"],
                "initial_gas_amounts": of["gas"][..., 0], "initial_free_volumes": of["gas"][..., 1],
            }
        )  # fmt: skip

    def _put(self, bars: Moving) -> None:
        """Write the bars of where a frame ends."""
        back = self._backward
        wp.copy(back.bars.points, bars.points)
        wp.copy(back.arrays["all_velocity_bar"], bars.velocities)
        back.bars.pressures.assign(back.step.features.gas * bars.pressures.numpy())
        back.arrays["all_load_bar"].zero_()
        of_loads = bars.loads.numpy()
        if of_loads.any():
            loads = np.zeros((*back.arrays["all_load_bar"].shape, 2), dtype=np.float32)
            loads[:, self.model.particle_offsets[:-1]] = of_loads
            back.arrays["all_load_bar"].assign(loads)
        gas = back.step.features.gas_changes * bars.gas.numpy().astype(np.float32)
        back.bars.gas.assign(gas)
        back.bars.gas_totals.zero_()
        for name, array in back.carried_bars.items():
            wp.copy(array, getattr(bars, name))

    def _taken(self, found: Mapping[str, Values], gas: Values) -> Moving:
        """Return the bars of where a frame begins, as arrays of their own."""
        back, device = self._backward, self.model.device
        state, carried = self._simulator.state, back.carried_bars
        beside = (*STATE_OF_SPHERES, "sphere_forces", *STATE_OF_TOUCH)
        return Moving(
            points=wp.clone(back.bars.points),
            velocities=wp.clone(back.arrays["all_velocity_bar"]),
            loads=wp.array(found["loads"], dtype=wp.vec2, device=device),
            pressures=wp.array(found["pressures"], dtype=wp.float32, device=device),
            gas=wp.array(gas, dtype=wp.vec2d, device=device),
            **{
                name: wp.clone(carried[name]) if name in carried else wp.zeros_like(getattr(state, name))
                for name in beside
            },
        )

    def _by_values(self, bars: Mapping[str, Values]) -> Values:
        totals = np.zeros((self.model.world_count, len(self.paths)))
        for column, chain in enumerate(self._chains):
            for name, slopes in chain.slopes.items():
                if name in bars:
                    totals[:, column] += product(slopes, bars[name])
        return totals


TYPES = (wp.vec3, wp.vec3, wp.vec2, wp.float32, wp.vec2d, *[wp.vec3] * 4, wp.vec4, wp.int8)
"""Contents of the arrays of `Moving`"""


class Begun(NamedTuple):
    """State at the beginning of a frame, as tensors, worlds first."""

    frame: int
    """Number of the frame"""
    points: Any
    """Places of all particles [m], shape (W, P, 3)"""
    velocities: Any
    """[m/s], shape (W, P, 3)"""
    loads: Any
    """Pressure at height 0 [Pa], and its rise with height [Pa/m], shape (W, B, 2)"""
    pressures: Any
    """Gauge pressures [Pa], shape (W, B)"""
    gas: Any
    """Amounts [mol] and free volumes [m^3] of gas, shape (W, B, 2)"""
    sphere_positions: Any
    """Places of spheres [m], shape (W, S, 3)"""
    sphere_velocities: Any
    """[m/s], shape (W, S, 3)"""
    sphere_spins: Any
    """[rad/s], shape (W, S, 3)"""
    sphere_forces: Any
    """Forces of particles on spheres that are still to act [N], shape (W, S, 3)"""
    holds: Any
    """Friction state of particles where balloons touch: slip [m] and overlap [m], shape (W, P, 4), or (W, 0, 4)"""
    deep: Any
    """1 of particles that may be deep in another balloon, shape (W, P), or (W, 0); nothing is derived by it"""


class Moved(NamedTuple):
    """Frames of a rollout, as tensors, worlds first."""

    points: Any
    """Places of all particles [m], shape (W, frames + 1, P, 3)"""
    velocities: Any
    """[m/s], shape (W, frames + 1, P, 3)"""
    pressures: Any
    """Gauge pressures [Pa], shape (W, frames + 1, B)"""
    sphere_positions: Any
    """Places of spheres [m], shape (W, frames + 1, S, 3)"""
    sphere_velocities: Any
    """[m/s], shape (W, frames + 1, S, 3)"""


class Rollout(Shown):
    """Simulate a scene as a function of PyTorch.

    `rollout(values)` gives all frames. For a policy in the loop, `rollout.start(values)` gives where the scene begins,
    and `rollout.step(begun, values)` a frame more, by values that may be others each time. Tensors share the memory of
    arrays of Warp. As with all of torch's graphs, `backward` goes once through each.

    Args:
        scene: Scene, name of a bundled one, scene file, or mesh, as a file or in memory.
        of: Dotted paths of the values, as for `gradient`.
        world_count: Number of worlds, copies of the scene side by side.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Schedule of frames that run backwards, as for `gradient`.
        laws: your own.

    Raises:
        MissingExtraError: PyTorch is not installed.
        InputError: The scene cannot be simulated or differentiated, or a path not.
    """

    @checked
    def __init__(
        self,
        scene: SceneLike,
        *,
        of: Sequence[str],
        world_count: int = 1,
        device: str | None = None,
        schedule: str = "auto",
        laws: Sequence[Law] = (),
    ):
        self._functions = _functions()
        self._steps = Steps(scene, of, world_count, device, schedule, laws)

    def start(self, values: Any) -> Begun:
        """Return where the scene begins with these values, a tensor of shape (world_count, path_count)."""
        return Begun(0, *self._functions[0].apply(self._steps, values))

    def step(self, begun: Begun, values: Any) -> Begun:
        """Simulate a frame, with these values from now on; those that count at the start alone have no effect.

        Raises:
            InputError: the values have another shape, or cannot be.
            BlowUpError: a world blew up.
        """
        return Begun(begun.frame + 1, *self._functions[1].apply(self._steps, begun.frame, values, *begun[1:]))

    def __call__(self, values: Any, frames: int | None = None) -> Moved:
        """Simulate the scene, and return all its frames.

        Args:
            values: a tensor of shape (world_count, path_count).
            frames: how many; as many as the scene says, when missing.
        """
        stack = import_module("torch").stack
        begun = self.start(values)
        seen = [begun]
        for _ in range(self._steps.plan.scene.frames if frames is None else frames):
            begun = self.step(begun, values)
            seen.append(begun)
        return Moved(*(stack([getattr(each, name) for each in seen], dim=1) for name in Moved._fields))


def _functions() -> tuple[Any, Any]:
    """Return the functions of autograd: of the start, and of a frame.

    Raises:
        MissingExtraError: PyTorch is not installed.
    """
    try:
        torch: Any = import_module("torch")
        once_differentiable: Any = import_module("torch.autograd.function").once_differentiable
    except ImportError:
        raise MissingExtraError("Rollout needs PyTorch: pip install 'balloon-warp[torch]'") from None

    def arrays(tensors: Sequence[Any]) -> Moving:
        # of an empty one, torch takes any strides for contiguous, and Warp does not
        dense = (tensor.detach() if tensor.numel() else tensor.new_zeros(tensor.shape) for tensor in tensors)
        each = (tensor.contiguous() for tensor in dense)
        return Moving(*(wp.from_torch(tensor, dtype=dtype) for tensor, dtype in zip(each, TYPES, strict=True)))

    def tensors(moving: Moving) -> tuple[Any, ...]:
        return tuple(wp.to_torch(array) for array in moving)

    def handed_out(ctx: Any, moving: Moving) -> tuple[Any, ...]:
        each = Moving(*tensors(moving))
        ctx.mark_non_differentiable(each.deep)
        return each

    def numbers(values: Any) -> np.ndarray:
        return values.detach().cpu().double().numpy()

    class Start(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, steps: Steps, values: Any) -> tuple[Any, ...]:
            ctx.steps = steps
            ctx.save_for_backward(values)
            return handed_out(ctx, steps.start(numbers(values)))

        @staticmethod
        @once_differentiable
        def backward(ctx: Any, *bars: Any) -> Any:
            (values,) = ctx.saved_tensors
            found = ctx.steps.turn_start_back(numbers(values), arrays(bars))
            return None, torch.from_numpy(found).to(values)

    class Step(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, steps: Steps, frame: int, values: Any, *moving: Any) -> tuple[Any, ...]:
            ctx.steps, ctx.frame = steps, frame
            ctx.save_for_backward(values, *moving)
            return handed_out(ctx, steps.advance(arrays(moving), frame, numbers(values)))

        @staticmethod
        @once_differentiable
        def backward(ctx: Any, *bars: Any) -> Any:
            values, *moving = ctx.saved_tensors
            by_begin, found = ctx.steps.turn_back(arrays(moving), ctx.frame, numbers(values), arrays(bars))
            return None, None, torch.from_numpy(found).to(values), *tensors(by_begin)

    return Start, Step
