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
  if (!act || !content || event.ctrlKey || event.metaKey || event.altKey) return;
  if (at.isContentEditable || ["INPUT", "TEXTAREA", "SELECT"].includes(at.tagName)) return;
  if (!isSeekable() && at.tagName === "BUTTON") return;  // the space bar presses it
  event.preventDefault();
  event.stopImmediatePropagation();
  if (isSeekable()) act(event);
  else noteLive();
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
