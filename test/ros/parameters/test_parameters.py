"""Parameters: what is accepted, what is refused in which words, and files as ROS reads them."""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from horizon_messages import PARAMETERS
from hypothesis import given
from hypothesis import strategies as st
from rclpy.context import Context

from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.ros.parameters.camera import OF_A_CAMERA
from horizon_sensor_ros.ros.parameters.common import (
    COMMON_PARAMETERS,
    NODE_PARAMETERS,
    NODES_PARAMETER,
)
from horizon_sensor_ros.ros.parameters.file import read_parameter_file
from horizon_sensor_ros.ros.parameters.horizon import HORIZON_PARAMETERS, horizon_parameters
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.ros.parameters.ignored import ignored_parameters, unknown_parameters
from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.ros.parameters.reference import parameter_file, parameter_reference
from horizon_sensor_ros.ros.parameters.target import TARGET_PARAMETERS, target_parameters
from horizon_sensor_ros.ros.parameters.target_settings import target_settings

ALL_PARAMETERS = (
    *HORIZON_PARAMETERS,
    *TARGET_PARAMETERS,
    *COMMON_PARAMETERS,
    *NODE_PARAMETERS,
    NODES_PARAMETER,
)
ANY_VALUE = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text()
    | st.lists(st.floats() | st.text() | st.integers(), max_size=5)
    | st.dictionaries(st.text(), st.integers())
)


def test_defaults_are_the_contracts() -> None:
    settings = horizon_settings(PARAMETERS)
    assert settings.pipeline.cameras == ("camera_1", "camera_2")
    assert settings.pipeline.sensor.planet == Planet(6371000.0, 0.0)
    assert settings.pipeline.sensor.method == "ml"
    assert settings.pipeline.base_frame == "base_link"
    assert settings.level_z == "up"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"camera_2.rotation": None}, ["camera_2.rotation is not set"]),
        ({"camera_1.rotation": [0, 0, 0, 1.01]}, ["camera_1.rotation", "length 1"]),
        ({"camera_1.rotation": [0, 0, 1]}, ["camera_1.rotation", "four"]),
        ({"camera_1.rotation": [0, 0, 0, float("nan")]}, ["camera_1.rotation", "finite"]),
        ({"camera_1.rotation": "identity"}, ["camera_1.rotation", "list of numbers"]),
        ({"planet_radius": -6371000.0}, ["planet_radius", "-6371000"]),
        ({"planet_radius": float("nan")}, ["planet_radius"]),
        ({"planet": "wgs84", "planet_air": False}, ["planet_air", "wgs84"]),
        ({"planet": "wgs84", "planet_radius": 1737400.0}, ["planet_radius is 1737400 m", "wgs84"]),
        ({"planet_radius": "large"}, ["planet_radius must be a double", "large"]),
        ({"planet": "cube"}, ["planet must be one of sphere, wgs84", "cube"]),
        ({"vertical": "plumb"}, ["vertical must be one of", "plumb"]),
        ({"level_z": "UP"}, ["level_z must be one of up, down"]),
        ({"method": "magic"}, ["method must be one of", "magic"]),
        ({"extrinsics_source": "guess"}, ["extrinsics_source", "guess"]),
        (
            {"altitude_min": 9e5, "altitude_max": 1e5},
            ["altitude_min must be positive and below altitude_max,"],
        ),
        (
            {"altitude_min": 1.0, "altitude_max": 10.0, "limb_height": 1e5},
            ["altitude_max must be above the limb's height"],
        ),
        ({"base_frame": ""}, ["base_frame is empty"]),
        ({"base_frame": " "}, ["base_frame is empty"]),
        ({"base_frame": "/base_link"}, ["base_frame begins with a slash", "'/base_link'"]),
        ({"slop": -0.1}, ["slop", "-0.1"]),
        ({"cameras": []}, ["cameras is empty"]),
        ({"cameras": ["camera_1", "camera_1"]}, ["cameras names one twice"]),
        ({"cameras": ["camera 1"]}, ["camera 1"]),
        ({"cameras": ["stereo/left"]}, ["'stereo/left'", "letters, digits and _", "remap"]),
        ({"cameras": "camera_1"}, ["cameras must be a list"]),
        ({"queue_size": 2.5}, ["queue_size must be an integer"]),
        ({"queue_size": int("9" * 400)}, ["queue_size must be an integer", "999..."]),
        ({"camera_1.mask": 7}, ["camera_1.mask must be a string"]),
        ({"camera_1.gamma": 0.0}, ["camera_1.gamma", "0.0"]),
        ({"camera_2.gamma": "sRGB"}, ["camera_2.gamma must be a double"]),
        ({"camera_1.exposure": -0.1}, ["camera_1.exposure", "0 to 10 s", "-0.1"]),
        ({"camera_2.corner_blur": 9.0}, ["camera_2.corner_blur", "-1 to 5 px", "9.0"]),
        ({"camera_2.readout": 20.0}, ["camera_2.readout", "-1 to 1 s", "20.0"]),
        ({"coarse_pose_position_sigma": -1.0}, ["coarse_pose_position_sigma", "-1.0"]),
        ({"altitude_prior_sigma": float("nan")}, ["altitude_prior_sigma"]),
        ({"imu_max_gap": 0.0}, ["imu_max_gap", "0.0"]),
    ],
)
def test_refused_with_name_and_reason_in_one_line(values: dict, words: list[str]) -> None:
    with pytest.raises(ParameterError) as caught:
        horizon_settings({**PARAMETERS, **values})
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_the_targets_defaults_are_the_contracts() -> None:
    settings = target_settings({})
    assert settings.pipeline.target_frame == "target"
    assert settings.pipeline.tracker.max_gap_s == 2.0
    registration = settings.pipeline.tracker.registration
    assert (registration.focal_px, registration.range_noise_m) == (None, None)


