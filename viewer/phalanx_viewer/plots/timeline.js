// The timeline: buttons, the time, and the whole run with its marks.
const EDGE = 8, SNAP = 6;
const RANK = { log: 0, fault: 1, backup: 2, worst: 3, violation: 4 };
const INK = { log: "#94a3b8", fault: "#475569", backup: "#f97316", worst: "#16a34a",
  violation: "#dc2626" };
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8];

const track = element("canvas"), time = element("output");
const button = (text, title, onclick) => element("button", {
  textContent: text, title,
  onclick() { onclick(); this.blur(); },  // else the space bar would press it again
});
const play = button("▶", "Play or pause; back to a live run's present (space)", () => togglePlay());
const speed = element("select", { title: "Speed",
  onchange() { phalanx.act({ speed: Number(this.value) }); this.blur(); } },
  ...SPEEDS.map(s => new Option(s + " ×", s)));
const linkButton = button("link", "An address that opens this moment, with the agent chosen", () => {
  const agent = encodeURIComponent(content.agents[content.chosen]);
  history.replaceState(null, "", `#t=${Number(clock.t.toFixed(3))}&agent=${agent}`);
  // Without the token, with which others could command the run.
  const address = location.href.replace(location.search, "");
  if (navigator.clipboard) navigator.clipboard.writeText(address).catch(() => {});
  say(`This moment: ${address}`);
});
const plotsButton = button("plots", "Show or fold the plots", foldPlots);
const firstViolation = () => content.marks.filter(mark => mark.kind === "violation")
  .reduce((first, mark) => !first || mark.t < first.t ? mark : first, null);
// The first recorded state with the violation lies after it.
const violationButton = button("violation", "To the first violation", () => {
  seek(firstViolation().t);
  phalanx.act({ step: 1 });
});
const bar = element("footer", { id: "phx-timeline" },
  button("|◀", "To the start (home)", () => seek(content.begin)), play, speed, time, track,
  button("worst", "To the worst moment (z)", seekWorst),
  violationButton, linkButton, plotsButton);
const note = element("div", { id: "phx-note", role: "status", hidden: true });
document.body.append(bar, note);
// On a small page its buttons may need two rows.
new ResizeObserver(() => document.documentElement.style
  .setProperty("--phx-timeline", bar.offsetHeight + "px")).observe(bar);

const narrow = matchMedia("(max-width: 1200px)");
const fold = folded => {
  document.body.classList.toggle("phx-folded", folded);
  document.body.classList.toggle("phx-open", !folded);
  redraw(true);
};
function foldPlots() { fold(!document.body.classList.contains("phx-folded")); }
narrow.addEventListener("change", () => fold(narrow.matches));
fold(narrow.matches);
addEventListener("resize", () => redraw(true));

function togglePlay() {
  if (isSeekable()) phalanx.act({ play: !clock.playing });
  // The newest frame is the present, which goes on: hold the one before.
  else if (clock.playing) phalanx.act({ seek: clock.t, step: -1 });
  else seek(content.end);
}

function seekWorst() {
  const worst = content.marks.find(mark => mark.kind === "worst");
  if (worst) seek(worst.t);
}

// For a while.
let noted = 0;
function say(text) {
  note.textContent = text;
  note.hidden = false;
  clearTimeout(noted);
  noted = setTimeout(() => { note.hidden = true; }, 8000);
}

// Go to the time and agent that the address names, such as "#t=12.3&agent=2".
function openAddress(hash) {
  const address = new URLSearchParams(hash.slice(1)), agent = address.get("agent");
  const action = {}, t = address.get("t");
  if (content.agents.includes(agent)) action.agent = agent;
  else if (agent !== null) say(`The run has no agent ${agent}: it has ${content.agents.join(", ")}.`);
  if (t && Number.isFinite(+t)) action.seek = clamp(+t, content.begin, content.end);
  else if (t !== null) say(`Expected a time in seconds, such as #t=12.3, got t=${t}.`);
  if (address.size) phalanx.act(action);
}
addEventListener("hashchange", () => openAddress(location.hash));

const trackTime = x =>
  content.begin + (content.end - content.begin) * (x - EDGE) / (track.clientWidth - 2 * EDGE);
const trackX = t => EDGE + (track.clientWidth - 2 * EDGE) *
  (t - content.begin) / (content.end - content.begin);

