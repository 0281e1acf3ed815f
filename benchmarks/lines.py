"""Size of the house: files, lines, closures and wide functions; and lines of the kernel half by kind, a row a folder.

python -m balloon_warp.benchmarks.lines
"""

import ast
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import balloon_warp
import balloon_warp.kernels

KINDS = ("bodies", "signatures", "imports", "docstrings", "comments", "blank")
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef)


def kinds_of(text: str) -> Counter[str]:
    """Return how many lines of a file are of each kind, with its functions and all of its lines."""
    tree, lines = ast.parse(text), text.splitlines()
    kinds = ["bodies"] * (len(lines) + 1)
    found = Counter({"functions": 0, "lines": len(lines)})
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            _mark(kinds, node, "imports")
        if isinstance(node, ast.FunctionDef):
            found["functions"] += 1
            begin = min([node.lineno, *(each.lineno for each in node.decorator_list)])
            kinds[begin : node.body[0].lineno] = ["signatures"] * (node.body[0].lineno - begin)
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
            _mark(kinds, node.body[0], "docstrings")
    for number, line in enumerate(lines, 1):
        if kinds[number] == "bodies" and not line.strip():
            kinds[number] = "blank"
        elif kinds[number] == "bodies" and line.lstrip().startswith("#"):
            kinds[number] = "comments"
    return found + Counter(kinds[1:])


def _mark(kinds: list[str], node: ast.stmt, kind: str) -> None:
    """Note the kind of a node's lines."""
    for number in range(node.lineno, (node.end_lineno or node.lineno) + 1):
        kinds[number] = kind


def folders() -> dict[str, Counter[str]]:
    """Return the counts of each folder of the kernels, with its files."""
    found: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for place in balloon_warp.kernels.__path__:
        root = Path(place)
        for path in sorted(root.rglob("*.py")):
            inside = path.relative_to(root).parts
            found[inside[0] if len(inside) > 1 else "beside them"] += kinds_of(path.read_text()) + Counter(files=1)
    return dict(found)


ROOMS = ("farm", "studio", "tools", "blender", "learn", "lab", "cli", "envs.py")
"""Folders beside the core"""
BESIDE = ("kernels", "scenes", "benchmarks")
"""Folders that an installed package has inside, and a source tree beside it"""
SMALL, WIDE = 60, 8
"""Lines of a small file, and parameters of a wide function"""
TWO_FRAMES = """
import sys
import balloon_warp
frames = balloon_warp.Simulator("squirrel_tether").run()
for _ in range(3):
    next(frames)
print(sum(name.startswith("balloon_warp") for name in sys.modules))
"""
"""The start and two frames; prints the number of our modules that they load"""


def house() -> dict[str, int]:
    """Return the size of the package and its kernels: files, lines, functions."""
    root = Path(balloon_warp.__path__[0])
    package = {path.relative_to(root): path.read_text() for path in root.rglob("*.py")}
    package = {path: text for path, text in package.items() if path.parts[0] not in BESIDE}
    kernels = {path: path.read_text() for place in balloon_warp.kernels.__path__ for path in Path(place).rglob("*.py")}
    core = [text for path, text in package.items() if path.parts[0] not in ROOMS]
    both = [*package.items(), *kernels.items()]
    functions = [each for _, text in both for each in _functions(ast.parse(text))]
    warp = [nested for node, nested in functions if _is_of_warp(node)]
    ran = subprocess.run([sys.executable, "-c", TWO_FRAMES], check=True, capture_output=True, text=True)
    return {
        "files of the package": len(package),
        "files of kernels": len(kernels),
        f"files below {SMALL} lines, but `__init__`": sum(
            text.count("\n") < SMALL for path, text in both if path.name[:2] != "__"
        ),
        "lines of the package": sum(text.count("\n") for text in package.values()),
        "lines of kernels": sum(text.count("\n") for text in kernels.values()),
        "lines of the core, with kernels": sum(text.count("\n") for text in [*core, *kernels.values()]),
        "our modules in a run of two frames": int(ran.stdout),
        "functions of Warp": len(warp),
        "of which closures": sum(warp),
        f"functions of {WIDE} parameters and more, but kernels": sum(
            _width(node) >= WIDE for node, _ in functions if not _is_kernel(node)
        ),
    }


def _functions(tree: ast.AST, nested: bool = False) -> Iterator[tuple[ast.FunctionDef, bool]]:
    """Find functions, and whether each is within another."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            yield node, nested
        yield from _functions(node, nested or isinstance(node, ast.FunctionDef))


def _is_kernel(node: ast.FunctionDef) -> bool:
    return any(ast.unparse(each).startswith("wp.kernel") for each in node.decorator_list)


def _is_of_warp(node: ast.FunctionDef) -> bool:
    return any(ast.unparse(each).startswith(("wp.func", "wp.kernel")) for each in node.decorator_list)


def _width(node: ast.FunctionDef) -> int:
    return len([*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs])


def main() -> None:
    """Print both tables."""
    print("| what | count |\n|---|---|")
    for what, count in house().items():
        print(f"| {what} | {count:,} |")
    print()
    columns = ("files", "functions", "lines", *KINDS)
    print(f"| folder | {' | '.join(columns)} |\n|{'---|' * (len(columns) + 1)}")
    every = folders()
    every["all"] = sum(every.values(), Counter())
    for folder, counts in every.items():
        print(f"| {folder} | {' | '.join(f'{counts[each]:,}' for each in columns)} |")


if __name__ == "__main__":
    main()
