"""That the code is built as it is said to be: imports go down, a law stands in one place, and nothing is too long to be
read."""

import ast
import ctypes
import sys
from collections.abc import Iterator
from pathlib import Path

from balloon_warp.kernels.laws import LAWS
from balloon_warp.kernels.tables import Tables

ROOT = Path(__file__).parent.parent
FOLDERS = ("balloon_warp", "kernels", "scenes", "benchmarks", "tests")
FILES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
TREES = {path.relative_to(ROOT).as_posix(): ast.parse(path.read_text(encoding="utf-8")) for path in FILES}

LAYERS = (
    ("garbage", "temporaries"),
    ("kernels", "errors", "quiet", "driver", "shown"),
    ("files", "turns", "launching", "interrupts", "laws", "meant", "beginning"),
    ("device",),
    ("mesh",),
    ("springs", "scene", "foil"),
    ("model", "provenance"),
    ("schedules", "advice", "inspection", "solids", "statics", "swelling"),
    ("solvers", "frame"),
    ("reading",),
    ("blow_ups", "outputs", "endings", "frame_reader"),
    ("display",),
    ("running",),
    ("steering",),
    ("simulator",),
    ("resume",),
    ("job",),
    ("sweep", "viewer"),
    ("comparison", "trajectories", "warming", "doctor"),
    ("designing",),
    ("benchmarks", "scenes"),
    ("cli",),
)
"""what stands in balloon_warp/, and kernels/, from the bottom up: each imports what is in the lines above its own, and
itself"""

MOST_FILE_LINES = 300
MOST_FUNCTION_LINES = 80
MOST_PARAMETERS = 12
"""that a call has to match up; an option, which has a default and can only be given by its name, is not counted"""


def imports(tree: ast.Module) -> Iterator[str]:
    """The modules that a file imports, wherever in it; of a name from the package itself, that."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = f"{'.' * node.level}{node.module or ''}"
            yield from (f"{module}.{name.name}" for name in node.names) if module == "balloon_warp" else (module,)


def room(module: str) -> str:
    """The file or folder of balloon_warp/ that a module is in."""
    return module.split(".")[1]


def rooms() -> dict[str, str]:
    """Of each file in balloon_warp/ the room; the package's face and its command may import anything."""
    found = {path: Path(path).with_suffix("").parts[1] for path in TREES if path.startswith("balloon_warp/")}
    return {path: own for path, own in found.items() if own not in ("__init__", "__main__")}


def functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    return (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def is_kernel(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether Warp launches it: a kernel's parameters are the arrays that it reads and writes, and may be many."""
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
        for module in imports(TREES[path])
        if module.startswith("balloon_warp.") and room(module) != own and rank[room(module)] >= rank[own]
    ]
    assert not upward, "\n".join(upward)


def test_every_room_has_a_layer() -> None:
    named = [name for layer in LAYERS for name in layer]
    assert len(named) == len(set(named))
    assert set(named) - {"kernels", "scenes", "benchmarks"} == set(rooms().values())


def test_kernels_import_warp_and_each_other_alone() -> None:
    others = [
        f"{path} imports {module}"
        for path, tree in TREES.items()
        for module in imports(tree)
        if path.startswith("kernels/")
        and not f"{module}.".startswith("balloon_warp.kernels.")
        and module.split(".")[0] not in {"warp", *sys.stdlib_module_names}
    ]
    assert not others, "\n".join(others)


def own_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function beside those of the functions and structs that it makes, which are looked at themselves."""
    parts: list[ast.AST] = [function]
    lines = (function.end_lineno or 0) - function.lineno + 1
    while parts:
        for node in ast.iter_child_nodes(parts.pop()):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
                lines -= (node.end_lineno or 0) - first + 1
            else:
                parts.append(node)
    return lines


def too_long(path: str) -> Iterator[str]:
    """What of a file is over a limit."""
    if (lines := (ROOT / path).read_text(encoding="utf-8").count("\n")) > MOST_FILE_LINES:
        yield f"{path} has {lines} lines"
    for function in functions(TREES[path]):
        if (length := own_lines(function)) > MOST_FUNCTION_LINES:
            yield f"{path}: {function.name} has {length} lines"
        if (count := parameter_count(function)) > MOST_PARAMETERS and not is_kernel(function):
            yield f"{path}: {function.name} has {count} parameters"


def test_nothing_is_too_long_to_be_read() -> None:
    excesses = [excess for path in TREES for excess in too_long(path)]
    assert not excesses, "\n".join(excesses)


def test_who_executes_a_list_of_phases_knows_none() -> None:
    """`block`, `lanes` and `patches` still call theirs one by one."""
    known = [
        f"{path} imports {module}"
        for path, tree in TREES.items()
        for module in imports(tree)
        if path.startswith("kernels/schedules/launched/")
        and module.startswith(("balloon_warp.kernels.laws", "balloon_warp.kernels.phases"))
    ]
    assert not known, "\n".join(known)


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
    """Names and texts in a file's code, and what it imports by name."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            found.add(node.id)
        elif isinstance(node, ast.arg):
            found.add(node.arg)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
        elif isinstance(node, ast.ImportFrom):
            found |= {name.name for name in node.names}
    return found


def test_laws_stand_in_their_folder() -> None:
    """Nothing that simulates knows a law's parameters, or calls its function by name."""
    parameters = {row.name for law in LAWS for row in law.parameters} - ALSO_ASKED.keys()
    functions = {law.force.func.__name__ for law in LAWS} - {"string", "weight", "damping"}  # usual words, too
    folders = (
        "kernels/loops/",
        "kernels/contact/",
        "kernels/phases/",
        "kernels/schedules/",
        "kernels/solvers/",
        "balloon_warp/schedules/",
    )
    for path, tree in TREES.items():
        if path.startswith(folders) or path in ("kernels/substep.py", "kernels/compose.py", "kernels/traits.py"):
            assert not words(tree) & (parameters | functions), path


def test_tables_are_small_enough_for_the_compiler_of_a_gpu():
    """`Tables` says why. For sm_90 the kernel of bodies and particles took 4 s at 8,008 bytes and 131 s at 8,568."""
    assert ctypes.sizeof(Tables.ctype) <= 8192
