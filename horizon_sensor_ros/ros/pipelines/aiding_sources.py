"""The topics that help the horizon sensor, coarse_pose and imu: what of them a set of frames gets.

As the pipeline: no node, no clock. Ages are differences of stamps, so live and offline agree.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

from horizon_sensor_ros.core.aiding import Aiding, AltitudeMeasurement, CoarsePose
from horizon_sensor_ros.core.motion.gyro import RateHistory
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.seconds import NANOSECONDS, nearest_s_from_ns
from horizon_sensor_ros.ros.messages.aiding import coarse_pose_from_message, rate_from_imu
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.messages.stamps import repeated_stamp, stamp_ns
from horizon_sensor_ros.ros.parameters.horizon_settings import AidingSettings
from horizon_sensor_ros.ros.pipelines.coarse_poses import CoarsePoses

COARSE_POSE_TOPIC = "coarse_pose"
_OF_NO_USE = "not used: planet is sphere; the Earth's ellipsoid is wgs84"
IMU_TOPIC = "imu"
# How the words of a topic begin that somebody publishes, and not as it is wanted.
OF_NO_AVAIL = ("refused: ", "too old: ", "of the future: ", "of another time: ")
# Poses refused in a row, from where on that is said though an older one is used.
_MANY_REFUSED = 3
_LONGEST_GAP_NS = 5 * NANOSECONDS  # of the imu; stamps that lie farther off are told


class AidingSources:
    """Keeps the coarse poses and the rates since the last set of frames.

    ignored : messages that were not used, by cause. words : what became of each topic for the last
    set, for a person.
    """

    def __init__(self, settings: AidingSettings, planet: Planet, base_frame: str) -> None:
        self.ignored: Counter[str] = Counter()
        self.words = {COARSE_POSE_TOPIC: "none", IMU_TOPIC: "none"}
        self._settings = settings
        self._planet = planet
        self._base_frame = base_frame
        self._rates = RateHistory(settings.imu_max_gap_ns)
        self._poses = CoarsePoses()
        # Why a topic's last message was refused, and how many were in a row.
        self._refused: dict[str, str] = {}
        self._in_a_row: Counter[str] = Counter()
        self._last_set: int | None = None

    def with_settings(
        self, settings: AidingSettings, planet: Planet, base_frame: str
    ) -> AidingSources:
        """Return sources of the same topics with other settings; the rates begin anew."""
        other = AidingSources(settings, planet, base_frame)
        other.ignored, other.words = self.ignored.copy(), self.words.copy()
        other._refused, other._in_a_row = self._refused.copy(), self._in_a_row.copy()
        other._poses = self._poses.with_sigmas(
            settings.position_sigma_m, settings.rotation_sigma_rad
        )
        other._last_set = self._last_set
        return other

    def reset(self) -> None:
        """Forget when the last set was; the topics' own stamps say whether they still count."""
        self._last_set = None

    def jump_back(self, stamp: int) -> None:
        """Go on at an earlier time (a looped bag): drop coarse poses whose stamps are nearer to
        the last set before the jump than to `stamp`.

        After that set's stamp the sets have not jumped: one image came late, or one stamp was far
        ahead.
        """
        if self._last_set is not None and stamp > self._last_set:
            return
        last, self._last_set = self._last_set, None
        if last is not None:
            self._poses.drop(lambda pose: abs(pose - last) <= abs(pose - stamp))

    def on_coarse_pose(self, msg: Any) -> None:
        """Take a `geometry_msgs/PoseStamped` of the base frame in the frame `earth`."""
        stamp, pose = stamp_ns(msg), coarse_pose_from_message(msg, self._planet)
        if isinstance(stamp, Refusal):
            self._ignore(COARSE_POSE_TOPIC, stamp)
        elif isinstance(pose, Refusal):
            self._ignore(COARSE_POSE_TOPIC, pose)
        else:
            self._accept(COARSE_POSE_TOPIC)
            sigmas = self._settings.position_sigma_m, self._settings.rotation_sigma_rad
            self._poses.add(stamp, CoarsePose(*pose, *sigmas))

    def on_imu(self, msg: Any) -> None:
        """Take the angular rate of a `sensor_msgs/Imu`."""
        stamp, rate = stamp_ns(msg), rate_from_imu(msg, self._base_frame)
        if isinstance(stamp, Refusal):
            self._ignore(IMU_TOPIC, stamp)
        elif isinstance(rate, Refusal):
            self._ignore(IMU_TOPIC, rate)
        elif not self._rates.add(stamp, rate):
            self._ignore(IMU_TOPIC, repeated_stamp(stamp))
        else:
            self._accept(IMU_TOPIC)

    def of_set(self, stamp: int) -> Aiding:
        """Return what is known for the set of this stamp, which is the last one from now on."""
        pose = self._pose_at(stamp)
        rotation, since_last = None, None
        rate, spread = None, 0.0
        if self._last_set is not None and stamp > self._last_set:
            since_last = nearest_s_from_ns(stamp - self._last_set)
        if len(self._rates):
            told = self._rates.rate(stamp)
            if told is not None:
                rate, spread = told
            words = "no set before"
            if self._last_set is not None:
                rotation = self._rates.rotation(self._last_set, stamp)
                words = "used" if rotation is not None else self._gap_at(stamp)
            self._say(IMU_TOPIC, words)
            self._rates.forget_before(stamp)
        else:
            self._say(IMU_TOPIC, "none")
        self._last_set = stamp
        return Aiding(
            pose,
            self._altitude(pose),
            rotation,
            rate_base_rad_s=rate,
            rate_spread_rad_s=spread,
            since_last_s=since_last,
        )

    def _gap_at(self, stamp: int) -> str:
        """Why no rotation is known up to the set of a stamp: another clock looks otherwise than a
        gap does.
        """
        off_ns = self._rates.off_ns(stamp)
        if abs(off_ns) <= _LONGEST_GAP_NS:
            return "a gap since the last set"
        way = "after" if off_ns > 0 else "before"
        seconds = nearest_s_from_ns(abs(off_ns))
        return f"of another time: its nearest stamp is {seconds:.1f} s {way} the frames'"

    def _pose_at(self, stamp: int) -> CoarsePose | None:
        chosen = self._poses.of_set(stamp, self._settings.max_age_ns)
        if chosen is None:
            self._say(COARSE_POSE_TOPIC, "none")
            return None
        if chosen.of_another_time:
            self.ignored[f"{COARSE_POSE_TOPIC}_of_another_time"] += chosen.of_another_time
        age = chosen.age_ns
        if abs(age) > self._settings.max_age_ns:
            off = "too old" if age > 0 else "of the future"
            self._say(COARSE_POSE_TOPIC, f"{off}: {nearest_s_from_ns(abs(age)):.1f} s")
            return None
        of_use = self._planet.flattening > 0.0 or self._settings.pose_altitude_sigma_m > 0.0
        age_s = nearest_s_from_ns(abs(age))
        if not of_use:
            self.words[COARSE_POSE_TOPIC] = _OF_NO_USE
        elif self._in_a_row[COARSE_POSE_TOPIC] < _MANY_REFUSED:
            self.words[COARSE_POSE_TOPIC] = "used"
        else:
            refused = self._refused[COARSE_POSE_TOPIC]
            self.words[COARSE_POSE_TOPIC] = (
                f"{refused}; used is the last good one, {age_s:.1f} s off"
            )
        return replace(chosen.pose, age_s=age_s)

    def _altitude(self, pose: CoarsePose | None) -> AltitudeMeasurement | None:
        """That of the pose, where its altitude has a sigma; else the parameter's, if any."""
        s = self._settings
        if pose is not None and s.pose_altitude_sigma_m > 0:
            return pose.altitude(self._planet, s.pose_altitude_sigma_m)
        if s.altitude_sigma_m > 0:
            return AltitudeMeasurement(s.altitude_m, s.altitude_sigma_m)
        return None

    def _accept(self, topic: str) -> None:
        self._refused.pop(topic, None)
        del self._in_a_row[topic]

    def _ignore(self, topic: str, refusal: Refusal) -> None:
        self.ignored[f"{topic}_{refusal.cause}"] += 1
        self._in_a_row[topic] += 1
        self._refused[topic] = f"refused: {refusal.reason}"
        if self.words[topic] != "used":
            self.words[topic] = self._refused[topic]

    def _say(self, topic: str, words: str) -> None:
        used = words == "used"
        self.words[topic] = words if used else self._refused.get(topic, words)
