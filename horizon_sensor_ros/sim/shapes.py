"""Small triangle meshes of satellite-like targets, in metres, in the target's own frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

_BOX_FACES = np.array(
    [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
     [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
)  # fmt: skip

_SICH_BODY = (0.840, 0.940, 0.740)


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles of a surface: ``vertices`` (V, 3) in metres and ``faces`` (F, 3) of vertex indices.

    Raises ValueError for wrong shapes, indices out of range and coordinates that are not finite.
    """

    vertices: np.ndarray
    faces: np.ndarray

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, dtype=float)
        faces = np.asarray(self.faces)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
            raise ValueError(
                f"vertices must be finite, of shape (V, 3), got shape {vertices.shape}"
            )
        if faces.ndim != 2 or faces.shape[1] != 3 or not np.issubdtype(faces.dtype, np.integer):
            raise ValueError(
                f"faces must be integers of shape (F, 3), got {faces.shape} {faces.dtype}"
            )
        if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise ValueError(f"faces must index {len(vertices)} vertices, got up to {faces.max()}")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces.astype(np.int64))

    def moved(
        self, rotation: np.ndarray | None = None, translation_m: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> TriangleMesh:
        """The mesh turned by ``rotation`` (3, 3), then shifted."""
        turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
        return TriangleMesh(self.vertices @ turn.T + np.asarray(translation_m, float), self.faces)


def assembly(parts: Sequence[TriangleMesh]) -> TriangleMesh:
    """One mesh of all parts; they may overlap."""
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return TriangleMesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, offsets, strict=True)]),
    )


def box(size_m: Sequence[float], centre_m: Sequence[float] = (0.0, 0.0, 0.0)) -> TriangleMesh:
    """A box of edge lengths ``size_m`` (x, y, z)."""
    corners = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    return TriangleMesh(
        corners * np.asarray(size_m, float) + np.asarray(centre_m, float), _BOX_FACES
    )


def beam(start_m: Sequence[float], end_m: Sequence[float], width_m: float) -> TriangleMesh:
    """A square bar of ``width_m`` from one point to another."""
    start, end = np.asarray(start_m, float), np.asarray(end_m, float)
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    rotation = np.column_stack([side, np.cross(axis, side), axis])
    return box((width_m, width_m, length)).moved(rotation, (start + end) / 2)


def revolved(profile_m: Sequence[tuple[float, float]], segments: int = 96) -> TriangleMesh:
    """A surface of revolution about z of the (radius, z) ``profile_m``, as rings of quads."""
    profile = np.asarray(profile_m, float)
    turn = np.arange(segments) * (2 * np.pi / segments)
    rings = np.stack(
        [np.outer(profile[:, 0], np.cos(turn)), np.outer(profile[:, 0], np.sin(turn)),
         np.repeat(profile[:, 1:], segments, axis=1)], axis=-1)  # fmt: skip
    here = np.arange(segments)
    after = (here + 1) % segments
    faces = []
    for low in range(len(profile) - 1):
        a, b = low * segments + here, low * segments + after
        c, d = a + segments, b + segments
        faces += [np.column_stack([a, b, c]), np.column_stack([b, d, c])]
    mesh = TriangleMesh(rings.reshape(-1, 3), np.concatenate(faces))
    tri = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    return TriangleMesh(mesh.vertices, mesh.faces[area > 0])


def cylinder(radius_m: float, length_m: float, segments: int = 96) -> TriangleMesh:
    """A closed cylinder along z, centred."""
    half = length_m / 2
    return revolved([(0, -half), (radius_m, -half), (radius_m, half), (0, half)], segments)


def dish(radius_m: float, depth_m: float, segments: int = 64, rings: int = 10) -> TriangleMesh:
    """A paraboloid reflector (no thickness) opening towards +z, its bottom at the origin."""
    radius = np.linspace(0.0, radius_m, rings + 1)
    return revolved([(r, depth_m * (r / radius_m) ** 2) for r in radius], segments)


