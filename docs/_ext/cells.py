"""Executed cells as their reader needs them: a shell command without the notebook's magic, a written file under its name."""

from docutils import nodes
from sphinx.application import Sphinx


def without_magic(app: Sphinx, doctree: nodes.document) -> None:
    for block in doctree.findall(nodes.literal_block):
        first, _, rest = block.astext().partition("\n")
        if first == "%%console":
            block["language"] = "console"
        elif first.startswith("%%writefile "):
            block["language"] = "yaml"
        else:
            continue
        block.rawsource = rest
        block.children = [nodes.Text(rest)]


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("doctree-read", without_magic)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
