"""The documentation site: docs/, the README and the benchmarks as they lie in the repository.

`./dev docs` builds it into build/docs/html. The source folder is the repository itself, so that
every relative link that works in the repository works in the site; links to sources become
downloads.
"""

from __future__ import annotations

import sys
from pathlib import Path

import rotavg

sys.path.insert(0, str(Path(__file__).parent))

project = "rotavg"
author = "The rotavg developers"
copyright = "the rotavg developers, MIT licence"
version = release = rotavg.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "complete",
    "cpp_reference",
    "gallery",
    "mathml",
    "python_reference",
    "repository",
]
root_doc = "docs/README"
include_patterns = [
    "README.md",
    "CHANGELOG.md",
    "third_party.md",
    "docs/**.md",
    "docs/**.rst",
    "benchmarks/*.md",
]
exclude_patterns = ["build", "dist", "demo", ".*", "shared", "python", "cpp", "tests", "examples"]
# A page may go from # to ###; an attribute that several classes have is none of them in particular.
suppress_warnings = ["myst.header", "ref.python"]

myst_enable_extensions = ["dollarmath", "colon_fence", "html_image"]
myst_heading_anchors = 4
highlight_language = "none"

default_role = "py:obj"  # `name` in a docstring: a link where it is one
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_class_signature = "mixed"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "IdArray", "Callback", "Id", "Source")}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_attr_annotations = False  # docstrings give shapes, which types do not
maximum_signature_line_length = 90
add_module_names = False
cpp_maximum_signature_line_length = 90
toc_object_entries = False

html_theme = "furo"
html_title = "rotavg"
html_static_path = ["static"]
html_css_files = ["rotavg.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}
templates_path: list[str] = []
copybutton_exclude = ".linenos, .gp, .go"