def sich_n1() -> TriangleMesh:
    """Form N1 of the paper: the body of a simplified Sich-2-1, one box."""
    return box(_SICH_BODY)


def sich_n5() -> TriangleMesh:
    """Form N5 of the paper: N1 and four solar panels in a cross near one end of the body.

    The paper gives sizes, not places; of the crosses tried this one comes nearest to the paper's
    clouds of 4219 and 4694 points (4170 and 4704, at the stated field of view of 40 deg).
    """
    out, along, thick = 0.570, 0.696, 0.016
    x, y, z = _SICH_BODY
    level = 0.75 * (y - thick) / 2
    panels = []
    for sign in (-1.0, 1.0):
        panels.append(box((out, thick, along), (sign * (x + out) / 2, level, 0.0)))
        panels.append(box((along, thick, out), (0.0, level, sign * (z + out) / 2)))
    return assembly([sich_n1(), *panels])


def winged_cylinder() -> TriangleMesh:
    """A cylinder with two solar wings on short arms and a nozzle at one end."""
    body = cylinder(0.35, 1.0)
    nozzle = revolved([(0.06, 0.0), (0.08, 0.08), (0.14, 0.2)]).moved(None, (0, 0, 0.5))
    parts = [body, nozzle]
    for sign in (-1.0, 1.0):
        parts.append(box((0.8, 0.02, 0.5), (sign * 0.95, 0.0, 0.1)))
        parts.append(beam((sign * 0.3, 0, 0.1), (sign * 0.56, 0, 0.1), 0.05))
    return assembly(parts)


def plate_with_dish() -> TriangleMesh:
    """A thick plate with a dish, its feed, and a small box on its face."""
    plate = box((1.2, 0.9, 0.1))
    reflector = dish(0.35, 0.12).moved(None, (-0.2, 0.05, 0.06))
    feed = beam((-0.2, 0.05, 0.05), (-0.2, 0.05, 0.32), 0.04)
    return assembly([plate, reflector, feed, box((0.2, 0.25, 0.15), (0.42, -0.2, 0.125))])


def l_truss() -> TriangleMesh:
    """An L-shaped body of open truss work with a box at the corner and one at the end of an arm."""
    half, bar = 0.14, 0.045
    parts = [box((0.34, 0.34, 0.34)), box((0.2, 0.3, 0.12), (1.15, 0.0, 0.0))]
    for direction, length in ((0, 1.05), (1, 0.85)):
        axis, side = np.eye(3)[direction], np.eye(3)[1 - direction]
        up = np.eye(3)[2]
        bays = np.linspace(0.17, length, 4)
        for a in (-half, half):
            for b in (-half, half):
                offset = a * side + b * up
                parts.append(beam(bays[0] * axis + offset, bays[-1] * axis + offset, bar))
        for near, far in pairwise(bays):
            for b in (-half, half):
                parts.append(
                    beam(near * axis - half * side + b * up, far * axis + half * side + b * up, bar)
                )
        for place in bays[1:]:
            ring = [(-half, -half), (half, -half), (half, half), (-half, half)]
            for (a, b), (c, d) in zip(ring, ring[1:] + ring[:1], strict=True):
                parts.append(
                    beam(place * axis + a * side + b * up, place * axis + c * side + d * up, bar)
                )
    return assembly(parts)


def body_of_revolution() -> TriangleMesh:
    """A tank with a cone and a nozzle: its turn about z cannot be observed."""
    dome = [(0.35 * np.sin(t), 0.5 - 0.2 * np.cos(t)) for t in np.linspace(0, np.pi / 2, 9)]
    profile = [(r, 0.6 - z) for r, z in dome] + [(0.35, -0.35), (0.2, -0.5), (0.1, -0.5)]
    return revolved([*profile, (0.18, -0.75)])


TARGETS: dict[str, Callable[[], TriangleMesh]] = {
    "n1": sich_n1,
    "n5": sich_n5,
    "winged_cylinder": winged_cylinder,
    "plate_with_dish": plate_with_dish,
    "l_truss": l_truss,
    "body_of_revolution": body_of_revolution,
}
