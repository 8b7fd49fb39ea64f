// Charts over one axis of time: a drag zooms all of them, a click seeks, and each line's value stands in its legend.
//
//   const stack = new GoshawkCharts(host, { bounds: [0, 60], ask, seek, ink, grid, bands });
//   const chart = stack.add(["speed"]);          // asks for its lines, if `ask` is given
//   stack.lines(chart, [{ key, label, unit, color, dashed, t: [...], v: [...] }]);
//   stack.now(12.5, { "0/speed": 4.2 });         // where the playhead stands, and the values there
//
// A colour may be a CSS variable, "var(--vehicle)": it follows the reader's theme.
class GoshawkCharts {
  static LEFT = 52; // px of an axis
  static LEAST_S = 0.02; // of a window

  constructor(host, options) {
    Object.assign(this, { host, bounds: [0, 1], bands: [], height: 128 }, options);
    this.window = [...this.bounds];
    this.charts = [];
    this.asked = 0;
    this.nowS = null;
    this.values = {};
    this.sync = uPlot.sync(`goshawk-${(GoshawkCharts.made = (GoshawkCharts.made || 0) + 1)}`);
    new ResizeObserver(() => this.resize()).observe(host);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
  }

  // ---- charts ----

  add(signals, title = "", first = false) {
    const element = document.createElement("section");
    element.className = "gk-chart";
    element.innerHTML = '<div class="gk-plot"></div><div class="gk-legend"></div>';
    const chart = { element, title, signals: [...signals], lines: [], hidden: new Set(), plot: null, number: 0 };
    if (first) this.charts.unshift(chart);
    else this.charts.push(chart);
    this.host[first ? "prepend" : "append"](element);
    this.request(chart);
    return chart;
  }

  drop(chart) {
    chart.plot?.destroy();
    chart.element.remove();
    this.charts = this.charts.filter((other) => other !== chart);
    this.align();
  }

  clear() {
    for (const chart of [...this.charts]) this.drop(chart);
  }

  // What was asked for. A chart keeps its plot while its lines are the same ones.
  lines(chart, lines) {
    const key = (some) => some.map((line) => `${line.key} ${line.unit} ${line.color}`).join("|");
    const same = chart.plot && key(lines) === key(chart.lines);
    chart.lines = lines;
    chart.asked = true;
    if (same) {
      chart.plot.setData(this.joined(chart), false);
      this.scale(chart);
    } else this.build(chart);
    this.legend(chart);
  }

  joined(chart) {
    if (!chart.lines.length) return [[]];
    return uPlot.join(chart.lines.map((line) => [line.t, line.v]));
  }

  units(chart) {
    return [...new Set(chart.lines.map((line) => line.unit))];
  }

  // ---- the window of time that all charts share ----

  zoom(fromS, toS) {
    const [first, last] = this.bounds;
    const wide = Math.min(Math.max(toS - fromS, GoshawkCharts.LEAST_S), last - first);
    const from = Math.min(Math.max(fromS, first), last - wide);
    this.window = [from, from + wide];
    for (const chart of this.charts) if (chart.plot) this.scale(chart);
    this.place();
    this.onzoom?.(...this.window);
    clearTimeout(this.soon);
    this.soon = setTimeout(() => this.charts.forEach((chart) => this.request(chart)), 80);
  }

  whole() {
    this.zoom(...this.bounds);
  }

  request(chart) {
    if (!this.ask) return;
    chart.number = ++this.asked;
    const columns = Math.max(100, Math.round(this.host.clientWidth));
    this.ask(chart, chart.number, this.window[0], this.window[1], columns);
  }

  scale(chart) {
    chart.plot.batch(() => {
      chart.plot.setScale("x", { min: this.window[0], max: this.window[1] });
      for (const unit of this.units(chart)) chart.plot.setScale(`y ${unit}`, this.range(chart, unit));
    });
  }

  // Of what is seen; with zero where that costs little room.
  range(chart, unit) {
    let low = Infinity;
    let high = -Infinity;
    for (const line of chart.lines) {
      if (line.unit !== unit || chart.hidden.has(line.key)) continue;
      for (let k = 0; k < line.t.length; k++) {
        const v = line.v[k];
        if (v == null || line.t[k] < this.window[0] || line.t[k] > this.window[1]) continue;
        if (v < low) low = v;
        if (v > high) high = v;
      }
    }
    if (low > high) return { min: 0, max: 1 };
    if (low > 0 && low < 0.6 * high) low = 0;
    if (high < 0 && high > 0.6 * low) high = 0;
    const room = 0.06 * (high - low) || 0.05 * Math.abs(high) || 1;
    return { min: low === 0 ? 0 : low - room, max: high === 0 ? 0 : high + room };
  }