def test_what_is_known_of_the_range_sensor_reaches_the_core() -> None:
    values = {"range_noise": 0.004, "pixel_angle": 0.003125, "max_gap": 5, "min_points": 7}
    values["range_bias_sigma"] = 0.002
    values["crop_max"] = [1, 2, 3.5]
    tracker = target_settings(values).pipeline.tracker
    assert tracker.registration.range_noise_m == 0.004
    assert tracker.registration.range_bias_sigma_m == 0.002
    assert tracker.registration.focal_px == pytest.approx(320.0)
    assert tracker.registration.min_points == 7
    assert tracker.max_gap_s == 5.0
    assert tracker.crop.most_m == (1.0, 2.0, 3.5)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"max_gap": 0.0}, ["max_gap", "0.0"]),
        ({"max_gap": float("nan")}, ["max_gap"]),
        ({"range_noise": -1.0}, ["range_noise", "-1.0"]),
        ({"pixel_angle": "small"}, ["pixel_angle must be a double", "small"]),
        ({"min_score": 1.5}, ["min_score", "1.5"]),
        ({"target_frame": " "}, ["target_frame is empty"]),
        ({"target_frame": "/target"}, ["target_frame begins with a slash", "'/target'"]),
        ({"min_points": 2.5}, ["min_points must be an integer"]),
        ({"crop_min": [0, 0]}, ["crop_min must be three numbers", "[0.0, 0.0]"]),
        ({"crop_max": "far"}, ["crop_max must be a list of numbers"]),
        ({"crop_min": [0, 0, 9], "crop_max": [1, 1, 9]}, ["crop_min must be below crop_max"]),
    ],
)
def test_the_targets_are_refused_likewise(values: dict, words: list[str]) -> None:
    with pytest.raises(ParameterError) as caught:
        target_settings(values)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@given(
    st.dictionaries(
        st.sampled_from([p.name for p in (*TARGET_PARAMETERS, *COMMON_PARAMETERS)]), ANY_VALUE
    )
)
def test_the_targets_values_of_any_kind_give_settings_or_one_line(values: dict[str, Any]) -> None:
    try:
        outcome = str(target_settings(values))
    except ParameterError as error:
        outcome = str(error)
    assert len(outcome.splitlines()) == 1


def test_whole_numbers_are_numbers() -> None:
    settings = horizon_settings({**PARAMETERS, "planet_radius": 1737400, "slop": 0})
    assert settings.pipeline.sensor.planet.radius_m == 1737400.0
    assert settings.pipeline.sensor.planet.has_air
    settings = horizon_settings({"cameras": ["a"], "a.rotation": [0, 0, 0, 1]})
    assert settings.pipeline.rotations == ((0.0, 0.0, 0.0, 1.0),)


def test_a_planet_without_air() -> None:
    moon = {"planet_radius": 1737400.0, "planet_air": False}
    assert not horizon_settings({**PARAMETERS, **moon}).pipeline.sensor.planet.has_air


