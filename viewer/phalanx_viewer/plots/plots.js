// The space-time diagram: the whole run, or its worst moment broadcast by broadcast.
const LATE = "#e8a200", LOST = "#d62728", FALSE = "#06b6d4", RELAYED = "#0daa9b";
let zoomed = false;

// In to the worst moment, or out again.
function toggleZoom() {
  zoomed = !zoomed;
  redraw(true);
  if (!zoomed) return;
  seekWorst();
  content.plots.filter(plot => plot.zoom).forEach(plot => folded.delete(plot.title));
  if (!panel.clientWidth) foldPlots();
  requestAnimationFrame(() => drawn.find(plot => shown[plot.index].zoom)?.canvas.scrollIntoView());
}

// Each lane has four rows: late, lost, the agent's state, and false broadcasts that it sent.
const STATES = [null, "#f97316", "#c084fc", "#475569"];
function drawLanes(p, lanes, X, down) {
  const high = down / lanes.length, row = high * 0.9 / 4;
  const intervals = lanes[0].state.length, wide = (content.end - content.begin) / intervals;
  const cell = (k, y, fill, alpha) => {
    p.globalAlpha = alpha;
    p.fillStyle = fill;
    p.fillRect(X(content.begin + k * wide), y, X(wide) - X(0) + 0.3, Math.max(row, 1));
  };
  lanes.forEach(({ late, lost, state, false: lied }, i) => {
    const top = TOP + i * high;
    for (let k = 0; k < intervals; k++) {
      if (late[k] > 0) cell(k, top, LATE, 0.3 + 0.7 * late[k] / 9);
      if (lost[k] > 0) cell(k, top + row, LOST, 0.3 + 0.7 * lost[k] / 9);
      if (state[k] > 0) cell(k, top + 2 * row, STATES[state[k]], 1);
      if (lied[k] > 0) cell(k, top + 3 * row, FALSE, 1);
    }
  });
  p.globalAlpha = 1;
  nameLanes(p, lanes.length, high);
}

// A lane for each agent, a dot for each of its steps, a line for each broadcast from its sender to
// its receiver, or half way there if it was lost; a dotted one for a state that others relayed.
const FATES = { "in time": "#9fb2ca", late: LATE, lost: LOST, false: FALSE, relayed: RELAYED };
const DASHES = { lost: [3, 2], relayed: [1, 3] };
function drawZoom(p, { steps, broadcasts }, X, down) {
  const high = down / steps.length, Y = i => TOP + (i + 0.5) * high;
  steps.forEach((_, i) => line(p, [[LEFT, Y(i)], [p.canvas.width, Y(i)]], colour("line"), 1));
  for (const [sender, sent, receiver, arrival, fate] of broadcasts) {
    const lost = fate === "lost", end = lost ? (sender + receiver) / 2 : receiver;
    line(p, [[X(sent), Y(sender)], [X(arrival), Y(end)]], FATES[fate], fate === "relayed" ? 1.5 : 1,
      DASHES[fate]);
  }
  steps.forEach((times, i) => {
    p.fillStyle = content.adversaries[i] ? LOST : colour("chosen");
    times.forEach(t => p.fillRect(X(t) - 2, Y(i) - 2, 4, 4));
  });
  nameLanes(p, steps.length, high);
}

function nameLanes(p, count, high) {
  p.fillStyle = colour("dim");
  p.textAlign = "right";
  p.textBaseline = "middle";
  for (let i = 0; i < count; i += Math.ceil(11 / high)) {
    p.fillText(content.agents[i], LEFT - 4, TOP + (i + 0.5) * high);
  }
}

// The plots: curves are drawn once into a layer; the cursor and the veil over the time after it,
// which move thirty times a second, are drawn on top of it.
const panel = element("aside", { id: "phx-plots" });
document.body.append(panel);
let shown = [], drawn = [];
const folded = new Set();  // titles of plots that the visitor folded

// Begin and end of a plot.
const spanOf = what => zoomed && what.zoom ? what.zoom : content;
const timeAt = (x, width, { begin, end }) =>
  begin + (end - begin) * (x - LEFT) / (width - LEFT - RIGHT);

