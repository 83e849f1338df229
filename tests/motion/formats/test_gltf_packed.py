"""glTF with compressed and sparse data.

The compressed bytes are those that meshoptimizer 1.3 makes of numbers that the test knows or states.
"""

from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import FormatError
from muybridge.motion.formats.gltf.container import Buffer, Document, pack_glb
from muybridge.motion.formats.gltf.meshopt import decode_meshopt
from muybridge.motion.formats.gltf.read import read_gltf

# Mode, filter, elements, bytes of one, compressed, and decoded (as meshoptimizer decodes; "": by a formula below).
PACKED = [
    ("ATTRIBUTES", "NONE", 20, 8,
        "a000053befbefb979c979c979c979c979cef000000979c970700d408c3d408c3d408c3d408c3d408c3ff000000d408c3"
        "d407002bc24fcb22ef947d700be22fab42cfff000000b45d90140700472088472088472088472088472088ff00000047"
        "2088470700cf32cbcf32cbcf32cbcf32cbcf32cbff000000cf32cbcf0700ac481bac481bac481bac481bac481bff0000"
        "00ac481bac07002c62982c62982c62982c62982c6298ff0000002c62982c000000000000000000000000000000000000"
        "000000000000004d9ae73481ce1b",
        ""),
    ("TRIANGLES", "NONE", 105, 2,
        "e1fe1e100e100e100ece1e160e150e140ece1e140e140e140ece1e140e140e140effffff0f0aff8401ad0186013202f5"
        "8d0118007687566778a9866589689801690000",
        "000001000500050001000600060001000200060002000700070002000300070003000800080003000400080004000900"
        "050006000a000a0006000b000b00060007000b0007000c000c00070008000c0008000d000d00080009000d0009000e00"
        "0a000b000f000f000b00100010000b000c0010000c00110011000c000d0011000d00120012000d000e0012000e001300"
        "0f0010001400140010001500150010001100150011001600160011001200160012001700170012001300170013001800"
        "5a000300460047005a00030000000c001800"),
    ("INDICES", "NONE", 10, 4,
        "d114040481b5180404052204c3a90700000000",
        "050000000600000007000000a08601000800000009000000a1860100000000000100000070110100"),
    ("ATTRIBUTES", "OCTAHEDRAL", 6, 4,
        "a0013ef00000ca61fb05013ff00000e24acdfc6d00000000000000000000000000000000000000000000000000000000"
        "000000457f7f",
        "0061527f58d5b07f59c1417f106ec27f92eb3c7fa3aee37f"),
    ("ATTRIBUTES", "OCTAHEDRAL", 6, 8,
        "a0013ff00000b0231c3269013cc000000c050f010ff000009aab5fe1013ff000001104140f0700000000000000000000"
        "00000000000000000000000000000000000000005804ff07ff7f",
        "0000f8616052ff7f5159d0d3abafff7f995987bfcb40ff7f4610806e7dc1ff7fad91cdea553dff7f08a2d1adbde3ff7f"),
    ("ATTRIBUTES", "QUATERNION", 6, 8,
        "a0013ff000004f2121ac15013cf0000011030e0a013ff0000087c9f587c9010ff00000180d0710013ff00000a6b27b1e"
        "f0020b4a730000000000011240000000000000000000000000000000000000000000000000000000c80521f90000fd07",
        "0000cc4d70413ab2474dccd98abac2bfab5569c2e63d54da2f10046ea8c18cf49a6bb11444c492e3ba57cd4c5a1a3dd2"),
    ("ATTRIBUTES", "EXPONENTIAL", 6, 16,
        "a0013ff00000bf6c803a25013ff000004c08437b14010040000000013ff00000049e63b517013ff000007315ac833701"
        "1240000000013ff00000ed9f3b1415013ff0000085827b7a55011990000000013ff000007b943a19ad013ff000000c1c"
        "1a281001008000000000000000000000000000000000000000000000f2e42600f2ba2000f21cd9fff2",
        "0000000000901b3f00e8023f00901bbf00801a3f00d098be00f40abf008800bf00582b3f0058f6be0098f73e00c096be"
        "0060013e000c5c3f0058f9be0060b7bd003457bf008025be00f8ee3e0080633e00802fbf009019bf00c052be0008b73e"),
]  # fmt: skip


QUATERNIONS = next(bytes.fromhex(p[4]) for p in PACKED if p[1] == "QUATERNION")


def elements() -> bytes:
    """Twenty elements of eight bytes, some of which hardly change and some of which do."""
    i, k = np.arange(20)[:, None], np.arange(8)[None]
    return (
        ((i * k * k + np.where(i % 3 > 0, 0, 77 * k) + np.where(k == 3, 200 * i * i, 0)) & 255)
        .astype(np.uint8)
        .tobytes()
    )


