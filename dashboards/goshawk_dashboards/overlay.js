// Stop, alerts and the last command's outcome in a layer of their own, above whatever viser's panels do: scrolled,
// folded away or behind a dialog, they would take their content with them.
if (!window.goshawkOver) {
  const press = (shiftKey) =>
    // viser's hotkeys listen here, and ignore a key whose target is an input field: so the target is the document.
    document.documentElement.dispatchEvent(
      new KeyboardEvent("keydown", { key: " ", code: "Space", shiftKey, bubbles: true }),
    );
  const layer = document.createElement("div");
  layer.id = "goshawk-over";
  layer.innerHTML =
    '<div class="goshawk-news"></div><div class="goshawk-stops">' +
    '<button><span>Stop</span><kbd aria-hidden="true">space</kbd></button>' +
    '<button hidden><span>Stop all</span><kbd aria-hidden="true">shift + space</kbd></button></div>';
  document.body.append(layer);
  const [news, stops] = layer.children;
  const [one, all] = stops.children;
  one.onclick = () => press(false);
  all.onclick = () => press(true);
  for (const kind of ["keydown", "keyup"])
    window.addEventListener(
      kind,
      (event) => {
        if (event.code !== "Space" || !event.isTrusted) return;
        event.preventDefault();
        event.stopImmediatePropagation();
        if (kind === "keydown" && !event.repeat) press(event.shiftKey);
      },
      true,
    );
  window.goshawkOver = (template) => {
    news.innerHTML = template.innerHTML;
    // The buttons stay the same elements: a press must not lose its button between down and up.
    one.firstChild.textContent = template.dataset.stop;
    all.hidden = template.dataset.fleet !== "true";
  };
  const waiting = document.querySelector("template[data-stop]");
  if (waiting) window.goshawkOver(waiting);
}
