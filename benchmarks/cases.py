"""The cases, one a line."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin
from typing import Literal

from balloon_warp.benchmarks.crowd import CrowdCase
from balloon_warp.benchmarks.rubber import RubberCase, rubber_cases
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Ground, Inflation, Obstacle, Scene, Sphere, Stiffness, Touch, load_scene


@dataclass(frozen=True)
class Case:
    """A batch of one balloon a world, a quad sphere of 6 cells^2 + 2 particles: its particle-substeps a second."""

    name: str
    schedule: str
    worlds: int
    cells: int = 9
    substeps: int = 32
    spheres: int = 0
    """they fall on the balloon; one alone lies on it"""
    ground: bool = False
    normals: Literal["cached", "fresh"] = "cached"
    gas: bool = False
    """a sealed amount of gas inflates them, and the air around drags"""
    peer: Literal["newton", "base"] | None = None
    """in turns with Newton, which has no obstacles then; or with the base case of the device"""
    quick: bool = False
    """part of a quick run"""

    @property
    def particles(self) -> int:
        """Number of particles in one world."""
        return 6 * self.cells**2 + 2

    def scene(self) -> Scene:
        """Return the scene, whose springs and mass per particle are the same in every case."""
        weight = 0.3 * self.particles / 488
        balloon = Balloon(
            mesh=quad_sphere(self.cells, radius=0.5),
            position=(0.0, 0.6, 0.0),
            mass=weight,
            damping=weight,
            stiffness=Stiffness(structural=10.0, shear=5.0, flexion=1.0),
            inflation=Inflation(kind="gas", start_pressure=20.0) if self.gas else Inflation(k_normal=0.5),
            drag_coefficient=0.47 if self.gas else 0.0,
        )
        return Scene(
            balloon=[balloon],
            sphere=_spheres(self.spheres),
            ground=Ground() if self.ground else None,
            substeps=self.substeps,
            normals=self.normals,
        )


def _spheres(count: int) -> list[Sphere]:
    """Place one sphere above the middle, or some in a ring above the balloon."""
    ring = 0.0 if count == 1 else 0.35
    turns = [2.0 * pi * number / max(count, 1) for number in range(count)]
    return [Sphere(position=(ring * cos(turn), 1.4, ring * sin(turn)), radius=0.2, mass=0.3) for turn in turns]


@dataclass(frozen=True)
class ExportCase:
    """Frames that were simulated before are written as a stage: megabytes (1e6) of its file a second."""

    name: str
    worlds: int
    cells: int
    frames: int
    quick: bool = False

    def scene(self) -> Scene:
        """Return the scene of the other cases, but for the step."""
        batch = Case(self.name, "auto", self.worlds, self.cells, spheres=1, ground=True)
        return batch.scene().model_copy(update={"frames": self.frames, "substeps": "auto"})


@dataclass(frozen=True)
class FirstFrameCase:
    """Seconds from the start of a Python process to the first frame of a bundled scene, on the host."""

    name: str
    cold: bool
    """with no kernel compiled before; otherwise with all of them in the cache"""
    scene: str = "squirrel_inflate"
    quick: bool = False


@dataclass(frozen=True)
class RealTimeCase:
    """Balloon beside Blender's cloth with pressure, on the same mesh: simulated seconds a second."""

    name: str
    cells: int = 9
    quick: bool = False

    def scene(self) -> Scene:
        """Return the scene with the step that stability asks for, at Blender's 24 frames a second."""
        return (
            Case(self.name, "auto", 1, self.cells)
            .scene()
            .model_copy(update={"substeps": "auto", "frames_per_second": 24.0})
        )


@dataclass(frozen=True)
class ReadingCase:
    """Every frame of one world of a bundled scene is read: particle-substeps a second, beside not reading any."""

    name: str
    worlds: int
    scene_name: str = "squirrel_inflate"
    normals: Literal["cached", "fresh"] = "cached"
    quick: bool = False

    def scene(self) -> Scene:
        """Return the scene, with more frames than are measured."""
        return load_scene(self.scene_name, {"normals": self.normals, "frames": 1_000_000})


