"""Runs of one scene side by side, with other values: one picture, one table."""

import csv
import itertools
import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Literal, NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from balloon_warp.batch.recorder import MEASURES, Recorder, columns_of
from balloon_warp.errors import BlowUpError, InputError, MissingExtraError
from balloon_warp.kernels.laws import Law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.run.report import RunHeader
from balloon_warp.scene import Scene, SceneLike, scene_of
from balloon_warp.scene.load import files_of_scene, find_mesh, override_scene, parse_value
from balloon_warp.simulator import Simulator
from balloon_warp.studio.render.render import MOST_PIXELS, MOST_SAMPLES, Picture, render_alike, write_png
from balloon_warp.system.api import checked
from balloon_warp.system.files import check_writable, require_no_inputs, scratch_folder, sole_writer, whole_file
from balloon_warp.usd import StageWriter

RANGE = r"[-+.\deE]+:[-+.\deE]+"
"""Pattern of ranges, as `batch` takes them"""
_OPENING, _CLOSING, _QUOTES = "[{", "]}", "\"'"


def parse_choices(text: str, scene_source: str = "") -> tuple[str, list[Any]]:
    """Split `PATH=VALUE,VALUE,...`; each value is read as in `--set`. Commas in brackets and quotes do not split.

    Args:
        text: argument of `--vary`.
        scene_source: the scene that the command names; meshes are sought beside its file, too.

    Raises:
        InputError: there is no path, no `=`, an empty value, or a range.
    """
    path, _, words = (part.strip() for part in text.partition("="))
    values = [word.strip() for word in _split(words)]
    if len(values) == 1 and re.fullmatch(RANGE, values[0]):
        raise InputError(
            f"--vary {text}: takes values, as in --vary {path}={values[0].replace(':', ',')}; ranges are for `batch`"
        )
    if not all(path.split(".")) or not all(values):
        raise InputError(
            f"--vary {text}: expected PATH=VALUE,VALUE,..., as in --vary normals=cached,fresh or "
            "--vary balloon.inflation.k_normal=1,2,4"
        )
    if path.split(".")[-1] == "mesh":
        return path, [find_mesh(value, scene_source) for value in values]
    return path, [parse_value(value) for value in values]


def shown(value: Any) -> str:
    """Show a value as a label or a table does: a mesh by its name."""
    if isinstance(value, float):
        return f"{value:g}"
    return value.name if isinstance(value, Path | PolygonMesh) else str(value)


