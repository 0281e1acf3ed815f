"""Lines of the kernel half by kind, a row a folder.

python -m balloon_warp.benchmarks.lines
"""

import ast
from collections import Counter, defaultdict
from pathlib import Path

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


def main() -> None:
    """Print the table."""
    columns = ("files", "functions", "lines", *KINDS)
    print(f"| folder | {' | '.join(columns)} |\n|{'---|' * (len(columns) + 1)}")
    every = folders()
    every["all"] = sum(every.values(), Counter())
    for folder, counts in every.items():
        print(f"| {folder} | {' | '.join(f'{counts[each]:,}' for each in columns)} |")


if __name__ == "__main__":
    main()
