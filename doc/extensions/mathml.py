"""Equations as MathML, which browsers draw themselves: no script, no picture, no network."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

# Two things that docutils' translator takes amiss: a fraction without braces, and an index after
# an accent, which it puts below the letter.
_BARE_FRACTION = re.compile(r"\\([td]?frac)\s*(\w)\s*(\w)")
_ACCENT_WITH_INDEX = re.compile(
    r'<munderover>\s*(<mi>[^<]*</mi>)\s*(.*?)\s*(<mo stretchy="false">[^<]*</mo>)\s*</munderover>',
    re.DOTALL,
)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer and make it the one in use."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def mathml(tex: str, *, block: bool = False) -> str:
    """MathML of an equation in TeX."""
    found = tex2mathml(_BARE_FRACTION.sub(r"\\\1{\2}{\3}", tex), as_block=block)
    return _ACCENT_WITH_INDEX.sub(r"<msub><mover>\1\3</mover>\2</msub>", found)


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{mathml(node.astext(), block=True)}</div>')
    raise nodes.SkipNode
