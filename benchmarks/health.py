"""What it costs to look after the worlds: the part of a frame that finds what blew up, and that keeps a state now and
then to see why: python -m balloon_warp.benchmarks.health [DEVICE]"""

import sys
from dataclasses import dataclass
from typing import Any

import warp as wp

from balloon_warp.benchmarks.cases import CPU_BASE, GPU_BASE, Case, balloons
from balloon_warp.benchmarks.measure import seconds_a_frame
from balloon_warp.cli.quiet import quiet_warp
from balloon_warp.device import pick_device
from balloon_warp.health import HEALTHY, HealthCheck
from balloon_warp.model import Model, State, build_model, copy_of
from balloon_warp.schedules import make_schedule
from balloon_warp.simulator import KEPT_FRAMES

REPEATS = 1000
"""looks in a frame: one alone is lost in the noise"""


class Looks:
    """Stands in for a schedule, whose frame is a number of looks at the worlds."""

    capturable = True

    def __init__(self, model: Model):
        self.model, self._check = model, HealthCheck(model)
        self._first_bad = wp.full(model.world_count, HEALTHY, dtype=wp.int32, device=model.device)

    def advance_frame(self, state: State) -> None:
        for _ in range(REPEATS):
            self._check.look(state, self._first_bad)


class Copies(Looks):
    """Stands in for a schedule, whose frame is a copy of a state."""

    capturable = False  # it allocates

    def advance_frame(self, state: State) -> None:
        copy_of(state)


@dataclass(frozen=True)
class Cost:
    """Of one case."""

    name: str
    frame: float
    """[s]"""
    look: float
    """part of a frame"""
    copy: float
    """part of a frame, on the average of all; 0 in a batch, which keeps none"""


def cost_of(case: Case, device: wp.Device) -> Cost:
    """The schedule, the looks and the copies in turns."""
    model = build_model(case.scene(), device, case.worlds)
    contenders: list[Any] = [make_schedule(model, case.schedule), Looks(model), Copies(model)]
    frame, looks, copy = seconds_a_frame(contenders)
    kept = copy / KEPT_FRAMES / frame if case.worlds == 1 else 0.0
    return Cost(case.name, frame, looks / REPEATS / frame, kept)


def main() -> None:
    """Print a table."""
    quiet_warp()
    device = pick_device(sys.argv[1] if len(sys.argv) > 1 else None)
    base, one = (CPU_BASE, "octets") if device.is_cpu else (GPU_BASE, "block")
    cases = [base, Case(balloons(1), one, 1), Case("one balloon of 9,602 particles", "gather", 1, cells=40)]
    print("| case | a frame [ms] | a look at it | states kept |\n|---|---|---|---|")
    for cost in (cost_of(case, device) for case in cases):
        print(f"| {cost.name} | {1e3 * cost.frame:.3g} | {cost.look:.2%} | {cost.copy:.2%} |")


if __name__ == "__main__":
    main()
