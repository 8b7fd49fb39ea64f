// The report's charts, of the data that lie in the page.
(() => {
  const { bounds, bands, charts } = JSON.parse(document.getElementById("flown").textContent);
  const stack = new GoshawkCharts(document.getElementById("charts"), { bounds, bands, ink: "var(--soft)", grid: "var(--grid)" });
  for (const { title, lines } of charts) stack.lines(stack.add([], title), lines);
  window.goshawkReport = stack; // for tests, and for who looks closer
})();
