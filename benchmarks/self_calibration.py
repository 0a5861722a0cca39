"""Self-calibration of two perpendicular cameras from simulated bags, against the truth.

The frames are of cameras mounted as the truth says; the parameters are wrong by a misalignment.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from horizon_bags import camera_info_message, header, image_message, write_messages
from tables import Options, Table

from horizon_sensor_ros.core.attitude import quaternion_from_rotation
from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.self_calibration.adjustment import Calibration, calibrate
from horizon_sensor_ros.core.target.rigid import rotation_from_vector
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.flight import Flight, Swing
from horizon_sensor_ros.sim.poses import random_direction
from horizon_sensor_ros.tools.calibration_recording import read_recording
