"""Runs of a scene side by side."""

import csv
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from balloon_warp.arguments import checked
from balloon_warp.beginning import Beginning
from balloon_warp.comparison.choices import shown
from balloon_warp.comparison.run import Run, simulate
from balloon_warp.comparison.sheet import Tile, compose_sheet
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.files import check_writable, whole_file
from balloon_warp.kernels.laws import Law
from balloon_warp.outputs.render.alike import render_alike
from balloon_warp.outputs.render.files import write_png
from balloon_warp.outputs.render.render import MOST_PIXELS, MOST_SAMPLES
from balloon_warp.ownership import require_no_inputs, sole_writer
from balloon_warp.scene import SceneLike, scene_of
from balloon_warp.scene.load import files_of_scene
from balloon_warp.temporaries import scratch_folder

MOST_COLUMNS = 4
"""Largest number of columns of the picture, where one thing varies"""


@dataclass(frozen=True)
class Comparison:
    """Comparison of runs; the last of the varied paths changes fastest."""

    runs: list[Run]
    picture: str
    table: str | None

    @property
    def columns(self) -> list[str]:
        """Columns of the table: varied paths, measures, and the outcome."""
        measured = dict.fromkeys(name for run in self.runs for name in run.figures)
        return [*self.runs[0].values, *measured, "outcome", "sentence"]

    def rows(self) -> list[list[Any]]:
        """Return the rows of the table: a row a run, None where a run has no such figure."""
        return [
            [
                *(value if isinstance(value, int | float) else shown(value) for value in run.values.values()),
                *(run.figures.get(name) for name in self.columns[len(run.values) : -2]),
                *(run.outcome, run.sentence),
            ]
            for run in self.runs
        ]


@checked
def compare(
    scene: SceneLike,
    vary: Mapping[str, Sequence[Any]],
    picture: str | Path,
    *,
    table: str | Path | None = None,
    frame: int | None = None,
    size: tuple[int, int] = (480, 270),
    samples: int = 4,
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    on_begin: Callable[[int, int, Beginning], None] = lambda run, run_count, beginning: None,
    on_frame: Callable[[int, int, int, int], None] = lambda run, run_count, frame, frame_count: None,
) -> Comparison:
    """Simulate a scene once for each combination of values, and show the runs side by side.

    All are seen through one camera, in a grid whose columns are the values of the last path.

    A run that is refused or blows up is shown as such.

    Args:
        scene: Scene of all runs, or a source that `load_scene` takes.
        vary: dotted paths, as in overrides, and the values of each.
        picture: Picture to write, .png.
        table: Table to write, .csv, a row a run.
        frame: the frame that is shown and measured; when missing, the one that the scene names as its picture, else the
            last.
        size: Width and height of each run's picture in pixels.
        samples: Rays per pixel.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        laws: User-defined laws beside the built-in ones; see `balloon_warp.laws`.
        on_begin: Called with run, number of runs and a summary, as a run begins.
        on_frame: Called with run, number of runs, frame and number of frames, after each frame.

    Raises:
        InputError: nothing varies, an output cannot be written, or every run is refused; nothing is written then.
        BlowUpError: no run reaches the frame; nothing is written then.
    """
    scene = scene_of(scene)
    picture, table = Path(picture), Path(table) if table else None
    combinations = [dict(zip(vary, values, strict=True)) for values in itertools.product(*vary.values())]
    columns = _column_count(vary)
    _check_request(combinations, columns, picture, table, size, samples)
    require_no_inputs((picture, table), files_of_scene(scene))
    with scratch_folder() as folder, sole_writer(picture, table):
        stages = [folder / f"{number}.usdc" for number in range(len(combinations))]
        runs = []
        for number, (values, stage) in enumerate(zip(combinations, stages, strict=True)):
            begin, report = (partial(told, number, len(combinations)) for told in (on_begin, on_frame))
            runs.append(simulate(scene, values, stage, frame, device, schedule, laws, begin, report))
        _require_one(runs)
        moments = [(stage, int(run.figures["frame"])) for run, stage in zip(runs, stages, strict=True) if run.figures]
        pictures = render_alike(moments, size, samples, device)
        tiles = [Tile(run.label, next(pictures) if run.figures else None, run.sentence) for run in runs]
        with whole_file(picture) as temporary:
            write_png(temporary, compose_sheet(tiles, columns, size))
        comparison = Comparison(runs, str(picture), str(table) if table else None)
        if table:
            with whole_file(table) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows([comparison.columns, *comparison.rows()])
    return comparison


def _column_count(vary: Mapping[str, Sequence[Any]]) -> int:
    """Count the values of the last path; those of a single path are broken into even rows."""
    last = len(list(vary.values())[-1]) if vary else 0
    if len(vary) != 1 or last <= MOST_COLUMNS:
        return last
    return math.ceil(last / math.ceil(last / MOST_COLUMNS))


def _check_request(
    combinations: Sequence[dict[str, Any]],
    columns: int,
    picture: Path,
    table: Path | None,
    size: tuple[int, int],
    samples: int,
) -> None:
    """Check the request before any work."""
    if not columns or not combinations:
        raise InputError("vary: nothing differs between the runs; expected values, as in --vary normals=cached,fresh")
    check_writable(picture, (".png",))
    if table:
        check_writable(table, (".csv",))
    if min(size) < 64:
        raise InputError(f"size: pictures of {size[0]}x{size[1]} pixels; expected at least 64x64")
    width, height = columns * size[0], math.ceil(len(combinations) / columns) * size[1]
    if max(width, height) > MOST_PIXELS:
        raise InputError(
            f"vary: {len(combinations)} runs make a picture of {width}x{height} pixels; expected at most "
            f"{MOST_PIXELS}x{MOST_PIXELS}: vary fewer values, or make each picture smaller"
        )
    if not 1 <= samples <= MOST_SAMPLES:
        raise InputError(f"samples: {samples} rays a pixel; expected 1 to {MOST_SAMPLES}")


def _require_one(runs: Sequence[Run]) -> None:
    if any(run.figures for run in runs):
        return
    if all(run.outcome == "refused" for run in runs):
        raise InputError(f"{', '.join(runs[0].label)}: {runs[0].sentence}")
    raise BlowUpError(next(run.sentence for run in runs if run.outcome == "blew up"))
