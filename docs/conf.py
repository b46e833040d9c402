import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "ext"))

import armwright

project = "Armwright"
author = "The Armwright developers"
copyright = "The Armwright developers; Apache-2.0"
version = release = armwright.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "armwright_pages"]
exclude_patterns = ["ext"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
nitpicky = False

autodoc_typehints = "none"  # shapes and units say more, and stand in the text
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = f"Armwright {release}"
html_static_path = ["static"]
html_css_files = ["armwright.css"]
html_show_sphinx = False
html_copy_source = False