function plotOf(index) {
  const title = element("button", { className: "phx-title", onclick() {
    const name = shown[index].title;
    if (!folded.delete(name)) folded.add(name);
    this.blur();  // else the space bar would press it again
    redraw(true);
  } });
  const value = element("output"), canvas = element("canvas");
  scrub(canvas, x => timeAt(x, canvas.clientWidth, spanOf(shown[index])));
  const zoom = element("button", { onclick() { toggleZoom(); this.blur(); } });
  const nodes = [element("h2", {}, title, value, zoom), canvas];
  panel.append(...nodes);
  return { nodes, title, value, zoom, canvas, layer: element("canvas"), index };
}

function drawPlots(all) {
  if (!panel.clientWidth) return;
  if (all) shown = content.plots.filter(p => p.agent == null || p.agent === content.chosen);
  if (drawn.length !== shown.length) {
    drawn.forEach(plot => plot.nodes.forEach(node => node.remove()));
    drawn = shown.map((_, index) => plotOf(index));
  }
  for (const plot of drawn) {
    plot.title.ariaExpanded = !(plot.canvas.hidden = folded.has(shown[plot.index].title));
    if (all || plot.width !== plot.canvas.clientWidth) drawLayer(plot);
    drawCursor(plot);
  }
}

function rangeOf({ curves, safe, logarithmic }) {
  let low = Infinity, high = -Infinity;
  const extend = v => { if (v < low) low = v; if (v > high) high = v; };
  for (const curve of curves.filter(curve => curve.role !== "guide")) {
    // Of pairs other than the worst one only the largest h counts.
    const isPair = curve.agent == null && !curve.role && !curve.to;
    if (isPair) extend(curve.y.reduce((a, b) => Math.max(a, b)));
    else [curve.y, curve.to || []].forEach(values => values.forEach(extend));
  }
  safe.filter(v => v != null).forEach(extend);
  if (low > high) [low, high] = [0, 1];
  if (logarithmic) return [low / 1.3, high * 1.3];
  const pad = 0.08 * (high - low) || 0.5;
  return [low - pad, high + pad];
}

function drawLayer(plot) {
  const what = shown[plot.index];
  if (what.lanes.length) {
    plot.canvas.style.height = clamp(14 * what.lanes.length, 60, 420) + TOP + BOTTOM + "px";
  }
  const [ink, width, height] = pen(plot.canvas);
  plot.width = width;
  plot.layer.width = plot.canvas.width;
  plot.layer.height = plot.canvas.height;
  const p = plot.layer.getContext("2d");
  p.scale(devicePixelRatio, devicePixelRatio);
  p.font = ink.font;
  const [low, high] = rangeOf(what), bend = what.logarithmic ? Math.log : v => v;
  const across = width - LEFT - RIGHT, down = height - TOP - BOTTOM;
  const span = spanOf(what);
  const X = t => LEFT + across * (t - span.begin) / (span.end - span.begin);
  const Y = v => TOP + down * (bend(high) - bend(v)) / (bend(high) - bend(low));
  plot.title.textContent = what.title + (what.unit ? ` [${what.unit}]` : "") +
    (what.of_agents ? `, agent ${content.agents[content.chosen]}` : "");
  plot.X = X;
  plot.zoom.hidden = !what.zoom;
  plot.zoom.textContent = zoomed ? "whole run (z)" : "worst moment (z)";
  if (!width) return;  // it is folded
  timeAxis(p, X, span, width, height);
  if (what.lanes.length) {
    if (span === what.zoom) drawZoom(p, what.zoom, X, down);
    else drawLanes(p, what.lanes, X, down);
    return;
  }
  valueAxis(p, Y, what.logarithmic ? decades(low, high) : ticks(low, high, 4), width);
  p.save();
  p.beginPath();
  p.rect(LEFT, TOP, across, down);
  p.clip();
  for (const period of content.periods) {
    const isFault = !isEmptySet(period);
    if (what.of_agents ? period.agent !== content.chosen : !isFault) continue;
    p.fillStyle = colour(isFault ? "fault" : "backup");
    p.fillRect(X(period.begin), TOP, Math.max(X(period.end) - X(period.begin), 0.5), down);
  }
  for (const [limit, edge] of [[what.safe[0], low], [what.safe[1], high]]) {
    if (limit == null) continue;
    p.fillStyle = colour("unsafe");
    p.fillRect(LEFT, Math.min(Y(limit), Y(edge)), across, Math.abs(Y(limit) - Y(edge)));
    line(p, [[LEFT, Y(limit)], [width - RIGHT, Y(limit)]], colour("limit"), 1, [4, 3]);
  }
  // Many agents are in an envelope, and only the chosen one has a curve.
  const crowded = what.curves.some(curve => curve.to);
  what.curves.filter(curve => isBold(curve) || !(crowded && curve.agent != null))
    .sort((a, b) => isBold(a) - isBold(b)).forEach(curve => drawCurve(p, X, Y, curve));
  p.restore();
}

