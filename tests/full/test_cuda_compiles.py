"""Kernels compile for a GPU where there is none: the compiler comes with Warp."""

import re
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import warp as wp
from feature_sets import feature_set
from meshes import quad_sphere

import balloon_warp
from balloon_warp.kernels.adjoints.exchange import exchange_back_kernel
from balloon_warp.kernels.compose import derive_helpers
from balloon_warp.kernels.contact.boxes import meet_kernel
from balloon_warp.kernels.contact.edges import box_edges, query_kernel
from balloon_warp.kernels.contact.free_frames import judge_kernel
from balloon_warp.kernels.contact.response import response_kernel
from balloon_warp.kernels.contact.search import find_kernel, searching_kernel
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.schedules.block import kernel_of_frame
from balloon_warp.kernels.schedules.block_backward import kernel_again, kernel_backwards
from balloon_warp.kernels.schedules.launched import kernel_of
from balloon_warp.kernels.schedules.patches import kernel_of_patches
from balloon_warp.model import Model, build_model
from balloon_warp.scene import Balloon, Inflation, Material, Obstacle, Scene, Water, load_scene
from balloon_warp.schedules.backward_one_launch import plan_backwards
from balloon_warp.schedules.framing import busy_features, free_features
from balloon_warp.schedules.gather import GatherSchedule, cut_into_patches, layout_of_patches, step_of_patches
from balloon_warp.schedules.launched import EDGE_THREADS, TEAM_THREADS, TEAM_THREADS_OF_SMALL
from balloon_warp.schedules.layouts import layout_of, step_of
from balloon_warp.schedules.one_launch import clear_features
from balloon_warp.schedules.tables import model_features

pytestmark = pytest.mark.skipif(sys.platform == "darwin", reason="Warp has no CUDA there")
HOPPER = 90
ROOT = Path(balloon_warp.__file__).parent.parent
GPU = SimpleNamespace(is_cpu=False, is_cuda=True, sm_count=132, max_shared_memory_per_block=226 << 10)
"""The properties of an H100 that layouts ask for"""
IN_A_CORNER = Scene(
    balloon=[Balloon(mesh=quad_sphere(3), position=(2.0, 2.0, 0.0))],
    obstacle=[Obstacle(shape="plane"), Obstacle(shape="plane", rotation=(0.0, 0.0, -90.0))],
)

IN_WATER = Scene(
    balloon=[Balloon(mesh=quad_sphere(3), inflation=Inflation(kind="gas", start_pressure=500.0))], water=Water()
)


def compiled(kernel: Any, threads: int, folder: Path) -> str:
    """Return the code of a kernel."""
    kernel.module.options["block_dim"] = threads
    (path,) = wp.compile_aot_module(kernel.module, arch=HOPPER, module_dir=folder, use_ptx=True)
    return next(Path(path).parent.glob("*.ptx")).read_text()


def files_with_kernels() -> list[str]:
    """Return the modules of the package with kernels that are not made for a scene."""
    roots = {"balloon_warp.kernels": ROOT / "kernels", "balloon_warp": ROOT / "balloon_warp"}
    return [
        ".".join([package, *file.relative_to(root).with_suffix("").parts])
        for package, root in roots.items()
        for file in sorted(root.rglob("*.py"))
        if re.search(r"^@wp\.kernel", file.read_text(), re.MULTILINE)
    ]


def test_files_with_kernels_compile(tmp_path: Path):
    """A file is one unit for the compiler: where a GPU's does not understand a function, it has none of its kernels."""
    modules = [wp.get_module(import_module(name).__name__) for name in files_with_kernels()]
    whole = [module for module in modules if any(not kernel.is_generic for kernel in module.kernels.values())]
    assert len(whole) > 10
    for module in whole:
        assert wp.compile_aot_module(module, arch=HOPPER, module_dir=tmp_path, use_ptx=True)


def model_for_a_gpu(source: Any) -> Model:
    """Return a model that says it is on a GPU."""
    model = build_model(load_scene(source, {"touch": False}), "cpu", 2)
    object.__setattr__(model, "device", GPU)
    return model


