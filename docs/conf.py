"""Settings of the documentation site: `sphinx-build -W docs build/docs`."""

from tdfscal import __version__ as release

project = "tdfscal"
author = "tdfscal maintainers"
version = release

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
]
exclude_patterns: list[str] = []
html_theme = "pydata_sphinx_theme"
html_title = f"tdfscal {release}"
# The pages lie side by side: no sections to show beside them.
html_sidebars = {"**": []}
html_theme_options = {"show_toc_level": 2, "navigation_with_keys": False}

myst_enable_extensions = ["amsmath", "dollarmath"]
# The pages link to headings as GitHub does.
myst_heading_anchors = 4
nb_execution_mode = "auto"
nb_execution_timeout = 300
nb_execution_raise_on_error = True

autodoc_typehints = "none"
autosummary_generate = True
numpydoc_show_class_members = False