const isBold = curve => curve.role === "chosen" || curve.agent === content.chosen;
const isEmptySet = period => ["backup", "no-authority"].includes(period.kind);

function valueAxis(p, Y, values, width) {
  p.fillStyle = colour("dim");
  p.textAlign = "right";
  p.textBaseline = "middle";
  for (const v of values) {
    line(p, [[LEFT, Y(v)], [width - RIGHT, Y(v)]], colour("line"), 1);
    p.fillText(label(v), LEFT - 4, Y(v));
  }
}

function timeAxis(p, X, { begin, end }, width, height) {
  p.fillStyle = colour("dim");
  p.textBaseline = "bottom";
  ticks(begin, end, 6).forEach((t, k) => {
    line(p, [[X(t), height - BOTTOM], [X(t), height - BOTTOM + 3]], colour("dim"), 1);
    p.textAlign = X(t) > width - 40 ? "right" : "center";
    p.fillText(label(t) + (k ? "" : " s"), X(t), height);
  });
}

function drawCurve(p, X, Y, curve) {
  const { t, y, to, role, agent } = curve;
  if (to) {
    p.beginPath();
    t.forEach((v, k) => p.lineTo(X(v), Y(y[k])));
    for (let k = t.length - 1; k >= 0; k--) p.lineTo(X(t[k]), Y(to[k]));
    p.fillStyle = colour("band");
    p.fill();
    return;
  }
  const kind = isBold(curve) ? "chosen" : role || (content.adversaries[agent] ? "adversary" : "other");
  // An agent holds what a control step decided until the next one.
  const held = agent != null || role === "guide";
  const points = t.flatMap((v, k) => [...held && k ? [[X(v), Y(y[k - 1])]] : [], [X(v), Y(y[k])]]);
  line(p, points, colour(kind), kind === "chosen" ? 1.8 : 1, kind === "guide" ? [4, 3] : []);
}

function drawCursor(plot) {
  const { canvas, layer, value, X, width } = plot, height = canvas.clientHeight;
  const p = canvas.getContext("2d");
  value.textContent = valueText(shown[plot.index], clock);
  if (!width) return;
  p.clearRect(0, 0, width, height);
  p.drawImage(layer, 0, 0, width, height);
  const x = clamp(X(clock.t), LEFT, width - RIGHT);
  p.fillStyle = colour("veil");
  p.fillRect(x, TOP, width - RIGHT - x, height - TOP - BOTTOM);
  line(p, [[x, TOP], [x, height - BOTTOM]], colour("ink"), 1);
}

// The bold curve's value, and the curve's name if the title does not have it. A server sends the
// value; a file holds the curve alone, which is thinned.
function valueText({ curves, title }, { t, values }) {
  const chosen = curves.find(isBold);
  if (!chosen) return "";
  const value = values && title in values ? values[title] : valueAt(chosen, t);
  return value == null ? "" : (chosen.name ? chosen.name + ": " : "") + label(value);
}

function valueAt(chosen, t) {
  let low = 0, high = chosen.t.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (chosen.t[middle] <= t) low = middle + 1; else high = middle;
  }
  return chosen.y[Math.max(low - 1, 0)];
}

function ticks(low, high, most) {
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find(m => m * power >= rough);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high * (1 + 1e-12); k++) found.push(k * step);
  return found;
}

function decades(low, high) {
  const found = [];
  for (let k = Math.ceil(Math.log10(low)); 10 ** k <= high; k++) found.push(10 ** k);
  return found;
}

// Numbers this small differ from 0 by rounding alone.
const label = v => String(Math.abs(v) < 1e-9 ? 0 : Number(v.toPrecision(4)));

redraws.push(drawPlots);
// Layers keep the colours of the page on which they were drawn.
new MutationObserver(() => redraw(true)).observe(
  document.documentElement, { attributeFilter: ["data-mantine-color-scheme"] });
