"""Architecture: imports go down, a law stands in one place, and nothing is too long to be read."""

import ast
import ctypes
import re
import sys
import tomllib
from collections.abc import Callable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from balloon_warp.kernels.laws import LAWS
from balloon_warp.kernels.tables import Tables

ROOT = Path(__file__).parent.parent
FOLDERS = ("balloon_warp", "kernels", "scenes", "benchmarks", "tests")
FILES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
TEXTS = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in FILES}
FACE = "balloon_warp/__init__.py"
"""the package's face, which loads each of its names from where it stands, when it is asked for"""


def module_of(path: str) -> str:
    """Return the module name of a file."""
    parts = [part for part in Path(path).with_suffix("").parts if part != "__init__"]
    return ".".join(parts if parts[0] in ("balloon_warp", "tests") else ["balloon_warp", *parts])


MODULES = {module_of(path): path for path in TEXTS if not path.startswith("tests/")}


@cache
def tree_of(path: str) -> ast.Module:
    """Return the tree of a file, once it is asked for: all of them take five seconds."""
    return ast.parse(TEXTS[path])


@cache
def imports_of(path: str) -> tuple[str, ...]:
    """Return the imports of a file, see `imports`."""
    return tuple(imports(tree_of(path), module_of(path)))


def imports(tree: ast.Module, own: str = "") -> Iterator[str]:
    """Find the modules that a file imports: at its top, within functions, for types alone, and by a string.

    Args:
        tree: of the file.
        own: the module that it is, if it is one of ours.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from _imported_from(node, own)
        elif isinstance(node, ast.Call) and _loads_a_module(node):
            yield from _loaded(node, tree)


def _imported_from(node: ast.ImportFrom, own: str) -> Iterator[str]:
    base = own.split(".")
    package = base if MODULES.get(own, "").endswith("__init__.py") else base[:-1]
    above = package[: len(package) - node.level + 1] if node.level else []
    module = ".".join([*above, *([node.module] if node.module else [])])
    inner = [f"{module}.{name.name}" for name in node.names]
    if module == "balloon_warp":  # a name of its face counts as where it is loaded from
        yield from (name if name in MODULES else _homes().get(name, "balloon_warp") for name in inner)
        return
    yield from (name for name in inner if name in MODULES)
    if any(name not in MODULES for name in inner):
        yield module


@cache
def _homes() -> dict[str, str]:
    """Return the module of each name of the package's face."""
    tables = [node for node in tree_of(FACE).body if isinstance(node, ast.Assign)]
    (homes,) = [node.value for node in tables if ast.unparse(node.targets[0]) == "_HOMES"]
    rows = ast.literal_eval(homes).items()
    return {f"balloon_warp.{name}": f"balloon_warp.{module}" for module, names in rows for name in names}


def _loads_a_module(call: ast.Call) -> bool:
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    return name in ("import_module", "__import__")


def _loaded(call: ast.Call, tree: ast.Module) -> Iterator[str]:
    """Find the modules that a call may load.

    A text that begins with a name of ours stands for every module with that beginning whose rest is a text of the
    file."""
    given = call.args[0]
    if isinstance(given, ast.Constant):
        yield str(given.value)
    elif isinstance(given, ast.JoinedStr) and isinstance(given.values[0], ast.Constant):
        begin = str(given.values[0].value)
        texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
        yield from (name for name in MODULES if name.startswith(begin) and name.removeprefix(begin) in texts)
    else:
        yield f"? {ast.unparse(call)}"


def loads(path: str) -> set[str]:
    """Return the files of the package that a file loads, with the packages around each."""
    own, found = module_of(path), set()
    for module in imports_of(path):
        around = [module.rsplit(".", depth)[0] for depth in range(1, module.count(".") + 1)]
        found.update([module, *(package for package in around if not f"{own}.".startswith(f"{package}."))])
    return {MODULES[module] for module in found if module in MODULES} - {path, FACE}