def test_a_quaternion_slightly_off_unit_length_is_taken() -> None:
    settings = horizon_settings({"cameras": ["a"], "a.rotation": [0, 0, 0, 1.0009]})
    assert settings.pipeline.rotations == ((0.0, 0.0, 0.0, 1.0009),)
    with pytest.raises(ParameterError, match=r"a\.rotation"):
        horizon_settings({"cameras": ["a"], "a.rotation": [0, 0, 0, 1.1]})


def test_unused_cameras_need_no_rotation() -> None:
    values = {"cameras": ["camera_1"], "camera_1.rotation": [0, 0, 0, 1]}
    assert horizon_settings(values).pipeline.cameras == ("camera_1",)


def test_with_tf_no_rotation_is_needed() -> None:
    assert horizon_settings({"extrinsics_source": "tf"}).pipeline.rotations == (None, None)


@given(
    st.dictionaries(
        st.sampled_from(
            [p.name for p in (*HORIZON_PARAMETERS, *COMMON_PARAMETERS)] + list(PARAMETERS)
        ),
        ANY_VALUE,
    )
)
def test_values_of_any_kind_give_settings_or_one_line(values: dict[str, Any]) -> None:
    try:
        outcome = str(horizon_settings(values))
    except ParameterError as error:
        outcome = str(error)
    assert len(outcome.splitlines()) == 1


FILE = """
/**:
  ros__parameters:
    planet_radius: 1000000.0
    slop: 0.1
attitude_node:
  ros__parameters:
    camera_1:
      rotation: [0, 0, 0, 1]
    limb_height: 6000.0
/flight/attitude_node:
  ros__parameters:
    slop: 0.2
flight:
  local_vertical_node:
    ros__parameters:
      camera_1.rotation: [1, 0, 0, 0]
/*/local_vertical_node:
  ros__parameters:
    slop: 0.3
/**/local_vertical_node:
  ros__parameters:
    level_z: down
other_node:
  ros__parameters:
    slop: 9.9
"""


@pytest.mark.parametrize(
    ("node", "namespace", "expected"),
    [
        (
            "attitude_node",
            "/",
            {"slop": 0.1, "camera_1.rotation": [0, 0, 0, 1], "limb_height": 6000.0},
        ),
        ("attitude_node", "/flight", {"slop": 0.2}),
        ("attitude_node", "flight/", {"slop": 0.2}),
        ("local_vertical_node", "/", {"slop": 0.1, "level_z": "down"}),
        (
            "local_vertical_node",
            "/flight",
            {"slop": 0.3, "camera_1.rotation": [1, 0, 0, 0], "level_z": "down"},
        ),
        ("local_vertical_node", "/a/b", {"slop": 0.1, "level_z": "down"}),
    ],
)
def test_files_are_read_as_ros_reads_them(
    tmp_path: Path, node: str, namespace: str, expected: dict
) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(FILE)
    values = read_parameter_file(path, node, namespace)
    assert values == {"planet_radius": 1e6, **expected}


