"""Checkpoints of batches: how they survive a kill, and resume to the same bytes.

The idea, and a run's half, is in `balloon_warp/resume/`.

checkpoints   what is safe of a batch: the parts of its table and its stage, and the states that they end with
parts         a part: some frames of some groups, in files of their own
journal       of a cluster's batch: which shares are done, and which of these are safe
"""

from balloon_warp.sweep.resume.checkpoints import BatchCheckpoints
from balloon_warp.sweep.resume.journal import ShareJournal
from balloon_warp.sweep.resume.parts import Part

__all__ = ["BatchCheckpoints", "Part", "ShareJournal"]
