"""The rules of glTF 2.0 that our files touch, checked with the standard library alone; a reader that trusts nothing."""

from __future__ import annotations

import json
import math
import struct
from itertools import pairwise

SIZES = {5123: 2, 5125: 4, 5126: 4}
CODES = {5123: "H", 5125: "I", 5126: "f"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Gltf:
    """A binary glTF file, every rule checked as it is read."""

    def __init__(self, data: bytes) -> None:
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data)), "12-byte header"
        assert length % 4 == 0
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON", "the first chunk is JSON"
        assert size % 4 == 0
        text = data[20 : 20 + size]
        assert text.rstrip(b" ").endswith(b"}"), "JSON is filled up with spaces"
        self.json = json.loads(text.decode("utf-8"))
        at = 20 + size
        size, kind = struct.unpack_from("<I4s", data, at)
        assert kind == b"BIN\0"
        assert size % 4 == 0
        assert at + 8 + size == length, "nothing after the second chunk"
        self.binary = data[at + 8 :]
        self.check()

    def check(self) -> None:
        j = self.json
        assert set(j) <= {
            *("asset", "scene", "scenes", "nodes", "meshes", "materials", "animations", "buffers", "bufferViews"),
            "accessors",
        }, "only what the specification names"
        assert j["asset"]["version"] == "2.0"
        (buffer,) = j["buffers"]
        assert "uri" not in buffer
        assert 0 <= len(self.binary) - buffer["byteLength"] <= 3
        self.check_views()
        self.check_accessors()
        self.check_nodes()
        self.check_meshes()
        for animation in j["animations"]:
            self.check_animation(animation)
        assert self.used == set(range(len(j["accessors"]))), "no accessor that nothing uses"

    def check_views(self) -> None:
        end = 0
        for view in self.json["bufferViews"]:
            assert view["byteOffset"] % 4 == 0
            assert view["byteOffset"] >= end, "views do not overlap"
            assert view["byteLength"] >= 1
            end = view["byteOffset"] + view["byteLength"]
            assert view.get("target") in (None, 34962, 34963)
            assert "byteStride" not in view, "packed"
        assert end == self.json["buffers"][0]["byteLength"]

    def check_accessors(self) -> None:
        self.used: set[int] = set()
        self.arrays = []
        views = [accessor["bufferView"] for accessor in self.json["accessors"]]
        assert sorted(views) == list(range(len(self.json["bufferViews"]))), "a view an accessor"
        for accessor in self.json["accessors"]:
            view = self.json["bufferViews"][accessor["bufferView"]]
            width, code = WIDTHS[accessor["type"]], accessor["componentType"]
            assert accessor["count"] >= 1
            assert accessor["count"] * width * SIZES[code] == view["byteLength"]
            flat = struct.unpack_from(f"<{accessor['count'] * width}{CODES[code]}", self.binary, view["byteOffset"])
            assert all(map(math.isfinite, flat))
            rows = [flat[k : k + width] for k in range(0, len(flat), width)]
            self.arrays.append(rows)
            for name, of in (("min", min), ("max", max)):
                if name in accessor:
                    assert accessor[name] == [of(row[k] for row in rows) for k in range(width)], f"exact {name}"

    def accessor(self, index: int, type_: str, component: int, target: int | None) -> dict:
        self.used.add(index)
        accessor = self.json["accessors"][index]
        assert (accessor["type"], accessor["componentType"]) == (type_, component)
        assert self.json["bufferViews"][accessor["bufferView"]].get("target") == target
        return accessor

    def check_nodes(self) -> None:
        nodes, (scene,) = self.json["nodes"], self.json["scenes"]
        assert self.json["scene"] == 0
        children = [child for node in nodes for child in node.get("children", ())]
        assert len(children) == len(set(children)), "a node has one parent"
        assert sorted([*children, *scene["nodes"]]) == list(range(len(nodes))), "a strict tree"
        for node in nodes:
            assert "children" not in node or node["children"], "no empty list"
            assert "matrix" not in node, "nodes that are animated have no matrix"
            assert abs(math.hypot(*node.get("rotation", (0, 0, 0, 1))) - 1) < 1e-6
            assert len(node.get("translation", (0, 0, 0))) == 3
        names = [node["name"] for node in nodes]
        assert all(names)

    def check_meshes(self) -> None:
        meshes = [node["mesh"] for node in self.json["nodes"] if "mesh" in node]
        assert sorted(meshes) == list(range(len(self.json["meshes"])))
        materials = set()
        for mesh in self.json["meshes"]:
            for part in mesh["primitives"]:
                assert set(part["attributes"]) == {"POSITION", "NORMAL"}
                positions = self.accessor(part["attributes"]["POSITION"], "VEC3", 5126, 34962)
                normals = self.accessor(part["attributes"]["NORMAL"], "VEC3", 5126, 34962)
                assert {"min", "max"} <= set(positions)
                assert positions["count"] == normals["count"]
                index = part["indices"]
                component = self.json["accessors"][index]["componentType"]
                assert component in (5123, 5125)
                assert self.accessor(index, "SCALAR", component, 34963)["count"] % 3 == 0
                largest = max(row[0] for row in self.arrays[index])
                assert largest < positions["count"]
                assert largest < {5123: 0xFFFF, 5125: 0xFFFFFFFF}[component], "the largest value restarts a primitive"
                for normal in self.arrays[part["attributes"]["NORMAL"]]:
                    assert abs(math.hypot(*normal) - 1) < 1e-5
                materials.add(part["material"])
        assert materials == set(range(len(self.json["materials"])))
        for material in self.json["materials"]:
            about = material["pbrMetallicRoughness"]
            assert all(
                0 <= v <= 1 for v in (*about["baseColorFactor"], about["metallicFactor"], about["roughnessFactor"])
            )

    def check_animation(self, animation: dict) -> None:
        targets = [(channel["target"]["node"], channel["target"]["path"]) for channel in animation["channels"]]
        assert len(targets) == len(set(targets)), "a property has one channel"
        assert sorted(c["sampler"] for c in animation["channels"]) == list(range(len(animation["samplers"])))
        for channel in animation["channels"]:
            sampler, path = animation["samplers"][channel["sampler"]], channel["target"]["path"]
            times = self.accessor(sampler["input"], "SCALAR", 5126, None)
            assert {"min", "max"} <= set(times)
            values = self.accessor(sampler["output"], {"rotation": "VEC4", "translation": "VEC3"}[path], 5126, None)
            assert sampler["interpolation"] == "LINEAR"
            assert times["count"] == values["count"]
            t = [row[0] for row in self.arrays[sampler["input"]]]
            assert t[0] == 0.0
            assert all(a < b for a, b in pairwise(t)), "strictly increasing"
            if path == "rotation":
                rows = self.arrays[sampler["output"]]
                assert all(abs(math.hypot(*row) - 1) < 1e-6 for row in rows)
                dots = [sum(x * y for x, y in zip(a, b, strict=True)) for a, b in pairwise(rows)]
                assert all(dot > 0.5 for dot in dots), "no jump of sign, no large turn"

    def node(self, name: str) -> int:
        return [node["name"] for node in self.json["nodes"]].index(name)

    def animation(self, name: str) -> dict:
        return next(animation for animation in self.json["animations"] if animation["name"] == name)
