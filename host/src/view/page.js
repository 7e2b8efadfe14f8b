"use strict";
// Draws the data of a map (see data.rs) and, on a live page, what the server sends.
const $ = id => document.getElementById(id);
const CONFIG = { modeBarButtonsToRemove: ["zoomIn2d", "zoomOut2d", "autoScale2d", "select2d", "lasso2d"], responsive: true, displaylogo: false };
// 1, 2 and 5 of every decade, in full
const LENGTHS = [-5, -4, -3, -2, -1, 0, 1, 2, 3, 4].flatMap(decade => [1, 2, 5].map(n => Number(n + "e" + decade)));
const TICKS = { tickmode: "array", tickvals: LENGTHS, ticktext: LENGTHS.map(String) };
const INK = { family: "system-ui, sans-serif", color: "#1c2430" };
const MEASURED = "#0072b2", CORRECTED = "#d55e00", REGION = "#009e73";
let data = null, place = null, colour = null;

// float32, little-endian, in base64; NaN becomes null, which Plotly leaves empty
function rows(layer) {
  const bytes = Uint8Array.from(atob(layer.values), c => c.charCodeAt(0));
  const values = new Float32Array(bytes.buffer);
  const out = [];
  for (let i = 0; i < data.rows; i++) {
    const row = Array.from(values.subarray(i * data.columns, (i + 1) * data.columns));
    out.push(row.map(v => Number.isFinite(v) ? v : null));
  }
  return out;
}

const axis = (corner, n) => Array.from({ length: n }, (_, i) => corner + (i + 0.5) * data.cell);
const named = layer => layer.title + (layer.unit ? ` [${layer.unit}]` : "");

function region() {
  if (!place) return null;
  const inside = r => r.box[0] <= place[0] && place[0] < r.box[2] && r.box[1] <= place[1] && place[1] < r.box[3];
  return data.regions.find(inside) || null;
}

function frame() {
  const r = region();
  if (!r) return [];
  const [x0, y0, x1, y1] = r.reach;
  return [{ type: "rect", x0, y0, x1, y1, line: { color: REGION, width: 2 } }];
}

function layout(extra) {
  return Object.assign({ font: INK, paper_bgcolor: "#fff", plot_bgcolor: "#e1e1e1", margin: { l: 55, r: 10, t: 40, b: 45 }, uirevision: "keep" }, extra);
}

function drawMaps() {
  // all places first: a place's width depends on how many there are
  for (const layer of data.layers.filter(layer => !$("map-" + layer.name))) {
    const div = document.createElement("div");
    div.id = "map-" + layer.name;
    $("maps").appendChild(div);
  }
  for (const layer of data.layers) {
    const id = "map-" + layer.name;
    const trace = {
      type: "heatmap", z: rows(layer), x: axis(data.corner[0], data.columns), y: axis(data.corner[1], data.rows),
      colorscale: layer.colours, zmin: layer.range[0], zmax: layer.range[1], colorbar: { title: { text: layer.unit }, thickness: 14 },
      hovertemplate: `x %{x:.2f} m, y %{y:.2f} m<br>${layer.title} %{z:.4g} ${layer.unit}<extra></extra>`,
    };
    const fresh = !$(id).data;
    Plotly.react(id, [trace], layout({
      title: { text: layer.title, font: { size: 15 }, x: 0.02, xanchor: "left" }, shapes: frame(),
      xaxis: { title: { text: "x [m]" }, constrain: "domain" },
      yaxis: { title: { text: "y [m]" }, scaleanchor: "x", constrain: "domain" },
    }), CONFIG);
    if (fresh) $(id).on("plotly_click", e => { place = [e.points[0].x, e.points[0].y]; select(); });
  }
}

function select() {
  for (const layer of data.layers) Plotly.relayout("map-" + layer.name, { shapes: frame() });
  drawLogLog();
}

