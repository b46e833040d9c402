import os
import sys
from pathlib import Path

import armwright

sys.path.insert(0, str(Path(__file__).parent / "ext"))

project = "Armwright"
author = "The Armwright developers"
copyright = "The Armwright developers; Apache-2.0"
version = release = armwright.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.viewcode",
    "armwright_cells",
    "armwright_domain",
    "armwright_formulas",
]
exclude_patterns = ["ext"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
nitpicky = False

maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"
viewcode_line_numbers = True

# Links to what other projects document need their sites, and no other part of the build does: `make docs LINKS=1`.
if os.environ.get("LINKS"):
    extensions.append("sphinx.ext.intersphinx")
    intersphinx_mapping = {
        "python": ("https://docs.python.org/3", None),
        "numpy": ("https://numpy.org/doc/stable", None),
        "scipy": ("https://docs.scipy.org/doc/scipy", None),
        "xarray": ("https://docs.xarray.dev/en/stable", None),
    }

html_theme = "furo"
html_title = f"Armwright {release}"
html_static_path = ["static"]
html_css_files = ["armwright.css"]
html_show_sphinx = False
html_copy_source = False