function markAt(x) {
  const near = content.marks.filter(mark => Math.abs(trackX(mark.t) - x) <= SNAP);
  return near.sort((a, b) => RANK[b.kind] - RANK[a.kind])[0];
}

scrub(track, x => (markAt(x) || { t: trackTime(x) }).t);
track.addEventListener("pointermove", event => {
  const mark = content && markAt(event.clientX - track.getBoundingClientRect().left);
  track.title = mark ? `${mark.t.toFixed(3)} s: ${mark.text}` : "";
});

redraws.push(() => {
  const [p, width, height] = pen(track), base = height - 20;
  speed.hidden = !content.seekable;
  violationButton.hidden = !firstViolation();
  const behind = !content.seekable && !clock.playing;
  play.className = behind ? "phx-behind" : "";
  play.textContent = behind ? `▶ live, ${clock.now.toFixed(1)} s` :
    !content.seekable ? "● live" : clock.playing ? "⏸" : "▶";
  if (document.activeElement !== speed) speed.value = clock.speed;
  time.textContent = clock.t.toFixed(3) + " s";
  p.fillStyle = colour("line");
  p.fillRect(EDGE, base - 6, width - 2 * EDGE, 6);
  p.fillStyle = colour("chosen");
  p.fillRect(EDGE, base - 6, clamp(trackX(clock.t) - EDGE, 0, width - 2 * EDGE), 6);
  for (const period of content.periods) {
    const isFault = !isEmptySet(period), x = trackX(period.begin);
    if (!isFault && period.agent !== content.chosen) continue;
    p.fillStyle = isFault ? INK.fault : INK.backup;
    p.fillRect(x, base + (isFault ? 1 : -9), Math.max(trackX(period.end) - x, 1), 2);
  }
  const marks = [...content.marks].sort((a, b) => RANK[a.kind] - RANK[b.kind]);
  for (const mark of marks) {
    p.fillStyle = INK[mark.kind];
    p.fillRect(trackX(mark.t) - 1, mark.kind === "log" ? base - 14 : base - 20, 2, 14);
  }
  p.fillStyle = colour("dim");
  for (const t of ticks(content.begin, content.end, clamp(width / 90, 3, 12))) {
    const text = label(t) + " s", half = p.measureText(text).width / 2;
    p.fillText(text, clamp(trackX(t) - half, 0, width - 2 * half), height - 4);
  }
  p.fillStyle = colour("ink");
  p.fillRect(trackX(clock.t) - 1, base - 24, 2, 30);
});

// Keys outside text fields: handled before the scene, whose camera also turns by arrow keys.
const KEYS = {
  " ": () => togglePlay(),
  ArrowLeft: event => seek(clock.t - (event.shiftKey ? 10 : 1) * content.step),
  ArrowRight: event => seek(clock.t + (event.shiftKey ? 10 : 1) * content.step),
  Home: () => seek(content.begin),
  ",": () => phalanx.act({ step: -1 }),
  ".": () => phalanx.act({ step: 1 }),
  End: () => seek(content.end),
  z: () => isSeekable() ? toggleZoom() : seekWorst(),
};
addEventListener("keydown", event => {
  const act = KEYS[event.key], at = event.target;
  if (!act || !content || event.ctrlKey || event.metaKey || event.altKey) return;
  if (at.isContentEditable || ["INPUT", "TEXTAREA", "SELECT"].includes(at.tagName)) return;
  if (!isSeekable() && at.tagName === "BUTTON") return;  // the space bar presses it
  event.preventDefault();
  event.stopImmediatePropagation();
  act(event);
}, { capture: true });

// A list of viser's takes an option that arrow keys have reached, and none that was typed.
addEventListener("keydown", event => {
  const field = event.target, list = document.getElementById(field.getAttribute("aria-controls"));
  if (event.key !== "Enter" || !list || list.querySelector("[data-combobox-selected]")) return;
  const options = [...list.querySelectorAll("[role=option]")];
  const typed = options.find(option => option.textContent === field.value) || options[0];
  if (!typed) return;
  event.stopImmediatePropagation();
  typed.click();
}, { capture: true });
// The keys after a choice are no text.
addEventListener("click", ({ target }) => {
  if (target.closest("[role=option]")) document.activeElement.blur();
});
