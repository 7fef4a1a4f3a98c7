"""The site of `make docs`: the pages of the repository as they stand there, and the reference.

The source folder is the repository itself, so that links between pages, examples and source files
mean on the site what they mean in a checkout. Nothing is fetched, neither here nor by the pages.
"""

import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

project = "Aleator"
author = "The Aleator developers"
copyright = author
release = version = installed("aleator")

root_doc = "docs/index"
include_patterns = ["docs/**", "examples/**", "README.md", "CONTRIBUTING.md", "CHANGELOG.md"]
exclude_patterns = ["**/out", "**/.*", "**/__pycache__"]
source_suffix = {".md": "markdown"}

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "docstrings",
    "mathml",
    "sources",
]
nitpicky = True
# Types in signatures are told as they are written: most of them have no page of their own.
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autoclass_content = "class"

myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
# `#a-heading` of another page is found as the forges find it.
myst_heading_anchors = 4
# A shell's or Python's prompt is not copied.
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "furo"
html_title = f"Aleator {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
templates_path = ["templates"]
html_additional_pages = {"index": "start.html"}
html_math_renderer = "mathml"
html_show_sphinx = False
html_copy_source = False
# A summary is fetched from the page that was found, which browsers refuse for local files.
html_show_search_summary = False
html_theme_options: dict[str, list[str]] = {"top_of_page_buttons": []}
pygments_style = "friendly"
pygments_dark_style = "native"
