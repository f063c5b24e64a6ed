"""How Sphinx builds the site; `docs.site.build` makes the pages that it reads."""

from contactlab import __version__

project = "contactlab"
author = "The contactlab authors"
copyright = author  # noqa: A001 - Sphinx's name
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
default_role = "code"
# A console's text, and sweep files with comments of their own.
highlight_language = "none"

html_theme = "furo"
html_title = "contactlab"
html_favicon = "_static/favicon.svg"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
