"""The container of glTF: arrays come back, and the rules that its files are held to do catch what breaks them."""

import json
import struct

import numpy as np
import pytest

import armwright as aw
from armwright.pictures.arm_glb import animated_arm
from armwright.pictures.glb_container import Arrays, container
from pictures.gltf_rules import Gltf


def parts(data):
    """The JSON and the binary chunk, by the standard library."""
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def joined(document, binary):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


@pytest.fixture(scope="module")
def file():
    arm = aw.load("two-link")
    t = np.linspace(0, 1, 11)
    return animated_arm(arm, t, {"run": np.column_stack([np.sin(3 * t), t])})


def test_arrays_come_back():
    arrays = Arrays()
    points = np.random.default_rng(0).normal(size=(5, 3))
    few, many = np.array([[0, 1, 2]]), np.array([[0, 1, 70_000]])
    places = [arrays.vertices(points, bounds=True), arrays.triangles(few), arrays.triangles(many)]
    places.append(arrays.samples(np.array([0.0, 0.1]), bounds=True))
    document, binary = parts(container({"asset": {"version": "2.0"}}, arrays))
    kinds = [document["accessors"][k]["componentType"] for k in places]
    assert kinds == [5126, 5123, 5125, 5126]
    found = []
    for accessor, view in zip(document["accessors"], document["bufferViews"], strict=True):
        kind = {5126: "<f4", 5123: "<u2", 5125: "<u4"}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        assert view["byteOffset"] % 4 == 0
        found.append(np.frombuffer(binary, kind, accessor["count"] * width, view["byteOffset"]).reshape(-1, width))
    assert np.array_equal(found[0], points.astype(np.float32))
    assert found[1].ravel().tolist() == [0, 1, 2]
    assert found[2].ravel().tolist() == [0, 1, 70_000]
    assert document["accessors"][places[3]]["max"] == [float(np.float32(0.1))]


def test_the_largest_short_is_no_index():
    arrays = Arrays()
    arrays.triangles(np.array([[0, 1, 0xFFFE]]))
    arrays.triangles(np.array([[0, 1, 0xFFFF]]))
    assert [accessor["componentType"] for accessor in arrays.accessors] == [5123, 5125]


def test_the_rules_let_a_whole_file_pass(file):
    document, binary = parts(file)
    gltf = Gltf(joined(document, binary))
    assert gltf.json == document
    assert [len(array) for array in gltf.arrays] == [accessor["count"] for accessor in document["accessors"]]


def _times(document):
    return document["animations"][0]["samplers"][0]["input"]


BROKEN = {
    "bounds that are not exact": lambda d: d["accessors"][_times(d)]["max"].__setitem__(0, 0.99),
    "no bounds": lambda d: d["accessors"][_times(d)].pop("min"),
    "a view that is not aligned": lambda d: d["bufferViews"][1].update(
        byteOffset=d["bufferViews"][1]["byteOffset"] + 2
    ),
    "a view for something else": lambda d: d["bufferViews"][0].update(target=34963),
    "a count too large": lambda d: d["accessors"][0].update(count=d["accessors"][0]["count"] + 1),
    "a node with two parents": lambda d: d["nodes"][1]["children"].append(3),
    "a rotation that is none": lambda d: d["nodes"][2].update(rotation=[0, 0, 0, 1.1]),
    "two channels for one joint": lambda d: d["animations"][0]["channels"][1]["target"].update(node=2),
    "a sampler that nothing uses": lambda d: d["animations"][0]["channels"].pop(),
    "positions without bounds": lambda d: d["accessors"][0].pop("max"),
    "an empty list": lambda d: d["nodes"][-1].update(children=[]),
    "an unknown key": lambda d: d.update(extra=1),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_the_rules_see(fault, file):
    document, binary = parts(file)
    BROKEN[fault](document)
    with pytest.raises(AssertionError):
        Gltf(joined(document, binary))


def test_the_rules_see_times_that_stand_still_and_signs_that_jump(file):
    document, binary = parts(file)
    sampler = document["animations"][0]["samplers"][0]
    times, turns = (
        document["bufferViews"][document["accessors"][sampler[k]]["bufferView"]] for k in ("input", "output")
    )
    still, jumps = bytearray(binary), bytearray(binary)
    still[times["byteOffset"] + 8 : times["byteOffset"] + 12] = still[times["byteOffset"] + 4 : times["byteOffset"] + 8]
    with pytest.raises(AssertionError, match="strictly increasing"):
        Gltf(joined(document, bytes(still)))
    for k in range(4):
        at = turns["byteOffset"] + 16 + 4 * k
        struct.pack_into("<f", jumps, at, -struct.unpack_from("<f", jumps, at)[0])
    with pytest.raises(AssertionError, match="jump of sign"):
        Gltf(joined(document, bytes(jumps)))