  // ---- drawing ----

  color(text) {
    const name = /^var\((--[\w-]+)\)$/.exec(text);
    return name ? getComputedStyle(document.documentElement).getPropertyValue(name[1]).trim() : text;
  }

  build(chart) {
    chart.plot?.destroy();
    const host = chart.element.firstElementChild;
    const units = this.units(chart);
    chart.right = Math.max(units.length - 1, 0);
    const ink = () => this.color(this.ink || "#8b95a5");
    const grid = () => this.color(this.grid || "#262d38");
    const scales = { x: { time: false, auto: false, min: this.window[0], max: this.window[1] } };
    for (const unit of units) scales[`y ${unit}`] = { auto: false, ...this.range(chart, unit) };
    const axes = [
      {
        stroke: ink, grid: { stroke: grid, width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif",
        size: 20, gap: 3, values: (_, ticks) => ticks.map((t) => `${+t.toFixed(3)} s`),
      },
      ...units.map((unit, k) => ({
        scale: `y ${unit}`, side: k === 0 ? 3 : 1, stroke: ink, size: GoshawkCharts.LEFT, gap: 4, space: 24,
        grid: { show: k === 0, stroke: grid, width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif",
      })),
    ];
    const series = chart.lines.map((line) => ({
      label: line.label, scale: `y ${line.unit}`, stroke: () => this.color(line.color), width: 1.4,
      dash: line.dashed ? [5, 4] : undefined, points: { show: false }, show: !chart.hidden.has(line.key),
    }));
    chart.plot = new uPlot(
      {
        width: Math.max(host.clientWidth, 50), height: this.height, padding: [8, 8, 0, 0],
        legend: { show: false }, scales, axes, series: [{}, ...series],
        cursor: {
          sync: { key: this.sync.key, scales: ["x", null], setSeries: false },
          drag: { x: true, y: false, setScale: false },
          points: { size: 6 },
          dataIdx: (plot, k, nearest) => this.nearest(plot, k, nearest),
          bind: {
            dblclick: () => () => this.whole(),
            mousedown: (_, __, handle) => (event) => (event.shiftKey && this.seek ? null : handle(event)),
          },
        },
        hooks: {
          drawClear: [(plot) => this.shade(plot)],
          setCursor: [() => this.value(chart)],
          setSelect: [(plot) => this.selected(plot)],
        },
      },
      this.joined(chart),
      host,
    );
    this.listen(chart);
    this.align();
  }

  // Of lines with other times: the nearest sample of this one, if it is near.
  nearest(plot, k, index) {
    const values = plot.data[k];
    for (let away = 0; away < 200; away++) {
      if (values[index - away] != null) return index - away;
      if (values[index + away] != null) return index + away;
    }
    return index;
  }

  selected(plot) {
    const { left, width } = plot.select;
    if (width < 4) return;
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    if (plot !== this.held) return; // the other charts hear of the same drag
    this.zoom(plot.posToVal(left, "x"), plot.posToVal(left + width, "x"));
  }

  listen(chart) {
    const over = chart.plot.over;
    const now = document.createElement("div");
    now.className = "gk-now";
    over.append(now);
    const time = (event) => chart.plot.posToVal(event.clientX - over.getBoundingClientRect().left, "x");
    let down = null;
    over.addEventListener("pointerdown", (event) => {
      down = event.button === 0 ? { x: event.clientX, scrubs: event.shiftKey } : null;
      this.held = chart.plot;
      if (down?.scrubs) over.setPointerCapture(event.pointerId);
    });
    over.addEventListener("pointermove", (event) => down?.scrubs && this.seek?.(time(event), true));
    over.addEventListener("pointerup", (event) => {
      if (down && (down.scrubs || Math.abs(event.clientX - down.x) < 4)) this.seek?.(time(event), false);
      down = null;
    });
    over.addEventListener(
      "wheel",
      (event) => {
        if (!event.ctrlKey && !event.altKey) return;
        event.preventDefault();
        const [from, to] = this.window;
        const at = time(event);
        const by = Math.exp(event.deltaY * 0.002);
        this.zoom(at - (at - from) * by, at + (to - at) * by);
      },
      { passive: false },
    );
  }

  shade(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    for (const band of this.bands) {
      const left = Math.max(plot.valToPos(band.from_s, "x", true), bbox.left);
      const right = Math.min(plot.valToPos(band.to_s, "x", true), bbox.left + bbox.width);
      if (right <= left) continue;
      ctx.globalAlpha = 0.09;
      ctx.fillStyle = this.color(band.color);
      ctx.fillRect(left, bbox.top, right - left, bbox.height);
    }
    ctx.restore();
  }

  // All plots are as wide as each other, however many axes they have.
  align() {
    const most = Math.max(0, ...this.charts.map((chart) => chart.right || 0));
    for (const chart of this.charts) {
      if (!chart.plot) continue;
      const right = 8 + GoshawkCharts.LEFT * (most - (chart.right || 0));
      chart.plot.padding[1] = () => right;
      this.fit(chart);
      this.scale(chart);
    }
    this.place();
  }

  fit(chart) {
    const width = chart.element.firstElementChild.clientWidth;
    if (width > 50) chart.plot.setSize({ width, height: this.height });
  }

  resize() {
    for (const chart of this.charts) if (chart.plot) this.fit(chart);
    this.place();
  }

  redraw() {
    for (const chart of this.charts) chart.plot?.redraw(false);
    for (const chart of this.charts) this.legend(chart);
  }

  // ---- playhead and legend ----

  now(timeS, values) {
    this.nowS = timeS;
    this.values = values;
    this.place();
    for (const chart of this.charts) this.value(chart);
  }

  place() {
    for (const { plot } of this.charts) {
      const mark = plot?.over.querySelector(".gk-now");
      if (!mark) continue;
      const shown = this.nowS !== null && this.nowS >= this.window[0] && this.nowS <= this.window[1];
      mark.style.display = shown ? "" : "none";
      if (shown) mark.style.transform = `translateX(${plot.valToPos(this.nowS, "x")}px)`;
    }
    const first = this.charts.find((chart) => chart.plot);
    if (first) this.onplace?.(first.plot.over.getBoundingClientRect());
  }

  legend(chart) {
    const box = chart.element.lastElementChild;
    box.replaceChildren();
    if (chart.title) box.append(Object.assign(document.createElement("b"), { textContent: chart.title }));
    for (const line of chart.lines) {
      const row = document.createElement("div");
      row.className = "gk-line";
      row.dataset.line = line.key;
      row.dataset.hidden = chart.hidden.has(line.key);
      const show = document.createElement("button");
      show.title = "show or hide";
      const swatch = document.createElement("i");
      swatch.style.borderTop = `3px ${line.dashed ? "dotted" : "solid"} ${line.color}`;
      const name = Object.assign(document.createElement("span"), { textContent: line.name || line.label });
      name.title = name.textContent;
      show.append(swatch, name);
      show.onclick = () => this.toggle(chart, line.key);
      row.append(show, document.createElement("output"));
      if (this.remove) {
        const gone = Object.assign(document.createElement("button"), { textContent: "×", title: "take it away" });
        gone.className = "gk-gone";
        gone.setAttribute("aria-label", `take away ${line.label}`);
        gone.onclick = () => this.remove(chart, line.label);
        row.append(gone);
      }
      box.append(row);
    }
    if (chart.asked && !chart.lines.some((line) => line.t.length))
      box.append(Object.assign(document.createElement("small"), { textContent: "nothing in this window" }));
    this.value(chart);
  }

  toggle(chart, key) {
    if (!chart.hidden.delete(key)) chart.hidden.add(key);
    chart.lines.forEach((line, k) => chart.plot.setSeries(k + 1, { show: !chart.hidden.has(line.key) }));
    this.scale(chart);
    this.legend(chart);
  }

  // Under the mouse, else at the playhead.
  value(chart) {
    const plot = chart.plot;
    if (!plot) return;
    const hovered = plot.cursor.left >= 0;
    const rows = chart.element.lastElementChild.querySelectorAll("output");
    chart.lines.forEach((line, k) => {
      const v = hovered ? plot.data[k + 1]?.[plot.cursor.idxs?.[k + 1]] : this.values[line.key];
      if (rows[k]) rows[k].textContent = v == null ? line.unit : `${GoshawkCharts.digits(v)} ${line.unit}`;
    });
  }

  static digits(v) {
    const size = Math.abs(v);
    if (Number.isInteger(v) || size >= 1e4) return v.toFixed(0);
    return v.toFixed(size >= 100 ? 1 : size >= 0.1 ? 2 : 3).replace("-", "−");
  }
}
