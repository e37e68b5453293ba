"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const LEVELS = 65534, GAP = 65535;
  const { start, step, count, margin } = data.grid;
  const time = Float64Array.from({ length: count }, (_, i) => start + i * step);
  const first = start - margin, last = time[count - 1] + margin;
  const charts = [];
  const several = data.runs.length > 1;
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

  // Digits that can be told apart in the plot: a thousandth of what it shows.
  function shown(value, chart) {
    const { min, max } = chart.scales.y, span = max - min;
    if (!(span > 0)) return String(Number(value.toPrecision(4)));
    const decimals = Math.ceil(-Math.log10(span / 1000));
    return decimals > 6 ? value.toExponential(3) : value.toFixed(Math.max(decimals, 0)).replace(/^-(0(\.0*)?)$/, "$1");
  }

  // Very small and very large numbers would not fit beside the axis.
  function ticksText(splits) {
    const size = Math.max(...splits.map((v) => Math.abs(v ?? 0)));
    const far = size > 0 && (size < 2e-3 || size >= 1e5);
    return splits.map((v) => (v == null ? "" : v === 0 ? "0" : far ? v.toExponential(1) : String(Number(v.toPrecision(6)))));
  }

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

  // All of the time reaches from end to end, though points of thinned series stand within their intervals.
  function period(_, low, high) {
    return [low === time[0] ? first : low, high === time[count - 1] ? last : high];
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

  function height(width) { return width < 420 ? 190 : 225; }

  // What is hidden, by run and in each plot by name.
  const hiddenRuns = new Set();

  function apply(chart) {
    chart.batch(() => chart.plot.series.forEach((s, i) => {
      const show = !chart.hidden.has(s.label) && !hiddenRuns.has(s.run);
      if (chart.series[i + 1].show !== show) chart.setSeries(i + 1, { show }, false);
    }));
  }

  // One entry a quantity; under the cursor the values of all runs that are shown.
  function makeLegend(chart, box) {
    const legend = document.createElement("div");
    legend.className = "legend";
    chart.entries = new Map();
    for (const s of chart.plot.series) {
      if (chart.entries.has(s.label)) continue;
      const entry = document.createElement("button"), value = document.createElement("span");
      entry.type = "button";
      entry.style.setProperty("--colour", s.colour);
      if (several && s.run != null) {
        entry.className = "several";
        entry.append(dashPicture(s.dash, "#1a1a1a", 24));
      }
      entry.setAttribute("aria-pressed", "true");
      value.className = "value";
      entry.append(s.label + " ", value);
      entry.addEventListener("click", () => {
        if (!chart.hidden.delete(s.label)) chart.hidden.add(s.label);
        entry.setAttribute("aria-pressed", String(!chart.hidden.has(s.label)));
        apply(chart);
      });
      legend.append(entry);
      chart.entries.set(s.label, value);
    }
    box.append(legend);
  }

  function dashPicture(dash, colour, width) {
    const space = "http://www.w3.org/2000/svg";
    const picture = document.createElementNS(space, "svg"), line = document.createElementNS(space, "line");
    picture.setAttribute("class", "dash");
    picture.setAttribute("width", String(width));
    picture.setAttribute("height", "6");
    for (const [key, value] of Object.entries({ x1: 0, y1: 3, x2: width, y2: 3, stroke: colour, "stroke-width": 2 })) line.setAttribute(key, value);
    line.setAttribute("stroke-dasharray", dash.join(" "));
    picture.append(line);
    return picture;
  }

  function tell(chart) {
    const at = chart.cursor.idx;
    chart.clock.textContent = at == null ? "" : chart.data[0][at].toFixed(3) + " s";
    for (const [label, place] of chart.entries) {
      place.replaceChildren();
      if (at != null) {
        const values = [];
        chart.plot.series.forEach((s, i) => {
          if (s.label === label && chart.series[i + 1].show && chart.data[i + 1][at] != null) {
            const who = several && s.run != null ? data.runs[s.run].label + " " : "";
            values.push([who + shown(chart.data[i + 1][at], chart), s.colour]);
          }
        });
        const unit = chart.plot.series.find((s) => s.label === label).unit;
        values.forEach(([text, colour], i) => {
          const one = document.createElement("span");
          one.textContent = (i ? " | " : "") + text;
          if (several) one.style.color = colour;
          place.append(one);
        });
        if (values.length && unit) place.append(" " + unit);
      }
    }
  }

  function draw(body, plot) {
    const width = body.clientWidth;
    const font = "11px system-ui, sans-serif", grid = { stroke: "#eee", width: 1 }, ticks = { stroke: "#ccc", size: 4, width: 1 };
    const options = {
      width, height: height(width),
      legend: { show: false },
      padding: [8, 10, 0, 0],
      cursor: { sync: { key: "time", setSeries: false }, drag: { x: true, y: false }, points: { size: 5 } },
      scales: { x: { time: false, range: period }, y: { range } },
      axes: [
        { label: "time (s)", labelSize: 16, labelGap: 0, size: 26, grid, ticks, font, labelFont: font, stroke: "#555" },
        { size: 54, grid, ticks, font, stroke: "#555",
          values: (_, splits) => ticksText(splits) },
      ],
      series: [
        {},
        ...plot.series.map((s) => ({
          label: s.label, stroke: s.colour, width: s.width, dash: s.dash.length ? s.dash : undefined,
          points: { show: false }, spanGaps: false, show: !hiddenRuns.has(s.run),
        })),
      ],
      hooks: { setScale: [zoomAll], setCursor: [(chart) => chart.entries && tell(chart)] },
    };
    const chart = new uPlot(options, [time, ...plot.series.map(unpack)], body);
    chart.plot = plot;
    chart.hidden = new Set();
    chart.clock = body.parentElement.querySelector(".time");
    makeLegend(chart, body.parentElement);
    const other = charts.find((c) => c.scales.x.min != null);
    charts.push(chart);
    if (other) chart.setScale("x", { min: other.scales.x.min, max: other.scales.x.max });
    new ResizeObserver(() => {
      const now = body.clientWidth;
      if (now > 0 && Math.abs(now - chart.width) > 1) chart.setSize({ width: now, height: height(now) });
    }).observe(body);
  }

  const bar = document.getElementById("runs");
  if (bar) data.runs.forEach((run, number) => {
    const button = document.createElement("button");
    button.type = "button";
    button.setAttribute("aria-pressed", "true");
    button.append(dashPicture([], run.colour, 34), run.label);
    button.addEventListener("click", () => {
      if (!hiddenRuns.delete(number)) hiddenRuns.add(number);
      button.setAttribute("aria-pressed", String(!hiddenRuns.has(number)));
      charts.forEach(apply);
    });
    bar.append(button);
  });

  // Plots are drawn when they come near the window: a robot of many joints has hundreds.
  const near = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting) drawOnce(entry.target);
  }, { rootMargin: "600px" });

  function drawOnce(body) {
    if (body.dataset.drawn || !body.clientWidth) return;
    body.dataset.drawn = "1";
    near.unobserve(body);
    draw(body, body.plot);
  }

  // On paper nothing comes near.
  window.addEventListener("beforeprint", () => document.querySelectorAll(".plot .body").forEach(drawOnce));

  for (const part of document.querySelectorAll("details.joint")) {
    const plots = data.joints[Number(part.dataset.joint)].plots;
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
      const clock = document.createElement("span");
      clock.className = "time";
      head.append(clock);
      body.plot = plot;
      box.append(head, body);
      place.append(box);
      near.observe(body);
    }
  }
  // The others follow while nothing else is to be done, for those who take a picture of the whole page.
  const bodies = [...document.querySelectorAll(".plot .body")];
  const idle = window.requestIdleCallback ?? ((work) => setTimeout(work, 50));
  function drawNext() {
    const next = bodies.find((body) => !body.dataset.drawn && body.clientWidth);
    if (!next) return;
    drawOnce(next);
    idle(drawNext);
  }
  idle(drawNext);
  window.asrsimCharts = charts;
})();
