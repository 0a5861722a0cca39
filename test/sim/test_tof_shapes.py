"""Meshes: closed where they should be, and read back from files as they were written."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from horizon_sensor_ros.sim.mesh_files import read_mesh
from horizon_sensor_ros.sim.shapes import (
    TARGETS,
    TriangleMesh,
    beam,
    box,
    cylinder,
    l_truss,
    revolved,
)


def volume(mesh: TriangleMesh) -> float:
    """By the divergence theorem; the sign is that of the faces' sense."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def test_volumes_are_those_of_the_solids() -> None:
    assert abs(volume(box((0.5, 0.7, 0.9), (1, 2, 3)))) == pytest.approx(0.5 * 0.7 * 0.9)
    assert abs(volume(beam((0, 0, 0), (1, 2, 2), 0.1))) == pytest.approx(0.03)
    assert abs(volume(cylinder(0.4, 1.2, 400))) == pytest.approx(np.pi * 0.16 * 1.2, rel=1e-3)
    ball = revolved([(np.sin(t), -np.cos(t)) for t in np.linspace(0, np.pi, 100)], 200)
    assert abs(volume(ball)) == pytest.approx(4 / 3 * np.pi, rel=1e-3)


def test_a_mesh_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="vertices"):
        TriangleMesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="faces"):
        TriangleMesh(np.zeros((3, 3)), np.array([[0, 1, 3]]))
    with pytest.raises(ValueError, match="faces"):
        TriangleMesh(np.zeros((3, 3)), np.array([[0.0, 1.0, 2.0]]))


def write_obj(path: Path, mesh: TriangleMesh) -> None:
    lines = ["# a comment", "o thing"]
    lines += [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    lines += [f"f {a + 1}/1/2 {b + 1}//3 {c + 1}" for a, b, c in mesh.faces]
    path.write_text("\n".join(lines), encoding="utf-8")


def write_stl(path: Path, mesh: TriangleMesh) -> None:
    record = np.zeros(
        len(mesh.faces), np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    )
    record["c"] = mesh.vertices[mesh.faces]
    path.write_bytes(b"\0" * 80 + len(record).to_bytes(4, "little") + record.tobytes())


def write_ascii_stl(path: Path, mesh: TriangleMesh) -> None:
    lines = ["solid thing"]
    for triangle in mesh.vertices[mesh.faces]:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid"]), encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "write"),
    [("m.obj", write_obj), ("m.STL", write_stl), ("m.stl", write_ascii_stl)],
)
def test_files_give_back_the_triangles(
    tmp_path: Path, name: str, write: Callable[[Path, TriangleMesh], None]
) -> None:
    mesh = l_truss()
    write(tmp_path / name, mesh)
    got = read_mesh(tmp_path / name)
    assert np.allclose(got.vertices[got.faces], mesh.vertices[mesh.faces], atol=1e-6)


def test_polygons_and_backward_numbers(tmp_path: Path) -> None:
    path = tmp_path / "quad.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2 -1\n", encoding="utf-8")
    assert read_mesh(path).faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_bounds_and_other_kinds_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.obj"
    write_obj(path, TARGETS["n1"]())
    with pytest.raises(ValueError, match="allowed"):
        read_mesh(path, max_bytes=10)
    with pytest.raises(ValueError, match="allowed"):
        read_mesh(path, max_faces=3)
    other = path.rename(tmp_path / "m.ply")
    with pytest.raises(ValueError, match=r"\.obj and \.stl"):
        read_mesh(other)


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300), st.sampled_from(["obj", "stl"]), st.booleans())
def test_any_bytes_are_a_mesh_or_a_value_error(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, kind: str, solid: bool
) -> None:
    path = tmp_path_factory.mktemp("mesh") / f"m.{kind}"
    path.write_bytes(b"solid\nvertex " + data if solid else data)
    told = ""
    try:
        mesh = read_mesh(path)
    except ValueError as error:
        told = str(error)
    assert str(path) in told or len(mesh.faces) > 0
