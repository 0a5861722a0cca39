"""Sphinx's settings: `make docs` builds the pages into build/docs, from Markdown and docstrings."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "extensions"), str(HERE.parent)]

project = "horizon_sensor_ros"
author = "Horizon Sensor ROS maintainers"
copyright = author
extensions = ["myst_parser", "sphinx.ext.autodoc", "mathml", "plain_docstrings", "module_pages"]
exclude_patterns = ["extensions", "figures", "pictures", "static"]

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
# Part of a ROS installation, and not to be had from PyPI.
autodoc_mock_imports = ["launch", "launch_ros"]
# Annotations are all there are; to look for others is a tenth of the time.
autodoc_use_type_comments = False
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True}
python_maximum_signature_line_length = 60
add_module_names = False
python_use_unqualified_type_names = True

html_theme = "alabaster"
html_title = project
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_copy_source = False
html_show_sphinx = False
html_use_index = False
html_domain_indices = False
html_theme_options = {
    "description": "Down, roll, pitch and altitude from cameras that see a planet's limb",
    "fixed_sidebar": True,
    "page_width": "74rem",
    "sidebar_width": "15rem",
    "body_max_width": "none",
    "font_family": "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif",
    "head_font_family": "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif",
    "font_size": "16px",
    "link": "#0072B2",
    "link_hover": "#D55E00",
    "show_powered_by": False,
    "show_relbars": True,
}
html_sidebars = {"**": ["about.html", "searchfield.html", "navigation.html"]}
