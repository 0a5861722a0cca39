"""Point clouds from files: PCD, PLY, NPY, and plain columns of x, y, z."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from horizon_sensor_ros.tools.command_errors import CommandError, in_one_line

_PCD_TYPES = {
    ("F", 4): "f4", ("F", 8): "f8",
    ("U", 1): "u1", ("U", 2): "u2", ("U", 4): "u4", ("U", 8): "u8",
    ("I", 1): "i1", ("I", 2): "i2", ("I", 4): "i4", ("I", 8): "i8",
}  # fmt: skip
_PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_MOST_HEADER_LINES = 200
# One array a coordinate has to come of them.
_AXES = ["x", "y", "z"]


def read_cloud(path: Path, max_bytes: int = 256_000_000, max_points: int = 5_000_000) -> np.ndarray:
    """Points (N, 3), or (H, W, 3) where the file is organised, float32 or float64, metres.

    Reads .pcd (ascii, binary), .ply (ascii, binary; the element vertex), .npy (an array of numbers
    of shape (N, 3+) or (H, W, 3+)) and .xyz, .txt, .csv (columns x, y, z, more are passed over).
    Raises CommandError, naming the file, where it is none of these, broken, or larger than the
    bounds.
    """
    readers = {
        ".pcd": _read_pcd,
        ".ply": _read_ply,
        ".npy": _read_npy,
        **dict.fromkeys((".xyz", ".txt", ".csv"), _read_columns),
    }
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise CommandError(f"{path}: clouds are read from {', '.join(readers)}")
    try:
        size = path.stat().st_size
        if size > max_bytes:
            raise CommandError(f"{path}: has {size} bytes, more than the {max_bytes} that are read")
        points = reader(path)
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror}") from None
    except CommandError:
        raise
    except Exception as error:
        # Not only ours: what numpy's reader of .npy raises depends on how a file is broken.
        raise CommandError(f"{path}: is no cloud that can be read: {in_one_line(error)}") from None
    count = points.size // 3
    if not 0 < count <= max_points:
        raise CommandError(f"{path}: has {count} points; 1 to {max_points} are read")
    return points


CLOUD_SUFFIXES = (".pcd", ".ply", ".npy", ".xyz", ".txt", ".csv")


def _read_npy(path: Path) -> np.ndarray:
    # Mapped, so that a header that promises more than there is takes no memory.
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if not isinstance(array, np.ndarray) or array.ndim not in (2, 3) or array.shape[-1] < 3:
        raise ValueError(f"shape {getattr(array, 'shape', None)} is not (N, 3) or (H, W, 3)")
    if array.dtype.kind not in "fiu":
        raise ValueError(f"type {array.dtype} is not numbers")
    return _floats(array[..., :3])


def _read_columns(path: Path) -> np.ndarray:
    lines = path.read_text(encoding="utf-8").replace(",", " ").replace(";", " ").splitlines()
    # A first line of names.
    if lines and lines[0].split()[:3] == _AXES:
        lines = lines[1:]
    return _table(lines, (0, 1, 2))


def _read_pcd(path: Path) -> np.ndarray:
    lines, body = _header_lines(path.read_bytes(), "DATA")
    header = {words[0]: words[1:] for words in map(str.split, lines)}
    for key in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT"):
        if not header.get(key):
            raise ValueError(f"its header has no {key}")
    kind = " ".join(header["DATA"])
    if kind == "binary_compressed":
        raise ValueError(
            "its data is compressed; convert it: pcl_convert_pcd_ascii_binary IN.pcd OUT.pcd 1"
        )
    names = header["FIELDS"]
    _require_axes(names)
    counts = [int(n) for n in header.get("COUNT", ["1"] * len(names))]
    sizes = [int(n) for n in header["SIZE"]]
    columns = [
        (name, "<" + _PCD_TYPES[kind, size], count)
        for name, kind, size, count in zip(names, header["TYPE"], sizes, counts, strict=True)
    ]
    width, height = int(header["WIDTH"][0]), int(header["HEIGHT"][0])
    if width < 0 or height < 0:
        raise ValueError(f"{width} x {height} points")
    if kind == "ascii":
        first = np.cumsum([0, *counts])
        where = tuple(int(first[names.index(axis)]) for axis in _AXES)
        points = _table(_lines(body), where)
    elif kind == "binary":
        points = _records(body, columns, width * height)
    else:
        raise ValueError(f"its data is {kind!r}, not ascii or binary")
    if len(points) != width * height:
        raise ValueError(f"has {len(points)} points, its header says {width} x {height}")
    return points.reshape(height, width, 3) if min(width, height) > 1 else points


def _read_ply(path: Path) -> np.ndarray:
    lines, body = _header_lines(path.read_bytes(), "end_header")
    words = [line.split() for line in lines]
    if words[0] != ["ply"] or len(words) < 3 or words[1][0] != "format":
        raise ValueError("does not begin with ply and its format")
    kind = words[1][1]
    elements = [i for i, w in enumerate(words) if w[0] == "element"]
    if not elements or words[elements[0]][1] != "vertex":
        raise ValueError("its first element is not vertex")
    end = elements[1] if len(elements) > 1 else len(words)
    properties = [w for w in words[elements[0] : end] if w[0] == "property"]
    if any(w[1] == "list" for w in properties):
        raise ValueError("its vertices have lists")
    names = [w[2] for w in properties]
    _require_axes(names)
    count = int(words[elements[0]][2])
    if kind == "ascii":
        points = _table(_lines(body)[: max(count, 0)], tuple(names.index(axis) for axis in _AXES))
        if len(points) != count:
            raise ValueError(f"has {len(points)} vertices, its header says {count}")
        return points
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(kind)
    if order is None:
        raise ValueError(f"its format is {kind!r}, not ascii or binary")
    columns = [(w[2], order + _PLY_TYPES[w[1]], 1) for w in properties]
    return _records(body, columns, count)


def _require_axes(names: list[str]) -> None:
    for axis in _AXES:
        if names.count(axis) != 1:
            raise ValueError(f"has {names.count(axis)} fields {axis}, not one")


def _header_lines(data: bytes, last: str) -> tuple[list[str], bytes]:
    """Lines up to that which begins with `last`, without comments, and what follows them."""
    lines: list[str] = []
    start = 0
    for _ in range(_MOST_HEADER_LINES):
        end = data.find(b"\n", start)
        if end < 0:
            break
        line = data[start:end].decode("ascii", errors="replace").strip()
        start = end + 1
        if line and not line.startswith(("#", "comment", "obj_info")):
            lines.append(line)
        if line.split()[:1] == [last]:
            return lines, data[start:]
    raise ValueError(f"has no header that ends with {last}")


def _lines(body: bytes) -> list[str]:
    return body.decode("ascii", errors="replace").splitlines()


def _records(body: bytes, columns: list[tuple[str, str, int]], count: int) -> np.ndarray:
    """Points of records that lie one after the other; a column is a name, a type, a number."""
    for name, kind, number in columns:
        if number < 1 or (name in _AXES and (number > 1 or kind[1] != "f")):
            raise ValueError(f"field {name} is {number} x {kind}; x, y, z must be floats")
    # Names may repeat ("_" pads), so that each gets one of its own.
    record = np.dtype(
        [
            (name if name in _AXES else f"{i} {name}", kind, (number,))
            for i, (name, kind, number) in enumerate(columns)
        ]
    )
    if not 0 <= count * record.itemsize <= len(body):
        raise ValueError(
            f"is cut short: {count} points of {record.itemsize} bytes, {len(body)} are there"
        )
    table = np.frombuffer(body, record, count)
    return _floats(np.concatenate([table[axis] for axis in _AXES], axis=-1))


def _table(lines: list[str], columns: tuple[int, ...]) -> np.ndarray:
    if not any(line.split("#", 1)[0].strip() for line in lines):
        raise ValueError("has no points")
    return np.loadtxt(lines, dtype=np.float64, usecols=columns, ndmin=2)


def _floats(points: np.ndarray) -> np.ndarray:
    """The same numbers, native float32 or float64."""
    kind = np.float32 if points.dtype == np.dtype(points.dtype.byteorder + "f4") else np.float64
    return np.ascontiguousarray(points, dtype=kind)
