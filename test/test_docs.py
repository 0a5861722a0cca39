"""The documentation: built without a warning, true to the code, readable in a browser."""

from __future__ import annotations

import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from horizon_sensor_ros.core.mathematics.attitude import (
    level_from_base,
    nadir_from_roll_pitch,
    rotation_from_quaternion,
)

ROOT = Path(__file__).parents[1]
DOC = ROOT / "doc"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# Quiet: no sandbox for root, and nothing that looks for a network.
BROWSER_OPTIONS = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages as `make docs` builds them: any warning is an error."""
    pytest.importorskip("sphinx", reason="sphinx is not installed: make venv installs it")
    pytest.importorskip("myst_parser", reason="myst-parser is not installed: make venv does")
    out = tmp_path_factory.mktemp("docs") / "html"
    options = ("-q", "-W", "--keep-going", "-b", "html")
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", *options, str(DOC), str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return out


def text_of(page: str) -> str:
    """A page's words, in one line."""
    return " ".join((DOC / page).read_text(encoding="utf-8").split())


def table_rows(page: str, heading: str) -> dict[str, list[str]]:
    """Cells by the first cell of each row, of the first table below a heading."""
    text = (DOC / page).read_text(encoding="utf-8").split(f"## {heading}\n", 1)[1]
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line.startswith("|"):
            first, *others = (cell.strip() for cell in line.strip("|").split("|"))
            found[first] = others
        elif found:
            break
    return found


# ---------------------------------------------------------------------------- pages


def test_every_page_is_built(pages: Path) -> None:
    for source in [*DOC.glob("*.md"), *DOC.glob("api/*.rst")]:
        page = pages / source.relative_to(DOC).with_suffix(".html")
        assert page.is_file()
    # Equations came out as MathML, not as text.
    assert "<math" in (pages / "horizon.html").read_text()


@pytest.mark.parametrize(
    ("tex", "found"),
    [
        (r"\tfrac12 x", "<mn>1</mn><mn>2</mn></mfrac>"),
        (r"\bar{\mathbf n}_i", "</mover><mi>i</mi></msub>"),
        (r"\sum_i x", "<munder>"),
    ],
)
def test_equations_mean_what_they_say(
    tex: str, found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(DOC / "extensions"))
    extension = pytest.importorskip("mathml")
    assert found in re.sub(r"\s*\n\s*", "", extension.mathml(tex))


def test_the_api_pages_have_every_module_of_the_core(pages: Path) -> None:
    text = "".join(page.read_text() for page in (pages / "api").glob("*.html"))
    core = ROOT / "horizon_sensor_ros" / "core"
    for file in core.rglob("*.py"):
        name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        if file.name != "__init__.py":
            assert f'id="module-{name}"' in text, name


def test_nothing_is_loaded_from_elsewhere(pages: Path) -> None:
    loaded = re.compile(r"""(?:src|<link[^>]*href)=["'](https?:)?//""")
    for page in pages.rglob("*.html"):
        assert not loaded.search(page.read_text(encoding="utf-8")), page


def playwright_api() -> Any:
    return pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser to look at the pages with: {', '.join(BROWSERS)}")
    with playwright_api().sync_playwright() as started:
        running = _launched(started.chromium, program)
        yield running
        running.close()


def _launched(chromium: Any, program: str) -> Any:
    """A browser; one in some hundred starts hangs, and is tried once more."""
    launch = partial(chromium.launch, executable_path=program, args=BROWSER_OPTIONS, timeout=30_000)
    try:
        return launch()
    except playwright_api().TimeoutError:
        return launch()


@pytest.mark.parametrize("width", [1280, 390])
def test_pages_in_a_browser(pages: Path, browser: Any, width: int) -> None:
    view = browser.new_page(viewport={"width": width, "height": 844})
    complaints: list[str] = []
    view.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
    view.on("pageerror", lambda error: complaints.append(str(error)))
    view.on("requestfailed", lambda request: complaints.append(request.url))
    for page in sorted(pages.rglob("*.html")):
        view.goto(page.as_uri())
        missing = "[...document.images].filter(i => !i.naturalWidth).map(i => i.src)"
        assert view.evaluate(missing) == [], page
        wide = view.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, f"{page} is {wide} px wide"
        assert complaints == [], page
    view.close()


# ---------------------------------------------------------------------------- generated parts


