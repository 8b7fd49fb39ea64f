// Stop, alerts and the last command's outcome in a layer of their own, above whatever viser's panels do: scrolled,
// folded away or behind a dialog, they would take their content with them.
{
  const press = (key, code, held = {}) =>
    // viser's hotkeys listen here, and ignore a key whose target is an input field: so the target is the document.
    document.documentElement.dispatchEvent(new KeyboardEvent("keydown", { key, code, bubbles: true, ...held }));
  const stop = (shiftKey) => press(" ", "Space", { shiftKey });
  const layer = document.createElement("div");
  layer.id = "goshawk-over";
  layer.innerHTML =
    '<div class="goshawk-column"><div></div><div></div><div class="goshawk-still" role="alert" hidden></div></div>' +
    '<div class="goshawk-stops" hidden>' +
    '<button class="goshawk-all"><span></span><kbd aria-hidden="true">shift + space, twice</kbd></button>' +
    '<button class="goshawk-one"><span></span><kbd aria-hidden="true">space</kbd></button>' +
    '<button class="goshawk-cancel"><span></span></button></div>';
  document.body.append(layer);
  const [column, stops] = layer.children;
  const [news, card, still] = column.children;
  const [all, one, cancel] = stops.children;
  one.onclick = () => stop(false);
  all.onclick = () => stop(true);
  cancel.onclick = () => press("Backspace", "Backspace", { altKey: true, shiftKey: true });
  for (const kind of ["keydown", "keyup"])
    window.addEventListener(
      kind,
      (event) => {
        if (event.code !== "Space" || !event.isTrusted || stops.hidden) return;
        event.preventDefault();
        event.stopImmediatePropagation();
        if (kind === "keydown" && !event.repeat) stop(event.shiftKey);
      },
      true,
    );

  // Where frames are slow, viser draws three quarters of the window's pixels, across and up. Without a graphics card a
  // flight is drawn with six tenths, to keep up with it. Charts are no canvases here, and stay sharp.
  if (document.querySelector('style[data-goshawk="plain"]')) {
    const { get } = Object.getOwnPropertyDescriptor(window, "devicePixelRatio");
    Object.defineProperty(window, "devicePixelRatio", { configurable: true, get: () => 0.8 * get.call(window) });
  }

  // Which vehicle this tab shows outlives a reload and a lost connection, after which viser begins with the first one.
  // Its digit asks for it again, until it is shown: viser may not listen yet.
  let visit, now, wanted;
  const remember = ({ visit: visitNow, shown, vehicles }) => {
    const names = vehicles.split(" ");
    if (visit !== visitNow) {
      const before = sessionStorage.getItem("goshawk-shown");
      wanted = before !== shown && names.includes(before) ? before : undefined;
    }
    visit = visitNow;
    now = shown;
    if (now === wanted) wanted = undefined;
    if (wanted === undefined) sessionStorage.setItem("goshawk-shown", now);
    else askFor(wanted, names.indexOf(wanted) + 1, 25);
  };
  const askFor = (name, digit, tries) => {
    if (name !== wanted) return;
    if (tries === 0 || digit > 9) wanted = undefined;
    else {
      press(`${digit}`, `Digit${digit}`);
      clearTimeout(askFor.timer);
      askFor.timer = setTimeout(askFor, 200, name, digit, tries - 1);
    }
  };

  const label = (button, words) => {
    // The buttons stay the same elements: a press must not lose its button between down and up.
    button.firstChild.textContent = words;
    button.hidden = words === "";
  };
  // Only the page itself can tell that the ground station, the way to it or the browser's drawing stands still: what it
  // showed last looks like now. A tab that nobody looks at is not drawn.
  const LATE_S = 4;
  let beat, beatAt;
  const hear = (beatNow) => {
    if (beat === beatNow) return;
    beat = beatNow;
    beatAt = performance.now();
  };
  const listen = () => {
    const silence = (performance.now() - beatAt) / 1000;
    const late = !document.hidden && silence > LATE_S;
    document.body.classList.toggle("goshawk-late", late);
    still.hidden = !late;
    if (!late) return;
    still.textContent =
      `Nothing new from the ground station for ${silence.toFixed(0)} s: what is shown is old, ` +
      "and Stop may not arrive. Pilot: be ready to take over.";
  };
  setInterval(listen, 500);
  document.addEventListener("visibilitychange", () => {
    beatAt &&= performance.now();
  });

  let told;
  const tell = (template) => {
    const facts = template.dataset;
    hear(facts.beat);
    // What pulses begins anew with each new element.
    if (told !== template.innerHTML) news.innerHTML = told = template.innerHTML;
    stops.hidden = facts.stop === "";
    label(one, facts.stop);
    label(all, facts.all);
    label(cancel, facts.cancel);
    all.dataset.armed = facts.armed;
    remember(facts);
  };
  const showCard = (template) => {
    // What lies between the panels of a wide window may be narrow.
    card.innerHTML = window.innerWidth > 576 ? "" : template.innerHTML;
  };

  // viser makes a template anew when its text is new.
  const takers = { over: tell, "over-phone": showCard };
  const taken = {};
  const look = () => {
    for (const [name, take] of Object.entries(takers)) {
      const template = document.querySelector(`template[data-goshawk="${name}"]`);
      if (!template || template === taken[name]) continue;
      taken[name] = template;
      take(template);
    }
  };
  new MutationObserver(look).observe(document, { childList: true, subtree: true });
}
