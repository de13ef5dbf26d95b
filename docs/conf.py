"""How the documentation is built: `make docs`."""

from __future__ import annotations

import sys
from pathlib import Path

import orientd

sys.path.insert(0, str(Path(__file__).parent))

project = "orientd"
release = version = orientd.__version__
project_copyright = "the authors of orientd, Apache-2.0"
html_title = f"orientd {version}"

extensions = [
    "generators.build",
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
]
exclude_patterns = ["generators", "reference/parts"]
# Classes of several packages share a name, such as Samples; a link goes to the first.
suppress_warnings = ["ref.python"]
# Options are spelled with two hyphens, not with a dash.
smartquotes = False
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["orientd.css"]
# Whose sources these pages were made of can be read in the repository.
mathjax_path = "mathjax/tex-chtml.js"
html_copy_source = False
html_show_sphinx = False

myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "fieldlist"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
python_use_unqualified_type_names = True
maximum_signature_line_length = 88
copybutton_exclude = ".linenos, .gp, .go"
