// Without a graphics card the browser draws on its processor, the panels too. Smoothed edges cost it several times what
// all else does: so the 3-D view has none there, and charts neither, of which only those in sight are drawn. viser itself
// draws fewer pixels where frames are slow.
{
  const ask = HTMLCanvasElement.prototype.getContext;
  const probe = document.createElement("canvas").getContext("webgl2");
  const named = probe?.getExtension("WEBGL_debug_renderer_info");
  const renderer = named ? probe.getParameter(named.UNMASKED_RENDERER_WEBGL) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  if (/swiftshader|llvmpipe|softpipe|basic render/i.test(renderer)) {
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      return ask.call(this, kind, kind.startsWith("webgl") ? { ...options, antialias: false } : options);
    };
    const plain = document.createElement("style");
    plain.dataset.goshawk = "plain";
    plain.textContent =
      "[data-goshawk] svg { content-visibility: auto } [data-goshawk] svg * { shape-rendering: crispEdges }";
    document.head.append(plain);

    // viser says for good that it is slow here, over the picture and on a phone over the mode. Once read, it goes.
    const watch = new MutationObserver(() => {
      const notes = [...document.querySelectorAll(".mantine-Notification-root")];
      const note = notes.find(({ textContent }) => /software webgl/i.test(textContent));
      if (!note) return;
      watch.disconnect();
      setTimeout(() => note.querySelector("button")?.click(), 8000);
    });
    watch.observe(document, { childList: true, subtree: true });
  }
}
