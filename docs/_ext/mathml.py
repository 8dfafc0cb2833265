"""Formulas as MathML, which browsers draw themselves: no script, no fonts from elsewhere."""

import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number

FUNCTION = re.compile(r"(?<=[\w}])\s*(\\(?:sin|cos))\s+")


def mathml(source: str, display: str) -> str:
    """MathML of a LaTeX formula; ``display`` is inline or block."""
    spaced = FUNCTION.sub(
        r"\\,\1\\,", source
    )  # the converter sets functions without their thin spaces
    return convert(spaced.replace("{aligned}", "{align*}"), display=display)


def visit_inline(translator, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def visit_block(translator, node: nodes.math_block) -> None:
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    if node["number"]:
        number = get_node_equation_number(translator, node)
        translator.body.append(f'<span class="eqno">({number})')
        translator.add_permalink_ref(node, "Link to this equation")
        translator.body.append("</span>")
    translator.body.append(f'<div class="formula">{mathml(node.astext(), "block")}</div></div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
