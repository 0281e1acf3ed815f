"""Derivatives of a loss by values of a scene."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from balloon_warp.arguments import checked
from balloon_warp.errors import InputError
from balloon_warp.gradients.derive import Asked, Gradient, derive
from balloon_warp.gradients.loss import Loss
from balloon_warp.gradients.refusals import require_differentiable, require_room_for_frames
from balloon_warp.gradients.smoothing import averaged, sampled
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Vary, worlds_of
from balloon_warp.model.varied_scene import scene_to_vary
from balloon_warp.scene import SceneLike
from balloon_warp.scene.overrides import Override
from balloon_warp.sweep.cluster import Cluster
from balloon_warp.sweep.groups import Group, plan_groups


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
    asked = Asked(of, loss, worlds_of(world_count, vary), vary or {}, device, schedule, laws, each, every, checkpoints)
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
    asked: Asked,
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
    from balloon_warp.gradients.spread import derive_on_workers

    return derive_on_workers(group, asked, cluster, on_frame)


def _group_of(scene: SceneLike, overrides: Mapping[str, Any] | Iterable[Override], asked: Asked) -> Group:
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
