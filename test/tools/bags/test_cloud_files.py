"""Point clouds from files: every kind that is read, and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from horizon_sensor_ros.tools.bags.cloud_files import CLOUD_SUFFIXES, read_cloud
from horizon_sensor_ros.tools.command_errors import CommandError

POINTS = np.random.default_rng(3).normal(0.0, 2.0, (6, 3)).astype(np.float32)


def pcd(data: str, body: bytes, *, size: str = "6 1", **others: str) -> bytes:
    width, height = size.split()
    lines = {
        "VERSION": ".7",
        "FIELDS": "intensity x y z _",
        "SIZE": "2 4 4 4 1",
        "TYPE": "U F F F U",
        "COUNT": "1 1 1 1 3",
        "WIDTH": width,
        "HEIGHT": height,
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": "6",
        "DATA": data,
    } | others
    text = "# .PCD v.7\n" + "".join(f"{k} {v}\n" for k, v in lines.items())
    return text.encode() + body


def binary_body() -> bytes:
    return b"".join(struct.pack("<H3f3B", 7, *map(float, p), 1, 2, 3) for p in POINTS)


def ply(kind: str, body: bytes, count: int = 6) -> bytes:
    return (
        f"ply\nformat {kind} 1.0\ncomment made here\nelement vertex {count}\n"
        "property uchar red\nproperty float x\nproperty float y\nproperty double z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode() + body


def text_rows(before: str, after: str) -> bytes:
    rows = (" ".join(repr(float(v)) for v in p) for p in POINTS)
    return "".join(f"{before}{row}{after}\n" for row in rows).encode()


def ply_body(order: str) -> bytes:
    return b"".join(struct.pack(f"{order}B2fd", 9, *map(float, p)) for p in POINTS) + b"\x03abc"


FILES = {
    "binary.pcd": pcd("binary", binary_body()),
    "ascii.pcd": pcd("ascii", text_rows("7 ", " 1 2 3")),
    "little.ply": ply("binary_little_endian", ply_body("<")),
    "big.ply": ply("binary_big_endian", ply_body(">")),
    "ascii.ply": ply("ascii", text_rows("9 ", "") + b"3 0 1 2\n"),
    "plain.xyz": text_rows("", ""),
    "more.txt": b"# from a scanner\n" + text_rows("", " 0.5"),
    "named.csv": b"x,y,z\n" + text_rows("", "").replace(b" ", b","),
}


@pytest.mark.parametrize("name", FILES)
def test_every_kind_gives_the_points(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    np.testing.assert_array_equal(read_cloud(tmp_path / name), POINTS)


def test_organised_clouds_stay_so(tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd("binary", binary_body(), size="3 2"))
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.pcd"), POINTS.reshape(2, 3, 3))
    np.save(tmp_path / "b.npy", POINTS.reshape(2, 3, 3))
    np.testing.assert_array_equal(read_cloud(tmp_path / "b.npy"), POINTS.reshape(2, 3, 3))


def test_points_that_are_nan_stay_so(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("1 2 3\nnan nan nan\n")
    assert np.isnan(read_cloud(tmp_path / "a.xyz")[1]).all()


def said(path: Path, data: bytes) -> str:
    path.write_bytes(data)
    with pytest.raises(CommandError) as caught:
        read_cloud(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_what_is_no_cloud_is_refused(tmp_path: Path) -> None:
    a = tmp_path / "a.pcd"
    assert "compressed" in said(a, pcd("binary_compressed", b""))
    assert "cut short" in said(a, pcd("binary", binary_body()[:-1]))
    assert "header says 4 x 2" in said(a, pcd("ascii", text_rows("7 ", " 1 2 3"), size="4 2"))
    assert "no header that ends with DATA" in said(a, b"\x00" * 1000)
    assert "its header has no SIZE" in said(a, pcd("ascii", b"", SIZE=""))
    assert "not one" in said(a, pcd("binary", binary_body(), FIELDS="i x y w _"))
    assert "must be floats" in said(a, pcd("binary", binary_body(), TYPE="U F F I U"))
    assert "-1 x -6" in said(a, pcd("binary", binary_body(), size="-1 -6"))
    b = tmp_path / "b.ply"
    assert "ply" in said(b, b"solid\nend_header\n")
    assert "cut short" in said(b, ply("binary_little_endian", ply_body("<"), count=-1))
    assert "header says 9" in said(b, ply("ascii", text_rows("9 ", ""), count=9))
    c = tmp_path / "c.npy"
    np.save(c, np.zeros((4, 2)))
    assert "(N, 3)" in said(c, c.read_bytes())
    np.save(c, np.array([{"a": 1}] * 3, dtype=object), allow_pickle=True)
    assert "no cloud" in said(c, c.read_bytes())
    np.save(c, np.zeros((4, 3), complex))
    assert "is not numbers" in said(c, c.read_bytes())
    np.save(c, np.zeros((4, 3)))
    # Each of these is another of numpy's errors.
    for broken in (b"", b"PK\x03\x04junk", c.read_bytes().replace(b"(4, 3)", b"(4, 3(")):
        assert "no cloud" in said(c, broken)
    assert "clouds are read from" in said(tmp_path / "d.las", b"LASF")
    assert "has no points" in said(tmp_path / "e.xyz", b"\n")


def test_a_header_that_promises_more_than_there_is_takes_no_memory(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((9, 3)))
    data = (tmp_path / "a.npy").read_bytes().replace(b"(9, 3), }      ", b"(9999999999, 3)")
    assert "no cloud" in said(tmp_path / "a.npy", data.replace(b"3)", b"3)}", 1))
    assert "cut short" in said(tmp_path / "b.pcd", pcd("binary", b"", size="999999999 999999999"))


def test_larger_files_than_are_read_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_bytes(FILES["plain.xyz"])
    with pytest.raises(CommandError, match="more than the 10 that are read"):
        read_cloud(tmp_path / "a.xyz", max_bytes=10)
    with pytest.raises(CommandError, match="1 to 5 are read"):
        read_cloud(tmp_path / "a.xyz", max_points=5)
    with pytest.raises(CommandError, match="cannot be read: No such file"):
        read_cloud(tmp_path / "none.xyz")


@given(
    name=st.sampled_from(sorted(FILES)),
    cut=st.floats(0.0, 1.0),
    noise=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), max_size=4),
)
def test_damage_is_refused_or_gives_points_but_never_raises_else(
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    cut: float,
    noise: list[tuple[float, int]],
) -> None:
    data = bytearray(FILES[name][: int(cut * len(FILES[name]))])
    for place, value in noise:
        if data:
            data[min(int(place * len(data)), len(data) - 1)] = value
    path = tmp_path_factory.mktemp("damaged") / name
    path.write_bytes(data)
    try:
        points = read_cloud(path)
    except CommandError:
        return
    assert points.shape[-1] == 3


def test_all_suffixes_are_read() -> None:
    assert {Path(name).suffix for name in FILES} | {".npy"} == set(CLOUD_SUFFIXES)
