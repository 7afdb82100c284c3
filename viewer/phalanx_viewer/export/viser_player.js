// Seek, play and follow the player of a scene that viser 1.1 embeds in a page.
//
// The player has no API: its slider and button are React's. A field takes a value that was set past
// React only with an event of its own. Upstream has no issue yet. It would say: "An embedded scene
// should offer seek(t), play(), pause() and an event for each new time."
(() => {
  const bar = () => document.querySelector("#root div:has(> .mantine-Slider-root)");
  const setValue = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
  // A field that loses the focus sets the time that it shows, rounded to 0.1 s, if React notices.
  const hide = event => event.stopPropagation();
  window.viserPlayer = {
    playing: true,
    seek(t) {
      const field = bar().querySelector("input");
      // React ignores a text that the field has already; empty text sets no time.
      for (const text of ["", t.toFixed(6)]) {
        setValue.call(field, text);
        field.dispatchEvent(new Event("input", { bubbles: true }));
      }
      // The field takes the focus, and would then take the keys.
      field.addEventListener("focusout", hide);
      field.blur();
      this.playing = false;
    },
    play(playing) { bar().querySelector("button").click(); this.playing = playing; },
    // The time that the player shows [s]; undefined before it is there.
    now() {
      const value = bar()?.querySelector("[role=slider]")?.getAttribute("aria-valuenow");
      return value == null ? undefined : Number(value);
    },
  };
})();