def as_it_is(features: Features) -> Features:
    return features


@pytest.mark.parametrize(
    ("source", "frames"),
    [
        ("sphere_launch", as_it_is),
        ("latex_inflate", as_it_is),
        (IN_A_CORNER, busy_features),
        (IN_WATER, as_it_is),
        ("airbag", clear_features),
    ],
    ids=["spheres", "rubber", "near obstacles", "in water", "between searches"],
)
def test_frames_in_blocks_compile(source: Any, frames: Any, tmp_path: Path):
    model = model_for_a_gpu(source)
    features = frames(model_features(model))
    layout = layout_of(model, features)
    kernel = kernel_of_frame(step_of(features, layout), layout)
    assert layout.threads > 1
    assert "bar.sync" in compiled(kernel, layout.threads, tmp_path)


def test_frames_backwards_in_blocks_compile(tmp_path: Path):
    derive_helpers()
    of = plan_backwards(
        model_for_a_gpu(Scene(balloon=[Balloon(mesh=quad_sphere(3), material=Material(preset="latex"))]))
    )
    assert of.layout.held == 1
    assert of.layout_again.held
    for kernel, layout in ((kernel_backwards(of, ()), of.layout), (kernel_again(of), of.layout_again)):
        assert "bar.sync" in compiled(kernel, layout.threads, tmp_path / kernel.key)


def test_free_frames_in_patches_compile(tmp_path: Path):
    """Blocks of a world exchange halos, and watch how far particles go."""
    model = build_model(load_scene("helium_rise"), "cpu")
    object.__setattr__(model, "device", GPU)
    features = free_features(model_features(model))
    patches = cut_into_patches(model, features)
    assert patches
    layout = layout_of_patches(model, features, patches, rings=False)
    text = compiled(kernel_of_patches(step_of_patches(features, layout), layout), layout.threads, tmp_path)
    assert "st.relaxed.gpu.global.b128" in text


def test_edges_that_touch_compile(tmp_path: Path):
    model = build_model(load_scene("knot"), "cpu", 2)
    step = GatherSchedule.step_of(model, model_features(model))
    (piece,) = (each for each in step.pieces if each.name == "worlds_meet")
    assert "bar.red" in compiled(kernel_of(step, piece), EDGE_THREADS, tmp_path)


@pytest.mark.parametrize("name", ["all", "faces"])
def test_launches_of_everything_compile(name: str, tmp_path: Path):
    """Each piece of a substep, and each piece of the search for contacts, of all pairs of things that touch."""
    model = build_model(feature_set(name), "cpu", 2)
    features = model_features(model)
    step = GatherSchedule.step_of(model, features)
    pieces = [each for each in step.pieces if each.item != "launches"]
    kernels = [
        kernel_of(step, each, part) for each in pieces for part in (("part", "parts") if each.sums else ("all",))
    ]
    searches = (meet_kernel, searching_kernel, query_kernel)
    kernels += [make(features) for make in searches if features.touches]
    if features.touches:
        kernels += [box_edges, find_kernel(features, True), response_kernel(features, True, False)]
    assert len(kernels) > 10
    for kernel in kernels:
        assert compiled(kernel, TEAM_THREADS_OF_SMALL, tmp_path / kernel.module.name)


def test_an_exchange_of_momentum_backwards_compiles(tmp_path: Path):
    features = model_features(build_model(load_scene("sphere_launch", {"contact": "impulse"}), "cpu", 2))
    assert features.impulses
    derive_helpers()
    assert "bar.sync" in compiled(exchange_back_kernel(features, ()), TEAM_THREADS, tmp_path)


def test_a_look_ahead_at_what_touches_itself_compiles(tmp_path: Path):
    features = model_features(build_model(load_scene("knot"), "cpu", 2))
    assert features.touches_itself
    assert "judge_worlds" in compiled(judge_kernel(features, looks_at_parts=False), 256, tmp_path)
