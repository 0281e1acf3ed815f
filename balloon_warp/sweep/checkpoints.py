"""Checkpoints of a batch: in the folder `partial` beside its table."""

from collections.abc import Callable, Mapping
from typing import Any

from balloon_warp.provenance import installed_versions
from balloon_warp.resume import Checkpoints
from balloon_warp.sweep.task import BatchTask

PARTIAL_NAME = "partial"


def batch_checkpoints(
    task: BatchTask,
    description: Mapping[str, Any],
    seconds: float,
    resume: bool = False,
    on_note: Callable[[str], None] = lambda sentence: None,
) -> Checkpoints:
    """Return the checkpoints of a batch.

    Args:
        task: the batch.
        description: of it, as of `describe_batch`.
        seconds, resume, on_note: as in `Checkpoints`.
    """
    job = {
        **description,
        "substeps": task.groups[0].plan.substeps,
        "on_blowup": task.on_blowup,
        "trajectories": task.trajectories.as_json() if task.trajectories else None,
        "versions": installed_versions(),
    }
    folder = task.folder / PARTIAL_NAME
    return Checkpoints(folder, "batch", job, task.scene, seconds=seconds, resume=resume, on_note=on_note)
