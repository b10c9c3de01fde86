"""One HTML file with everything inside: readable without a network, on a phone and on paper."""

import base64
import html
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

Table = tuple[list[str], list[list[str]]]  # header, rows
Picture = tuple[Path | bytes, str]  # PNG, as a file or as its bytes, and its caption

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem; overflow-wrap: break-word; }
h1 { font-size: 1.6rem; line-height: 1.25; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
img { max-width: 100%; height: auto; } figure { margin: 1rem 0; } figcaption { color: #555; font-size: .9rem; }
.scroll { overflow-x: auto; } .scroll + .scroll { margin-top: 1rem; }
table { border-collapse: separate; border-spacing: 0; font-size: .82rem; white-space: nowrap; }
th, td { text-align: right; padding: .25rem .6rem; border-bottom: 1px solid #e3e3e3; font-variant-numeric: tabular-nums; }
th { border-bottom: 1px solid #666; } .words { text-align: left; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0; background: #fff; }
.chart { min-height: 12rem; } .controls { display: flex; flex-wrap: wrap; gap: .5rem 1rem; margin: .6rem 0; }
.controls label { font-size: .82rem; color: #555; }
.controls select { display: block; font: inherit; color: #222; max-width: 16rem; }
details { margin: .6rem 0; font-size: .9rem; } summary { cursor: pointer; } pre { white-space: pre-wrap; font-size: .78rem; }
footer { color: #555; font-size: .82rem; margin-top: 3rem; border-top: 1px solid #e3e3e3; padding-top: .6rem; }
@media (max-width: 600px) {
  body { margin: 1rem auto; padding: 0 .7rem; } th:first-child, td:first-child { max-width: 9rem; white-space: normal; }
  figure:has(img) { overflow-x: auto; } figure img { max-width: none; width: 40rem; }
}
@media print {
  body { max-width: none; margin: 0; font-size: 11pt; } .controls, .modebar { display: none !important; }
  figure, tr, pre { break-inside: avoid; } h2 { break-after: avoid; }
  .scroll { overflow: visible; } table { white-space: normal; font-size: .7rem; }
}
"""


NUMBER = re.compile(r"[+-]?(\d*\.?\d+(e[+-]?\d+)?(?![\w.-])|$)", re.IGNORECASE)  # no date and no version


class Chart(NamedTuple):
    """A picture that answers the pointer. data: a plotly figure as JSON, or what `kind` of page.js draws from it."""

    data: str
    caption: str
    kind: str = "plot"


class Section(NamedTuple):
    """Pictures and charts stand before the tables; details (summary, text) are folded away at the end."""

    heading: str
    paragraphs: Sequence[str] = ()
    table: Table | None = None
    pictures: Sequence[Picture] = ()
    charts: Sequence[Chart] = ()
    more: Sequence[Table] = ()
    details: Sequence[tuple[str, str]] = ()


def page(title: str, sections: Iterable[tuple[Any, ...]], *, footer: str = "") -> str:
    """The sections one after the other, as one file. A section may be given as the tuple of its first entries. plotly.js is
    in the file, once, if and only if a section has a chart."""
    given = [Section(*section) for section in sections]
    body = [f"<h1>{html.escape(title)}</h1>"]
    charts = [chart for section in given for chart in section.charts]
    ids = iter(range(len(charts)))
    for section in given:
        body += _section(section, ids)
    if footer:
        body.append(f"<footer>{html.escape(footer)}</footer>")
    view = '<meta name="viewport" content="width=device-width, initial-scale=1">'
    head = f'<meta charset="utf-8">{view}<title>{html.escape(title)}</title><link rel="icon" href="data:,">'
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style>{library() if charts else ""}</head>\n<body>\n'
        + "\n".join(body)
        + (f"\n<script>{_script()}</script>" if charts else "")
        + "\n</body></html>\n"
    )


def library() -> str:
    """plotly.js, as it comes with the package plotly."""
    from plotly.offline import get_plotlyjs

    return f"<script>{get_plotlyjs()}</script>"


def _script() -> str:
    return (Path(__file__).parent / "page.js").read_text(encoding="utf-8")


def _section(section: Section, ids: Any) -> list[str]:
    body = [f"<h2>{html.escape(section.heading)}</h2>"]
    body += [f"<p>{html.escape(paragraph)}</p>" for paragraph in section.paragraphs]
    body += [_figure(picture, caption) for picture, caption in section.pictures]
    body += [_chart(chart, next(ids)) for chart in section.charts]
    body += [_table(table) for table in (section.table, *section.more) if table is not None]
    body += [f"<details><summary>{html.escape(what)}</summary><pre>{html.escape(text)}</pre></details>"
             for what, text in section.details]  # fmt: skip
    return body


def _figure(picture: Path | bytes, caption: str) -> str:
    data = base64.b64encode(picture if isinstance(picture, bytes) else picture.read_bytes()).decode()
    text = html.escape(caption)
    return f'<figure><img alt="{text}" src="data:image/png;base64,{data}"><figcaption>{text}</figcaption></figure>'


def _chart(chart: Chart, number: int) -> str:
    data = chart.data.replace("<", "\\u003c")  # a string in it could close the script
    words = html.escape(chart.caption)
    holder = f'<div class="chart" role="img" aria-label="{words}" data-kind="{chart.kind}" data-source="chart-{number}"></div>'
    script = f'<script type="application/json" id="chart-{number}">{data}</script>'
    return f"<figure>{holder}<figcaption>{words}</figcaption>{script}</figure>"


def as_json(value: Any) -> str:
    """JSON without NaN and infinity, which browsers refuse: they become null."""
    return json.dumps(_finite(value), allow_nan=False, separators=(",", ":"))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not abs(value) < float("inf") else value


def _table(table: Table) -> str:
    header, rows = table
    kinds = [' class="words"' if _is_words([row[i] for row in rows if i < len(row)]) else "" for i in range(len(header))]
    top = "".join(f"<th{kind}>{html.escape(cell)}</th>" for kind, cell in zip(kinds, header, strict=True))
    lines = "".join(f"<tr>{_cells(row, kinds)}</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{lines}</tbody></table></div>'


def _cells(row: list[str], kinds: list[str]) -> str:
    return "".join(f"<td{kind}>{html.escape(cell)}</td>" for kind, cell in zip(kinds, row, strict=True))


def _is_words(column: list[str]) -> bool:
    """Whether most cells that are not empty are no numbers: words stand at the left."""
    full = [cell for cell in column if cell]
    return 2 * sum(NUMBER.match(cell) is not None for cell in full) < len(full)