def test_numbers_as_ros_writes_them(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(
        "/**:\n ros__parameters:\n  planet_radius: 1e6\n"
        "  cameras: [a]\n  a.rotation: [0.0, 0., .0, 1e0]\n"
    )
    settings = horizon_settings(read_parameter_file(path, "attitude_node"))
    assert settings.pipeline.sensor.planet.radius_m == 1e6


@pytest.mark.parametrize("text", ["'6371000.0'", '"1e6"', "' 1 '", "1_0e", "six"])
def test_a_string_is_no_number(tmp_path: Path, text: str) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(f"/**:\n ros__parameters:\n  planet_radius: {text}\n")
    with pytest.raises(ParameterError, match="planet_radius must be a double, got '"):
        horizon_settings({**PARAMETERS, **read_parameter_file(path, "attitude_node")})


def test_a_value_of_any_length_is_shown_in_a_line() -> None:
    for value in (16**6000, "x" * 10_000, [[1] * 1000] * 1000):
        with pytest.raises(ParameterError, match="slop must be a double") as caught:
            horizon_settings({**PARAMETERS, "slop": value})
        assert len(str(caught.value)) < 120


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [1, 2", "not valid YAML"),
        ("slop: 0.1", "no ros__parameters"),
        ("- 1\n- 2", "no ros__parameters"),
        ("/**:\n  ros__parameters:\n  slop: 0.1", "nothing under ros__parameters"),
        ("/**: {ros__parameters: {}}\nb: {slop: 1}", "has b/slop outside of ros__parameters"),
        ("/**: {ros__parameters: {}, slop: [1]}", r"has \*\*/slop outside of ros__parameters"),
        ("a: &x {ros__parameters: {slop: 1}}\nb: *x", "aliases"),
        ("/**: {ros__parameters: {f: !!python/object/apply:os.getcwd []}}", "is an empty list"),
        ("#" * 1_000_001, "larger than"),
        ("a: " + 400_000 * "[" + 400_000 * "]", "nested too deeply"),
        ("a: " + 5000 * "- " + "1", "not valid YAML"),
        ("a:\n  " + 5000 * "- " + "1", "no ros__parameters"),
        ("\x00", "not valid YAML"),
        ("/**: {ros__parameters: {a: 1}, ros__parameters: {b: 1}}", r"twice for /\*\* .line 1"),
        ("/**: {ros__parameters: {slop: }}", "has no value for 'slop' .line 1"),
        ("/**: {ros__parameters: {camera_1: {}}}", "has nothing in 'camera_1' .line 1"),
        ("/**: {ros__parameters: {a: [1.0, 0]}}", r"a .of /\*\*. mixes whole numbers and decimals"),
        ("/**: {ros__parameters: {a: [[1.0]]}}", "has a list or a mapping in the list 'a'"),
        ("b: {ros__parameters: {a: [x, 1]}}", "a .of /b. mixes values of several kinds"),
        ("/**: {ros__parameters: {? [a] : 1}}", "a key that is no word"),
        ("ros__parameters: {slop: 1}", "ros__parameters under no node's name .line 1"),
        ("/**: {ros__parameters: {}}\na*: {ros__parameters: {}}", "of '/a\\*', .* name .line 2"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=words) as caught:
        read_parameter_file(path, "attitude_node")
    assert len(str(caught.value).splitlines()) == 1


SCALARS = (
    *("null", "~", "y", "N", "yes", "Off", "TRUE", "tRue", "abc", "a b", "=", "1,000", "1.5.2"),
    *("1", "+1", "-1", "010", "08", "0o10", "0x1F", "-0x10", "0x", "0b11", "1_000", "1:30"),
    *("1.", ".5", "-.5", "09.5", "1e6", "1.e5", "1E+6", "1e", "1e400", "1e-400", "0x1.8p3"),
    *("9223372036854775807", "9223372036854775808", "-9223372036854775808", "2024-01-01"),
    *(".inf", "-.Inf", ".nan", "nan", "-inf", "infinity", "'1'", "'yes'", '"1.5"', "''"),
    *("!!str 5", "!!int '5'", "!!float 5", "|\n      5", ">-\n      5"),
    *("[1, 2]", "[1.0, 2e0]", "[y, no]", "[null, a]", "['1', b]", "[x, ]", "[nan]"),
)


@pytest.fixture
def read_by_a_node(ros_domain: int) -> Callable[[Path], dict[str, Any]]:
    """Return the parameters of a real node that is started with a file."""

    def read(path: Path) -> dict[str, Any]:
        context = Context()
        arguments = ["--ros-args", "--params-file", str(path)]
        rclpy.init(args=arguments, context=context, domain_id=ros_domain)
        try:
            node = rclpy.create_node(
                "attitude_node",
                context=context,
                automatically_declare_parameters_from_overrides=True,
            )
            values = {name: each.value for name, each in node.get_parameters_by_prefix("").items()}
            node.destroy_node()
        finally:
            rclpy.shutdown(context=context)
        own = {"use_sim_time", "start_type_description_service"}
        return {
            name: list(value) if isinstance(value, array) else value
            for name, value in values.items()
            if name not in own
        }

    return read


def as_read(values: dict[str, Any]) -> dict[str, str]:
    """Values with their kinds, and NaN like itself."""
    return {name: repr(value) for name, value in values.items()}


def test_values_are_those_that_a_node_gets(
    tmp_path: Path, read_by_a_node: Callable[[Path], dict[str, Any]]
) -> None:
    path = tmp_path / "params.yaml"
    lines = [f"    p{i}: {text}" for i, text in enumerate(SCALARS)]
    path.write_text("\n".join(["/**:", "  ros__parameters:", *lines]))
    expected = as_read(read_by_a_node(path))
    assert len(expected) == len(SCALARS)
    assert as_read(read_parameter_file(path, "attitude_node")) == expected


@pytest.mark.parametrize(
    "text",
    [
        "/**: {ros__parameters: {a: 1, a: 2}}",
        "/**: {ros__parameters: {a: 2.5, a: 1, b: x, b: 2.5, c: 2.5, c: x, d: [1.0], d: 2.0}}",
        "/**: {ros__parameters: {a: [1.0, 2.0], a: [3], b: {c: 1}, b: {d: 2, c: 3}, b.d: 4}}",
        "/**: {ros__parameters: {a: 1, b: 1}}\nattitude_node: {ros__parameters: {a: 2}}\n"
        "/**: {ros__parameters: {a: 3, b: 3}}",
        "attitude_node: {ros__parameters: {a: 2}}\n/**: {ros__parameters: {a: 3}}",
        "/**: {ros__parameters: {010: 1, true: 2, <<: {a: 1}}}",
        "/**: {ros__parameters: {a: 1}}\n---\n/**: {ros__parameters: {b: &x 1}}",
        "other: {ros__parameters: {a: []}}\n/**: {ros__parameters: {b: 1}}",
    ],
)
def test_names_that_are_there_twice_are_those_that_a_node_gets(
    tmp_path: Path, text: str, read_by_a_node: Callable[[Path], dict[str, Any]]
) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(text)
    assert as_read(read_parameter_file(path, "attitude_node")) == as_read(read_by_a_node(path))


NAMES = (
    *("attitude_node", "/attitude_node", "/*", "**", "/**/attitude_node", "nav/", "/", "_x", "x9"),
    *("attitude_*", "/**attitude_node", "//attitude_node", "/nav/", "/***", "9", "a-b", "a b", "~"),
    *("\u00e4", "/nav//attitude_node", "/nav/9/x", "/n-v/x", "ros__parameters"),
)


@pytest.mark.parametrize(
    "form",
    [
        "'{}': {{ros__parameters: {{a: 1}}}}",
        "nav: {{'{}': {{ros__parameters: {{a: 1}}}}}}",
        "'{}': {{attitude_node: {{ros__parameters: {{a: 1}}}}}}",
    ],
)
def test_names_that_no_node_has_are_refused_as_by_a_node(
    tmp_path: Path, form: str, read_by_a_node: Callable[[Path], dict[str, Any]]
) -> None:
    path = tmp_path / "params.yaml"
    refused = 0
    for name in NAMES:
        path.write_text(form.format(name))
        try:
            expected = read_by_a_node(path)
        except RuntimeError:
            refused += 1
            with pytest.raises(ParameterError, match="node's name"):
                read_parameter_file(path, "attitude_node")
        else:
            assert read_parameter_file(path, "attitude_node") == expected, name
    assert 0 < refused < len(NAMES)


@pytest.mark.parametrize(
    "value", ["!!bool foo", "!!int ''", "2024-13-45", "0x" + 5000 * "f", 5000 * "9", "null", "1_0"]
)
def test_what_ros_takes_for_text_is_no_number(tmp_path: Path, value: str) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(f"/**: {{ros__parameters: {{slop: {value}}}}}")
    with pytest.raises(ParameterError, match="slop must be a double, got '") as caught:
        horizon_settings({**PARAMETERS, **read_parameter_file(path, "attitude_node")})
    assert len(str(caught.value)) < 120


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="No such file"):
        read_parameter_file(tmp_path / "none.yaml", "attitude_node")


def test_an_empty_file_sets_nothing(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text("# nothing\n")
    assert read_parameter_file(path, "attitude_node") == {}


def test_typing_errors_in_names_are_found() -> None:
    values = {**PARAMETERS, "planet_raduis": 1.0, "use_sim_time": True}
    values["max_gap"] = 3.0
    values["nodes"] = ["attitude_node"]
    values["qos_overrides./attitude.publisher.depth"] = 3
    ignored = ["qos_overrides./attitude.publisher.durability"]
    # rclpy goes by full topic names alone.
    ignored.append("qos_overrides.attitude.publisher.depth")
    values.update(dict.fromkeys(ignored, 3))
    for own in (horizon_parameters(values), target_parameters()):
        assert unknown_parameters(values, own) == ["planet_raduis", *ignored]


def test_a_known_altitude_without_its_sigma_is_said_to_be_ignored() -> None:
    values = {**PARAMETERS, "altitude_prior": 5e5}
    (told,) = ignored_parameters(values, horizon_parameters(values))
    assert "altitude_prior is ignored" in told
    assert "altitude_prior_sigma" in told
    # The target's node has the same file.
    assert ignored_parameters(values, target_parameters()) == []
    values["altitude_prior_sigma"] = 100.0
    assert ignored_parameters(values, horizon_parameters(values)) == []


def test_typing_errors_in_cameras_names_are_found() -> None:
    values = {**PARAMETERS, "camera1.gamma": 2.2, "camra_2.mask": "/mask.png", "left.readout": 0.1}
    unknown = ["camera1.gamma", "camra_2.mask", "left.readout"]
    assert unknown_parameters(values, horizon_parameters(values)) == unknown
    # Others are used: the blocks of the shipped file may stay.
    values["cameras"] = ["left", "right"]
    assert unknown_parameters(values, horizon_parameters(values)) == unknown[:2]
    # What the cameras are called is none of the target's business.
    assert unknown_parameters(values, target_parameters()) == []


def test_the_shipped_file_is_made_from_the_table() -> None:
    shipped = Path(__file__).parents[3] / "config" / "params.yaml"
    assert shipped.read_text() == parameter_file()


def test_the_shipped_file_holds_every_default() -> None:
    values = yaml.safe_load(parameter_file())["/**"]["ros__parameters"]
    assert values == {p.name: p.default for p in ALL_PARAMETERS}
    assert max(len(line) for line in parameter_file().splitlines()) <= 100


def test_the_block_of_a_camera_may_be_uncommented_as_a_whole(tmp_path: Path) -> None:
    """Its lines are one block: a second one of the same name is an error to YAML, and to ROS."""
    text = parameter_file()
    start = text.index("    # camera_1:")
    block = text[start : text.index("\n\n", start)]
    whole = "\n".join("    " + line.removeprefix("    # ") for line in block.splitlines())
    path = tmp_path / "params.yaml"
    path.write_text(text.replace(block, whole))
    values = read_parameter_file(path, "attitude_node")
    names = {of("camera_1").name for of in OF_A_CAMERA}
    assert names <= values.keys()
    assert not unknown_parameters(values, horizon_parameters(values))


def test_the_reference_names_every_parameter() -> None:
    reference = parameter_reference()
    names = [parameter.name for parameter in ALL_PARAMETERS]
    for name in (
        *names,
        "camera_N.rotation",
        "camera_N.mask",
        "camera_N.gamma",
        "camera_N.readout",
        "camera_N.exposure",
        "camera_N.corner_blur",
    ):
        assert f"| `{name}` |" in reference
    assert '| `camera_N.mask` | `""` |' in reference


def test_what_is_told_of_a_camera_is_its_own() -> None:
    rotation = [0.0, 0.0, 0.0, 1.0]
    values = {
        "cameras": ["left", "right"],
        "left.rotation": rotation,
        "right.rotation": rotation,
        "left.corner_blur": 0.3,
        "right.readout": -0.02,
        "right.exposure": 0.01,
        "right.gamma": 2.2,
    }
    left, right = horizon_settings(values).pipeline.each
    assert (left.name, left.corner_blur_px, left.readout_s, left.gamma) == ("left", 0.3, 0.0, 1.0)
    assert (right.corner_blur_px, right.readout_s, right.gamma) == (None, -0.02, 2.2)
    assert (left.exposure_s, right.exposure_s) == (0.0, 0.01)
    with pytest.raises(ParameterError) as error:
        horizon_settings({**values, "left.gamma": 0.0, "left.readout": 2.0})
    assert "left.gamma" in str(error.value)
    assert "left.readout" in str(error.value)


def test_every_number_has_its_range_and_its_unit() -> None:
    numbers = [
        parameter
        for parameter in (*horizon_parameters({}), *target_parameters())
        if parameter.kind in ("double", "integer")
    ]
    assert len(numbers) > 30
    # Shares, counts, exponents, and multiples of a noise.
    plain = re.compile(
        r"min_(limb_share|clear_sky|contrast|points|score|overlap)|max_(bright_sky|space_level)"
        r"|max_refused|queue_size|keyframe_overlap|camera_\d\.gamma"
    )
    for parameter in numbers:
        assert parameter.minimum is not None, parameter.name
        assert parameter.maximum is not None, parameter.name
        name = parameter.name
        assert bool(parameter.unit) != bool(plain.fullmatch(name)), name