@dataclass(frozen=True)
class ContactCase:
    """Batch of balloons that may meet an obstacle, or each other, in turns with one that can meet nothing.

    The rates are in particle-substeps a second.
    """

    name: str
    schedule: str
    worlds: int
    meets: Literal["obstacle", "touch"]
    near: bool
    """they lie on the obstacle, or are packed in a box; otherwise far away"""
    cells: int = 9
    substeps: int = 32
    quick: bool = False

    @property
    def particles(self) -> int:
        """Number of particles in one world."""
        return (1 if self.meets == "obstacle" else EIGHT) * (6 * self.cells**2 + 2)

    @property
    def frames_before(self) -> int:
        """Frames before measuring begins, until packed balloons lie still."""
        return 60 if self.near and self.meets == "touch" else 0

    def scene(self) -> Scene:
        """Return the scene of one balloon above a box, or of eight."""
        if self.meets == "obstacle":
            return _lying(self)
        return _packed(self) if self.near else _apart(self)

    def without(self) -> Scene:
        """Return the case without contact."""
        return self.scene().model_copy(update={"obstacle": [], "touch": False})


EIGHT = 8


def _lying(case: ContactCase) -> Scene:
    box = Obstacle(size=(3.0, 1.0, 3.0), position=(0.0, -0.5 if case.near else -50.0, 0.0))
    one = _pressed(case.cells, (0.0, 0.5, 0.0))
    return Scene(balloon=[one], obstacle=[box], substeps=case.substeps)


def _apart(case: ContactCase) -> Scene:
    """Place balloons in two layers of four."""
    held = [balloon.model_copy(update={"fixed": [0]}) for balloon in _eight(case, 4.0, 20.0)]
    return Scene(balloon=held, touch=Touch(), substeps=case.substeps, gravity=0.0)


def _packed(case: ContactCase) -> Scene:
    """Pack balloons in two layers of four, in a box that is a twentieth of its width too narrow for each.

    Free they would swell to a radius of 0.535 m.
    """
    side = 4.0 * 0.535 * 0.95
    walls = [((0.0, -0.5, 0.0), (0.0, 0.0, 0.0)), ((0.0, 0.5, 0.0), (0.0, 0.0, 180.0))]
    walls += [((-0.5, 0.0, 0.0), (0.0, 0.0, -90.0)), ((0.5, 0.0, 0.0), (0.0, 0.0, 90.0))]
    walls += [((0.0, 0.0, -0.5), (90.0, 0.0, 0.0)), ((0.0, 0.0, 0.5), (-90.0, 0.0, 0.0))]
    box = [Obstacle(shape="plane", position=(side * x, side * y, side * z), rotation=turn) for (x, y, z), turn in walls]
    return Scene(
        balloon=_eight(case, 0.5 * side, 6.0), obstacle=box, touch=Touch(), substeps=case.substeps, gravity=0.0
    )


def _eight(case: ContactCase, apart: float, pressure: float) -> list[Balloon]:
    middles = (-0.5 * apart, 0.5 * apart)
    places = [(x, y, z) for x in middles for y in middles for z in middles]
    return [_pressed(case.cells, place, pressure) for place in places]


def _pressed(cells: int, place: tuple[float, float, float], pressure: float = 20.0) -> Balloon:
    balloon = Case("", "auto", 1, cells).scene().balloon[0]
    inflation = Inflation(kind="pressure", pressure=pressure)
    return balloon.model_copy(update={"position": place, "inflation": inflation})


AnyCase = Case | ContactCase | CrowdCase | ExportCase | FirstFrameCase | ReadingCase | RealTimeCase | RubberCase


def balloons(worlds: int) -> str:
    """Return the name of a case of so many worlds."""
    return "one balloon" if worlds == 1 else f"{worlds:,} balloons"


GPU_BASE = Case(balloons(4096), "block", 4096, peer="newton", quick=True)
CPU_BASE = Case(balloons(64), "lanes", 64, peer="newton", quick=True)

COMMON_CASES: list[AnyCase] = [
    FirstFrameCase("time to first frame, kernels to be compiled [s]", cold=True),
    FirstFrameCase("time to first frame, kernels in the cache [s]", cold=False, quick=True),
    ExportCase("export of one world of 9,602 particles [MB/s]", 1, cells=40, frames=60, quick=True),
    ExportCase("export of 64 worlds of 488 particles [MB/s]", 64, cells=9, frames=60, quick=True),
]


