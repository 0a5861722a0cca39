"""Meshes: closed where they should be, and refused where they are none."""

import numpy as np
import pytest

from horizon_sensor_ros.sim.shapes import (
    TriangleMesh,
    beam,
    box,
    cylinder,
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
