"""Derivatives of a loss by values of a scene: on one device or many workers, smoothed or not."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.batch.recorder import Group, plan_groups
from balloon_warp.batch.simulate import Trajectories
from balloon_warp.blow_ups import BlowUp
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.farm.cluster import Cluster
from balloon_warp.farm.local_workers import UNSENT, pack
from balloon_warp.farm.remote import Work, connect, modules_of, require_laws_that_travel, run_shares
from balloon_warp.kernels.laws import Law
from balloon_warp.lab.gradients.chain import value_in_worlds
from balloon_warp.lab.gradients.derive import (
    DerivativeRequest,
    Gradient,
    Loss,
    derive,
    require_differentiable,
    require_room_for_frames,
)
from balloon_warp.model import ModelPlan, Vary, worlds_of
from balloon_warp.model.timeline import scene_to_vary
from balloon_warp.scene import SceneLike
from balloon_warp.scene.load import Override
from balloon_warp.system.arguments import checked

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
