"""Triangle meshes from Wavefront OBJ and STL files, with bounds on what is read."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from horizon_sensor_ros.sim.shapes import TriangleMesh

_STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(
    path: str | Path, max_bytes: int = 64_000_000, max_faces: int = 500_000
) -> TriangleMesh:
    """Read an ``.obj`` or ``.stl`` (ASCII or binary) file.

    Units are taken as metres. Raises ValueError, naming the file, where it is larger than the
    bounds, of another kind, or broken; OSError where it cannot be read.
    """
    path = Path(path)
    size = path.stat().st_size
    if size > max_bytes:
        raise ValueError(f"{path}: {size} bytes, more than the allowed {max_bytes}")
    readers = {".obj": _read_obj, ".stl": _read_stl}
    if path.suffix.lower() not in readers:
        raise ValueError(f"{path}: only .obj and .stl meshes are read")
    try:
        mesh = readers[path.suffix.lower()](path.read_bytes())
    except (ValueError, IndexError) as error:
        raise ValueError(f"{path}: broken mesh file: {error}") from error
    if not 0 < len(mesh.faces) <= max_faces:
        raise ValueError(f"{path}: {len(mesh.faces)} triangles; 1 to {max_faces} are allowed")
    return mesh


def _read_obj(data: bytes) -> TriangleMesh:
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for line in data.decode("utf-8", errors="replace").splitlines():
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words[0] == "f":
            # "7", "7/1", "7//3" and "7/1/3" all name vertex 7; negative ones count back from the
            # last.
            numbers = [int(word.split("/", 1)[0]) for word in words[1:]]
            if 0 in numbers:
                raise ValueError("vertex number 0")
            corner = [n - 1 if n > 0 else len(vertices) + n for n in numbers]
            faces += [(corner[0], b, c) for b, c in pairwise(corner[1:])]
    return TriangleMesh(np.array(vertices).reshape(-1, 3), np.array(faces, int).reshape(-1, 3))


def _read_stl(data: bytes) -> TriangleMesh:
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + count * _STL_RECORD.itemsize:
        corners = np.frombuffer(data, _STL_RECORD, count, 84)["corners"].reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        lines = (line.split() for line in data.decode("ascii", errors="replace").splitlines())
        rows = [words[1:4] for words in lines if words and words[0].lower() == "vertex"]
        corners = np.array(rows, dtype=float).reshape(-1, 3)
    else:
        raise ValueError("neither an ASCII STL nor a binary one of the size that its header tells")
    if len(corners) % 3:
        raise ValueError(f"{len(corners)} vertices do not make triangles")
    return TriangleMesh(corners.astype(float), np.arange(len(corners)).reshape(-1, 3))
