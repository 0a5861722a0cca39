"""Files that parameters name."""

from __future__ import annotations

from pathlib import Path

import cv2
from ament_index_python.packages import get_package_share_directory

from horizon_sensor_ros.core.cameras.mask import Mask

_PACKAGE = "package://"
_HALF = 128


def resource_path(name: str) -> Path:
    """Path of an absolute path or of ``package://PACKAGE/PATH``, below that package's share.

    Raises ValueError, saying why, when it is neither or there is no such package.
    """
    if name.startswith(_PACKAGE):
        package, _, path = name.removeprefix(_PACKAGE).partition("/")
        try:
            return Path(get_package_share_directory(package)) / path
        except (LookupError, ValueError, OSError):
            raise ValueError(f"{name}: there is no package {package!r} here") from None
    if not Path(name).is_absolute():
        raise ValueError(f"{name} is no absolute path and does not start with {_PACKAGE}")
    return Path(name)


def read_mask(path: Path) -> Mask:
    """Mask of a picture: used where it is white. ValueError, saying why, when it is none."""
    if not path.is_file():
        raise ValueError(f"there is no file {path}")
    try:
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        # A header that promises more than OpenCV takes.
        picture = None
    if picture is None:
        raise ValueError(f"{path} is not a picture")
    try:
        return Mask(picture >= _HALF)
    except ValueError:
        raise ValueError(f"{path} is black all over: it masks the whole image") from None
