"""Import graph of the repository's files, and its cycles."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
FOLDERS = ("balloon_warp", "kernels", "scenes", "benchmarks", "tests")
FILES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
TREES = {path.relative_to(ROOT).as_posix(): ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
FACE = "balloon_warp/__init__.py"
"""the package's face, which loads each of its names from where it stands, when it is asked for"""


def module_of(path: str) -> str:
    """Return the module name of a file."""
    parts = [part for part in Path(path).with_suffix("").parts if part != "__init__"]
    return ".".join(parts if parts[0] in ("balloon_warp", "tests") else ["balloon_warp", *parts])


MODULES = {module_of(path): path for path in TREES if not path.startswith("tests/")}


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
        yield from (name if name in MODULES else _home(name) for name in inner)
        return
    yield from (name for name in inner if name in MODULES)
    if any(name not in MODULES for name in inner):
        yield module


@cache
def _homes() -> dict[str, str]:
    """Return the module of each name of the package's face."""
    tables = [node.value for node in TREES[FACE].body if isinstance(node, ast.Assign) and _named(node) == "_HOMES"]
    return {f"balloon_warp.{name}": f"balloon_warp.{module}"
            for module, names in ast.literal_eval(tables[0]).items() for name in names}  # fmt: skip


def _named(node: ast.Assign) -> str:
    return ast.unparse(node.targets[0])


def _home(name: str) -> str:
    return _homes().get(name, "balloon_warp")


def _loads_a_module(call: ast.Call) -> bool:
    return ast.unparse(call.func).split(".")[-1] in ("import_module", "__import__")


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


def unknown_imports() -> list[str]:
    """Find the files that load a module by a name that is not written in them."""
    return sorted({path for path, tree in TREES.items() for name in imports(tree) if name.startswith("?")})


def graph() -> dict[str, set[str]]:
    """Return the modules of the package that each file loads, with the packages around each."""
    return {path: _loads(path) for path in MODULES.values() if path != FACE}


def _loads(path: str) -> set[str]:
    own, found = module_of(path), set()
    for module in imports(TREES[path], own):
        around = [module.rsplit(".", depth)[0] for depth in range(1, module.count(".") + 1)]
        found.update([module, *(package for package in around if not f"{own}.".startswith(f"{package}."))])
    return {MODULES[module] for module in found if module in MODULES} - {path, FACE}


def circle(loads: dict[str, set[str]]) -> list[str]:
    """Find a cycle of files that load each other, in order; empty where there is none."""
    done: set[str] = set()

    def follow(path: str, way: list[str]) -> list[str]:
        if path in way:
            return [*way[way.index(path) :], path]
        if path in done:
            return []
        for other in sorted(loads.get(path, ())):
            if found := follow(other, [*way, path]):
                return found
        done.add(path)
        return []

    return next((found for path in sorted(loads) if (found := follow(path, []))), [])
