"""Blow-ups: detection of non-finite or runaway states, diagnosis, and recovery.

1. It is found on the device: after each frame `schedules/health.py` looks at every particle and sphere, and notes the
   first one in each world that is where it cannot be.
2. From that frame nothing is left to learn. So `Simulator` keeps `Origins`: a state of a while ago, and all that it
   takes to begin again from there.
3. `replay` simulates that one world again, its last frames substep by substep, until it goes bad.
4. `diagnose` looks at that substep: the farthest mover, the forces on it (`pulls`), and the largest stable step.
   It makes a `BlowUp`, whose text is a sentence.
5. `Simulator` raises a `BlowUpError` with it. A `policy` decides the fate of the run: it stops, ends at its last good
   frame, or begins again with half the step. A run does so in `job.py`, a batch in `sweep/blow_ups.py`; the viewer
   offers its last good state.
"""

from balloon_warp.blow_ups.diagnosis import BlowUp, Pull, Pulls, diagnose
from balloon_warp.blow_ups.replay import KEPT_FRAMES, MOST_HALVINGS, Origin, Origins, check_policy, with_half_the_step

__all__ = [
    "KEPT_FRAMES",
    "MOST_HALVINGS",
    "BlowUp",
    "Origin",
    "Origins",
    "Pull",
    "Pulls",
    "check_policy",
    "diagnose",
    "with_half_the_step",
]
