"""Package as people see it: on Tab, in signatures, in help() and above the mouse in an editor."""

import inspect
import pydoc

import pytest
from meshes import quad_sphere

import balloon_warp as bw
from balloon_warp.errors import InputError
from balloon_warp.scene.hover import unsaid
from balloon_warp.scene.reference import tables
from balloon_warp.scene.schema.field_help import meaning_of
from balloon_warp.shown import plain_docstring
from balloon_warp.solids import MassProperties
from balloon_warp.sweep.batch import BatchSummary

TABLES = list(dict.fromkeys(table for _, table in tables()))
DATACLASSES = (bw.Frame, bw.Trajectories, bw.PolygonMesh, MassProperties, BatchSummary)
PYTHONS = ("Annotated[", "FieldInfo", "_SupportsArray", "numpy.dtype", "model_construct", "__dataclass_fields__")
"""what Python and libraries say and nobody wants to read"""
SIMULATOR = """controls frame_number mass_properties model observations picture read_frame relax reset restore run save
set starts state step stiffness time warnings"""
FRAME = """areas body_poses contacts corners gas_amounts ground_height inflation_forces is_finite meshes net_forces
number obstacle_poses points pressures sphere_positions sphere_velocities stretches string_anchors string_lengths
thrusts time torn velocities volumes water_level"""


@pytest.fixture(scope="module")
def simulator() -> bw.Simulator:
    return bw.Simulator(bw.Scene(balloon=[bw.Balloon(mesh=quad_sphere(2))]), "cpu")


def helped(thing: object) -> str:
    """Return the text of help(), without the lines that it draws."""
    return " ".join(pydoc.render_doc(thing, renderer=pydoc.plaintext).replace("|", " ").split())


def test_tab_offers_what_is_public(simulator: bw.Simulator):
    assert [name for name in dir(bw) if not name.startswith("__")] == sorted(bw.__all__)
    assert dir(simulator) == SIMULATOR.split()
    assert dir(simulator.read_frame()) == FRAME.split()
    assert dir(bw.Ground()) == sorted(bw.Ground.model_fields)
    of_one = ("controls", "frame_number", "model", "observations", "starts", "state")
    assert dir(bw.Simulator) == [name for name in SIMULATOR.split() if name not in of_one]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_help_of_a_table_says_every_field(table: type):
    said = helped(table)
    for name, field in table.model_fields.items():
        default = ", required" if field.is_required() else f" = {' '.join(repr(field.default).split())}"
        assert f"{name}{default}" in said, name
        assert meaning_of(table, name).replace("|", " ").replace("  ", " ") in said, name
    assert not [word for word in PYTHONS if word in said]


@pytest.mark.parametrize("cls", DATACLASSES, ids=lambda cls: cls.__name__)
def test_help_of_a_result_says_every_field(cls: type):
    said = helped(cls)
    names = inspect.signature(cls).parameters
    assert not [name for name in names if f" {name} (" not in said and f" {name} = " not in said]
    assert not [word for word in PYTHONS[:2] + PYTHONS[4:] if word in said]


def test_help_of_a_frame_has_units_and_shapes():
    assert (
        "velocities (list[NDArray[np.float32]]) Velocities of each balloon's particles [m/s], shape (particle_count, 3)"
        in helped(bw.Frame)
    )
    assert "mass = 0.1 (number > 0) Mass of the whole balloon, shared equally by its particles [kg]" in helped(
        bw.Balloon
    )
    assert "position = (0.0, 0.0, 0.0) (3 numbers) Position of the mesh's origin [m]" in helped(bw.Balloon)


@pytest.mark.parametrize("name", [name for name in bw.__all__ if callable(getattr(bw, name))])
def test_signatures_are_short(name: str):
    """A function's signature has its types; that of the longest, `animate`, fits into ten lines."""
    found = getattr(bw, name)
    if not (inspect.isclass(found) and issubclass(found, Exception)):
        signature = str(inspect.signature(found))
        assert len(signature) < (1000 if inspect.isfunction(found) else 500)
        assert not [word for word in PYTHONS if word in signature]


def test_what_is_written_stays_what_it_is():
    """The plain docstring is that of the source, and a table of wrong fields gets an error."""
    assert plain_docstring(bw.Ground).splitlines()[0] == (bw.Ground.__doc__ or "").splitlines()[0]
    assert "Fields:" not in plain_docstring(bw.Ground)
    with pytest.raises(InputError, match="unknown field; did you mean height"):
        bw.Ground(heigt=1.0)


def test_editors_show_what_each_field_is():
    """Each field has its description below it, as `python -m balloon_warp.scene.hover` writes it."""
    assert [f"{table.__name__}.{field}: {meaning}" for table, field, meaning in unsaid()] == []
