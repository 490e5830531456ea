"""Self-contained HTML: one look for the report and the demo page, everything inside one file, no scripts."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape

_MANY_COLUMNS = 6

_STYLE = """
:root { --ink:#1d2430; --soft:#5c6675; --paper:#fbfbfa; --card:#fff; --line:#e3e6ea;
 --accent:#1668c9; --good:#12805c; }
@media (prefers-color-scheme: dark) {
 :root { --ink:#e8ebf0; --soft:#9aa5b5; --paper:#14171c; --card:#1c2128; --line:#303743;
  --accent:#6db0ff; --good:#53c99b; }
 .figure { background:#fff; }
}
* { box-sizing:border-box }
body { margin:0; background:var(--paper); color:var(--ink);
 font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif }
main { max-width:1180px; margin:0 auto; padding:32px 22px 80px }
h1 { font-size:30px; margin:0 0 4px; letter-spacing:-.01em } h2 { font-size:21px; margin:46px 0 10px }
h3 { font-size:16px; margin:24px 0 6px } p { max-width:76ch } .soft { color:var(--soft) } small { color:var(--soft) }
a { color:var(--accent) } code { font:13px/1.4 ui-monospace,Menlo,Consolas,monospace; background:var(--line);
 border-radius:4px; padding:1px 5px } pre { background:var(--card); border:1px solid var(--line); border-radius:8px;
 padding:12px 14px; overflow:auto } pre code { background:none; padding:0 }
svg { max-width:100%; height:auto } img,video { max-width:100%; height:auto; border-radius:8px; display:block }
table { border-collapse:collapse; margin:10px 0 6px; font-variant-numeric:tabular-nums }
th,td { padding:6px 12px; text-align:right; border-bottom:1px solid var(--line); white-space:nowrap }
th:first-child,td:first-child { text-align:left } th { color:var(--soft); font-weight:600; font-size:14px }
tr.ours td { font-weight:650 } td.best { color:var(--good) }
.wide { font-size:12.5px } .wide th { font-size:12px } .wide th,.wide td { padding:6px 4px }
.wide th + th,.wide td + td { padding-left:6px }
.scroll { overflow-x:auto; background:linear-gradient(90deg,var(--paper) 45%,transparent) 0 0/34px 100% local,
 linear-gradient(-90deg,var(--paper) 45%,transparent) 100% 0/34px 100% local,
 linear-gradient(90deg,var(--line),transparent) 0 0/14px 100% scroll,
 linear-gradient(-90deg,var(--line),transparent) 100% 0/14px 100% scroll; background-repeat:no-repeat }
.cards { display:grid; grid-template-columns:repeat(auto-fit,minmax(190px,1fr)); gap:14px; margin:20px 0 }
.card { background:var(--card); border:1px solid var(--line); border-radius:12px; padding:14px 16px }
.card b { display:block; font-size:29px; line-height:1.2; letter-spacing:-.02em }
.card span { color:var(--soft); font-size:14px }
.card .good { color:var(--good) }
.figure { border:1px solid var(--line); border-radius:10px; padding:8px; margin:10px 0 }
.pair { display:grid; grid-template-columns:repeat(auto-fit,minmax(380px,1fr)); gap:16px }
.frame { background:var(--card); border:1px solid var(--line); border-radius:10px; padding:10px 12px; margin:12px 0 }
.legend { max-width:none } .legend span { white-space:nowrap }
.legend i { display:inline-block; width:13px; height:13px; border-radius:3px; margin:0 6px 0 16px; vertical-align:-1px }
"""


def page(title: str, body: Iterable[str]) -> str:
    """Return a whole HTML document."""
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body><main>\n"
        + "\n".join(body)
        + "\n</main></body></html>\n"
    )


def table(head: Sequence[str], rows: Iterable[Sequence[str]], ours: frozenset[int] = frozenset()) -> str:
    """Return a table; cells are text (escaped), the rows `ours` stand out.

    One of many columns is set smaller, to fit into the page; on a narrower screen it scrolls, with a shadow at the
    side where there is more.
    """
    cells = "".join(f"<th>{escape(text)}</th>" for text in head)
    lines = []
    for index, row in enumerate(rows):
        mark = " class='ours'" if index in ours else ""
        lines.append(f"<tr{mark}>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>")
    size = " class='wide'" if len(head) > _MANY_COLUMNS else ""
    return f"<div class='scroll'><table{size}><tr>{cells}</tr>{''.join(lines)}</table></div>"


def cards(items: Iterable[tuple[str, str, str]]) -> str:
    """Return large numbers: (number, what it is, what to hold it against)."""
    parts = [
        f"<div class='card'><b>{escape(number)}</b>{escape(what)}<br><span>{escape(beside)}</span></div>"
        for number, what, beside in items
    ]
    return f"<div class='cards'>{''.join(parts)}</div>"


def picture(content: bytes, kind: str, alt: str) -> str:
    """Return an image that is inside the page; `kind` is jpeg, png or webp."""
    encoded = base64.b64encode(content).decode("ascii")
    return f"<img alt='{escape(alt, quote=True)}' loading='lazy' src='data:image/{kind};base64,{encoded}'>"


def legend(entries: Iterable[tuple[str, Sequence[int]]]) -> str:
    """Return names with their colours."""
    marks = [f"<span><i style='background:rgb({r},{g},{b})'></i>{escape(name)}</span>" for name, (r, g, b) in entries]
    return f"<p class='legend'>{' '.join(marks)}</p>"
