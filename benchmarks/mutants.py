"""Mutants: copies of the source with one small fault each, drawn by a seed.

An operator replaces the text of one node of a file's syntax tree; the rest of the file stays as it is. Docstrings,
comments, annotations, strings, names and raised errors are left alone.
"""

import ast
import random
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from balloon_warp.benchmarks.mutation_operators import OPERATORS, Edit, Signatures, Source


@dataclass(frozen=True)
class Mutant:
    """Fault in one place of one file."""

    stratum: str
    path: str
    """From the root of the tree"""
    line: int
    operator: str
    function: str
    """Dotted name of the function around the place; empty at a file's top"""
    spans: tuple[tuple[int, int], ...]
    """First and last lines of the functions around the place, decorators included, the innermost first"""
    old: str
    new: str
    """Text of the expression or statement before and after"""
    edit: Edit

    @property
    def key(self) -> str:
        """The mutant's name, which stays when lines move."""
        return f"{self.path} {self.function}: {self.old} -> {self.new}"

    def source(self, before: bytes) -> bytes:
        """Return the mutated file, of the file as it was."""
        return before[: self.edit.start] + self.edit.text + before[self.edit.end :]


@dataclass(frozen=True)
class Stratum:
    """Part of the source that has a share of the mutants."""

    name: str
    share: float
    globs: tuple[str, ...]
    """Patterns of its files, from the root of the tree"""

    def files(self, root: Path) -> list[Path]:
        """Return the files, sorted.

        Raises:
            FileNotFoundError: a pattern finds none.
        """
        found = {pattern: list(root.glob(pattern)) for pattern in self.globs}
        if missing := [pattern for pattern, paths in found.items() if not paths]:
            raise FileNotFoundError(f"stratum {self.name}: no file is {missing[0]} in {root}")
        return sorted({path for paths in found.values() for path in paths})


def mutants_of(stratum: str, path: str, text: bytes, signatures: Signatures) -> list[Mutant]:
    """Return all mutants of a file.

    Args:
        stratum: the file's.
        path: the file's, from the root of the tree.
        text: of the file.
        signatures: see `signatures_of`.
    """
    source = Source(text)
    return list(_mutants(stratum, path, source, signatures, source.tree, "", ()))


def _mutants(
    stratum: str, path: str, source: Source, signatures: Signatures, node: ast.AST, function: str,
    spans: tuple[tuple[int, int], ...],
) -> Iterator[Mutant]:  # fmt: skip
    if isinstance(node, ast.FunctionDef):
        first = min([node.lineno, *(each.lineno for each in node.decorator_list)])
        spans = ((first, node.end_lineno or first), *spans)
        function = f"{function}.{node.name}".lstrip(".")
    if isinstance(node, ast.expr | ast.stmt):
        text, begin, end = source.text, source.start(node), source.end(node)
        for operator, find in OPERATORS.items():
            for edit in filter(None, find(node, source, signatures)):
                new = text[begin : edit.start] + edit.text + text[edit.end : end]
                yield Mutant(stratum, path, text.count(b"\n", 0, edit.start) + 1, operator, function, spans,
                             _on_a_line(source.of(node)), _on_a_line(new), edit)  # fmt: skip
    for child in _changeable(node):
        yield from _mutants(stratum, path, source, signatures, child, function, spans)


def _on_a_line(text: bytes) -> str:
    return " ".join(text.decode().split())


def _changeable(node: ast.AST) -> Iterator[ast.AST]:
    """Return a node's children, without annotations, f-strings, words of sentences and raised errors."""
    skipped: list[ast.AST | None] = []
    if isinstance(node, ast.FunctionDef):
        skipped = [node.returns]
    elif isinstance(node, ast.arg | ast.AnnAssign):
        skipped = [node.annotation]
    elif isinstance(node, ast.Assert):
        skipped = [node.msg]
    for child in ast.iter_child_nodes(node):
        if child not in skipped and not isinstance(child, ast.Raise | ast.JoinedStr) and not _is_wording(child):
            yield child


def _is_wording(node: ast.AST) -> bool:
    """Return whether a node chooses between words of a sentence."""
    sides = [node.body, node.orelse] if isinstance(node, ast.IfExp) else []
    texts = [side.value for side in sides if isinstance(side, ast.Constant) and isinstance(side.value, str)]
    return any(isinstance(side, ast.JoinedStr) for side in sides) or any(" " in text for text in texts)


def signatures_of(texts: Sequence[bytes]) -> Signatures:
    """Return the annotations of the parameters of all functions in files, by the functions' names."""
    found: defaultdict[str, list[list[str | None]]] = defaultdict(list)
    for text in texts:
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                types = (each.annotation for each in [*node.args.posonlyargs, *node.args.args])
                found[node.name].append([each and ast.unparse(each) for each in types])
    return found


@cache
def all_mutants(root: Path, strata: tuple[Stratum, ...]) -> Mapping[str, Sequence[Mutant]]:
    """Return all mutants of each stratum of a tree."""
    texts = {path: path.read_bytes() for stratum in strata for path in stratum.files(root)}
    signatures = signatures_of(list(texts.values()))
    return {
        stratum.name: [
            mutant
            for path in stratum.files(root)
            for mutant in mutants_of(stratum.name, path.relative_to(root).as_posix(), texts[path], signatures)
        ]
        for stratum in strata
    }


def draw(root: Path, strata: tuple[Stratum, ...], count: int, seed: int) -> list[Mutant]:
    """Draw mutants: of each stratum by its share, of its operators alike, and at most one a line.

    Args:
        root: of the tree.
        strata: that have the mutants.
        count: of mutants; there are fewer where a stratum has not as many lines.
        seed: the same one draws the same mutants.
    """
    ends = [round(count * sum(each.share for each in strata[: last + 1])) for last in range(len(strata))]
    drawn = []
    for stratum, begin, end in zip(strata, [0, *ends], ends, strict=False):
        chance = random.Random(f"{seed} {stratum.name}")
        left = defaultdict(list)
        for mutant in chance.sample(every := all_mutants(root, strata)[stratum.name], len(every)):
            left[mutant.operator].append(mutant)
        lines: dict[tuple[str, int], str] = {}
        while len(lines) < end - begin and any(left.values()):
            mutant = left[chance.choice([operator for operator in OPERATORS if left[operator]])].pop()
            if (mutant.path, mutant.line) not in lines and mutant.key not in lines.values():
                lines[mutant.path, mutant.line] = mutant.key
                drawn.append(mutant)
    return drawn
