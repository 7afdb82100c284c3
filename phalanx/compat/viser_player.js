// Seek, play and follow the player of a scene that viser 1.1 embeds in a page.
//
// The player has no API: its slider and button are React's. A field takes a value that was set past
// React only with an event of its own. Upstream has no issue yet. It would say: "An embedded scene
// should offer seek(t), play(), pause() and an event for each new time."
(() => {
  const bar = () => document.querySelector("#root div:has(> .mantine-Slider-root)");
  const setValue = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
  window.viserPlayer = {
    playing: true,
    seek(t) {
      const field = bar().querySelector("input");
      setValue.call(field, String(t));
      field.dispatchEvent(new Event("input", { bubbles: true }));
      field.blur();  // it takes the focus, and would then take the keys
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
