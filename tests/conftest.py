"""Configuration and fixtures of all tests."""

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import warp as wp
from warp._src import context
from xdist.scheduler import LoadScopeScheduling

import balloon_warp

wp.config.log_level = wp.LOG_ERROR
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of the processes that test: two threads each only wait for a core
gc.set_threshold(20_000)  # Warp's code generator makes much that stays, which is else looked through again and again

pytest_plugins = ("page_fixtures",)

CROWDED = (
    *("cluster", "cluster_mistakes", "cluster_room", "envs_processes", "examples", "guard", "kills"),
    *("nonsense", "playground", "repeatable_anywhere", "gradients_workers", "resume_batch_processes"),
    *("trust", "view", "view_look", "view_parts"),
)
"""files of tests that start processes or wait for a page: one process goes through them while others do the rest, or a
machine of two cores is too slow for the clocks that people and networks go by. They also have a core before the rest"""

PHYSICS = (
    *("added_mass", "breathing", "collision", "conservation", "empty", "faces", "fills", "friction", "gas"),
    *("gas_heat", "impulse", "impulse_energy", "membrane_motion", "necks", "obstacles", "softening", "sphere_friction"),
    *("timeline", "touch", "touch_crowds", "touch_deep", "touch_stack", "tubes", "wind"),
)
"""files of tests of physics. On a CPU they run in `scatter` and in `octets`, which people run there, and which has what
touches from `block`: test_matrix.py finds that all schedules give the same, with any two features together"""

LEFT_TO_THE_MATRIX = ("gather", "lanes", "block")
"""schedules that tests of physics leave out on a CPU"""

BRIEF = (
    *("atmosphere", "block_layouts", "collision", "contact", "diagnosis", "euler", "free_frames"),
    *("gas", "gas_heat", "gradients", "gradients_held", "gradients_lanes", "grazing", "health", "law_schedules"),
    *("necks", "obstacles", "odd_meshes", "own_phases", "restore", "setting", "sphere_friction", "times", "tubes"),
    "water",
)
"""files of tests that simulate for a shorter time than it takes to optimize their many kernels: these stay as they are
written, which compiles in a quarter of the time. So do the scenes of methods in test_matrix.py; its bundled scenes, and
all other tests, run what people run"""

OF_METHODS = {
    "test_a_schedule_gives_scatters_trajectory": "",
    "test_corrections_show_in_the_scene_with_everything": "",
    "test_the_scene_with_everything_has_contacts": "everything",
}
"""tests of test_matrix.py of scenes of methods: which scene, where their parameters do not say so"""

PLAYED = ("folded", "tether_scene")
"""files that look at bundled scenes, too"""

LONGEST = ("crowded", "bundled", "matrix", "gradients", "block_layouts")
"""groups of tests"""


class ByGroups(LoadScopeScheduling):
    """Distribution of tests by groups: tests of a group share kernels and simulations, which one process makes once.
    The groups of xdist itself, by marks, are lost in pytest 9.2."""

    def _split_scope(self, nodeid: str) -> str:
        return group_of(nodeid)


def pytest_xdist_auto_num_workers() -> int:
    """Return one more than there are cores: a process on the crowded tests waits for half of the time."""
    return (os.cpu_count() or 1) + 1


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling:
    return ByGroups(config, log)


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "long: simulates for longer than it takes to optimize its kernels")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the longest groups first, so that no process idles at the end, and the brief ones last, so that a process
    changes its level of optimization once."""
    for item in items:
        if is_left_to_the_matrix(item):
            item.add_marker(pytest.mark.skip("test_matrix.py finds that it gives the same"))
    items.sort(key=lambda item: (is_brief(item), group_of(item.nodeid) not in LONGEST))


def group_of(nodeid: str) -> str:
    """Return the group of a test: its file, some files together, or a scene of methods in all schedules, which
    test_matrix.py simulates once in `scatter`."""
    file, _, test = nodeid.partition("::")
    name = Path(file).stem.removeprefix("test_")
    if name == "matrix" and (asked := test.partition("[")[0]) in OF_METHODS:
        return f"matrix {OF_METHODS[asked] or test.rpartition('-')[2]}"
    if name in CROWDED:
        return "crowded"
    # each bundled scene is simulated once, see `played`
    return "bundled" if name.startswith("bundled_") or name in PLAYED else name


def is_left_to_the_matrix(item: pytest.Item) -> bool:
    """Return whether a test is one of physics that a CPU may skip in this schedule."""
    file, call = item.path.stem.removeprefix("test_"), getattr(item, "callspec", None)
    if file not in PHYSICS or call is None or call.params.get("device") != "cpu":
        return False
    ways = (str(call.params.get(name)).partition(",")[0] for name in ("schedule", "way", "layout"))
    return not set(ways).isdisjoint(LEFT_TO_THE_MATRIX)


def is_brief(item: pytest.Item) -> bool:
    """Return whether a test's kernels are compiled unoptimized: all of a brief file, unless marked as `long`."""
    group = group_of(item.nodeid)
    return (group.startswith("matrix ") or group in BRIEF) and not item.get_closest_marker("long")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Set the level of optimization for a test, on a CPU only: the option is shared by both devices."""
    if group_of(item.nodeid) != "crowded" and hasattr(os, "nice") and os.nice(0) == 0:
        os.nice(5)  # for good: those whose clocks go on come first
    compile_at(0 if is_brief(item) and not wp.is_cuda_available() else None)


def compile_at(level: int | None) -> None:
    """Set the level of optimization for all kernels, loaded ones included: two levels round differently."""
    if level == wp.config.optimization_level:
        return
    wp.config.optimization_level = level
    for module in context.user_modules.values():
        module.mark_modified()


@pytest.fixture(params=["cpu", "cuda:0"])
def device(request: pytest.FixtureRequest) -> str:
    """Return each device in turn; tests of the GPU are skipped where there is none."""
    if request.param != "cpu" and not wp.is_cuda_available():
        pytest.skip("needs a GPU")
    return request.param


@pytest.fixture
def gpu() -> wp.Device:
    """Return the first GPU."""
    if not wp.is_cuda_available():
        pytest.skip("needs a GPU")
    return wp.get_device("cuda:0")


@pytest.fixture(params=["gather", "lanes", "octets", "block"])
def schedule(request: pytest.FixtureRequest, device: str) -> str:
    """Return each schedule that is tested against `scatter`, where it runs."""
    if request.param in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{request.param} is for the CPU")
    return request.param


@pytest.fixture(scope="session", autouse=True)
def ctrl_c_of_this_process() -> Iterator[None]:
    """Restore the default SIGINT handler, so that Ctrl-C reaches the tests where a shell has told them to ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session", autouse=True)
def package_of_this_process() -> Iterator[None]:
    """Put the tested package first on the path of every process that a test starts, as an installed copy may be
    another."""
    tested = str(Path(balloon_warp.__path__[0]).resolve().parent)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", tested, prepend=os.pathsep)
        yield