def test_the_table_of_parameters_is_that_of_the_declared_ones() -> None:
    page = (DOC / "parameters.md").read_text(encoding="utf-8")
    written = runpy.run_path(str(DOC / "write_parameters.py"))["parameter_page"](page)
    assert page == written, "`make params` writes it anew"


def test_files_that_the_architecture_names_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DOC))
    figure = pytest.importorskip("figures.architecture")
    drivers = (figure.HORIZON_DRIVER, figure.TARGET_DRIVER)
    groups = (drivers, figure.HORIZON, figure.TARGET, figure.ROS_IN, figure.ROS_OUT, figure.NODES)
    names = [name for name, _ in sum((*groups, figure.TOOLS), ())]
    # The others are steps that are no file of their own.
    files = [name for name in names if "/" in name]
    assert len(files) > 15
    for name in files:
        assert (ROOT / "horizon_sensor_ros" / name).exists(), name


def test_every_figure_of_a_page_is_drawn_by_code() -> None:
    code = [*(DOC / "figures").glob("*.py"), ROOT / "benchmarks" / "soak.py"]
    drawn = "".join(path.read_text() for path in code)
    for page in [*DOC.glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]:
        for picture in re.findall(r"!\[[^\]]*\]\((?:doc/)?pictures/([^)]+)\)", page.read_text()):
            assert (DOC / "pictures" / picture).is_file(), f"{page.name}: {picture}"
            by = re.search(rf'["/]{re.escape(picture)}\b', drawn)
            assert by, f"{page.name}: nothing draws {picture}"


def test_every_cause_of_a_refusal_is_explained() -> None:
    written = "\n".join(path.read_text() for path in (ROOT / "horizon_sensor_ros").rglob("*.py"))
    causes = set(re.findall(r'Refusal\(\s*"([a-z_]+)"', written))
    assert {"bad_data", "zero_size", "no_camera_info"} <= causes
    page = text_of("conventions.md")
    assert [cause for cause in sorted(causes) if f"`{cause}`" not in page] == []


# ---------------------------------------------------------------------------- conventions


@pytest.mark.parametrize(("level_z", "column"), [("up", 0), ("down", 1)])
def test_what_the_page_says_of_roll_and_pitch(level_z: str, column: int) -> None:
    rows = table_rows("conventions.md", "Roll, pitch and the level frame")
    angles = {"roll": np.radians(7.0), "pitch": np.radians(11.0)}
    functions = {
        f"{f.__name__} {a}": float(f(v)) for f in (np.sin, np.cos) for a, v in angles.items()
    }
    said = rows["nadir in the base frame"][column].strip("`()").split(", ")
    nadir = []
    for text in said:
        terms = re.findall(r"(?:sin|cos) (?:roll|pitch)", text)
        nadir.append((-1 if text.startswith("-") else 1) * np.prod([functions[t] for t in terms]))
    code = nadir_from_roll_pitch(angles["roll"], angles["pitch"], level_z)
    np.testing.assert_allclose(nadir, code, atol=1e-12)

    level = [float(v) for v in rows["nadir in the level frame"][column].strip("`()").split(",")]
    rot_level_from_base = level_from_base(code, level_z)
    np.testing.assert_allclose(rot_level_from_base @ code, level, atol=1e-12)

    # Heights of nose and right side of a craft whose base frame is the one of this column.
    up_level = -np.array(level)
    right_base = np.array(
        {"forward-left-up": [0, -1.0, 0]}.get(rows["goes with a base frame"][column], [0, 1.0, 0])
    )
    pitched = level_from_base(nadir_from_roll_pitch(0.0, 0.1, level_z), level_z)
    nose_height = up_level @ pitched @ [1.0, 0, 0]
    says = rows["pitch > 0 (with that base frame)"][column].replace("*", "")
    assert says == ("nose up" if nose_height > 0 else "nose down")
    rolled = level_from_base(nadir_from_roll_pitch(0.1, 0.0, level_z), level_z)
    assert up_level @ rolled @ right_base < 0
    assert rows["roll > 0 (with that base frame)"][column] == "right side down"


def test_the_page_says_which_default_holds() -> None:
    from horizon_sensor_ros.ros.parameters.horizon import HORIZON_PARAMETERS

    default = next(p.default for p in HORIZON_PARAMETERS if p.name == "level_z")
    header = table_rows("conventions.md", "Roll, pitch and the level frame")[""]
    assert [f"`level_z: {default}` (default)" == cell for cell in header] == [True, False]


