"""Cost of each method beside the paper's step, and its look, on one bundled scene.

Run it by python -m balloon_warp.benchmarks.methods [DEVICE].
"""

import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.scene import load_scene
from balloon_warp.scene.load import parse_override
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device
from balloon_warp.tools.compare import Run, simulate

SCENE = "squirrel_inflate"
ROUNDS = 3
"""of all methods in turns, so that other work of the machine slows all"""


class Method(NamedTuple):
    """Line of the table."""

    name: str
    overrides: tuple[str, ...] = ()
    """of the scene, over those of `PAPER`"""
    schedule: str = "auto"


PAPER = ("normals=cached", "solver=symplectic_euler")
METHODS = [
    Method("the paper's step"),
    Method("fresh normals", ("normals=fresh",)),
    Method("forward Euler, in as many substeps", ("solver=forward_euler", "substeps=13")),
    Method("projective", ("solver=projective",)),
    Method("viscous springs", ("balloon.stiffness.viscosity=0.0002",)),
    Method("overextended springs stop pulling", ("balloon.stiffness.yield_stretch=2.0",)),
    Method("Provot's correction", ("correction=provot", "correction_limit=0.25")),
    Method("Tarantino's correction", ("correction=tarantino", "correction_limit=0.25")),
    Method("torsion springs", ("balloon.stiffness.torsion=0.01",)),
    Method("stiffness that varies", ("balloon.stiffness.variation=0.5",)),
    Method("given pressure", ("balloon.inflation={kind='pressure', pressure=[[0.2, 0.0], [1.7, 370.0]]}",)),
    Method(
        "sealed gas",
        (
            "balloon.helium=0",
            "balloon.inflation={kind='gas', pump=[[0.2, 0.0], [0.3, 2.3], [1.6, 2.3], [1.7, 0.0]]}",
        ),
    ),
    Method("water", ("water={level=0.3, density=30.0}",)),
    Method("schedule `gather`", schedule="gather"),
    Method("schedule `scatter`", schedule="scatter"),
]


class Row(NamedTuple):
    """Cost of a method, and its last run; None where a run blew up."""

    method: Method
    ratio: float | None
    """cost over that of the first method"""
    gather_ratio: float | None
    """the same where both run in `gather`, which every explicit method can"""
    seconds: float
    """for a simulated second; 0 where it blew up"""
    run: Run
    """whose figures are those of the last frame, when all should be still"""


def measure_methods(
    methods: Sequence[Method] = METHODS,
    device: str | None = None,
    rounds: int = ROUNDS,
    frames: int | None = None,
    on_run: Callable[[Run], None] = lambda run: None,
) -> list[Row]:
    """Return a row for each method; costs are relative to the first.

    Args:
        frames: of the scene; its own when missing.
        on_run: told each run when it is over.

    Raises:
        InputError: a method's run is refused.
    """
    scene = load_scene(SCENE, [parse_override(text) for text in PAPER] + ([("frames", frames)] if frames else []))
    # On a CPU only our own time counts, whatever else keeps it busy; every schedule uses one core for one world.
    clock = time.process_time if pick_device(device).is_cpu else time.perf_counter
    done: dict[tuple[Method, str], list[Run]] = {}
    for _ in range(rounds):
        for method in methods:
            values = dict(parse_override(text) for text in method.overrides)
            for schedule in dict.fromkeys([method.schedule, "gather"]):
                run = simulate(scene, values, partial(Simulator, device=device, schedule=schedule), clock=clock)
                done.setdefault((method, schedule), []).append(run)
                on_run(run)
    for method in methods:
        if (run := done[method, method.schedule][-1]).outcome == "refused":
            raise InputError(f"{method.name}: {run.sentence}")
    seconds = {key: _seconds(runs) for key, runs in done.items()}
    first = methods[0]
    return [
        Row(
            method=method,
            ratio=_ratio(seconds[method, method.schedule], seconds[first, first.schedule]),
            gather_ratio=_ratio(seconds[method, "gather"], seconds[first, "gather"]),
            seconds=scene.frames_per_second * (seconds[method, method.schedule] or 0.0),
            run=done[method, method.schedule][-1],
        )
        for method in methods
    ]


def _seconds(runs: Sequence[Run]) -> float | None:
    """Return the undisturbed time of a frame, that of the fastest tenth of all frames; None where a run is not done."""
    if not all(run.figures for run in runs):
        return None
    return float(np.percentile([seconds for run in runs for seconds in run.frame_seconds], 10))


def _ratio(own: float | None, first: float | None) -> float | None:
    return own / first if own and first else None


def as_markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a table of docs/METHODS.md."""
    lines = [
        "| method | cost | in `gather` | substeps | volume [L] | stretch | unrest [mJ] |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        figures = row.run.figures
        cells = ["blows up", *["-"] * 5]
        if figures:
            cells = [
                *(_two_digits(ratio) if ratio else "-" for ratio in (row.ratio, row.gather_ratio)),
                f"{figures['substeps']}",
                f"{1000 * figures['volume']:.1f}",
                f"{figures['largest_stretch']:.2f}",
                _two_digits(1000 * figures["kinetic_energy"]),
            ]
        lines.append(f"| {row.method.name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def main() -> None:
    """Print the table."""
    quiet_warp()
    rows = measure_methods(device=sys.argv[1] if len(sys.argv) > 1 else None, on_run=_tell)
    print(as_markdown(rows))
    print(f"\nThe first takes {rows[0].seconds:.3g} s for a simulated second.")


def _tell(run: Run) -> None:
    print(run.outcome, ", ".join(run.label), file=sys.stderr)


if __name__ == "__main__":
    main()
