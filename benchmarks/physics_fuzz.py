"""Makes random legal scenes, runs them, and holds them to what must be true of any scene.

    python -m balloon_warp.benchmarks.physics_fuzz --seconds 600

A failure is shrunk to the smallest scene that shows it, printed as a scene file with the property and both numbers, and
ends the process with status 1. PhyFu (Xiao et al., ICSE 2023) tested Taichi, Warp, Brax and Nimble so.
"""

import argparse
import gc
import random
import secrets
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import Any

import numpy as np
from pydantic import ValidationError

from balloon_warp.benchmarks.physics_alike import Measure, Property
from balloon_warp.benchmarks.physics_known import known
from balloon_warp.benchmarks.physics_meshes import listed
from balloon_warp.benchmarks.physics_newton import compared_with_newton
from balloon_warp.benchmarks.physics_properties import PROPERTIES
from balloon_warp.benchmarks.physics_runs import MOST_SUBSTEPS, Case
from balloon_warp.benchmarks.physics_scenes import KINDS, Kind, drawn
from balloon_warp.benchmarks.physics_twins import Tables
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene.fields import toml_value
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

BATCH = 20
"""Scenes that are drawn of a kind before the next, which may have to compile"""
TOGETHER = 5
"""Scenes whose simulators are collected at once: they refer to themselves, and take gigabytes until Python would do it.
A search takes a second where many tests ran before."""
Count = Counter[str]
"""Scenes and properties by their outcome"""


class PropertyError(AssertionError):
    """A property does not hold for a scene."""

    def __init__(self, name: str, measure: Measure, tables: Tables):
        super().__init__(f"{name}: found {measure.found:.6g}, allowed {measure.allowed:.6g} ({measure.note})")
        self.name, self.measure, self.tables = name, measure, tables


def check(tables: Tables, properties: Sequence[Property], device: str, counts: Count) -> None:
    """Hold a scene to properties; its outcome is added to the counts.

    Raises:
        PropertyError: one does not hold.
    """
    try:
        case = Case(tables, device)
        if not 1 <= case.substeps * case.scene.frames <= MOST_SUBSTEPS:
            counts["too long"] += 1
            return
    except (InputError, ValidationError):
        counts["refused"] += 1
        return
    counts["simulated"] += 1
    counts["blown up"] += case.run.blow_up is not None
    for holds in properties:
        measure = holds(case)
        if measure is None:
            continue
        counts["properties"] += 1
        if not measure.holds and (line := known(case, holds.__name__)):
            counts[f"known: {line}"] += 1
            break  # others may fail for it, too
        if not measure.holds:
            raise PropertyError(holds.__name__, measure, tables)


def fuzz(
    kind: Kind, examples: int, number: int, counts: Count, device: str = "cpu", is_over: Callable[[], bool] = bool
) -> None:
    """Draw scenes of a kind, and hold them to all properties; a failure is shrunk.

    Args:
        number: seed of the scenes; the same gives the same.
        is_over: whether to stop early, unless a failure is being shrunk.

    Raises:
        PropertyError: of the smallest scene that was found.
    """
    failed: list[Property] = []  # the first one is shrunk, and no other
    turns = count(1)

    def hold(tables: Tables) -> None:
        if failed or not is_over():
            try:
                check(tables, failed or PROPERTIES, device, Counter() if failed else counts)
            except PropertyError as error:
                failed[:] = [each for each in PROPERTIES if each.__name__ == error.name]
                raise
            finally:
                if not next(turns) % TOGETHER:
                    gc.collect()

    drawn(kind, examples, number, hold)


def kinds_of(number: int) -> Iterator[tuple[str, Kind]]:
    """Yield kinds of scenes without end: those by name, then variations of them."""
    draws = random.Random(number)
    yield from KINDS.items()
    while True:
        name = draws.choice(list(KINDS))
        kind = KINDS[name]
        yield (
            name,
            kind._replace(
                mesh=draws.choice(("quads", "triangles")) if kind.mesh != "sheet" else kind.mesh,
                balloons=draws.choice((1, 2, 4)),
                inflation=draws.choice(("pressure", "gas")) if kind.mesh != "sheet" else kind.inflation,
                material=draws.choice(("springs", "neo_hookean", "mooney_rivlin"))
                if not kind.bursts
                else kind.material,
                ground=kind.obstacles == ("lid",) or draws.random() < 0.5,
                touch=draws.random() < 0.5,
            ),
        )


def scene_file(tables: Tables) -> str:
    """Write a scene as a file that `balloon-warp run` takes, its meshes as points and faces."""
    lines, within = [], []
    for name, value in tables.items():
        if isinstance(value, list | dict) and value:
            for table in value if isinstance(value, list) else [value]:
                within += ["", f"[[{name}]]" if isinstance(value, list) else f"[{name}]"]
                within += [f"{field} = {toml_value(_plain(each))}" for field, each in table.items()]
        elif value != []:
            lines.append(f"{name} = {toml_value(value)}")
    return "\n".join([*lines, *within]) + "\n"


def read_scene(text: str) -> Tables:
    """Read the tables of a `scene_file` again."""
    tables = tomllib.loads(text)
    for balloon in tables["balloon"]:
        points, faces = balloon["mesh"]
        balloon["mesh"] = listed(np.array(points), np.array([len(face) for face in faces]), np.concatenate(faces))
    return tables


def _plain(value: Any) -> Any:
    if not isinstance(value, PolygonMesh):
        return value
    faces = np.split(value.face_vertex_indices, np.cumsum(value.face_vertex_counts)[:-1])
    return [value.points.tolist(), [face.tolist() for face in faces]]


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not 1.0 <= seconds < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number of seconds from 1 on (got {text})")
    return seconds


def main(arguments: Sequence[str] | None = None) -> None:
    """Print how many scenes and properties were tried; status 1 after a failure, with its scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=_seconds, default=600.0, help="time to look for failures; at least 1")
    parser.add_argument("--seed", type=int, help="seed of the scenes; another one each time when missing")
    parser.add_argument("--device", help="Warp device, such as cpu or cuda:0")
    parser.add_argument("--newton", action="store_true", help="count what holds here and in Newton's cloth instead")
    asked = parser.parse_args(arguments)
    quiet_warp()
    try:
        device = pick_device(asked.device).alias
    except InputError as mistake:
        parser.error(str(mistake))
    number = secrets.randbelow(1 << 32) if asked.seed is None else asked.seed
    end, counts = time.monotonic() + asked.seconds, Counter()
    print(f"seed {number}, {device}", flush=True)
    if asked.newton:
        print(compared_with_newton(asked.seconds, number, device))
        return
    for round_number, (name, kind) in zip(count(), kinds_of(number)):
        if time.monotonic() > end:
            break
        before = counts.copy()
        try:
            fuzz(kind, BATCH, number + round_number, counts, device, lambda: time.monotonic() > end)
        except PropertyError as failure:
            print(f"{name}: {failure}\nin this scene:\n\n{scene_file(failure.tables)}")
            sys.exit(1)
        print(f"{name}: {_shown(counts - before)}", flush=True)
    print(f"in all: {_shown(counts)}; no failure")


def _shown(counts: Count) -> str:
    return ", ".join(f"{number:,} {outcome}" for outcome, number in sorted(counts.items())) or "nothing"


if __name__ == "__main__":
    main()
