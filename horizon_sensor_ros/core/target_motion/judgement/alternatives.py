"""Motions that would look almost alike: a target whose faces stand at right angles, turned by one
or two of them; a prism of five to sixteen sides, turned by one of those.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, permutations, product

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector, vector_from_rotation
from horizon_sensor_ros.core.target_motion.alignment.consistency import view_consistency
from horizon_sensor_ros.core.target_motion.alignment.search import align_batch
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

# Normals so near belong to one face.
_SAME_FACE = np.cos(np.radians(15.0))
_GATES = np.array([0.3, 0.2, 0.15])
_LAST_GATES = np.array([0.15, 0.1, 0.1, 0.08])
_KEPT = 8
# What fell back to the motion itself is none.
_APART_RAD = np.radians(20.0)
# And one that leaves much less in common says little.
_LEAST_OVERLAP = 0.45
# The middle of the target lies so far behind that of the surface seen, in rms radii of it.
_DEPTHS = np.array([0.0, 0.6, 1.2])
# From side to side of prisms, dense enough for those between; those of four are right turns.
_SIDES_RAD = np.outer(2.0 * np.pi / np.array([5, 6, 7, 8, 9, 10, 12, 14, 16]), [-1.0, 1.0]).ravel()
# So many faces, of at least such a share of the surface, give a prism's axis.
_FACES, _LEAST_FACE = 4, 0.03


@dataclass(frozen=True, eq=False)
class Rival:
    """Another motion that explains the views nearly as well.

    rotation, translation_m : (3, 3) and (3,) of it. turn_rad : how far the target turns in it.
    apart_rad : angle between it and the motion found. score, overlap : its view consistency.
    lead : its score less that of the motion found.
    """

    rotation: np.ndarray
    translation_m: np.ndarray
    turn_rad: float
    apart_rad: float
    score: float
    overlap: float
    lead: float


def right_turns() -> np.ndarray:
    """(23, 3, 3) rotations that map the three axes on each other, without the one that leaves
    them.
    """
    turns = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) > 0:
                turns.append(turn)
    return np.array([turn for turn in turns if not np.array_equal(turn, np.eye(3))])


def face_axes(view: SurfaceView) -> np.ndarray:
    """(3, 3) axes as columns: normal of the largest face, of the next one most across it, and the
    third.

    Without a second face, the longest extent of the first stands for it.
    """
    points, normals = view.sample(300)
    normals = normals[normals.any(axis=1)].astype(float)
    if not len(normals):
        return np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2].T
    first = normals[_largest_face(normals)].mean(axis=0)
    first /= np.linalg.norm(first)
    across = np.abs(normals @ first) < 0.5
    if across.sum() > 0.03 * len(normals):
        normals = normals[across]
        second = normals[_largest_face(normals)].mean(axis=0)
    else:
        second = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    return np.column_stack([first, second, np.cross(first, second)])


def _largest_face(normals: np.ndarray) -> np.ndarray:
    """(N,) bool, which of the normals (N, 3) are the largest face's."""
    near: np.ndarray = normals @ normals.T > _SAME_FACE
    face: np.ndarray = near[near.sum(axis=1).argmax()]
    return face


def alike_prism_turns(view: SurfaceView) -> np.ndarray:
    """(K, 3, 3) turns from side to side, were the target a prism.

    Its axis is square to two faces that are seen, or the normal of one.
    """
    normals = view.sample(300)[1]
    left = normals[normals.any(axis=1)].astype(float)
    least = _LEAST_FACE * len(left)
    faces: list[np.ndarray] = []
    while len(faces) < _FACES and len(left):
        largest = _largest_face(left)
        if largest.sum() < least:
            break
        face = left[largest].mean(axis=0)
        faces.append(face / np.linalg.norm(face))
        left = left[~largest]
    axes = list(faces)
    for one, other in combinations(faces, 2):
        across = np.cross(one, other)
        length = np.linalg.norm(across)
        if length > 0.3 and all(abs(across @ axis) < _SAME_FACE * length for axis in axes):
            axes.append(across / length)
    turns = [axis * angle for axis in axes for angle in _SIDES_RAD]
    return rotation_from_vector(np.array(turns).reshape(-1, 3))


def right_turned(
    a: SurfaceView, b: SurfaceView, rotation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Motions (23, 3, 3), (23, 3) a right turn or two beside the given one, centroid on
    centroid.
    """
    axes = face_axes(b)
    rotations = axes @ right_turns() @ axes.T @ rotation
    return rotations, b.image.centroid_m - rotations @ a.image.centroid_m


def prism_turned(
    b: SurfaceView,
    rotation: np.ndarray,
    translation_m: np.ndarray,
    rot_b_from_a_still: np.ndarray,
    most_rad: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Motions (M, 3, 3), (M, 3) from one side of a prism to another beside the given one, about
    some middles of it; those that turn by less than ``most_rad``, if nothing does in
    ``rot_b_from_a_still``.
    """
    turns = alike_prism_turns(b)
    turns = turns[
        np.einsum("kij,ji->k", turns, rotation @ rot_b_from_a_still.T) > 1 + 2 * np.cos(most_rad)
    ]
    front = b.image.centroid_m
    behind = b.size_m * front / np.linalg.norm(front)
    middles = front + np.outer(_DEPTHS, behind)
    rotations = np.repeat(turns @ rotation, len(middles), axis=0)
    about = (translation_m - middles) @ turns.transpose(0, 2, 1) + middles
    return rotations, about.reshape(-1, 3)


def rivals(
    a: SurfaceView,
    b: SurfaceView,
    rotation: np.ndarray,
    translation_m: np.ndarray,
    rot_b_from_a_still: np.ndarray,
    starts: tuple[np.ndarray, np.ndarray],
) -> list[Rival]:
    """The most consistent motions that ``starts`` (K, 3, 3), (K, 3) lead to, beside the given
    one; ``rot_b_from_a_still`` : rotation of one that turns nothing.
    """
    rotations, translations = starts
    if not len(rotations):
        return []
    rotations, translations = align_batch(a, b, rotations, translations, b.size_m * _GATES, 100)
    away = np.einsum("kij,ij->k", rotations, rotation) < 1.0 + 2.0 * np.cos(_APART_RAD)
    if not away.any():
        return []
    rotations, translations = rotations[away], translations[away]
    seen = view_consistency(a, b, rotations, translations, 150, 2.0)
    kept = np.argsort(-seen.score * np.sqrt(seen.overlap), kind="stable")[:_KEPT]
    rotations, translations = align_batch(
        a, b, rotations[kept], translations[kept], b.size_m * _LAST_GATES, 150
    )
    rotations = np.concatenate([rotation[None], rotations])
    translations = np.concatenate([translation_m[None], translations])
    seen = view_consistency(a, b, rotations, translations, 300, 1.0)
    found = []
    alike = zip(rotations[1:], translations[1:], seen.score[1:], seen.overlap[1:], strict=True)
    for turn, shift_m, score, overlap in alike:
        apart = float(np.linalg.norm(vector_from_rotation(rotation.T @ turn)))
        if apart > _APART_RAD and overlap > _LEAST_OVERLAP * seen.overlap[0]:
            whole = float(np.linalg.norm(vector_from_rotation(turn @ rot_b_from_a_still.T)))
            lead = float(score - seen.score[0])
            found.append(Rival(turn, shift_m, whole, apart, float(score), float(overlap), lead))
    return found