def beside(base: Case, **changed: Sequence[int]) -> Iterator[Case]:
    """Return the base case with other values of one field, each in turns with the base case, to see how the cost grows.

    With `cells`, the worlds are as many as keep the number of all particles.
    """
    for field, values in changed.items():
        for value in values:
            case = replace(base, **{field: value}, peer="base", quick=False)
            label = f"{value:,} {field if value > 1 else field.removesuffix('s')}"
            if field == "cells":
                worlds = base.worlds * base.particles // case.particles // 8 * 8
                label, case = f"{case.particles:,} particles", replace(case, worlds=worlds)
            yield replace(case, name=f"{base.name}, but {label}")


def contact_cases(schedule: str, worlds: int, worlds_of_eight: int) -> Iterator[ContactCase]:
    """Return the cases of one balloon and a box, and of eight balloons."""
    for near, where in ((False, "far from"), (True, "on")):
        yield ContactCase(f"{worlds:,} balloons {where} a box", schedule, worlds, "obstacle", near)
    for near, how in ((False, "far apart"), (True, "packed in a box")):
        name = f"{worlds_of_eight:,} worlds of eight balloons that touch, {how}"
        yield ContactCase(name, schedule, worlds_of_eight, "touch", near)


GPU_CASES: list[AnyCase] = [
    GPU_BASE,
    Case("4,096 balloons, sphere and ground", "block", 4096, spheres=1, ground=True, quick=True),
    Case("4,096 balloons, fresh normals", "block", 4096, normals="fresh", peer="newton"),
    *[Case("4,096 balloons, sealed gas", name, 4096, gas=True, peer="base") for name in ("block", "gather", "scatter")],
    Case(balloons(65536), "block", 65536),
    Case(balloons(64), "block", 64),
    Case(balloons(1), "block", 1, peer="newton", quick=True),
    Case("one balloon, sphere and ground", "block", 1, spheres=1, ground=True),
    Case("512 balloons of 2,648 particles", "block", 512, cells=21),
    *[Case(balloons(worlds), "gather", worlds) for worlds in (1, 64, 4096, 65536)],
    *[Case(balloons(worlds), "scatter", worlds) for worlds in (1, 64, 4096, 65536)],
    Case("one balloon of 99,848 particles", "gather", 1, cells=129, quick=True),
    Case("one balloon of 99,848 particles, sphere and ground", "gather", 1, cells=129, spheres=1, ground=True),
    Case("one balloon of 99,848 particles, sealed gas", "gather", 1, cells=129, gas=True),
    *beside(GPU_BASE, cells=(4, 18, 36)),
    *beside(GPU_BASE, worlds=(16, 256, 1024, 16384)),
    *beside(GPU_BASE, substeps=(8, 16, 64, 128)),
    *beside(GPU_BASE, spheres=(1, 2, 4, 8)),
    *contact_cases("block", 4096, 1024),
    *rubber_cases("block", 4096),
    ReadingCase("frames of one world, read", 1024),
    ReadingCase("frames of one world, read, fresh normals", 1024, normals="fresh"),
    *COMMON_CASES,
]

CPU_CASES: list[AnyCase] = [
    CPU_BASE,
    Case("64 balloons, sphere and ground", "lanes", 64, spheres=1, ground=True),
    Case("64 balloons, fresh normals", "lanes", 64, normals="fresh", peer="newton"),
    Case("64 balloons, sealed gas", "lanes", 64, gas=True, peer="base"),
    Case(balloons(4096), "lanes", 4096),
    Case(balloons(64), "octets", 64),
    *[Case(balloons(worlds), "gather", worlds) for worlds in (1, 64)],
    *[Case(balloons(worlds), "scatter", worlds) for worlds in (1, 64)],
    Case(balloons(1), "octets", 1, peer="newton", quick=True),
    Case("one balloon, sphere and ground", "octets", 1, spheres=1, ground=True),
    Case("one balloon, fresh normals", "octets", 1, normals="fresh", peer="newton"),
    *beside(CPU_BASE, cells=(4, 18, 24)),
    *beside(CPU_BASE, worlds=(8, 16, 256)),
    *beside(CPU_BASE, substeps=(8, 16, 64, 128)),
    *beside(CPU_BASE, spheres=(1, 2, 4, 8)),
    *contact_cases("lanes", 64, 8),
    *rubber_cases("lanes", 64),
    ReadingCase("frames of one world, read", 64),
    RealTimeCase("one balloon [simulated s/s]", quick=True),
    CrowdCase("eight balloons that touch [simulated s/s]", peer="newton", quick=True),
    CrowdCase("eight balloons that touch [simulated s/s]", peer="blender", quick=True),
    *COMMON_CASES,
]