@pytest.mark.parametrize(("mode", "filtered", "count", "stride", "packed", "plain"), PACKED)
def test_compressed_data_are_decoded_bit_for_bit(mode, filtered, count, stride, packed, plain):
    expected = bytes.fromhex(plain) or elements()
    assert decode_meshopt(bytes.fromhex(packed), count, stride, mode, filtered) == expected
    for cut in (1, 5):
        with pytest.raises((ValueError, IndexError)):
            assert decode_meshopt(bytes.fromhex(packed)[: len(packed) // 4 - cut], count, stride, mode, filtered) != b""
    with pytest.raises(ValueError, match="unknown"):
        decode_meshopt(b"\x00" + bytes.fromhex(packed)[1:], count, stride, mode, filtered)
    with pytest.raises(ValueError, match="cannot hold"):
        decode_meshopt(bytes.fromhex(packed), 10**9, stride, mode, filtered)


def packed_file(path: Path, compressed: bytes, **view) -> Path:
    """Two joints, of which the first turns by keys in a compressed view, from QUATERNION data of PACKED."""
    buffer = Buffer()
    times = buffer.add(np.arange(6) / 30, "SCALAR", bounds=True)
    start = len(buffer.data)
    buffer.data += compressed
    buffer.views.append({
        "buffer": 1, "byteLength": 48, "extensions": {"EXT_meshopt_compression": {
            "buffer": 0, "byteOffset": start, "byteLength": len(compressed), "byteStride": 8, "count": 6,
            "mode": "ATTRIBUTES", "filter": "QUATERNION", **view,
        }},
    })  # fmt: skip
    buffer.accessors.append({"bufferView": 1, "componentType": 5122, "normalized": True, "count": 6, "type": "VEC4"})
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["EXT_meshopt_compression"], "extensionsRequired": ["EXT_meshopt_compression"],
        "nodes": [{"name": "hips", "children": [1]}, {"name": "spine", "translation": [0, 1, 0]}],
        "skins": [{"joints": [0, 1]}],
        "animations": [{"samplers": [{"input": times, "output": 1}],
                        "channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}]}],
        "accessors": buffer.accessors, "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)},
                    {"byteLength": 48, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}],
    }  # fmt: skip
    path.write_bytes(pack_glb(document, bytes(buffer.data)))
    return path


def test_a_file_with_compressed_keys_is_read(tmp_path):
    packed, plain = next((p[4], p[5]) for p in PACKED if p[1] == "QUATERNION")
    keys = np.frombuffer(bytes.fromhex(plain), "<i2").reshape(6, 4) / 32767
    motion = read_gltf(packed_file(tmp_path / "m.glb", bytes.fromhex(packed)))
    x, y, z, w = (keys / np.linalg.norm(keys, axis=1, keepdims=True)).T
    up = np.stack([2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)], axis=1)  # where y points
    spine = motion.joint_positions_world()[:, 1]
    np.testing.assert_allclose(spine, np.stack([up[:, 0], -up[:, 2], up[:, 1]], axis=1), atol=1e-6)
    packed_file(tmp_path / "bad.glb", bytes.fromhex(packed), mode="NEW")
    with pytest.raises(FormatError, match="compressed buffer view 1 cannot be read .*'NEW'.*without compression"):
        read_gltf(tmp_path / "bad.glb")


@pytest.mark.parametrize("based", [True, False])
def test_sparse_values_replace_those_they_start_from(tmp_path, based):
    buffer = Buffer()
    plain = buffer.add(np.arange(12.0).reshape(4, 3), "VEC3")
    indices = buffer.add(np.array([1, 3]), "SCALAR", 5121)
    values = buffer.add(np.array([[7.0, 8, 9], [-1, -2, -3]]), "VEC3")
    sparse = {"count": 2, "indices": {"bufferView": indices, "componentType": 5121}, "values": {"bufferView": values}}
    accessor = {"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse}
    if based:
        accessor["bufferView"] = plain
    document = {"asset": {"version": "2.0"}, "accessors": [accessor], "bufferViews": buffer.views,
                "buffers": [{"byteLength": len(buffer.data)}]}  # fmt: skip
    (tmp_path / "m.glb").write_bytes(pack_glb(document, bytes(buffer.data)))
    expected = np.arange(12.0).reshape(4, 3) if based else np.zeros((4, 3))
    expected[[1, 3]] = [[7, 8, 9], [-1, -2, -3]]
    np.testing.assert_array_equal(Document(tmp_path / "m.glb").accessor(0), expected)
    accessor["count"] = 3
    (tmp_path / "m.glb").write_bytes(pack_glb(document, bytes(buffer.data)))
    with pytest.raises(FormatError, match="accessor 0 replaces value 3 of 3"):
        Document(tmp_path / "m.glb").accessor(0)
