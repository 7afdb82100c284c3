// Draw all of a message in one picture. viser 1.1 handles messages while it draws: names, rings and
// cameras move in that picture, but what React sets, such as bodies, lines and texts, in the next. So
// messages wait for the time between two pictures. Upstream has no issue yet. It would say: "Poses
// are drawn one frame before the props of the same atomic block".
if (window.__viserMutable && !window.viserFrames) (() => {
  const viewer = window.viserFrames = window.__viserMutable, held = [];
  const { drainMessageQueue: handle, requestRender: draw } = viewer;
  const release = () => {
    viewer.messageQueue.push(...held.splice(0));
    handle();
    draw();
  };
  viewer.drainMessageQueue = () => {
    held.push(...viewer.messageQueue.splice(0));
    if (document.hidden) release();  // it draws nothing
    else if (held.length) requestAnimationFrame(() => setTimeout(release));
  };
  viewer.requestRender = () => { viewer.drainMessageQueue(); draw(); };
})();
