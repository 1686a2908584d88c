"""Settings of Sphinx for `make docs`. The sources are the whole repository, where links are relative to their files."""

import gc
import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
gc.set_threshold(200_000, 20, 50)  # trees of 45 pages stay: looking through them for garbage took a fifth of the time
ROOT = Path(__file__).parents[2]

project = "uav-cosim"
version = release = installed("uav-cosim")
language = "en"

root_doc = "docs/site/index"
include_patterns = ["*.md", "docs/*.md", "docs/site/*.md", "benchmarks/README.md"]
_READ = {include.partition("/")[0] for include in include_patterns}
# Sphinx looks through all folders that are not excluded, environments and caches among them.
exclude_patterns = [one.name for one in ROOT.iterdir() if one.is_dir() and one.name not in _READ]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton", "declarations"]
myst_heading_anchors = 4
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_class_signature = "separated"
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = "uav-cosim"
html_extra_path = ["index.html"]  # leads from the folder to the first page
html_show_copyright = html_show_sphinx = html_copy_source = False
