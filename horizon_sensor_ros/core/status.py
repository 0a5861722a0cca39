"""Why there is an answer, or why there is none."""

from enum import Enum


class Status(str, Enum):
    """Outcome of an estimation step; the value is the machine-readable word shown on
    ``/diagnostics``.
    """

    OK = "ok"
    BAD_IMAGE = "bad_image"
    NO_LIMB = "no_limb"
    TOO_FEW_POINTS = "too_few_points"
    ILL_CONDITIONED = "ill_conditioned"
    NOT_CONVERGED = "not_converged"
    POOR_FIT = "poor_fit"
    WRONG_POLARITY = "wrong_polarity"
    ALTITUDE_OUT_OF_RANGE = "altitude_out_of_range"
    CAMERAS_DISAGREE = "cameras_disagree"
    UNCERTAIN = "uncertain"
    REPEATED_STAMP = "repeated_stamp"
    REPEATED_CLOUD = "repeated_cloud"

    def __str__(self) -> str:
        return self.value
