"""A gradient on many workers: each takes some of the worlds."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.blow_ups import BlowUp
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.gradients.derive import Asked, Gradient, derive
from balloon_warp.sweep.child import UNSENT, pack
from balloon_warp.sweep.cluster import Cluster
from balloon_warp.sweep.groups import Group
from balloon_warp.sweep.remote import Work, connect, modules_of, require_laws_that_travel, run_shares
from balloon_warp.trajectories import Trajectories

TRACKS = ("pressures", "gas_amounts", "sphere_positions", "sphere_velocities")
"""Arrays of trajectories with a row for each world; so have `points` and `velocities`, by balloon"""


def derive_on_workers(
    group: Group, asked: Asked, cluster: Cluster, on_frame: Callable[[int], None]
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


def _require_that_it_travels(asked: Asked, cluster: Cluster) -> None:
    try:
        pack(asked.loss)
    except UNSENT as error:
        raise InputError(f"loss: cannot be sent to other processes ({cluster.option}): {error}") from None


def _of_worlds(asked: Asked, rows: NDArray[np.integer]) -> Asked:
    """Return the arguments for some of the worlds."""
    vary = {path: np.asarray(values)[rows] for path, values in asked.vary.items()}
    return asked._replace(world_count=len(rows), vary=vary)


def _derive_and_count(group: Group, asked: Asked, on_frame: Callable[[int], None]) -> tuple[Gradient, bool]:
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
