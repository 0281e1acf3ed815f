"""Instances of a USD stage, each as a prim of its own, in memory: those of PointInstancers, and native ones."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from balloon_warp.errors import InputError

MOST_INSTANCES = 100_000
"""Largest number of instances of all PointInstancers of a stage"""
PLACED_BY = ("positions", "orientations", "scales", "velocities", "angularVelocities", "accelerations", "invisibleIds")
"""Attributes of a PointInstancer whose samples move its instances"""


class Scattered(NamedTuple):
    """Instances of a PointInstancer."""

    path: Sdf.Path
    prototypes: list[Sdf.Path]
    """Prototype of each instance"""
    matrices: list[tuple[Usd.TimeCode, Vt.Matrix4dArray]]
    """Places of all instances at each sample, or by default"""
    seen: list[tuple[Usd.TimeCode, NDArray[np.bool_]]]
    """Visibility of the instances at each sample, or by default"""
    children: list[str]
    """Names of the prims below, which are not shown themselves"""


def share_nothing(stage: Usd.Stage, is_changed: Callable[[Usd.Prim], bool]) -> None:
    """Give native instances that have such prims below them prims of their own, which can be changed."""
    every = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)
    while True:
        shared = [each for each in stage.GetPrototypes() if any(map(is_changed, Usd.PrimRange(each, every)))]
        with Sdf.ChangeBlock():
            for instance in (each for prototype in shared for each in prototype.GetInstances()):
                if not instance.IsInPrototype():
                    Sdf.CreatePrimInLayer(stage.GetSessionLayer(), instance.GetPath()).instanceable = False
        if not shared:
            return


def expand_instancers(stage: Usd.Stage, source: str) -> list[str]:
    """Put a prim in the place of each instance of the stage's PointInstancers, which become transforms around them.

    Returns:
        Sentences on PointInstancers that could not be taken.

    Raises:
        InputError: there are too many instances.
    """
    scattered, sentences, count = [], [], 0
    for prim in stage.TraverseAll():
        if instancer := UsdGeom.PointInstancer(prim):
            try:
                found = _scattered(instancer)
            except ValueError as error:
                sentences.append(f"Left out of the stage: {prim.GetPath()} (PointInstancer: {error}).")
                continue
            scattered.append(found)
            count += len(found.prototypes)
    if count > MOST_INSTANCES:
        raise InputError(f"{source}: its PointInstancers have {count:,} instances; expected at most {MOST_INSTANCES:,}")
    with Sdf.ChangeBlock():
        for each in scattered:
            _write(stage.GetSessionLayer(), each)
    return sentences


def _scattered(instancer: UsdGeom.PointInstancer) -> Scattered:
    """Read the instances of a PointInstancer.

    Raises:
        ValueError: its attributes do not fit together, or its instances come and go.
    """
    own, prim = instancer.GetProtoIndicesAttr(), instancer.GetPrim()
    if len({tuple(own.Get(time) or ()) for time in own.GetTimeSamples()}) > 1:
        raise ValueError("its protoIndices change")
    samples = {time for name in PLACED_BY for time in prim.GetAttribute(name).GetTimeSamples()}
    times = [Usd.TimeCode(time) for time in sorted(samples)]
    numbers = np.array(own.Get(Usd.TimeCode.EarliestTime()) or (), np.int64)
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    if ((numbers < 0) | (numbers >= len(targets))).any():
        raise ValueError(f"its protoIndices do not match its {len(targets)} prototypes")
    matrices, seen = [], []
    for time in times or [Usd.TimeCode.Default()]:
        placed = instancer.ComputeInstanceTransformsAtTime(
            time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        )
        if len(placed) != len(numbers):
            raise ValueError(f"it places {len(placed)} instances of {len(numbers)}")
        mask = np.array(instancer.ComputeMaskAtTime(time) or np.ones(len(numbers)), bool)
        matrices.append((time, placed))
        seen.append((time, mask))
    children = [each.GetName() for each in prim.GetAllChildren()]
    return Scattered(prim.GetPath(), [targets[each] for each in numbers.tolist()], matrices, seen, children)


def _write(layer: Sdf.Layer, scattered: Scattered) -> None:
    around = Sdf.CreatePrimInLayer(layer, scattered.path)
    around.typeName = "Xform"
    for name in scattered.children:
        Sdf.CreatePrimInLayer(layer, scattered.path.AppendChild(name)).active = False
    hidden = ~np.array([mask for _, mask in scattered.seen])
    for number, prototype in enumerate(scattered.prototypes):
        if hidden[:, number].all():
            continue
        name = f"{prototype.name}_{number}"
        while name in scattered.children:
            name += "_"
        place = Sdf.PrimSpec(around, name, Sdf.SpecifierDef, "Xform")
        order = Sdf.AttributeSpec(place, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform)
        order.default = Vt.TokenArray(["xformOp:transform"])
        matrix = Sdf.AttributeSpec(place, "xformOp:transform", Sdf.ValueTypeNames.Matrix4d)
        for time, matrices in scattered.matrices:
            _set(layer, matrix, time, Gf.Matrix4d(matrices[number]))
        if hidden[:, number].any():
            visibility = Sdf.AttributeSpec(place, "visibility", Sdf.ValueTypeNames.Token)
            for time, mask in scattered.seen:
                _set(layer, visibility, time, "inherited" if mask[number] else "invisible")
        copy = Sdf.PrimSpec(place, prototype.name, Sdf.SpecifierDef)
        copy.active = True
        copy.referenceList.prependedItems = [Sdf.Reference("", prototype)]


def _set(layer: Sdf.Layer, attribute: Sdf.AttributeSpec, time: Usd.TimeCode, value: object) -> None:
    if time.IsDefault():
        attribute.default = value
    else:
        layer.SetTimeSample(attribute.path, time.GetValue(), value)
