"""Reader of .glb files by the specification alone: nothing here is of the package."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np


class Glb:
    """Contents of a .glb file, and its arrays."""

    def __init__(self, path: Path):
        data = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        self.said: dict[str, Any] = json.loads(data[20 : 20 + size])
        binary, kind = struct.unpack_from("<I4s", data, 20 + size)
        self.said: dict[str, Any] = json.loads(data[20 : 20 + size])
        json.dumps(self.said, allow_nan=False)  # JSON has no NaN
        assert 28 + size + binary == length
        self.binary = data[28 + size :]
        self.nodes = {node["name"]: node for node in self.said["nodes"]}

    def array(self, number: int) -> np.ndarray:
        """Return the numbers of an accessor."""
        accessor = self.said["accessors"][number]
        view = self.said["bufferViews"][accessor["bufferView"]]
        columns = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        kind = {5126: np.float32, 5125: np.uint32}[accessor["componentType"]]
        assert view["byteLength"] == accessor["count"] * columns * 4
        values = np.frombuffer(self.binary, kind, accessor["count"] * columns, view["byteOffset"])
        values = values.reshape(-1, columns)
        if "min" in accessor:
            np.testing.assert_array_equal(values.min(axis=0), np.float32(accessor["min"]))
            np.testing.assert_array_equal(values.max(axis=0), np.float32(accessor["max"]))
        return values

    def channels(self, name: str) -> dict[str, tuple[np.ndarray, np.ndarray, str]]:
        """Return a node's channels by their targets: times, values, and interpolation."""
        [animation] = self.said["animations"]
        found = {}
        for channel in animation["channels"]:
            if self.said["nodes"][channel["target"]["node"]]["name"] == name:
                sampler = animation["samplers"][channel["sampler"]]
                times, values = self.array(sampler["input"])[:, 0], self.array(sampler["output"])
                found[channel["target"]["path"]] = times, values, sampler["interpolation"]
        return found

    def primitive(self, name: str) -> dict[str, Any]:
        return self.said["meshes"][self.nodes[name]["mesh"]]["primitives"][0]

    def shapes(self, name: str, attribute: str = "POSITION") -> np.ndarray:
        """Return the shapes of a mesh at each keyframe's weights, shape (keyframes, vertex_count, 3)."""
        primitive = self.primitive(name)
        rest = self.array(primitive["attributes"][attribute]).astype(np.float64)
        moves = np.array([self.array(target[attribute]) for target in primitive["targets"]], np.float64)
        times, weights, how = self.channels(name)["weights"]
        assert how == "LINEAR"
        return rest + np.einsum("ft,tvi->fvi", weights.reshape(len(times), -1), moves)