def circle(loads: dict[str, set[str]]) -> list[str]:
    """Find a cycle of files that load each other, in order; empty where there is none."""
    try:
        TopologicalSorter(loads).prepare()
    except CycleError as error:
        return error.args[1][::-1]
    return []


LAYERS = (
    ("errors",),
    ("system", "kernels"),
    ("laws",),
    ("mesh",),
    ("springs", "scene"),
    ("model",),
    ("schedules",),
    ("frame", "solvers"),
    ("steering",),
    ("usd",),
    ("blow_ups",),
    ("simulator",),
    ("run",),
    ("batch",),
    ("farm", "studio"),
    ("tools",),
    ("blender", "learn"),
    ("lab",),
    ("envs",),
    ("benchmarks", "scenes"),
    ("cli",),
)
"""rooms of balloon_warp/, and kernels/, from the bottom up: each imports those in lines above its own, and itself"""
MOST_FILE_LINES = 800
MOST_FUNCTION_LINES = 80
MOST_PARAMETERS = 12
"""that a call has to match up; an option, which has a default and can only be given by its name, is not counted"""


def room(module: str) -> str:
    """Return the file or folder of balloon_warp/ that a module is in."""
    return module.split(".")[1]


def rooms() -> dict[str, str]:
    """Return the room of each file in balloon_warp/; the package's face and its command may import anything."""
    found = {path: Path(path).with_suffix("").parts[1] for path in TEXTS if path.startswith("balloon_warp/")}
    return {path: own for path, own in found.items() if own not in ("__init__", "__main__")}


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Find functions in statements: to look through expressions takes ten times as long."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node
        if isinstance(node, ast.stmt | ast.excepthandler | ast.match_case):
            yield from functions(node)


