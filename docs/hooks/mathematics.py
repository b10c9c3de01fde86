r"""Formulas become MathML while the site is built, so that a page needs no script and no network to show them.

Formulas are written as $...$ and $$...$$; pymdownx.arithmatex marks them as \(...\) and \[...\], and this hook converts what it
marked. Every browser since 2023 draws MathML.
"""

import html
import re

from latex2mathml.converter import convert

MARKED = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
SPACING = [  # what TeX knows and MathML has to be told
    (re.compile(r'<mo(?: stretchy="false")?>&#x0007C;</mo>'),
     '<mo lspace="0" rspace="0" stretchy="false">&#x0007C;</mo>'),  # |x|
    (re.compile(r"(^|<mrow>|<mtd>|(?:&#x0003D;|&#x02264;|&#x0002C;|&#x00028;)</mo>)<mo>&#x02212;</mo>"),
     r'\1<mo form="prefix" lspace="0" rspace="0">&#x02212;</mo>'),  # = -x
    (re.compile(r"<mi>(log|sin|cos)</mi>(?!<mo)"), r'<mi>\1</mi><mspace width="0.167em" />'),
    (re.compile(r"(</mi>|</mn>|</msub>)(?=<mi>(?:sin|cos)</mi>)"), r'\1<mspace width="0.167em" />'),
]  # fmt: skip


def to_mathml(match: re.Match[str]) -> str:
    tag, source = match.groups()
    made = convert(html.unescape(source).strip(), display="block" if tag == "div" else "inline")
    for pattern, replacement in SPACING:
        made = pattern.sub(replacement, made)
    return f'<{tag} class="formula">{made}</{tag}>'


def on_page_content(content: str, **_) -> str:
    return MARKED.sub(to_mathml, content)
