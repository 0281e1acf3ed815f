"""Cost of health checks: detection of blow-ups, and the states kept to diagnose them.

Run it by python -m balloon_warp.benchmarks.health [DEVICE]; status 1 where the cost is more than allowed.
"""

import sys
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import warp as wp

from balloon_warp.benchmarks.cases import CPU_BASE, GPU_BASE, Case, balloons
from balloon_warp.benchmarks.measure import FRAMES, seconds_a_frame
from balloon_warp.blow_ups import KEPT_FRAMES
from balloon_warp.kernels.phases.motion import check
from balloon_warp.model import Model, State, build_model, initial_state, overwrite
from balloon_warp.schedules import layouts
from balloon_warp.schedules.choose import Schedule, make_schedule
from balloon_warp.schedules.frames import HealthCheck
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

GPU_FRAMES = 100
"""that are timed together: some take 30 us, as long as to launch one and wait for it"""
MOST = 0.01
"""part of a frame that it may cost"""
REPEATS = 1000
"""looks in a frame: one alone is lost in the noise"""


class Launches:
    """Stands in for a schedule, whose frame is the end of many frames."""

    capturable = True

    def __init__(self, model: Model):
        self.model, self._check = model, HealthCheck(model)

    def advance_frame(self, state: State) -> None:
        for _ in range(REPEATS):
            self._check.end_frame(state)


class Counts(Launches):
    """Many ends without a look."""

    def advance_frame(self, state: State) -> None:
        for _ in range(REPEATS):
            wp.launch(count_frame, 1, inputs=[state.frame], device=self.model.device)


class Copies(Launches):
    """Stands in for a schedule, whose frame is a copy of a state."""

    capturable = False  # so is a simulator's, which is none of the recorded frame

    def __init__(self, model: Model):
        super().__init__(model)
        self._copy = initial_state(model)

    def advance_frame(self, state: State) -> None:
        overwrite(self._copy, state)


@wp.kernel(enable_backward=False)
def count_frame(frame: Any):
    """Count a frame, in one thread."""
    frame[0] = frame[0] + 1


def blind_schedule(model: Model, name: str) -> Schedule:
    """Make a schedule whose kernels leave out their own health checks."""
    with patch.object(layouts, "check", replace(check, when=lambda features: False)):
        return make_schedule(model, name)


@dataclass(frozen=True)
class Cost:
    """Cost of a case."""

    name: str
    frame: float
    """[s]"""
    look: float
    """part of a frame"""
    copy: float
    """part of a frame, on the average of all; 0 in a batch, which keeps none"""

    @property
    def is_small(self) -> bool:
        """Return whether both together are within their limit."""
        return self.look + self.copy < MOST


def cost_of(case: Case, device: wp.Device) -> Cost:
    """Return the cost of the checks: the schedule, and the same without checks, ends of frames and copies, in turns."""
    model = build_model(case.scene(), device, case.worlds)
    schedules = [make_schedule(model, case.schedule), blind_schedule(model, case.schedule)]
    beside: list[Any] = [Launches(model), Counts(model), Copies(model)]
    frame, blind, ends, counts, copy = seconds_a_frame([*schedules, *beside], FRAMES if device.is_cpu else GPU_FRAMES)
    look = frame - blind if case.schedule == "block" else (ends - counts) / REPEATS
    kept = copy / KEPT_FRAMES / frame if case.worlds == 1 else 0.0
    return Cost(case.name, frame, look / frame, kept)


def main() -> None:
    """Print a table; status 1 where a case costs too much."""
    quiet_warp()
    device = pick_device(sys.argv[1] if len(sys.argv) > 1 else None)
    base, one = (CPU_BASE, "octets") if device.is_cpu else (GPU_BASE, "block")
    cases = [base, Case(balloons(1), one, 1), Case("one balloon of 9,602 particles", "gather", 1, cells=40)]
    print("| case | a frame [ms] | a look at it | states kept |\n|---|---|---|---|")
    costs = []
    for case in cases:
        costs.append(cost := cost_of(case, device))
        print(f"| {cost.name} | {1e3 * cost.frame:.3g} | {cost.look:.2%} | {cost.copy:.2%} |")
    sys.exit(0 if all(cost.is_small for cost in costs) else 1)


if __name__ == "__main__":
    main()
