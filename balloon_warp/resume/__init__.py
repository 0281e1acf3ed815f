"""Checkpoints of long jobs: how they survive a kill, and resume to the same bytes.

While a run or a batch is at work, now and then it writes a checkpoint into a folder beside its output: what it has
written since the last one, then the state from which it goes on. Each file appears whole, in an order in which a kill
between any two leaves a checkpoint that is good. With `--resume` the same command finds the folder, makes sure that it
is of the same job, takes up what is there, and simulates the rest. Once the output is whole, the folder goes.

folder      the folder: one job's, put aside when another begins
same_job    whether two jobs are the same, and where they differ
run         the checkpoints of a run, which writes one stage

Those of a batch, which writes a table and shares of worlds, are `balloon_warp/sweep/resume/`.
"""

from balloon_warp.resume.folder import PartialFolder
from balloon_warp.resume.run import CHECKPOINT_SECONDS, Checkpoints, describe_run, halvings_until, partial_path
from balloon_warp.resume.same_job import as_json, differences

__all__ = [
    "CHECKPOINT_SECONDS",
    "Checkpoints",
    "PartialFolder",
    "as_json",
    "describe_run",
    "differences",
    "halvings_until",
    "partial_path",
]
