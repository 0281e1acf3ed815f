"""Files that nobody thought of: those that somebody did, with parts of them changed, as Hypothesis draws them."""

import re
from collections.abc import Sequence

from hypothesis import strategies as st

from balloon_warp.benchmarks.bad_meshes import MESH_CASES
from balloon_warp.scene import bundled_scenes

LARGEST_SEED = 4096
"""bytes; in a small file most changes meet something that counts"""
MESH_PIECES = [
    *b"v f # \\ / - . , e \n \r \t \0 \xff 0 1 9 nan inf 1e400 1e-400 -0 1e18 1e-18 _ +".split(b" "),
    *[b" ", b"\r\n", b"\\\n", b"v 0 0 0\n", b"f 1 2 3\n", b"f -1 -2 -3\n", b"f 1/1/1 2//2 3/3 4\n", b"\xef\xbb\xbf"],
    *[b"4294967297", b"mtllib a\n", b"vn 0 0 1\n", b"l 1 2\n", b"9" * 400, b"\xd9\xa3"],
]
SCENE_PIECES = [
    *b"[ ] { } \" ' = . , # \n \0 \xff 0 1 -1 9 nan inf -inf 1e400 1e-300 1e11 true false 0x10 1979-05-27 _".split(
        b" "
    ),
    *[b"[[balloon]]\n", b"[water]\n", b"[[tube]]\nballoons = [0, 0]\nconductance = 1.0\n", b"9" * 30, b"[" * 2000],
    *[b"balloon.", b"[[change]]\ntime = 0.1\n", b'set = { "balloon.mass" = 0.5 }\n', b"[0.0, 1.0]", b'"gas"', b"[]"],
    *[b'mesh = "/dev/zero"\n', b'mesh = "."\n', b"weld = true\n", b"fixed = [0, 1, 2]\n", b'"projective"', b"{}"],
]


def mesh_seeds() -> list[bytes]:
    """Return the small OBJ files of the table."""
    contents = [case.content() for case in MESH_CASES]
    return [content for content in contents if len(content) <= LARGEST_SEED]


def scene_seeds() -> list[bytes]:
    """Return the bundled scenes, with `cube.obj` for their meshes."""
    contents = [path.read_bytes() for path in bundled_scenes().values()]
    return [re.sub(rb'mesh = "[^"]*"', b'mesh = "cube.obj"', content) for content in contents]


NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.])")
NUMBERS = b"0 1 2 3 -1 -2 5 8 1e-3 0.5 1e-9 1e-18 1e3 1e9 1e11 1e18 1e38 3.5e38 1e300 100000 2147483648".split(b" ")


@st.composite
def mutated(draw: st.DrawFn, seeds: Sequence[bytes], pieces: Sequence[bytes]) -> bytes:
    """Return a random seed file with a few changes, of its numbers or of anything."""
    content = draw(st.sampled_from(seeds))
    for _ in range(draw(st.integers(1, 4))):
        change = draw(st.sampled_from([_other_number, _other_number, _other_parts]))
        content = change(draw, content, pieces)
    return content


def _other_number(draw: st.DrawFn, content: bytes, pieces: Sequence[bytes]) -> bytes:
    found = list(NUMBER.finditer(content))
    if not found:
        return _other_parts(draw, content, pieces)
    old = found[draw(st.integers(0, len(found) - 1))]
    return content[: old.start()] + draw(st.sampled_from(NUMBERS)) + content[old.end() :]


def _other_parts(draw: st.DrawFn, content: bytes, pieces: Sequence[bytes]) -> bytes:
    """Words, lines or characters taken out, put in, moved or repeated."""
    separator = draw(st.sampled_from([b"", b" ", b"\n", b"\n"]))
    parts = content.split(separator) if separator else [content[n : n + 1] for n in range(len(content))]
    place = draw(st.integers(0, len(parts)))
    kept = parts[place : place + draw(st.sampled_from([0, 1, 1, 2, 20]))]
    new = draw(st.one_of(st.sampled_from(pieces), st.just(separator.join(kept)), st.binary(max_size=4)))
    times = draw(st.sampled_from([0, 1, 1, 1, 2, 20, 3000]))
    parts[place : place + len(kept)] = [new] * (times if times * len(new) < 200_000 else 1)
    if draw(st.booleans()):
        parts.insert(draw(st.integers(0, len(parts))), separator.join(kept))
    return separator.join(parts)
