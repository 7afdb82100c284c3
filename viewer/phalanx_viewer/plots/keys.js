// Keys outside text fields: handled before the scene, whose camera also turns by arrow keys.
const KEYS = {
  " ": () => togglePlay(),
  ArrowLeft: event => seek(clock.t - (event.shiftKey ? 10 : 1) * content.step),
  ArrowRight: event => seek(clock.t + (event.shiftKey ? 10 : 1) * content.step),
  Home: () => seek(content.begin),
  ",": () => phalanx.act({ step: -1 }),
  ".": () => phalanx.act({ step: 1 }),
  End: () => seek(content.end),
  z: () => toggleZoom(),
};
addEventListener("keydown", event => {
  const act = KEYS[event.key], at = event.target;
  if (!act || !isSeekable() || event.ctrlKey || event.metaKey || event.altKey) return;
  if (at.isContentEditable || ["INPUT", "TEXTAREA", "SELECT"].includes(at.tagName)) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  act(event);
}, { capture: true });
