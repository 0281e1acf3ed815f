"""Manifest of a batch, `manifest.json`: its inputs, versions and outputs, enough to reproduce it."""

import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from balloon_warp.files import whole_file
from balloon_warp.marks import manifest_text
from balloon_warp.model.strain_bound import strain_bound_described
from balloon_warp.provenance import (
    describe_laws,
    describe_scene,
    hash_of_file,
    installed_versions,
    without_folders,
)
from balloon_warp.resume.folder import JOB_NAME
from balloon_warp.sweep.checkpoints import PARTIAL_NAME
from balloon_warp.sweep.columns import describe_columns
from balloon_warp.sweep.task import BatchTask, Outcome

MANIFEST_NAME = "manifest.json"
MANIFEST_NAMES = (MANIFEST_NAME, f"{PARTIAL_NAME}/{JOB_NAME}")
"""Files of which one of ours tells that a folder is a batch's"""


def describe_batch(task: BatchTask) -> dict[str, Any]:
    """Describe the inputs of a batch, as JSON has them, the same wherever its files are.

    Before the run: files may change meanwhile. A mesh from Python has the hash of its arrays, and its name.
    """
    described = {
        "scene": describe_scene(task.scene),
        "worlds": task.world_count,
        "vary": task.varied,
        "export": task.chosen.tolist(),
        "laws": describe_laws(task.laws),
        "files": task.file_hashes,
        "strain_bound": strain_bound_described(task.groups[0].plan),
    }
    return without_folders(described)


def write_manifest(
    task: BatchTask,
    description: Mapping[str, Any],
    provenance: Mapping[str, Any],
    outcome: Outcome,
    names: Sequence[str],
) -> Path:
    """Write the manifest, after the outputs that it names: one that does not fit them is an earlier batch's.

    Args:
        task: of the batch.
        description: of it, as of `describe_batch`.
        provenance: where its values came from, such as the command and the seed.
        outcome: how it was done.
        names: of the files in the folder.

    Raises:
        InputError: it cannot be written.
    """
    hashes = [outcome.hashes.get(name) or hash_of_file(task.folder / name) for name in names]
    manifest = {
        **provenance,
        "versions": installed_versions(),
        "platform": platform.platform(),
        "device": outcome.device,
        "schedule": outcome.schedule,
        "schedule_asked": task.schedule,
        "workers": outcome.workers,
        "on_blowup": task.on_blowup,
        "healthy_worlds": outcome.healthy_worlds,
        "restarted_worlds": {str(world): substeps for world, substeps in outcome.failures.restarted.items()},
        "table": task.table,
        "trajectories": task.trajectories.as_json() if task.trajectories else None,
        "blow_ups": [report.as_json() for report in outcome.failures.reports],
        **description,
        "columns": describe_columns(task.scene, task.varied, task.laws, outcome.pairs),
        "outputs": dict(zip(names, hashes, strict=True)),
    }
    path = task.folder / MANIFEST_NAME
    with whole_file(path) as temporary:
        temporary.write_text(manifest_text(manifest), encoding="utf-8")
    return path
