// The legend over the scene's lower edge, folded at first on a small page, and where the scene is.
const legend = element("details", { id: "phx-legend", open: !matchMedia("(max-width: 576px)").matches },
  element("summary", { textContent: "Legend" }), element("div"));
legend.className = "phalanx-over";
document.body.append(legend);

redraws.push(all => {
  if (!all) return;
  legend.lastChild.replaceChildren(...content.legend.map(([text, sign, colour]) => element("span", {},
    element("b", { textContent: sign, ariaHidden: true, style: `color: ${colour}` }), " " + text)));
});

// The free margins of the page around the scene, for what lies over it.
const margins = new ResizeObserver(([{ target }]) => {
  const box = target.getBoundingClientRect(), root = document.documentElement.style;
  root.setProperty("--phx-left", box.left + "px");
  root.setProperty("--phx-right", innerWidth - box.right + "px");
  root.setProperty("--phx-bottom", innerHeight - box.bottom + "px");
});
(function watch() {
  const scene = document.querySelector("#root canvas");
  if (scene) margins.observe(scene);
  else requestAnimationFrame(watch);
})();
