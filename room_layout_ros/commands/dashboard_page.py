"""The dashboard's page: one file, no library, polls the server beside it."""

from __future__ import annotations

from html import escape

from room_layout_ros.core.labels import FACES, LABEL_COLORS

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Room layout</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
:root { --ink:#e8ebf0; --soft:#9aa5b5; --paper:#14171c; --card:#1c2128; --line:#303743 }
* { box-sizing:border-box }
body { margin:0; background:var(--paper); color:var(--ink); font:15px/1.45 system-ui,sans-serif }
header { display:flex; gap:18px; align-items:baseline; padding:14px 20px } h1 { font-size:20px; margin:0 }
#source { color:var(--soft) } #age { margin-left:auto; color:var(--soft); font-variant-numeric:tabular-nums }
main { display:grid; grid-template-columns:repeat(auto-fit,minmax(430px,1fr)); gap:14px; padding:0 20px 24px }
section { background:var(--card); border:1px solid var(--line); border-radius:12px; padding:10px 12px }
h2 { font-size:13px; color:var(--soft); margin:0 0 8px; font-weight:600 }
img,canvas { width:100%; display:block; border-radius:6px }
#plan { aspect-ratio:4/3; object-fit:contain }
canvas { cursor:grab; touch-action:none }
table { border-collapse:collapse; width:100%; font-variant-numeric:tabular-nums }
td { padding:3px 0; border-bottom:1px solid var(--line) } td:last-child { text-align:right }
.bar { display:inline-block; height:8px; background:#6db0ff; border-radius:4px; margin-right:8px; vertical-align:1px }
.bad { color:#ff8f85 }
</style></head><body>
<header><h1>Room layout</h1><span id="source">SOURCE</span><span id="age">waiting for the first room</span></header>
<main>
<section><h2>Estimate</h2><img id="overlay" alt="overlay of the estimate"></section>
<section><h2>The room in 3-D (drag to turn)</h2><canvas id="room" width="860" height="645"></canvas></section>
<section id="plan-card"><h2>Free space from above (bright: free)</h2><img id="plan" alt="free-space grid"></section>
<section><h2>Numbers</h2><table id="numbers"></table>
<h2 style="margin-top:14px">Milliseconds</h2><table id="stages"></table></section>
</main>
<script>
"use strict";
const COLORS = FACE_COLORS, $ = id => document.getElementById(id);
let state = null, shown = -1, seen = 0, turn = -0.55, tilt = 0.45, drag = null;
function rows(table, entries, bars) {
  table.replaceChildren();
  const most = Math.max(...entries.map(e => +e[1] || 0), 1e-9);
  for (const [name, value] of entries) {
    const row = table.insertRow(), left = row.insertCell(), right = row.insertCell();
    if (bars) {
      const bar = document.createElement("span"); bar.className = "bar";
      bar.style.width = (100 * value / most) + "px"; left.append(bar);
    }
    left.append(name); right.textContent = bars ? (+value).toFixed(1) : value;
  }
}
function draw() {
  const canvas = $("room"), g = canvas.getContext("2d"), w = canvas.width, h = canvas.height;
  g.clearRect(0, 0, w, h);
  if (!state || !state.polygons.length) return;
  const limit = 12, clamp = p => p.map(v => Math.max(-limit, Math.min(limit, v)));
  const faces = state.polygons.map(f => ({face: f.face, points: f.points.map(clamp)}));
  const all = faces.flatMap(f => f.points).concat([[0, 0, 0]]), mid = [0, 1, 2].map(k =>
    (Math.min(...all.map(p => p[k])) + Math.max(...all.map(p => p[k]))) / 2);
  const reach = Math.max(...all.map(p => Math.hypot(p[0] - mid[0], p[1] - mid[1], p[2] - mid[2])), 0.1);
  const project = p => {
    const [x, y, z] = [p[0] - mid[0], p[1] - mid[1], p[2] - mid[2]];
    const a = x * Math.cos(turn) + z * Math.sin(turn), b = -x * Math.sin(turn) + z * Math.cos(turn);
    const c = y * Math.cos(tilt) - b * Math.sin(tilt), d = y * Math.sin(tilt) + b * Math.cos(tilt);
    const near = 2.5 * reach / (2.5 * reach + d);
    return [a * near, c * near, d];
  };
  const spread = all.map(project), span = k => [Math.min(...spread.map(p => p[k])), Math.max(...spread.map(p => p[k]))];
  const [x0, x1] = span(0), [y0, y1] = span(1), s = 0.9 * Math.min(w / (x1 - x0), h / (y1 - y0));
  const place = p => {
    const [x, y, d] = project(p);
    return [w / 2 + s * (x - (x0 + x1) / 2), h / 2 + s * (y - (y0 + y1) / 2), d];
  };
  const flat = faces.map(f => ({face: f.face, points: f.points.map(place)}));
  flat.sort((m, n) => mean(n.points) - mean(m.points));
  for (const f of flat) {
    g.beginPath(); f.points.forEach((p, i) => i ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])); g.closePath();
    g.fillStyle = COLORS[f.face] + (mean(f.points) > 0 ? "88" : "18"); g.fill();
    g.lineWidth = 2.5; g.strokeStyle = COLORS[f.face]; g.stroke();
  }
  const o = place([0, 0, 0]), t = place([0, 0, 0.5]);
  g.strokeStyle = g.fillStyle = "#fff"; g.lineWidth = 2;
  g.beginPath(); g.moveTo(o[0], o[1]); g.lineTo(t[0], t[1]); g.stroke();
  g.beginPath(); g.arc(o[0], o[1], 5, 0, 7); g.fill();
}
const mean = points => points.reduce((s, p) => s + p[2], 0) / points.length;
$("room").onpointerdown = e => { drag = [e.clientX, e.clientY, turn, tilt]; e.target.setPointerCapture(e.pointerId); };
$("room").onpointermove = e => {
  if (!drag) return;
  turn = drag[2] + (e.clientX - drag[0]) / 150;
  tilt = Math.max(-1.5, Math.min(1.5, drag[3] + (e.clientY - drag[1]) / 150)); draw();
};
$("room").onpointerup = () => { drag = null; };
async function poll() {
  try {
    const answer = await fetch("state.json", {cache: "no-store"}); state = await answer.json();
    if (state.number !== shown) {
      shown = state.number; seen = performance.now();
      $("overlay").src = "overlay.jpg?" + shown;
      $("plan-card").hidden = !state.plan; if (state.plan) $("plan").src = "plan.jpg?" + shown;
      rows($("numbers"), Object.entries(state.numbers), false);
      rows($("stages"), Object.entries(state.stages), true); draw();
    }
    const age = (performance.now() - seen) / 1000;
    $("age").className = age > 3 ? "bad" : "";
    const text = "frame " + state.name + ", " + age.toFixed(1) + " s ago";
    $("age").textContent = shown < 0 ? "waiting for the first room" : text;
  } catch (error) { $("age").className = "bad"; $("age").textContent = "the dashboard has ended"; }
  setTimeout(poll, 120);
}
poll();
</script></body></html>
"""


def dashboard_html(source: str) -> str:
    """Return the page."""
    colors = {face: "#{:02x}{:02x}{:02x}".format(*LABEL_COLORS[face].tolist()) for face in FACES}
    entries = ", ".join(f'{face}: "{color}"' for face, color in colors.items())
    return _PAGE.replace("FACE_COLORS", f"{{{entries}}}", 1).replace("SOURCE", escape(source), 1)
