"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const LEVELS = 65534, GAP = 65535;
  const { start, step, count } = data.grid;
  const time = Float64Array.from({ length: count }, (_, i) => start + i * step);
  const charts = [];
  let zooming = false;

  // 16 bits a value between the smallest and the largest; an empty text is a constant.
  function unpack(series) {
    const values = new Array(count);
    if (!series.data) return values.fill(series.low);
    const text = atob(series.data), unit = (series.high - series.low) / LEVELS;
    for (let i = 0; i < count; i++) {
      const level = text.charCodeAt(2 * i) | (text.charCodeAt(2 * i + 1) << 8);
      values[i] = level === GAP ? null : level === LEVELS ? series.high : series.low + level * unit;
    }
    return values;
  }

  const shown = (value) => (value == null ? "" : String(Number(value.toPrecision(5))));

  // Values that rest are not blown up to show their last digits.
  function range(_, low, high) {
    if (low == null) return [0, 1];
    const size = Math.max(Math.abs(low), Math.abs(high)), span = high - low;
    if (span <= 1e-6 * size || size < 1e-12) {
      const half = size < 1e-12 ? 1 : 0.1 * size;
      return [low - half, high + half];
    }
    return [low - 0.07 * span, high + 0.07 * span];
  }

  function zoomAll(source, key) {
    if (key !== "x" || zooming) return;
    zooming = true;
    const { min, max } = source.scales.x;
    for (const chart of charts) {
      const other = chart.scales.x;
      if (chart !== source && (other.min !== min || other.max !== max)) chart.setScale("x", { min, max });
    }
    zooming = false;
  }

  function height(width) { return width < 420 ? 190 : 220; }

  function draw(body, plot) {
    const width = body.clientWidth;
    const options = {
      width, height: height(width),
      cursor: { sync: { key: "time", setSeries: false }, drag: { x: true, y: false }, points: { size: 5 } },
      scales: { x: { time: false }, y: { range } },
      axes: [
        { label: "time (s)", labelSize: 18, size: 34, grid: { stroke: "#eee" }, ticks: { stroke: "#ccc", size: 4 },
          font: "11px system-ui, sans-serif", labelFont: "11px system-ui, sans-serif", stroke: "#555" },
        { size: 56, grid: { stroke: "#eee" }, ticks: { stroke: "#ccc", size: 4 }, font: "11px system-ui, sans-serif",
          stroke: "#555", values: (_, splits) => splits.map((v) => (v == null ? "" : String(Number(v.toPrecision(6))))) },
      ],
      series: [
        { label: "time", value: (_, v) => (v == null ? "" : v.toFixed(3) + " s") },
        ...plot.series.map((s) => ({
          label: s.label, stroke: s.colour, width: s.width, dash: s.dash.length ? s.dash : undefined,
          points: { show: false }, spanGaps: false,
          value: (_, v) => (v == null ? "" : shown(v) + " " + s.unit),
        })),
      ],
      hooks: { setScale: [zoomAll] },
    };
    const chart = new uPlot(options, [time, ...plot.series.map(unpack)], body);
    const other = charts.find((c) => c.scales.x.min != null);
    charts.push(chart);
    if (other) chart.setScale("x", { min: other.scales.x.min, max: other.scales.x.max });
    new ResizeObserver(() => {
      const now = body.clientWidth;
      if (now > 0 && Math.abs(now - chart.width) > 1) chart.setSize({ width: now, height: height(now) });
    }).observe(body);
  }

  // Plots are drawn when they come near the window: a robot of many joints has hundreds.
  const near = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting || entry.target.dataset.drawn || !entry.target.clientWidth) continue;
      entry.target.dataset.drawn = "1";
      near.unobserve(entry.target);
      draw(entry.target, entry.target.plot);
    }
  }, { rootMargin: "600px" });

  for (const part of document.querySelectorAll("details.joint")) {
    const plots = part.dataset.objects ? data.objects : data.joints[Number(part.dataset.joint)].plots;
    const place = part.querySelector(".plots");
    for (const plot of plots) {
      const box = document.createElement("div"), head = document.createElement("h3"), body = document.createElement("div");
      box.className = "plot";
      body.className = "body";
      head.textContent = plot.title + " ";
      if (plot.unit) {
        const unit = document.createElement("span");
        unit.className = "unit";
        unit.textContent = "(" + plot.unit + ")";
        head.append(unit);
      }
      body.plot = plot;
      box.append(head, body);
      place.append(box);
      near.observe(body);
    }
  }
  window.asrsimCharts = charts;
})();
