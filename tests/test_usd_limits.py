"""Stages that ask for too much are refused in a sentence, before USD reads or composes them."""

import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from pxr import Sdf, Usd

from balloon_warp import InputError, check_stage, load_mesh
from balloon_warp.mesh.usd_open import open_stage
from balloon_warp.outputs.render.stage_reader import RenderStage

MESH = """def Mesh "M" {
    int[] faceVertexCounts = [3, 3, 3, 3]
    int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
}
"""


def doubling(levels: int) -> str:
    text = f'def "L0" {{ {MESH} }}\n'
    for level in range(levels):
        both = "".join(f'def "{name}" (references = </L{level}>) {{}}\n' for name in "ab")
        text += f'def "L{level + 1}" {{\n{both}}}\n'
    return text


def chain(length: int) -> str:
    links = "".join(f'def "a{number}" (references = </a{number + 1}>) {{}}\n' for number in range(length))
    return f'{links}def "a{length}" {{}}\n'


def scattered(levels: int) -> str:
    text = f'def "L0" {{ {MESH} }}\n'
    for level in range(levels):
        twice = f"rel prototypes = </L{level}>\n int[] protoIndices = [0, 0]\n"
        text += f'def PointInstancer "L{level + 1}" {{ {twice} }}\n'
    return text


TEXTS = {
    "prims in prims": ('def "a" {\n' * 100_000 + "}\n" * 100_000, "is nested 100,000 deep; expected at most 500"),
    "prims after strings": (
        'def "a" { string b = "}}}\\"}" # }}}}\n' * 1_000 + "}" * 1_000,
        "is nested 1,000 deep; expected at most 500",
    ),
    "dictionaries": (
        f"(customLayerData = {'{ dictionary a = ' * 50_000}{{}}{'}' * 50_000})\n",
        "is nested 50,002 deep; expected at most 500",
    ),
    "numbers": (f'def "a" {{ float b = {"(" * 9_000}1{")" * 9_000} }}', "is nested 9,001 deep; expected at most 500"),
    "references that double": (doubling(25), "has more than 1,000,000 prims with all that references repeat"),
    "instances that double": (scattered(25), "has more than 1,000,000 prims with all that references repeat"),
    "a chain of references": (chain(20_000), "has more than 100 references that follow each other"),
    "a circle": (
        'def "a" (references = </b>) {}\ndef "b" (references = </a>) {}\n',
        "its references go in a circle, through /",
    ),
    "a pipe": ('def "a" (references = @./pipe.usdc@) {}\n', "pipe.usdc: is not a regular file"),
    "a pipe as a payload": ('def "a" (payload = @./pipe.usdc@) {}\n', "pipe.usdc: is not a regular file"),
    "a device as a layer": ("(subLayers = [@./zero.usda@])\n", "zero.usda: is not a regular file"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_stage_that_asks_for_too_much_is_refused(name: str, tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.usdc")
    (tmp_path / "zero.usda").symlink_to("/dev/zero")
    text, said = TEXTS[name]
    (tmp_path / "stage.usda").write_text(f"#usda 1.0\n{text}")
    with pytest.raises(InputError, match=said.replace("(", r"\(")):
        open_stage(tmp_path / "stage.usda")


@pytest.mark.parametrize("read", [load_mesh, RenderStage, lambda path: check_stage(path, device="cpu")])
def test_all_readers_refuse_it(read: Callable[[Path], object], tmp_path: Path):
    (tmp_path / "stage.usda").write_text(f"#usda 1.0\n{doubling(25)}")
    with pytest.raises(InputError, match="has more than 1,000,000 prims"):
        read(tmp_path / "stage.usda")


def test_the_text_in_a_package_is_looked_at(tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "stage.usdz", "w", zipfile.ZIP_STORED) as package:
        package.writestr("stage.usda", "#usda 1.0\n" + 'def "a" {\n' * 100_000)
    with pytest.raises(InputError, match="is nested 100,000 deep"):
        open_stage(tmp_path / "stage.usdz")


def test_prims_of_a_binary_file_in_each_other_are_counted(tmp_path: Path):
    layer = Sdf.Layer.CreateNew(str(tmp_path / "stage.usdc"))
    Sdf.CreatePrimInLayer(layer, f"/{'/'.join('a' * 600)}")
    layer.Save()
    with pytest.raises(InputError, match="has more than 500 prims in each other"):
        open_stage(tmp_path / "stage.usdc")


def test_sublayers_that_multiply_are_refused(tmp_path: Path):
    for number in range(12):
        layers = ", ".join([f"@./s{number + 1}.usda@"] * 2)
        (tmp_path / f"s{number}.usda").write_text(f"#usda 1.0\n(subLayers = [{layers}])\n")
    (tmp_path / "s12.usda").write_text("#usda 1.0\n")
    with pytest.raises(InputError, match="has more than 1,000 sublayers, repeated ones included"):
        open_stage(tmp_path / "s0.usda")


def test_what_real_stages_do_is_not_refused(tmp_path: Path):
    """References into referenced prims, inherited classes, variants, layers beside, and the same many times."""
    (tmp_path / "rock.usda").write_text(f'#usda 1.0\n(defaultPrim = "Rock")\ndef "Rock" {{ {MESH} }}\n')
    (tmp_path / "layer.usda").write_text('#usda 1.0\nover "World" {\n over "a" {\n custom int x = 1\n }\n }\n')
    many = "".join(f'def "r{number}" (instanceable = true\n references = @./rock.usda@) {{}}\n' for number in range(50))
    (tmp_path / "stage.usda").write_text(
        "#usda 1.0\n(subLayers = [@./layer.usda@])\n"
        'class "_kind" {\n double y = 2\n }\n'
        f'def Xform "World" {{\n{many}'
        'def "a" (references = @./rock.usda@\n inherits = </_kind>) {}\n'
        'def "b" (references = </World/a/M>) {}\n'
        'def "c" (variants = { string v = "one" }\n prepend variantSets = "v") {\n'
        '  variantSet "v" = {\n "one" (references = </World/a>) {\n }\n "two" {\n def "d" {}\n }\n }\n }\n}\n'
    )
    mesh = load_mesh(tmp_path / "stage.usda")
    assert (mesh.face_count, mesh.warnings) == (53 * 4, ())
    assert isinstance(open_stage(tmp_path / "stage.usda"), Usd.Stage)
