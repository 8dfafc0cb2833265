"""The site. Build it with ``microvib docs --build``, or ``sphinx-build -W --keep-going docs docs/_build/html``.

It is made from the repository alone and needs no network, neither to build nor to read: formulas become MathML, fonts are the
reader's, figures and numbers come from the package as it is.
"""

import hashlib
import os
import sys
from pathlib import Path

import microvib

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

os.environ["COLUMNS"] = "96"  # tables that are printed on a page fold to what it has room for

project = "microvib"
author = "The microvib developers"
copyright = author
version = release = microvib.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_click",
    "mathml",
    "drawings",
    "gallery",
    "cells",
]
exclude_patterns = ["_build", "_ext"]
nitpicky = True
# Types of other libraries: their pages are elsewhere, and a link needs the network.
nitpick_ignore_regex = [("py:(class|obj|data)", r".*")]

html_theme = "furo"
html_title = f"microvib {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_search_summary = False  # would fetch the pages, which a browser forbids for files
html_theme_options = {"navigation_with_keys": True}

math_renderer = html_math_renderer = "mathml"
smartquotes = False  # examples are pasted, from prose and help texts, too
numfig = math_numfig = True
highlight_language = "none"
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 4
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autosummary_generate = False


def _package_hash() -> str:
    """Hash of all that a computed page can depend on: code and data of the package, helpers of the site."""
    files = [*Path(microvib.__file__).parent.rglob("*"), *(HERE / "_ext").rglob("*")]
    wanted = sorted(
        f for f in files if f.suffix in (".py", ".yaml", ".csv") and "site" not in f.parts
    )
    return hashlib.sha256(b"".join(f.read_bytes() for f in wanted)).hexdigest()[:16]


# Pages are executed again when they change or when the package does.
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / "_build" / "executed" / _package_hash())
nb_execution_in_temp = True
nb_execution_show_tb = True  # the warning that a failed cell is says why
nb_execution_timeout = 600
nb_merge_streams = True
nb_render_markdown_format = "myst"
nb_number_source_lines = False
# What the cells call: this environment's commands, and the helpers of the site.
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
os.environ["PYTHONPATH"] = str(HERE / "_ext")
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the command line has it