def test_the_page_says_where_a_camera_looks() -> None:
    page = text_of("conventions.md")
    for name, down in (("forward-left-up", [0, 0, -1.0]), ("forward-right-down", [0, 0, 1.0])):
        text = re.search(rf"{name}: `\[([^]]+)\]`", page)
        assert text
        rot_base_from_cam = rotation_from_quaternion(np.array(eval(f"[{text[1]}]")))
        np.testing.assert_allclose(rot_base_from_cam @ [0, 0, 1], [1, 0, 0], atol=1e-12)
        np.testing.assert_allclose(rot_base_from_cam @ [0, 1, 0], down, atol=1e-12)


def test_what_the_page_says_of_the_attitudes_covariance() -> None:
    from horizon_sensor_ros.core.mathematics.attitude import (
        GROUND_VARIANCE_M2,
        YAW_VARIANCE_RAD2,
        pose_covariance,
    )

    page = text_of("conventions.md")
    assert "about the level frame's **fixed** axes (REP 103): `R = exp(e) R_true`" in page
    assert "They are not variances of Euler angles" in page
    assert "`(2 pi)^2` rad² and `1e14` m²" in page
    assert pytest.approx((2 * np.pi) ** 2) == YAW_VARIANCE_RAD2
    assert GROUND_VARIANCE_M2 == 1e14
    # A disturbed nadir turns the published rotation by exp(e) from the left, about fixed axes.
    nadir = nadir_from_roll_pitch(0.4, -0.7, "up")
    across = np.cross(nadir, [0.3, 0.5, 0.8])
    small = 1e-6 * across / np.linalg.norm(across)
    rot, disturbed = (level_from_base(n, "up") for n in (nadir, nadir + small))
    turn = disturbed @ rot.T
    e = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0]]) / 2
    cov = np.zeros((4, 4))
    cov[:3, :3] = np.outer(small, small)
    np.testing.assert_allclose(
        pose_covariance(cov, rot, "up")[3:5, 3:5], np.outer(e, e), rtol=1e-4, atol=1e-18
    )


def test_what_the_page_says_of_the_targets_step() -> None:
    from target_messages import good_cloud

    from horizon_sensor_ros.ros.parameters.target_settings import target_settings
    from horizon_sensor_ros.ros.pipelines.target_pipeline import TargetPipeline

    rows = table_rows("conventions.md", "The target's pose, step and twist")
    pipeline = TargetPipeline(target_settings({}).pipeline)
    first = dict(pipeline.on_cloud(good_cloud(0)).outputs)
    second = dict(pipeline.on_cloud(good_cloud(1)).outputs)
    assert "no step and no twist" in text_of("conventions.md")
    assert list(first) == ["target/pose"]
    frames = {f"`{topic}`": message.header.frame_id for topic, message in second.items()}
    for topic in ("`target/pose_delta`", "`target/twist`"):
        assert rows[topic][0].replace("<target_frame>", "target") == f"`{frames[topic]}`"
    assert rows["`target/pose`"][0] == "the range sensor's"
    assert frames["`target/pose`"] == good_cloud(1).header.frame_id
    assert rows["`target/pose_delta`"][1].startswith("`inv(pose_previous) * pose_now`")
    before, now, step = (
        matrix(message.pose.pose)
        for message in (first["target/pose"], second["target/pose"], second["target/pose_delta"])
    )
    np.testing.assert_allclose(np.linalg.inv(before) @ now, step, atol=1e-9)


def matrix(pose: Any) -> np.ndarray:
    q, p = pose.orientation, pose.position
    found = np.eye(4)
    found[:3, :3] = rotation_from_quaternion(np.array([q.x, q.y, q.z, q.w]))
    found[:3, 3] = p.x, p.y, p.z
    return found


def test_what_the_pages_say_of_the_defaults() -> None:
    from horizon_sensor_ros.core.horizon.config import HorizonConfig

    config = HorizonConfig()
    rows = table_rows("horizon.md", "Judgement")
    for name in ("max_space_level", "min_contrast", "max_bright_sky", "min_clear_sky"):
        assert float(rows[f"`{name}`"][0]) == getattr(config, name)
    assert float(rows["`min_limb_share`"][0]) == config.min_limb_share
    assert rows["`max_residual`"][0] == f"{config.max_residual_px:g} px"
    sigma_deg = np.degrees(config.max_nadir_sigma_rad)
    assert rows["`max_nadir_sigma`"][0] == f"{sigma_deg:g} deg"
