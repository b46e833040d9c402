import armwright

project = "Armwright"
author = "The Armwright developers"
copyright = "The Armwright developers; Apache-2.0"
version = release = armwright.__version__

extensions = ["myst_parser"]
exclude_patterns = ["ext"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
nitpicky = False

html_theme = "furo"
html_title = f"Armwright {release}"
html_static_path = ["static"]
html_css_files = ["armwright.css"]
html_show_sphinx = False
html_copy_source = False
