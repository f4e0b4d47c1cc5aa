"""The documentation site: sphinx-build -W docs FOLDER (extra `docs`). Its pages are also read on GitHub as they are."""

import sys
from pathlib import Path

from sphinx.ext.autodoc.mock import mock

import wayfield

with mock(["stable_baselines3"]):  # which NativeVecEnv extends: the site needs nothing of it
    import wayfield.envs.sb3

sys.path.insert(0, str(Path(__file__).parent))

project = "wayfield"
author = "The wayfield authors"
release = version = wayfield.__version__
html_title = "wayfield"

extensions = ["myst_parser", "sphinx.ext.autodoc"]
extensions += ["registry_pages", "docstrings", "simulators"]  # of this folder
suppress_warnings = ["myst.header"]  # the full tables of a run begin below the title of a page
source_suffix = {".md": "markdown"}

myst_heading_anchors = 4  # as GitHub has them
myst_enable_extensions = ["attrs_inline"]

html_theme = "furo"
html_static_path = ["_static"]
html_favicon = "_static/icon.svg"
html_css_files = ["site.css"]
html_js_files = [("tables.js", {"defer": "defer"})]
html_extra_path = ["generated/demo.html", "demo.png"]  # written by simulators; what links to it show
html_show_sourcelink = False
html_show_copyright = False

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
