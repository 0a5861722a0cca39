"""Which of some pixels is the nearest to each."""

from __future__ import annotations

import cv2
import numpy as np


def nearest(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (H, W), pixels, to the nearest pixel that is meant (H, W), bool; and its flat index
    (H, W), zeros where there is none at all.
    """
    distance, label = cv2.distanceTransformWithLabels(
        (~where).view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_label = np.zeros(int(label.max()) + 1, np.int64)
    place = np.flatnonzero(where)
    if len(place):
        of_label[label.ravel()[place]] = place
    return distance, of_label[label]