def _split(words: str) -> list[str]:
    """Split at commas that are in neither brackets nor quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in words:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in _QUOTES:
            quote = letter
        else:
            depth += (letter in _OPENING) - (letter in _CLOSING)
        if letter == "," and not quote and depth <= 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


MOST_STRETCH = 100.0
"""Largest stretch of a spring in a run that is shown: one that explodes but stays finite would leave the others no room
in the picture"""


@dataclass(frozen=True)
class Run:
    """Run with one set of values."""

    values: dict[str, Any]
    """Varied values by their dotted paths"""
    outcome: Literal["done", "refused", "blew up"]
    sentence: str
    """Reason for failure; empty if the run is done"""
    figures: dict[str, float]
    """Measures at the frame that is shown; empty where the run is not done"""
    frame_seconds: list[float] = field(default_factory=list)
    """Duration of each frame [s]"""

    @property
    def label(self) -> list[str]:
        """Lines that distinguish this run, one for each value."""
        return [f"{path} = {shown(value)}" for path, value in self.values.items()]


class Still(NamedTuple):
    """Frame of a run that is shown, and measured."""

    frame: int | None = None
    """Number, unless `picture_frame` is varied; when missing, the one that the scene names as its picture, else the
    last"""
    stage: Path | None = None
    """Stage to write that frame into, if any"""


OF_THE_SCENE = Still()
"""Still of the frame that the scene names"""


def simulate(
    scene: Scene,
    values: dict[str, Any],
    simulator_of: Callable[[Scene], Simulator],
    still: Still = OF_THE_SCENE,
    on_begin: Callable[[RunHeader], None] = lambda header: None,
    on_frame: Callable[[int, int], None] = lambda done, count: None,
    clock: Callable[[], float] = time.perf_counter,
) -> Run:
    """Run the scene with these values as far as the frame that is shown.

    Args:
        simulator_of: makes the simulator of a scene.
        on_begin: called with a summary of the run, whose frames end at the one that is shown.
        on_frame: Called with the number of frames done, and of all.
        clock: function that returns the time [s], by which frames are timed.
    """
    try:
        scene = override_scene(scene, values.items(), other_kinds=True)
        varied = "picture_frame" in values  # a label shows the value, or its refusal
        last = shown_frame(scene, scene.picture_frame if varied else still.frame)
        simulator = simulator_of(scene)
        on_begin(replace(RunHeader.of(simulator.model, simulator.schedule.name), frames=last))
        figures, seconds = _measured(simulator, last, still.stage, on_frame, clock)
    except (InputError, MissingExtraError) as refusal:
        return Run(values, "refused", str(refusal), {})
    except BlowUpError as failure:
        return Run(values, "blew up", str(failure), {})
    return Run(values, "done", "", figures, seconds)


def _measured(
    simulator: Simulator,
    last: int,
    stage: Path | None,
    on_frame: Callable[[int, int], None],
    clock: Callable[[], float],
) -> tuple[dict[str, float], list[float]]:
    """Measure the figures at the frame that is shown, and the wall time of each frame until then [s]."""
    recorder = Recorder(simulator, np.zeros(0, dtype=np.int32))
    seconds = []
    for number in range(1, last + 1):
        began = clock()
        simulator.step_unread()  # waits for the device, to see whether the world is healthy
        seconds.append(clock() - began)
        on_frame(number, last)
    record = recorder.read()
    measured = dict(zip(columns_of(simulator.model.scene), map(float, record.measures[0]), strict=True))
    figures = {name: measured[name] for name in MEASURES}
    if not record.healthy[0] or figures["largest_stretch"] > MOST_STRETCH:
        raise BlowUpError(
            f"the simulation blew up: by frame {last} a spring exceeds {MOST_STRETCH:g} times its rest length"
        )
    if stage:
        with StageWriter(stage, simulator.model) as writer:
            writer.write(simulator.read_frame())
    shapes = simulator.model.shapes
    if len(shapes) == 1 and shapes[0].closed:
        figures["roundness"] = 36.0 * np.pi * figures["volume"] ** 2 / figures["area"] ** 3
    figures = {
        "frame": last,
        **(figures | measured),
        "particles": simulator.model.particle_count,
        "substeps": simulator.model.substeps,
        **({"seconds_a_frame": median(seconds)} if seconds else {}),
    }
    return figures, seconds


def shown_frame(scene: Scene, frame: int | None) -> int:
    """Find the frame that is shown of a scene.

    Raises:
        InputError: the scene has no such frame.
    """
    if frame is None:
        return min(scene.frames if scene.picture_frame is None else scene.picture_frame, scene.frames)
    if not 0 <= frame <= scene.frames:
        raise InputError(f"frame: {frame} is not in the scene; expected 0 to {scene.frames}")
    return frame


PAPER, INK, FAINT, ALARM = (255, 255, 255), (40, 40, 40), (238, 238, 238), (150, 40, 30)
"""Colors of the sheet, sRGB"""
LEAST_LETTERS = 12
"""Least height of letters [pixels]"""


class Tile(NamedTuple):
    """Run's part of the sheet."""

    label: Sequence[str]
    """Lines above the picture"""
    picture: Picture | None
    """Picture of shape (height, width, 3), or None"""
    sentence: str
    """Reason for a missing picture"""


def compose_sheet(tiles: Sequence[Tile], columns: int, size: tuple[int, int]) -> Picture:
    """Lay tiles out in rows, each under its label; shape (height, width, 3).

    Args:
        tiles: row by row.
        columns: tiles in a row.
        size: width and height of a tile's picture in pixels.
    """
    font = ImageFont.load_default(letter_height(size))
    line = round(1.4 * letter_height(size))
    gap = line // 2
    labels = [[part for text in tile.label for part in _wrapped(text, font, size[0])] for tile in tiles]
    head = gap + line * max(map(len, labels), default=0)
    rows = -(-len(tiles) // columns)
    sheet = Image.new("RGB", (columns * (size[0] + gap) + gap, rows * (head + size[1] + gap) + gap), PAPER)
    draw = ImageDraw.Draw(sheet)
    for place, (tile, label) in enumerate(zip(tiles, labels, strict=True)):
        row, column = divmod(place, columns)
        left, top = gap + column * (size[0] + gap), gap + row * (head + size[1] + gap)
        draw.multiline_text((left, top + gap // 2), "\n".join(label), INK, font, spacing=line - letter_height(size))
        if tile.picture is not None:
            sheet.paste(Image.fromarray(tile.picture), (left, top + head))
            continue
        draw.rectangle((left, top + head, left + size[0] - 1, top + head + size[1] - 1), FAINT)
        lines = _wrapped(tile.sentence, font, size[0] - 2 * line)
        draw.multiline_text((left + line, top + head + line), "\n".join(lines), ALARM, font)
    return np.asarray(sheet)


def letter_height(size: tuple[int, int]) -> int:
    """Return the height of the letters [pixels] over pictures of this size."""
    return max(LEAST_LETTERS, round(size[1] / 16))


def _wrapped(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> list[str]:
    """Return the lines of at most `width` pixels; a longer word gets a line of its own."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


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
    on_begin: Callable[[int, int, RunHeader], None] = lambda run, run_count, header: None,
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
        runs, simulator_of = [], partial(Simulator, device=device, schedule=schedule, laws=laws)
        for number, (values, stage) in enumerate(zip(combinations, stages, strict=True)):
            begin, report = (partial(told, number, len(combinations)) for told in (on_begin, on_frame))
            runs.append(simulate(scene, values, simulator_of, Still(frame, stage), begin, report))
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