def is_kernel(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Return whether Warp launches a function: a kernel's parameters are the arrays that it uses, and may be many."""
    return any(ast.unparse(decorator).startswith("wp.kernel") for decorator in function.decorator_list)


def parameter_count(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    named = function.args
    required = sum(default is None for default in named.kw_defaults)
    return len(named.posonlyargs) + len(named.args) + bool(named.vararg) + required + bool(named.kwarg)


def test_imports_go_down() -> None:
    rank = {name: number for number, layer in enumerate(LAYERS) for name in layer}
    upward = [
        f"{path} imports {module}"
        for path, own in rooms().items()
        for module in imports_of(path)
        if module.startswith("balloon_warp.") and room(module) != own and rank[room(module)] >= rank[own]
    ]
    assert not upward, "\n".join(upward)


def test_architecture_names_forty_files() -> None:
    text = (ROOT / "docs/ARCHITECTURE.md").read_text(encoding="utf-8")
    section = text[text.index("## Forty files") : text.index("## From laws to kernels")]
    assert len(set(re.findall(r"\]\(\.\./([\w/]+\.\w+)\)", section))) == 40
    assert text.count("\n") <= 250


def test_nothing_loads_what_loads_it() -> None:
    found = circle({path: loads(path) for path in MODULES.values() if path != FACE})
    assert not found, " loads\n".join(found)
    assert set(circle({"a": {"b"}, "b": {"c", "d"}, "d": {"b"}})) == {"b", "d"}


def test_every_room_has_a_layer() -> None:
    listed = [name for layer in LAYERS for name in layer]
    assert len(listed) == len(set(listed))
    assert set(listed) - {"kernels", "scenes", "benchmarks"} == set(rooms().values())


OF_PHASES = ("balloon_warp.kernels.laws", "balloon_warp.kernels.phases")


def is_not_of_kernels(module: str) -> bool:
    """Return whether a module is neither Python's nor Warp's nor a kernel's."""
    known = {"warp", "?", *sys.stdlib_module_names}
    return not f"{module}.".startswith("balloon_warp.kernels.") and re.split("[. ]", module)[0] not in known


@pytest.mark.parametrize(
    ("folder", "is_wrong"),
    [
        pytest.param("kernels/", is_not_of_kernels, id="kernels import Warp and each other alone"),
        pytest.param(
            "kernels/schedules/", lambda each: each.startswith(OF_PHASES), id="schedules know no phase or law"
        ),
    ],
)
def test_folders_import_what_they_may(folder: str, is_wrong: Callable[[str], bool]) -> None:
    files = [path for path in TEXTS if path.startswith(folder)]
    found = [f"{path} imports {each}" for path in files for each in imports_of(path) if is_wrong(each)]
    assert not found, "\n".join(found)


def too_long(path: str) -> Iterator[str]:
    """Return the parts of a file that are over a limit; the lines of a function are with those of nested ones."""
    if (lines := TEXTS[path].count("\n")) > MOST_FILE_LINES:
        yield f"{path} has {lines} lines"
    for function in functions(tree_of(path)):
        if (length := (function.end_lineno or 0) - function.lineno + 1) > MOST_FUNCTION_LINES:
            yield f"{path}: {function.name} has {length} lines"
        if (count := parameter_count(function)) > MOST_PARAMETERS and not is_kernel(function):
            yield f"{path}: {function.name} has {count} parameters"


def test_nothing_is_too_long_to_be_read() -> None:
    excesses = [excess for path in TEXTS for excess in too_long(path)]
    assert not excesses, "\n".join(excesses)


ALSO_ASKED = {
    "gravity": "spheres fall, too",
    "correction_limit": "correction is no force",
    "air_pressure": "tubes carry gas",
    "air_temperature": "pumps bring air's",
    "air_lapse": "gas is told that there is none",
    "water_level": "which part of a face is wet",
    "damping": "the projective solver takes it implicitly",
}
"""parameters of laws that something else asks for, and why"""


def words(tree: ast.Module) -> set[str]:
    """Return names and texts in a file's code, and names that it imports."""
    found: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.arg(arg=name) | ast.Constant(value=str(name)):
                found.add(name)
            case ast.ImportFrom(names=names):
                found |= {each.name for each in names}
    return found


def test_no_kernel_is_generic() -> None:
    """Warp replays all forms of a kernel in a graph of a CPU as the last that it recorded."""
    found = (each for path, text in TEXTS.items() if path.startswith("kernels/") for each in functions(ast.parse(text)))
    kernels = [each for each in found if is_kernel(each)]
    assert len(kernels) > 50
    generic = [each.name for each in kernels if any("Any" in ast.unparse(arg) for arg in each.args.args)]
    assert generic == []


def test_laws_stand_in_their_folder() -> None:
    parameters = {row.name for law in LAWS for row in law.parameters} - ALSO_ASKED.keys()
    functions = {law.force.func.__name__ for law in LAWS} - {"string", "weight", "damping"}  # usual words, too
    folders = [f"kernels/{name}/" for name in ("loops", "contact", "phases", "schedules")]
    files = [f"kernels/{name}.py" for name in ("substep", "compose", "features", "projective")]
    for path in TEXTS:
        if path.startswith((*folders, *files, "balloon_warp/schedules/")):
            assert not words(tree_of(path)) & (parameters | functions), path


def test_tables_are_small_enough_for_the_compiler_of_a_gpu():
    """The parameter struct of a kernel stays small: for sm_90 the kernel of bodies and particles took 4 s to compile at
    8,008 bytes and 131 s at 8,568 (`Tables` says why)."""
    assert ctypes.sizeof(Tables.ctype) <= 8192


def test_every_package_is_installed() -> None:
    """The list of packages is that of the folders: one that it lacks would be missing in an installation, and one that
    is no folder stops it."""
    packages = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    names = {".".join(Path(file).parent.parts) for file in TEXTS if not file.startswith("tests")}
    assert len(names) > 30
    assert {name if name.startswith("balloon_warp") else f"balloon_warp.{name}" for name in names} == packages
