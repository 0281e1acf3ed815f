"""Checkpoints of long jobs: how they survive a kill, and resume to the same bytes.

While a run or a batch is at work, now and then it writes a checkpoint into a folder beside its output: the state from
which it goes on, then the output since the last one. Each file appears whole, in an order in which a kill
between any two leaves a checkpoint that is good. With `--resume` the same command finds the folder, makes sure that it
is of the same job, takes up its frames, and simulates the rest. Once the output is whole, the folder goes.

recording     the frames of a job: simulated, written, kept safe
checkpoints   the safe part of a job: parts of its output, and the states that they end with
part          a part: some frames of some groups; the interface of an output that has parts
folder        the folder: one job's, put aside when another begins
same_job      whether two jobs are the same, and where they differ
run           a run: a job of one world, whose stage is all
"""

from balloon_warp.resume.checkpoints import (
    CHECKPOINT_SECONDS,
    Checkpoints,
    Part,
    PartialFolder,
    RunOutput,
    as_json,
    describe_run,
    differences,
    halvings_until,
    partial_path,
    record_frames,
)

__all__ = [
    "CHECKPOINT_SECONDS",
    "Checkpoints",
    "Part",
    "PartialFolder",
    "RunOutput",
    "as_json",
    "describe_run",
    "differences",
    "halvings_until",
    "partial_path",
    "record_frames",
]
