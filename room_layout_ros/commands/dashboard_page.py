"""The dashboard's page. Plotly draws; the script (dashboard_script.py) asks the server for the newest room."""

from __future__ import annotations

import json
from html import escape

from room_layout_ros.core.labels import FACES, LABEL_COLORS, LABEL_NAMES

from .dashboard_script import SCRIPT

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Room layout</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<style>
:root { --ink:#e8ebf0; --soft:#9aa5b5; --paper:#14171c; --card:#1c2128; --line:#303743 }
* { box-sizing:border-box }
body { margin:0; background:var(--paper); color:var(--ink); font:15px/1.45 system-ui,sans-serif }
header { display:flex; flex-wrap:wrap; gap:4px 18px; align-items:baseline; padding:14px 20px 10px }
h1 { font-size:20px; margin:0 }
#source, #age { color:var(--soft) }
#age { margin-left:auto; font-variant-numeric:tabular-nums }
#age.bad { color:#ff8f85 }
main { display:grid; grid-template-columns:repeat(12,1fr); gap:14px; padding:0 20px 20px }
section { background:var(--card); border:1px solid var(--line); border-radius:12px; padding:10px 12px; min-width:0 }
h2 { font-size:13px; color:var(--soft); margin:0 0 8px; font-weight:600 }
.wide { grid-column:span 7 } .less { grid-column:span 5 } .third { grid-column:span 4 }
#overlay { width:100%; display:block; border-radius:6px }
#overlay:not([src]) { visibility:hidden }
#room { height:620px } #plan, #stages, #rate { height:380px }
table { border-collapse:collapse; width:100%; font-variant-numeric:tabular-nums; margin-top:8px }
#numbers.old { opacity:.45 }
td { padding:3px 0; border-bottom:1px solid var(--line) } td:last-child { text-align:right }
@media (max-width:1100px) { .third { grid-column:span 6 } .wide, .less, .third:last-child { grid-column:span 12 } }
@media (max-width:700px) { .third { grid-column:span 12 } #room { height:420px } main, header { padding-inline:10px } }
</style></head><body>
<header><h1>Room layout</h1><span id="source">SOURCE</span><span id="age">waiting for the first room</span></header>
<main>
<section class="wide"><h2>The room in 3-D (drag to turn, wheel to zoom, click a name to hide it)</h2>
<div id="room"></div></section>
<section class="less"><h2>Estimate</h2><img id="overlay" alt="overlay of the estimate">
<table id="numbers"></table></section>
<section class="third"><h2>Free space from above</h2><div id="plan"></div></section>
<section class="third"><h2>Milliseconds per stage</h2><div id="stages"></div></section>
<section class="third"><h2>Frames per second</h2><div id="rate"></div></section>
</main>
<script src="plotly.min.js"></script>
<script>
SCRIPT
</script></body></html>
"""


def dashboard_html(source: str) -> str:
    """Return the page."""
    colors = ("#{:02x}{:02x}{:02x}".format(*LABEL_COLORS[face].tolist()) for face in FACES)
    faces = [{"face": f, "name": LABEL_NAMES[f], "color": c} for f, c in zip(FACES, colors, strict=True)]
    script = SCRIPT.replace("FACES_OF_THE_ROOM", json.dumps(faces), 1)
    return _PAGE.replace("SCRIPT", script, 1).replace("SOURCE", escape(source), 1)
