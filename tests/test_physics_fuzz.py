"""Fuzzer of physics: what it found stays mended, fixed seeds find nothing, and each property can fail."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from balloon_warp.benchmarks import physics_fuzz, physics_properties, physics_runs
from balloon_warp.benchmarks.physics_fuzz import PropertyError, check, fuzz, read_scene, scene_file
from balloon_warp.benchmarks.physics_properties import PROPERTIES
from balloon_warp.benchmarks.physics_scenes import KINDS
from balloon_warp.scene import load_scene

FOUND = sorted((Path(__file__).parent / "found").glob("*.toml"))
SCENES = 3
"""Scenes of each kind: a minute of two cores in all, with their kernels compiled"""


@pytest.mark.parametrize("path", FOUND, ids=lambda path: path.stem)
def test_what_was_found_stays_mended(path: Path):
    check(read_scene(path.read_text("utf-8")), PROPERTIES, "cpu", Counter())


@pytest.mark.parametrize("name", KINDS)
def test_fixed_scenes_hold_to_all_properties(name: str):
    counts: Counter[str] = Counter()
    fuzz(KINDS[name], SCENES, 0, counts)
    assert counts["properties"] >= 5 * counts["simulated"] > 0
