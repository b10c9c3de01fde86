"""One HTML file with its pictures inside, readable without a network and on a phone."""

import base64
import html
from pathlib import Path

from jaxobs.report.demo_text import Table

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
img { max-width: 100%; height: auto; } figure { margin: 1rem 0; } figcaption { color: #555; font-size: .9rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: .82rem; white-space: nowrap; }
th, td { text-align: right; padding: .25rem .6rem; border-bottom: 1px solid #e3e3e3; font-variant-numeric: tabular-nums; }
th { border-bottom: 1px solid #666; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0; background: #fff; }
"""


Section = tuple[str, list[str], Table, list[tuple[Path, str]]]  # heading, paragraphs, table, pictures with captions


def page(title: str, sections: list[Section]) -> str:
    """The sections one after the other, each with its pictures before its table."""
    body = [f"<h1>{html.escape(title)}</h1>"]
    for heading, paragraphs, table, pictures in sections:
        body.append(f"<h2>{html.escape(heading)}</h2>")
        body += [f"<p>{html.escape(paragraph)}</p>" for paragraph in paragraphs]
        body += [_figure(path, caption) for path, caption in pictures]
        body.append(_table(table))
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{html.escape(title)}</title>'
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>\n<body>\n'
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def _figure(path: Path, caption: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    text = html.escape(caption)
    return f'<figure><img alt="{text}" src="data:image/png;base64,{data}"><figcaption>{text}</figcaption></figure>'


def _table(table: Table) -> str:
    header, rows = table
    top = "".join(f"<th>{html.escape(cell)}</th>" for cell in header)
    lines = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{lines}</tbody></table></div>'
