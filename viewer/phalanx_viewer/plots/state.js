// The state of the page: its content, its cursor, and the functions that draw them.
let content = null;
let clock = { t: 0, playing: false, speed: 1 };
// viser rewrites an address, without what is behind its #.
const ADDRESS = new URL(performance.getEntriesByType("navigation")[0].name).hash || location.hash;
const redraws = [];  // called with true if the content is new
let due = false, fresh = false;

const phalanx = window.phalanx = {
  act: () => {},
  show(shown) {
    const first = content === null;
    content = shown;
    if (first) openAddress(ADDRESS);
    redraw(true);
  },
  at(time) { clock = time; redraw(false); },
};

// At most once for each frame that the browser paints.
function redraw(all) {
  fresh ||= all;
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    const all = fresh;
    due = fresh = false;
    if (content) redraws.forEach(draw => draw(all));
  });
}

function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

const colour = name => getComputedStyle(document.documentElement).getPropertyValue("--phx-" + name);
const clamp = (v, low, high) => Math.min(Math.max(v, low), high);
const isSeekable = () => content !== null && content.seekable;

function seek(t) {
  t = clamp(t, content.begin, content.end);
  // The server confirms a little later. A live run's present comes from there alone.
  if (isSeekable() || t < clock.now) phalanx.at({ ...clock, t, playing: false, values: null });
  phalanx.act({ seek: t });
}

// Margins of a plot.
const LEFT = 44, RIGHT = 8, TOP = 4, BOTTOM = 16;

// A context for drawing in CSS pixels on a canvas of the screen's own pixels.
function pen(canvas) {
  const scale = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = width * scale;
  canvas.height = height * scale;
  const found = canvas.getContext("2d");
  found.scale(scale, scale);
  found.font = "10px system-ui, sans-serif";
  return [found, width, height];
}

function line(p, points, stroke, wide, dash = []) {
  p.beginPath();
  points.forEach(point => p.lineTo(...point));
  p.strokeStyle = stroke;
  p.lineWidth = wide;
  p.setLineDash(dash);
  p.stroke();
}

// Press and drag on a canvas: seek the times under the pointer while it is down.
function scrub(canvas, timeAt) {
  const move = event => seek(timeAt(event.clientX - canvas.getBoundingClientRect().left));
  canvas.addEventListener("pointerdown", event => {
    canvas.setPointerCapture(event.pointerId);
    move(event);
  });
  canvas.addEventListener("pointermove", event => { if (event.buttons) move(event); });
}

document.head.append(element("style", { textContent: STYLE }));