function drawSurface() {
  const height = data.layers.find(l => l.name === "mean") || data.layers.find(l => l.name === "elevation");
  if (!height) return;
  const tint = data.layers.find(l => l.name === colour) || height;
  const z = rows(height);
  const [width, depth] = [data.columns * data.cell, data.rows * data.cell];
  const known = z.flat().filter(v => v !== null);
  const relief = known.reduce((a, v) => Math.max(a, v), -1e30) - known.reduce((a, v) => Math.min(a, v), 1e30);
  const most = Math.max(width, depth);
  const trace = {
    type: "surface", z, x: axis(data.corner[0], data.columns), y: axis(data.corner[1], data.rows), surfacecolor: rows(tint),
    colorscale: tint.colours, cmin: tint.range[0], cmax: tint.range[1], colorbar: { title: { text: named(tint), side: "right" }, thickness: 14 },
    hovertemplate: "x %{x:.2f} m, y %{y:.2f} m<br>elevation %{z:.3f} m<extra></extra>",
  };
  Plotly.react("surface", [trace], layout({
    margin: { l: 0, r: 0, t: 10, b: 0 },
    scene: {
      xaxis: { title: { text: "x [m]" } }, yaxis: { title: { text: "y [m]" } }, zaxis: { title: { text: "z [m]" } }, aspectmode: "manual",
      aspectratio: { x: width / most, y: depth / most, z: Math.max(0.05, relief / most) }, camera: { eye: { x: -0.9, y: -1.1, z: 0.9 } },
    },
  }), CONFIG);
}

function law(curve, name, colour) {
  if (!curve.law) return [];
  const { hurst, sigma, from, to } = curve.law;
  const d = [from, to];
  return [{ x: d, y: d.map(d => sigma * d ** hurst), mode: "lines", line: { color: colour, width: 2 }, name: `${name}: D ${(3 - hurst).toFixed(3)} ± ${curve.law.error.toFixed(3)}, σ(1 m) ${sigma.toFixed(4)} m` }];
}

function points(curve, name, colour, symbol) {
  const kept = curve.lags.filter(l => l[2] > 0);
  return { x: kept.map(l => l[0]), y: kept.map(l => l[2]), mode: "markers", marker: { color: colour, size: 8, symbol }, name };
}

function drawLogLog() {
  const whole = data.whole, r = region();
  const traces = [
    { x: whole.lags.map(l => l[0]), y: whole.lags.map(l => l[1]), mode: "markers", marker: { color: MEASURED, size: 8, symbol: "circle-open" }, name: "whole map, as measured" },
    points(whole, "whole map, noise and tilt taken off", CORRECTED, "circle"),
    ...law(whole, "whole map", CORRECTED),
  ];
  if (r) traces.push(points(r, "region, noise and tilt taken off", REGION, "square"), ...law(r, "region", REGION));
  const why = r && !r.law ? `region: no power law (${r.reason})` : "";
  Plotly.react("loglog", traces, layout({
    plot_bgcolor: "#fff", legend: { orientation: "h", y: -0.18 }, title: { text: why, font: { size: 14 } },
    xaxis: { type: "log", ...TICKS, title: { text: "distance d [m]" }, gridcolor: "#e6eaef" },
    yaxis: { type: "log", ...TICKS, title: { text: "rms elevation difference S(d) [m]" }, gridcolor: "#e6eaef" },
  }), CONFIG);
}

function table(id, lines) {
  const body = document.createElement("tbody");
  for (const line of lines) {
    const tr = body.insertRow();
    if (line[1] === 0) tr.className = "zero";
    for (const cell of line) tr.insertCell().textContent = typeof cell === "number" ? String(+cell.toPrecision(6)) : cell;
  }
  $(id).replaceChildren(body);
}

function draw(next) {
  data = next;
  $("title").textContent = data.title;
  document.title = data.title;
  $("summary").textContent = data.summary;
  colour ??= data.layers.some(l => l.name === "mean") ? "mean" : "elevation";
  const list = $("colour");
  if (list.options.length !== data.layers.length) {
    list.replaceChildren(...data.layers.map(l => new Option(named(l), l.name, false, l.name === colour)));
    list.onchange = () => { colour = list.value; drawSurface(); };
  }
  drawMaps();
  drawSurface();
  drawLogLog();
  table("counters", data.counters);
  table("parameters", data.parameters);
  table("timings", data.timings);
}

function live() {
  const socket = new WebSocket(location.origin.replace(/^http/, "ws") + "/data");
  socket.onopen = () => { $("state").textContent = "live"; };
  socket.onmessage = message => draw(JSON.parse(message.data));
  socket.onclose = () => { $("state").textContent = "not connected; trying again"; setTimeout(live, 2000); };
}

if (DATA) draw(DATA); else live();
