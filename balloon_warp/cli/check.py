"""`balloon-warp check`."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress

from balloon_warp.cli.options import Device, Json, parse_frames
from balloon_warp.cli.progress import Console, counted, warn
from balloon_warp.warp_logging import quiet_warp

if TYPE_CHECKING:
    from balloon_warp.checking import CheckReport, Crossing

MOST_PAIRS = 20
"""Number of pairs listed at most"""


def check(
    stage: Annotated[
        Path, typer.Argument(metavar="STAGE", help="A USD file that `run` wrote, or any other with moving meshes.")
    ],
    *,
    frames: Annotated[
        str | None,
        typer.Option(metavar="FIRST:LAST", help="Range of frames to check, such as 10:90. All if not given."),
    ] = None,
    within: Annotated[
        float | None,
        typer.Option(
            metavar="METERS",
            help="Tolerated penetration of a balloon into a solid. A twentieth of the mean edge if not given.",
        ),
    ] = None,
    device: Device = None,
    as_json: Json = False,
) -> None:
    """Check a stage for interpenetration.

    Reports which balloons, parts of a balloon, obstacles, bodies, spheres and ground penetrate each other, and where.
    The exit status is 1 if any do.

    Try `balloon-warp check press.usdc`.
    """
    part = parse_frames(frames) if frames else None
    quiet_warp()
    from balloon_warp.checking import check_stage  # loads USD: only once the arguments are known to be good

    terminal = Console(emoji=False, stderr=True)
    with Progress(console=terminal, disable=not terminal.is_terminal, transient=True) as progress:
        task = progress.add_task(stage.name, total=None)
        report = check_stage(
            stage,
            frames=part,
            within=within,
            device=device,
            on_frame=lambda done, count: progress.update(task, completed=done, total=count),
            on_note=warn,
        )
    if as_json:
        print(json.dumps({**asdict(report), "passed": report.passed}))
    else:
        _print(report)
    if not report.passed:
        raise typer.Exit(1)


def _print(report: "CheckReport") -> None:
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    things = counted(len(report.things), "thing")
    looked = f"{counted(report.frames, 'frame')}, {things}, {report.triangles:,} triangles"
    pairs: dict[tuple[str, str], list[Crossing]] = {}
    for crossing in report.crossings:
        pairs.setdefault((crossing.first, crossing.second), []).append(crossing)
    said = f"{counted(len(pairs), 'pair')} of objects cross" if pairs else "nothing crosses"
    console.print(f"{report.stage}: {said} ({looked})", markup=False)
    deepest = sorted(pairs.values(), key=lambda those: -max(each.depth for each in those))
    for those in deepest[:MOST_PAIRS]:
        worst = max(those, key=lambda each: each.depth)
        frames = _spans([each.frame for each in those])
        console.print(f"  {worst}; crosses at {frames}", markup=False)
    if len(deepest) > MOST_PAIRS:
        console.print(f"  and {len(deepest) - MOST_PAIRS} shallower pairs; --json lists all", markup=False)


def _spans(frames: Sequence[int]) -> str:
    """Return the numbers as ranges, the first few of them."""
    spans: list[list[int]] = []
    for frame in frames:
        if spans and frame == spans[-1][1] + 1:
            spans[-1][1] = frame
        else:
            spans.append([frame, frame])
    words = [str(begin) if begin == end else f"{begin}-{end}" for begin, end in spans[:4]]
    return ", ".join(words) + (f" and {len(spans) - 4} more" if len(spans) > 4 else "")
