// The dock below the scene: play and step, the flight as a band of phases, the charts, and the picker of signals.
// It talks with the review's desk over a WebSocket of its own, and finds in viser's page which viser client it is.
(() => {
  const make = (name, properties = {}, ...children) => {
    const element = Object.assign(document.createElement(name), properties);
    element.append(...children);
    return element;
  };
  const option = (value, words = value) => make("option", { value, textContent: words });
  const whole_s = () => about.end_s - about.begin_s;
  const share = (seconds) => `${(100 * seconds) / whole_s()}%`;
  const place = (timeS) => share(timeS - about.begin_s);
  const LISTED = 200; // signals of the picker
  let about = null;
  let viewer = null;
  let socket = null;
  let scrubbing = false;

  // ---- elements ----

  const button = (words, onclick, more = {}) => make("button", { type: "button", textContent: words, onclick, ...more });
  const play = button("Play", () => say({ type: "toggle" }), { className: "play", title: "space" });
  const time = make("input", { className: "time", inputMode: "decimal", ariaLabel: "Time, s" });
  const length = make("span", { className: "soft" });
  const speed = make("select", { ariaLabel: "Speed" });
  const aligned = make("select", { ariaLabel: "Aligned by", hidden: true });
  const flights = make("div", { className: "flights" });
  const whole = button("Whole flight", () => stack.whole(), { title: "double-click on a chart" });
  const add = button("+ signal", () => openPicker());
  const alter = button("Plan again …", () => openAlter(), { hidden: true, title: "from here on, with another policy or other parameters" });
  const bar = make(
    "div", { className: "bar" }, play,
    button("◀ event", () => say({ type: "step", what: "event", way: -1 }), { title: "arrow up" }),
    button("◀ frame", () => say({ type: "step", what: "frame", way: -1 }), { title: "arrow left" }),
    button("frame ▶", () => say({ type: "step", what: "frame", way: 1 }), { title: "arrow right" }),
    button("event ▶", () => say({ type: "step", what: "event", way: 1 }), { title: "arrow down" }),
    time, length, speed, aligned, flights, make("span", { className: "room" }), alter, whole, add,
  );
  const band = make("div", { className: "band", title: "click or drag to go there" });
  band.dataset.goshawk = "band";
  const windowed = make("div", { className: "window" });
  const cursor = make("div", { className: "cursor" });
  cursor.dataset.goshawk = "cursor";
  const host = make("div", { className: "charts" });
  host.dataset.goshawk = "charts";
  const grip = make("div", { className: "grip", title: "drag to resize" });
  const search = make("input", { type: "search", placeholder: "any signal: speed, imu, cost …", ariaLabel: "Search a signal" });
  const where = make("select", { ariaLabel: "Add to" });
  const found = make("ul");
  const picker = make("div", { id: "goshawk-picker", hidden: true }, search, where, found);
  const policy = make("select", { ariaLabel: "Policy" });
  const keys = make("datalist", { id: "goshawk-parameters" });
  const changes = make("div", { className: "changes" });
  const lasts = make("input", { inputMode: "decimal", value: "3", ariaLabel: "For how many seconds" });
  const replan = button("Plan again", () => sendAlter(), { className: "play" });
  const restore = button("As it was flown", () => say({ type: "restore" }), { disabled: true });
  const said = make("output", { className: "said" });
  said.dataset.goshawk = "altered";
  const alterPanel = make(
    "div", { id: "goshawk-alter", hidden: true },
    make("label", {}, "Policy", policy),
    changes,
    make("div", { className: "row" }, button("+ parameter", () => addChange()), make("span", { className: "room" }), "for", lasts, "s"),
    make("div", { className: "row" }, replan, restore, make("span", { className: "room" }), button("Close", () => openAlter())),
    said, keys,
  );
  const dock = make("div", { id: "goshawk-dock" }, grip, bar, band, host, picker, alterPanel);
  document.body.append(dock);

  // ---- charts ----

  let next = 0;
  const byNumber = new Map();
  const stack = new GoshawkCharts(host, {
    ask: (chart, number, from_s, to_s, columns) => {
      chart.id ??= next++;
      byNumber.set(number, chart);
      say({ type: "show", chart: chart.id, number, signals: chart.signals, from_s, to_s, columns });
    },
    seek: (time_s, hand) => say({ type: "seek", time_s, hand }),
    remove: (chart, signal) => {
      chart.signals = chart.signals.filter((name) => name !== signal);
      if (chart.signals.length) return stack.request(chart);
      stack.drop(chart);
      say({ type: "show", chart: chart.id, number: 0, signals: [], from_s: 0, to_s: 1, columns: 100 });
    },
    onplace: ({ left, right }) => {
      // The band lies over the plots, whatever axes they have.
      band.style.marginLeft = `${left}px`;
      band.style.marginRight = `${dock.clientWidth - right}px`;
    },
    onzoom: (from_s, to_s) => {
      windowed.style.left = place(from_s);
      windowed.style.width = share(to_s - from_s);
      windowed.style.display = to_s - from_s < 0.999 * whole_s() ? "" : "none";
      host.dataset.window = `${from_s.toFixed(3)} ${to_s.toFixed(3)}`;
    },
  });

  window.goshawkReview = stack; // for tests, and for who looks closer

  // ---- the picker ----

  const openPicker = () => {
    picker.hidden = !picker.hidden;
    if (picker.hidden) return;
    where.replaceChildren(option("new", "as a new chart"));
    stack.charts.forEach((chart, k) => where.append(option(k, `to chart ${k + 1}: ${chart.signals[0]}`)));
    search.value = "";
    list();
    search.focus();
  };
  const list = () => {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const names = Object.keys(about?.units || {}).filter((name) => words.every((w) => name.toLowerCase().includes(w)));
    found.replaceChildren(
      ...names.slice(0, LISTED).map((name) =>
        make("li", {}, make("button", { type: "button", onclick: () => pick(name) }, name, make("small", { textContent: about.units[name] }))),
      ),
    );
    if (names.length > LISTED) found.append(make("li", { textContent: `… and ${names.length - LISTED} more, type to narrow` }));
    if (!names.length) found.append(make("li", { textContent: "no signal goes by these words" }));
  };
  const pick = (name) => {
    const chart = where.value === "new" ? null : stack.charts[Number(where.value)];
    if (!chart) stack.add([name]).element.scrollIntoView({ block: "nearest" });
    else if (!chart.signals.includes(name)) {
      chart.signals.push(name);
      stack.request(chart);
    }
    picker.hidden = true;
  };
  search.oninput = list;
  picker.addEventListener("keydown", (event) => {
    if (event.key === "Escape") picker.hidden = true;
    if (event.key === "Enter" && event.target === search) found.querySelector("button")?.click();
  });

  // ---- planning again ----

  let altered = []; // the charts of what was altered
  const openAlter = () => {
    alterPanel.hidden = !alterPanel.hidden;
    picker.hidden = true;
    if (!alterPanel.hidden && !changes.children.length) addChange();
  };
  const addChange = () => {
    const key = make("input", { placeholder: "planner.costs.obstacle", ariaLabel: "Parameter", spellcheck: false });
    key.setAttribute("list", keys.id);
    const value = make("input", { className: "value", ariaLabel: "Value", spellcheck: false });
    key.oninput = () => (value.placeholder = about.alter.parameters[key.value.trim()] ?? "");
    const row = make("div", { className: "row" }, key, "=", value);
    row.append(button("×", () => row.remove(), { title: "take it away" }));
    changes.append(row);
  };
  const sendAlter = () => {
    const wanted = [...changes.children].map((row) => [...row.querySelectorAll("input")].map((input) => input.value.trim()));
    const set = wanted.filter(([key, value]) => key || value).map(([key, value]) => `${key} = ${value}`);
    said.textContent = "planning again …";
    said.dataset.bad = false;
    replan.disabled = true;
    say({ type: "alter", for_s: Number(lasts.value.replace(",", ".")) || 0, changes: set, policy: policy.value || null });
  };
  const showAltered = (message) => {
    replan.disabled = false;
    said.dataset.bad = Boolean(message.error);
    said.textContent = message.error || message.words;
    if (message.error) return;
    for (const chart of altered.filter((chart) => stack.charts.includes(chart))) stack.drop(chart);
    altered = message.charts.toReversed().map((signals) => stack.add(signals, "", true));
    host.scrollTop = 0;
    const room = 0.1 * (message.to_s - message.at_s);
    stack.zoom(message.at_s - room, message.to_s + room);
  };
  alterPanel.addEventListener("keydown", (event) => {
    if (event.key === "Escape") alterPanel.hidden = true;
    if (event.key === "Enter" && event.target.tagName === "INPUT" && !replan.disabled) sendAlter();
  });

  // ---- the desk ----

  const say = (message) => socket?.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message));
  const connect = () => {
    socket = new WebSocket(new URL("/charts", location.href.replace(/^http/, "ws")));
    socket.binaryType = "arraybuffer";
    const decoder = new TextDecoder();
    socket.onopen = () => viewer !== null && say({ type: "hello", viewer });
    socket.onmessage = (event) => hear(JSON.parse(decoder.decode(event.data)));
    socket.onclose = () => {
      replan.disabled = false;
      setTimeout(connect, 1000);
    };
  };
  const hear = (message) => {
    if (message.type === "about") open(message);
    else if (message.type === "now") now(message);
    else if (message.type === "altered") showAltered(message);
    else if (message.type === "stranger") setTimeout(() => say({ type: "hello", viewer }), 200);
    else if (message.type === "curves") {
      const chart = byNumber.get(message.number);
      byNumber.delete(message.number);
      if (!chart || chart.number !== message.number || !about) return; // a newer question is under way
      if (about.flights.length > 1) {
        chart.title = chart.signals.length === 1 ? chart.signals[0] : "";
        for (const line of message.lines) {
          const { short } = about.flights[line.flight];
          line.name = chart.title ? short : `${short}: ${line.label}`;
        }
      }
      stack.lines(chart, message.lines);
    }
  };
  // viser gives a browser a new client when it connects anew.
  setInterval(() => {
    const found = document.querySelector("[data-viewer]")?.dataset.viewer;
    if (found === undefined || Number(found) === viewer) return;
    viewer = Number(found);
    say({ type: "hello", viewer });
  }, 150);

  const open = (message) => {
    const before = about;
    about = message;
    const begin = about.begin_s < 0 ? `${about.begin_s.toFixed(2).replace("-", "−")} to ` : "";
    length.textContent = `of ${begin}${about.end_s.toFixed(2)} s`;
    if (!before) {
      speed.replaceChildren(...about.speeds.map((s) => option(s, `${s} ×`)));
      speed.value = "1";
    }
    alter.hidden = !about.alter;
    if (about.alter && !before) {
      policy.replaceChildren(option("", "the one that flew"), ...about.alter.policies.map((name) => option(name)));
      keys.replaceChildren(...Object.keys(about.alter.parameters).map((key) => option(key)));
    }
    restore.disabled = !about.altered;
    if (before?.altered && !about.altered) {
      altered.forEach((chart) => stack.charts.includes(chart) && stack.drop(chart));
      said.textContent = "";
    }
    aligned.hidden = !about.alignments.length;
    aligned.replaceChildren(...about.alignments.map((name) => option(name, `aligned by ${name}`)));
    aligned.value = about.aligned;
    flights.replaceChildren(
      ...(about.flights.length > 1 ? about.flights : []).map((flight) => {
        const shift = flight.by_s ? ` (${flight.by_s > 0 ? "+" : "−"}${Math.abs(flight.by_s).toFixed(2)} s)` : "";
        return make("span", { title: flight.name + shift }, make("i", { style: `background:${flight.color}` }), flight.short + shift);
      }),
    );
    if (about.beside) {
      const { name, words, color } = about.beside;
      const span = make("span", { title: words }, make("i", { style: `background:${color}` }), `beside: ${name}`);
      span.dataset.goshawk = "beside";
      flights.append(span);
    }
    drawBand();
    stack.bounds = [about.begin_s, about.end_s];
    stack.bands = about.phases;
    if (!before) about.charts.forEach((signals) => stack.add(signals));
    if (before?.begin_s === about.begin_s && before.end_s === about.end_s) stack.zoom(...stack.window);
    else stack.whole();
  };
  const drawBand = () => {
    const at = (className, from_s, to_s, title) => {
      const element = make("div", { className, title });
      element.style.left = place(from_s);
      if (to_s !== null) element.style.width = share(to_s - from_s);
      return element;
    };
    const phases = about.phases.map((phase) => {
      const words = `${phase.name} ${phase.from_s.toFixed(2)} to ${phase.to_s.toFixed(2)} s`;
      const element = at("phase", phase.from_s, phase.to_s, words);
      element.style.background = phase.color;
      element.dataset.phase = phase.name;
      if ((phase.to_s - phase.from_s) / whole_s() > 0.009 * phase.name.length) element.textContent = phase.name;
      return element;
    });
    const fallbacks = about.fallbacks.map((f) => at("fallback", f.from_s, f.to_s, `fallback: ${f.name}`));
    const marks = about.marks.map((mark) => {
      const element = at("mark", mark.time_s, null, `${mark.time_s.toFixed(2)} s  ${mark.text}`);
      element.style.background = mark.color;
      element.dataset.tall = mark.tall;
      return element;
    });
    band.replaceChildren(...phases, ...fallbacks, ...marks, windowed, cursor);
    band.dataset.phases = about.phases.map((phase) => phase.name).join("|");
    drawTicks();
  };
  // As many as have room for their words.
  const drawTicks = () => {
    if (!about) return;
    const most = Math.min(14, Math.max(2, band.clientWidth / 45));
    const step = [0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600].find((s) => whole_s() / s <= most) || 1200;
    const ticks = [];
    for (let k = Math.floor(about.begin_s / step) + 1; k * step < about.end_s - 0.015 * whole_s(); k++) {
      const tick = make("div", { className: "tick", textContent: `${+(k * step).toFixed(1)} s`.replace("-", "−") });
      tick.style.left = place(k * step);
      ticks.push(tick);
    }
    for (const old of band.querySelectorAll(".tick")) old.remove();
    windowed.before(...ticks);
  };
  new ResizeObserver(drawTicks).observe(band);
  const now = ({ time_s, playing, values }) => {
    cursor.dataset.time = time_s.toFixed(3);
    if (about) cursor.style.left = place(time_s);
    play.textContent = playing ? "Pause" : "Play";
    if (document.activeElement !== time) time.value = time_s.toFixed(2);
    stack.now(time_s, values);
    // While it plays, the window goes on with it.
    const [from, to] = stack.window;
    if (playing && time_s > to && to < stack.bounds[1]) stack.zoom(to, to + (to - from));
  };

  // ---- hands ----

  const seekTo = (event, hand) => {
    const box = band.getBoundingClientRect();
    const part = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
    say({ type: "seek", time_s: about.begin_s + part * whole_s(), hand });
  };
  band.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !about) return;
    scrubbing = true;
    band.setPointerCapture(event.pointerId);
    seekTo(event, true);
  });
  band.addEventListener("pointermove", (event) => scrubbing && seekTo(event, true));
  band.addEventListener("pointerup", (event) => {
    if (scrubbing) seekTo(event, false);
    scrubbing = false;
  });
  time.onchange = () => {
    const wanted = Number(time.value.replace(",", "."));
    if (Number.isFinite(wanted)) say({ type: "seek", time_s: wanted });
    time.blur();
  };
  speed.onchange = () => say({ type: "speed", times: Number(speed.value) });
  aligned.onchange = () => say({ type: "align", to: aligned.value });
  // A key for a control of the dock is not one of viser's hotkeys, too.
  dock.addEventListener("keydown", (event) => {
    const tag = event.target.tagName;
    if (tag === "INPUT" || tag === "SELECT" || (tag === "BUTTON" && event.code === "Space")) event.stopPropagation();
  });
  // A button that was clicked does not keep the keys.
  dock.addEventListener("click", (event) => event.detail > 0 && event.target.closest("button")?.blur());
  grip.addEventListener("pointerdown", (event) => grip.setPointerCapture(event.pointerId));
  grip.addEventListener("pointermove", (event) => {
    if (!grip.hasPointerCapture(event.pointerId)) return;
    document.documentElement.style.setProperty("--dock-wanted", `${Math.max(90, innerHeight - event.clientY)}px`);
  });

  connect();
})();
