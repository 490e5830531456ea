"""The script of the dashboard's page: traces for Plotly, and the loop that asks for the newest room."""

from __future__ import annotations

SCRIPT = r""""use strict";
const FACES = FACES_OF_THE_ROOM, $ = id => document.getElementById(id);
const INK = "#c9d1dc", LINE = "#303743", FONT = {color: INK, family: "system-ui,sans-serif", size: 12};
const config = (buttons, more) => ({responsive: true, displaylogo: false, plotGlPixelRatio: 1,
  displayModeBar: buttons.length > 0, modeBarButtons: [buttons], ...more});
const REACH = 12;  // metres of the room that are shown in each direction
const OLD_S = 3;  // a room that is older is not the newest that there should be
const POLL_MS = 100, REST_MS = 20, CHART_MS = 500;  // between questions, least pause after drawing, between charts
const decode = (text, Type) => new Type(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
const dark = more => ({
  // The person's view, zoom and hidden names outlive a frame.
  uirevision: "keep", paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: FONT,
  hoverlabel: {bgcolor: "#14171c", bordercolor: LINE, font: {color: INK}}, margin: {l: 0, r: 0, t: 0, b: 0}, ...more});
const axis = (title, more) => ({title: {text: title}, gridcolor: LINE, zerolinecolor: LINE, ...more});

// The camera frame (x right, y down, z ahead) is drawn as right, ahead, up.
const columns = points => ({x: points.map(p => p[0]), y: points.map(p => p[2]), z: points.map(p => -p[1])});
function faceTraces({face, name, color}, polygons) {
  const corners = polygons[face] || [], fan = corners.slice(2).map((_, k) => k + 1);
  const edge = columns(corners.concat(corners.slice(0, 1)));
  return [
    {type: "mesh3d", name, legendgroup: name, showlegend: true, ...columns(corners), color, opacity: 0.3,
     i: fan.map(() => 0), j: fan, k: fan.map(k => k + 1), flatshading: true,
     lighting: {ambient: 1, diffuse: 0, specular: 0, fresnel: 0},
     hovertemplate: "right %{x:.2f}<br>ahead %{y:.2f}<br>up %{z:.2f}"},
    {type: "scatter3d", mode: "lines", name, legendgroup: name, showlegend: false, ...edge, hoverinfo: "skip",
     line: {color, width: 6}}];
}
function cloudTrace(cloud) {
  const xyz = cloud ? decode(cloud.points, Float32Array) : [], rgb = cloud ? decode(cloud.colors, Uint8Array) : [];
  const n = xyz.length / 3, x = new Float32Array(n), y = new Float32Array(n), z = new Float32Array(n), color = [];
  for (let k = 0; k < n; k++) {
    x[k] = xyz[3 * k]; y[k] = xyz[3 * k + 2]; z[k] = -xyz[3 * k + 1];
    color.push(`rgb(${rgb[3 * k]},${rgb[3 * k + 1]},${rgb[3 * k + 2]})`);
  }
  return {type: "scatter3d", mode: "markers", name: "points", showlegend: true, x, y, z,
    marker: {size: 2, symbol: "square", color, line: {width: 0}},
    hovertemplate: "right %{x:.2f}<br>ahead %{y:.2f}<br>up %{z:.2f}"};
}
const CORNERS = [[-0.2, -0.15, 0.3], [0.2, -0.15, 0.3], [0.2, 0.15, 0.3], [-0.2, 0.15, 0.3]];
const CAMERA = {type: "scatter3d", mode: "lines", name: "camera", hoverinfo: "name", line: {color: "#fff", width: 4},
  ...columns(CORNERS.flatMap((c, k) => [[0, 0, 0], c, CORNERS[(k + 1) % 4]]).concat([[0, 0, 0]]))};
function ranges(traces) {
  const range = key => {
    let low = 0, high = 0;
    for (const trace of traces) for (const v of trace[key]) { if (v < low) low = v; if (v > high) high = v; }
    // Whole steps, so that the scene does not tremble with each frame; a corridor's end may be far away.
    return [Math.max(-REACH, Math.floor(low * 2) / 2), Math.min(REACH, Math.ceil(high * 2) / 2)];
  };
  return {x: range("x"), y: range("y"), z: range("z")};
}
function keepView() {
  // Plotly notes the view before the mouse's wheel has moved it: the last notch would be lost with the next frame.
  const plot = $("room");
  plot._fullLayout?.scene?._scene?.saveLayout(plot.layout);
}
function drawRoom(state) {
  keepView();
  const traces = [...FACES.flatMap(face => faceTraces(face, state.polygons)), CAMERA, cloudTrace(state.cloud)];
  const range = ranges(traces), unit = state.metric === null ? "" : state.metric ? " [m]" : " [front wall = 1]";
  const side = (name, key) =>
    axis(name + unit, {range: range[key], nticks: 6, showbackground: false, showspikes: false});
  return Plotly.react("room", traces, dark({
    legend: {x: 0, y: 1, bgcolor: "rgba(0,0,0,0)"},
    scene: {xaxis: side("right", "x"), yaxis: side("ahead", "y"), zaxis: side("up", "z"), aspectmode: "data",
      camera: {eye: {x: 0.4, y: -2, z: 0.8}, center: {x: 0, y: 0, z: -0.1}}}}),
    config(["orbitRotation", "tableRotation", "pan3d", "resetCameraDefault3d"]));
}

const CELLS = ["unknown", "free", "occupied"], SHADES = ["#262c35", "#6db0ff", "#ffb454"];
const STEPS = SHADES.flatMap((shade, k) => [[k / 3, shade], [(k + 1) / 3, shade]]);
function planTraces(grid) {
  const traces = [{type: "scatter", mode: "markers+text", x: [0], y: [0], text: ["camera"], name: "camera",
    textposition: "bottom center", hoverinfo: "skip", cliponaxis: false,
    marker: {symbol: "triangle-up", size: 14, color: "#fff"}}];
  if (!grid) return traces;
  const cells = decode(grid.cells, Int8Array), z = [];
  for (let k = 0; k < grid.ahead; k++)
    z.push(Array.from(cells.subarray(k * grid.left, (k + 1) * grid.left), v => v < 0 ? 0 : v < 50 ? 1 : 2));
  const half = grid.resolution / 2;
  traces.unshift({type: "heatmap", z, text: z.map(row => row.map(v => CELLS[v])), zmin: -0.5, zmax: 2.5,
    colorscale: STEPS, x0: grid.origin[1] + half, dx: grid.resolution, y0: grid.origin[0] + half, dy: grid.resolution,
    hovertemplate: "ahead %{y:.2f} m<br>left %{x:.2f} m<br>%{text}<extra></extra>",
    colorbar: {tickvals: [0, 1, 2], ticktext: CELLS, thickness: 10, outlinewidth: 0, len: 0.5, y: 0.75}});
  return traces;
}
function drawPlan(state) {
  const none = {text: "no free space: it needs depth, and floor in view", showarrow: false, xref: "paper",
    yref: "paper", x: 0.5, y: 0.5};
  return Plotly.react("plan", planTraces(state.grid), dark({
    margin: {l: 48, r: 8, t: 8, b: 42}, showlegend: false, dragmode: "pan", annotations: state.grid ? [] : [none],
    xaxis: axis("left [m]", {autorange: "reversed", constrain: "domain", zeroline: false}),
    yaxis: axis("ahead [m]", {scaleanchor: "x", constrain: "domain", zeroline: false})}),
    config(["resetScale2d"], {scrollZoom: true}));
}

function drawStages(state) {
  const names = Object.keys(state.stages), ms = Object.values(state.stages);
  const sum = ms.reduce((sum, v) => sum + v, 0), took = state.milliseconds;
  const all = took === null ? `sum ${sum.toFixed(1)}` : `frame ${took.toFixed(1)}, sum ${sum.toFixed(1)}`;
  return Plotly.react("stages", [{type: "bar", orientation: "h", y: names, x: ms, marker: {color: "#6db0ff"},
    text: ms.map(v => v.toFixed(1)), textposition: "auto", hovertemplate: "%{y}: %{x:.2f} ms<extra></extra>"}], dark({
    margin: {l: 8, r: 12, t: 8, b: 60}, bargap: 0.3,
    xaxis: axis(`ms: ${all}<br>(stages run beside each other)`, {rangemode: "tozero"}),
    yaxis: axis("", {autorange: "reversed", automargin: true})}), config([]));
}

const SPAN_S = 60, WINDOW_S = 2, seen = [], rate = {x: [], y: []};
let answeredS = -Infinity;
function count(now, frames) {
  answeredS = now;
  if (frames < seen.at(-1)?.[1]) seen.length = 0;  // the dashboard was started anew
  if (frames !== seen.at(-1)?.[1]) seen.push([now, frames]);
  while (seen.length > 2 && now - seen[1][0] >= WINDOW_S) seen.shift();
}
function framesPerSecond() {
  const [since, before] = seen[0], [last, frames] = seen.at(-1), came = frames - before;
  // The next frame has not come yet: with it there would be so many at most.
  const silence = answeredS - last, most = silence < WINDOW_S ? (came + 1) / (answeredS - since) : 1 / silence;
  return came && Math.min(came / (last - since), most);
}
function drawRate() {
  const now = performance.now() / 1000;
  // In less time the count says little: of 10 per second two may come within a tenth.
  const from = rate.x.at(-1) ?? seen[0][0] + WINDOW_S;
  if (answeredS > from) { rate.x.push(answeredS); rate.y.push(framesPerSecond()); }
  while (rate.x.length && now - rate.x[0] > SPAN_S) { rate.x.shift(); rate.y.shift(); }
  return Plotly.react("rate", [{type: "scatter", mode: "lines", x: rate.x.map(t => t - now), y: [...rate.y],
    line: {color: "#6db0ff", width: 2}, fill: "tozeroy", hovertemplate: "%{y:.1f} per second<extra></extra>"}], dark({
    margin: {l: 36, r: 12, t: 8, b: 42}, xaxis: axis("seconds ago", {range: [-SPAN_S, 0]}),
    yaxis: axis("", {rangemode: "tozero"})}), config([]));
}

function drawNumbers(state) {
  const table = $("numbers");
  table.replaceChildren();
  for (const [name, value] of Object.entries(state.numbers)) {
    const row = table.insertRow();
    row.insertCell().textContent = name; row.insertCell().textContent = value;
  }
}

// While the person turns the room, it stands still; what came meanwhile is drawn afterwards.
let held = false, waiting = null, shown = -1, drawn = -1, drawnAt = 0, name = "";
$("room").addEventListener("pointerdown", () => { held = true; }, true);
function release() {
  held = false;
  if (waiting) { drawRoom(waiting); waiting = null; }
}
// Plotly keeps the new view at the mouseup that comes right after the pointerup.
for (const end of ["pointerup", "pointercancel"]) addEventListener(end, () => setTimeout(release, 50), true);
async function draw(state) {
  if (state.overlay) $("overlay").src = "overlay.jpg?frame=" + state.frames;
  await null;  // The browser asks for the picture here: the first drawing may take longer than a picture is kept.
  drawNumbers(state);  // of the frame in the picture
  if (held) waiting = state; else await drawRoom(state);
  await drawPlan(state);
}
// Charts need not change with each frame; the rate changes without one, too.
let charted = null, chartedAt = -Infinity;
async function chart() {
  const now = performance.now();
  if (now - chartedAt < CHART_MS) return;
  const stages = newest !== charted && drawStages(newest);
  charted = newest; chartedAt = now;
  await Promise.all([stages, drawRate()]);
}
function tellAge(answered) {
  const age = (performance.now() - drawnAt) / 1000, old = !ended && shown >= 0 && age > OLD_S;
  const why = reason && (old || shown < 0) ? `: ${reason}` : "";
  $("age").className = !answered || old ? "bad" : "";
  $("age").textContent = !answered ? "the dashboard has ended" : ended ? `frame ${name}, the last: ${ended}`
    : (shown < 0 ? "waiting for the first room" : `frame ${name}, ${age.toFixed(1)} s ago`) + why;
  $("numbers").className = old && why ? "old" : "";  // they say what was so then
}
let newest = null, reason = "", ended = "";
async function poll() {
  const begun = performance.now();
  // undefined: no answer. null: nothing new. waiting: nothing new, and why. ended: no more will come, and why.
  const state = await fetch("state.json?after=" + shown).then(answer => answer.json()).catch(() => undefined);
  const isRoom = state && "number" in state;
  if (isRoom) newest = state;
  if (state) { reason = state.waiting ?? reason; ended = state.ended ?? ""; }
  if (newest && state !== undefined) count(performance.now() / 1000, newest.frames);
  try {
    if (isRoom) {
      shown = state.number; name = state.name;
      drawnAt = performance.now() - 1000 * state.age_s;  // a page that is opened late gets an old room
      await draw(state);
      drawn = state.number;
    }
    if (newest) await chart();
  } finally {
    tellAge(state !== undefined);
    setTimeout(poll, Math.max(REST_MS, POLL_MS - (performance.now() - begun)));
  }
}
poll();
"""
