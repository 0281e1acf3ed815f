"""The installation: its report, a self test, kernels compiled ahead, and the source of a scene's kernels."""

import platform
import re
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.batch.batch import run_batch
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.schedules.launched import source_of
from balloon_warp.mesh.load import load_mesh
from balloon_warp.model import build_model
from balloon_warp.run.report import installed_versions
from balloon_warp.scene import Balloon, Inflation, Scene, SceneLike, scene_of
from balloon_warp.schedules.choose import schedule_named
from balloon_warp.schedules.gather import PullingOctets
from balloon_warp.schedules.launched import LaunchedSchedule
from balloon_warp.schedules.one_launch import BlockSchedule, LanesSchedule, SearchedSchedule
from balloon_warp.schedules.tables import model_features
from balloon_warp.simulator import Simulator
from balloon_warp.studio.animate import animate
from balloon_warp.system.api import checked
from balloon_warp.system.files import scratch_folder
from balloon_warp.system.warp_threads import pick_device


@dataclass(frozen=True)
class WarmUp:
    """Result of compiling kernels ahead."""

    device: str
    schedule: str
    seconds: float
    """Duration including compilation [s]; a second time, all but the compilation remains"""


@checked
def warm_up(
    scene: SceneLike,
    device: str | None = None,
    world_count: int = 1,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
) -> WarmUp:
    """Compile the kernels that a scene needs, so that later runs begin at once.

    It simulates one frame as `animate` or `run_batch` does, with a picture, and throws it away. Warp keeps the kernels
    in its cache, where later processes of this machine find them. The environment variable WARP_CACHE_PATH says where.

    Which kernels a scene needs depends on its methods, not on its meshes or numbers. A method that a `[[change]]`
    brings is compiled when the change comes.

    Args:
        scene: Scene, or a source that `load_scene` takes.
        device: Warp device; the GPU, or else the CPU, if not given.
        world_count: more than one for a batch of about as many: with "auto" the schedule depends on it.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        laws: User-defined laws beside the built-in ones.

    Raises:
        InputError: as `animate` and `run_batch`.
    """
    began = time.perf_counter()
    short = scene_of(scene).model_copy(update={"frames": 1, "picture_frame": None})
    with scratch_folder() as path:
        how = {"device": device, "schedule": schedule, "laws": laws}
        if world_count == 1:
            done = animate(short, path / "warm.usdc", picture=path / "warm.png", **how)
        else:
            done = run_batch(short, path, world_count, export=[0], **how)
    return WarmUp(done.device, done.schedule, time.perf_counter() - began)


def kernel_source(scene: Scene, schedule: str = "gather") -> str:
    """Write the kernels of a scene's substep as text, in the order of their launches.

    Args:
        schedule: any; a block's are for the CPU, whose blocks have one thread.

    Raises:
        InputError: there is no such schedule, or it cannot simulate the scene.
    """
    model = build_model(scene, "cpu")
    named = schedule_named(schedule, model)
    if issubclass(named, (LanesSchedule, BlockSchedule, PullingOctets, SearchedSchedule)):
        return named.source_of(model)
    assert issubclass(named, LaunchedSchedule)
    return source_of(named.step_of(model, model_features(model)))


FRAMES = 60
CUBE = (
    [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)],
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]],
)
"""Points [m], and faces that wind outward"""
GRAVITY = 9.81  # [m/s^2]
MOST_ERROR = 1e-4
"""Tolerance over the distance fallen; float32's error in a thousand additions is a tenth of that"""


@dataclass(frozen=True)
class SelfTest:
    """A balloon under pressure that falls through empty space: where it is, and where it must be."""

    fallen: float
    """Fall of the center of mass [m]"""
    expected: float
    """Fall by the formula of symplectic Euler [m]"""
    grown: float
    """Volume at the end over that at the start [1]"""
    seconds: float
    """Duration, including the compilation of kernels [s]"""

    @property
    def passed(self) -> bool:
        return abs(self.fallen - self.expected) <= MOST_ERROR * self.expected and self.grown > 1.0


@dataclass(frozen=True)
class Report:
    """Report of `balloon-warp doctor`."""

    versions: dict[str, str]
    system: str
    device: str
    """Default device, with its name"""
    devices: list[str]
    """Devices that Warp sees"""
    kernel_cache: str
    missing: dict[str, list[str]]
    """Missing packages of each extra; empty if it is complete"""
    self_test: SelfTest

    def as_json(self) -> dict[str, Any]:
        return asdict(self) | {"passed": self.self_test.passed}


def examine(device: str | None = None) -> Report:
    """Look at the installation, and simulate a second.

    Raises:
        InputError: there is no such device.
    """
    taken = pick_device(device)
    return Report(
        versions=installed_versions(),
        system=platform.platform(terse=True),
        device=f"{taken.alias} ({taken.name})",
        devices=[each.alias for each in wp.get_devices()],
        kernel_cache=str(wp.config.kernel_cache_dir),
        missing=missing_extras(),
        self_test=self_test(taken.alias),
    )


def missing_extras() -> dict[str, list[str]]:
    """Return the missing packages of each extra.

    Nothing is known of a source tree that is not installed.
    """
    try:
        requirements = metadata.requires("balloon-warp") or []
    except metadata.PackageNotFoundError:
        return {}
    missing: dict[str, list[str]] = {}
    for requirement in requirements:
        if extra := re.search(r"extra == ['\"](.+?)['\"]", requirement):
            (package,) = re.findall(r"^[\w.-]+", requirement)
            missing.setdefault(extra[1], [])
            if not _is_installed(package):
                missing[extra[1]].append(package)
    return dict(sorted(missing.items()))


def _is_installed(package: str) -> bool:
    try:
        metadata.version(package)
    except metadata.PackageNotFoundError:
        return False
    return True


def self_test(device: str) -> SelfTest:
    """Simulate a falling cube for a second under a pressure that inflates it.

    Neither pressure nor springs may move its center of mass, which falls by g h^2 n (n + 1) / 2 in n steps of h
    seconds.
    """
    started = time.perf_counter()
    balloon = Balloon(mesh=load_mesh(CUBE), mass=1.0, damping=0.0, inflation=Inflation(pressure=20.0))
    scene = Scene(balloon=[balloon], gravity=GRAVITY, frames=FRAMES)
    simulator = Simulator(scene, device)
    frames = list(simulator.run())
    steps = FRAMES * simulator.model.substeps
    return SelfTest(
        fallen=float(np.mean(frames[0].points[0] - frames[-1].points[0], axis=0)[1]),  # particles of the same mass
        expected=GRAVITY * frames[-1].time ** 2 * (1.0 + 1.0 / steps) / 2.0,
        grown=float(frames[-1].volumes[0] / frames[0].volumes[0]),
        seconds=time.perf_counter() - started,
    )
