// The space-time diagram: the whole run, or its worst moment broadcast by broadcast.
const LATE = "#e8a200", LOST = "#d62728", FALSE = "#06b6d4";
let zoomed = false;

function toggleZoom() {
  zoomed = !zoomed;
  redraw(true);
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
// its receiver, or half way there if it was lost.
const FATES = { "in time": "#9fb2ca", late: LATE, lost: LOST, false: FALSE };
function drawZoom(p, { steps, broadcasts }, X, down) {
  const high = down / steps.length, Y = i => TOP + (i + 0.5) * high;
  steps.forEach((_, i) => line(p, [[LEFT, Y(i)], [p.canvas.width, Y(i)]], colour("line"), 1));
  for (const [sender, sent, receiver, arrival, fate] of broadcasts) {
    const lost = fate === "lost", end = lost ? (sender + receiver) / 2 : receiver;
    line(p, [[X(sent), Y(sender)], [X(arrival), Y(end)]], FATES[fate], 1, lost ? [3, 2] : []);
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
