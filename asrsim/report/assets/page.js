"use strict";
// The plots of a page. A plot without points of its own is drawn over the page's grid of times.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const LEVELS = 65534, GAP = 65535, TALL = 225;
  // Size at which a plot is drawn for paper, where two of them stand side by side.
  const PAPER = { width: 480, height: 225 };
  const charts = [];
  const several = data.runs.length > 1;
  let zooming = false;

  // 16 bits a value between the smallest and the largest; an empty text is a constant. A logarithmic series has powers of ten.
  function unpack(series, count) {
    const values = new Array(count);
    const back = series.log ? (v) => 10 ** v : (v) => v;
    if (!series.data) return values.fill(back(series.low));
    const text = atob(series.data), unit = (series.high - series.low) / LEVELS;
    for (let i = 0; i < count; i++) {
      const level = text.charCodeAt(2 * i) | (text.charCodeAt(2 * i + 1) << 8);
      values[i] = level === GAP ? null : back(level === LEVELS ? series.high : series.low + level * unit);
    }
    return values;
  }

  const grid = data.grid && (({ start, step, count, margin }) => {
    const values = Float64Array.from({ length: count }, (_, i) => start + i * step);
    return { values, first: start - margin, last: values[count - 1] + margin };
  })(data.grid);

  function pointsOf(plot) {
    if (!plot.x) return grid;
    const values = unpack(plot.x, plot.x.count);
    return { values, first: values[0], last: values[values.length - 1] };
  }

  // Digits that can be told apart in the plot: a thousandth of what it shows.
  function shown(value, chart) {
    const { min, max, distr } = chart.scales.y, span = max - min;
    if (!(span > 0) || distr === 3) return String(Number(value.toPrecision(4)));
    const decimals = Math.ceil(-Math.log10(span / 1000));
    return decimals > 6 ? value.toExponential(3) : value.toFixed(Math.max(decimals, 0)).replace(/^-(0(\.0*)?)$/, "$1");
  }

  // Very small and very large numbers would not fit beside the axis.
  function ticksText(splits) {
    const size = Math.max(...splits.map((v) => Math.abs(v ?? 0)));
    const far = size > 0 && (size < 2e-4 || size >= 1e5);
    return splits.map((v) => (v == null ? "" : v === 0 ? "0" : far ? v.toExponential(1) : String(Number(v.toPrecision(6)))));
  }
  // Powers of ten, and 2 and 5 of each in a narrow range.
  function powers(_, axis, min, max) {
    const low = Math.floor(Math.log10(min)), high = Math.ceil(Math.log10(max)), found = [];
    const every = Math.max(1, Math.ceil((high - low) / 6)), digits = high - low <= 2 ? [1, 2, 5] : [1];
    for (let power = low; power <= high; power += every) for (const digit of digits) found.push(digit * 10 ** power);
    return found.filter((v) => v >= min && v <= max);
  }
  const powersText = (_, splits) => splits.map((v) => (v == null ? "" : v < 1e-3 || v >= 1e5 ? v.toExponential(0) : String(Number(v.toPrecision(3)))));

  const logarithmicAxis = { splits: powers, filter: (_, splits) => splits, values: powersText };

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

  const byTime = (chart) => chart.across === "time";

  function zoomAll(source, key) {
    if (key !== "x" || zooming) return;
    zooming = true;
    const { min, max } = source.scales.x;
    for (const chart of charts) {
      const other = chart.scales.x;
      if (chart !== source && chart.across === source.across && (other.min !== min || other.max !== max)) chart.setScale("x", { min, max });
    }
    zooming = false;
  }

  const height = (width) => (width < 420 ? 190 : TALL);

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
    const named = [...new Set(chart.plot.series.map((s) => s.label))].length > 1 || !chart.plot.x;
    for (const s of chart.plot.series) {
      if (chart.entries.has(s.label) || !s.label) continue;
      const entry = document.createElement("button"), value = document.createElement("span");
      entry.type = "button";
      entry.style.setProperty("--colour", s.colour);
      const shared = several && s.run != null;
      if (shared || (named && s.dash.length)) {
        entry.className = "several";
        entry.append(dashPicture(s.dash, shared ? "currentColor" : s.colour, 24));
      } else if (!named) entry.className = "single";
      else if (s.kind === "points") entry.className = "points";
      entry.setAttribute("aria-pressed", "true");
      value.className = "value";
      entry.append(named ? s.label + " " : "", value);
      entry.addEventListener("click", () => {
        if (!chart.hidden.delete(s.label)) chart.hidden.add(s.label);
        entry.setAttribute("aria-pressed", String(!chart.hidden.has(s.label)));
        apply(chart);
      });
      legend.append(entry);
      chart.entries.set(s.label, value);
    }
    for (const label of new Set((chart.plot.bands ?? []).map((band) => band.label))) {
      const entry = document.createElement("span"), colour = chart.plot.bands.find((band) => band.label === label).colour;
      entry.className = "band";
      entry.style.setProperty("--colour", colour);
      entry.textContent = label;
      legend.append(entry);
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
    const unit = chart.plot.acrossUnit ?? "s";
    chart.clock.textContent = at == null ? chart.plot.note ?? "" : (byTime(chart) ? chart.data[0][at].toFixed(3) : String(Number(chart.data[0][at].toPrecision(4)))) + " " + unit;
    for (const [label, place] of chart.entries) {
      place.replaceChildren();
      if (at == null) continue;
      const values = [];
      chart.plot.series.forEach((s, i) => {
        if (s.label === label && chart.series[i + 1].show && chart.data[i + 1][at] != null) {
          const who = several && s.run != null ? data.runs[s.run].label + " " : "";
          values.push([who + shown(chart.data[i + 1][at], chart), s.colour]);
        }
      });
      const own = chart.plot.series.find((s) => s.label === label).unit || chart.plot.unit;
      values.forEach(([text, colour], i) => {
        const one = document.createElement("span");
        one.textContent = (i ? " | " : "") + text;
        if (several) one.style.color = colour;
        place.append(one);
      });
      if (values.length && own) place.append(" " + own);
    }
    // A cursor that a hand moves moves the time of the whole page.
    if (byTime(chart) && chart.cursor.event && at != null) asrsimClock.set(chart.data[0][at], chart);
  }

  // The time of the moving view, in every plot over time.
  function mark(chart, time) {
    const { min, max } = chart.scales.x, there = time !== null && time >= min && time <= max;
    chart.now.hidden = !there;
    if (there) chart.now.style.transform = `translateX(${chart.valToPos(time, "x")}px)`;
  }

  function look(s) {
    const base = { label: s.label, stroke: s.colour, width: s.width, dash: s.dash.length ? s.dash : undefined, spanGaps: false, pxAlign: 0, show: !hiddenRuns.has(s.run) };
    if (s.kind === "points") return { ...base, paths: () => null, points: { show: true, size: 5, width: 0, fill: s.colour } };
    return { ...base, points: { show: s.kind === "both", size: 5, width: 0, fill: s.colour } };
  }

  function draw(body, plot) {
    const style = getComputedStyle(document.documentElement), ink = style.getPropertyValue("--soft"), line = style.getPropertyValue("--line");
    const width = body.clientWidth, points = pointsOf(plot), across = plot.across ?? "time", logarithmic = plot.logarithmic ?? "";
    const font = "11px system-ui, sans-serif", lines = { stroke: line, width: 1 }, ticks = { stroke: line, size: 4, width: 1 };
    const bands = plot.bands ?? [], n = plot.series.length, count = points.values.length;
    const unit = plot.acrossUnit ?? "s";
    // Points at the ends are seen whole.
    if (plot.series.some((s) => s.kind === "points" || s.kind === "both")) {
      const room = 0.02 * (points.last - points.first);
      Object.assign(points, { first: points.first - room, last: points.last + room });
    }
    // All of the time reaches from end to end, though points of thinned series stand within their intervals.
    const period = (_, low, high) => [low === points.values[0] ? points.first : low, high === points.values[count - 1] ? points.last : high];
    const xScale = logarithmic.includes("x") ? { time: false, distr: 3 } : { time: false, range: period };
    const yScale = logarithmic.includes("y") ? { distr: 3 } : { range: plot.span ? () => plot.span : range };
    const options = {
      width, height: height(width),
      legend: { show: false },
      padding: [8, logarithmic.includes("x") ? 18 : 10, 0, 0],
      cursor: { sync: { key: across, setSeries: false }, drag: { x: true, y: false }, points: { size: 5 } },
      scales: { x: xScale, y: yScale },
      axes: [
        { label: across + (unit ? ` (${unit})` : ""), labelSize: 16, labelGap: 0, size: 26, grid: lines, ticks, font, labelFont: font, stroke: ink, values: (_, splits) => ticksText(splits), ...(logarithmic.includes("x") ? logarithmicAxis : {}) },
        { size: 54, grid: lines, ticks, font, stroke: ink, values: (_, splits) => ticksText(splits), ...(logarithmic.includes("y") ? logarithmicAxis : {}) },
      ],
      series: [
        {}, ...plot.series.map(look),
        ...bands.flatMap(() => [0, 1].map(() => ({ width: 0, points: { show: false }, stroke: "transparent", spanGaps: false }))),
      ],
      bands: bands.map((band, i) => ({ series: [n + 1 + 2 * i, n + 2 + 2 * i], fill: band.colour })),
      hooks: { setScale: [zoomAll, (chart) => chart.now && mark(chart, asrsimClock.time)], setCursor: [(chart) => chart.entries && tell(chart)] },
    };
    const values = [points.values, ...plot.series.map((s) => unpack(s, count)), ...bands.flatMap((band) => [band.high, band.low].map((edge) => unpack(edge, count)))];
    const chart = new uPlot(options, values, body);
    Object.assign(chart, { plot, across, hidden: new Set(), clock: body.parentElement.querySelector(".time"), now: document.createElement("div") });
    chart.now.className = "now";
    chart.now.hidden = true;
    chart.over.append(chart.now);
    chart.clock.textContent = plot.note ?? "";
    makeLegend(chart, body.parentElement);
    const other = charts.find((c) => c.across === across && c.scales.x.min != null && !plot.x);
    charts.push(chart);
    if (other) chart.setScale("x", { min: other.scales.x.min, max: other.scales.x.max });
    if (byTime(chart)) {
      asrsimClock.listen(chart, (time) => mark(chart, time));
      mark(chart, asrsimClock.time);
    }
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

  function drawOnce(body) {
    if (body.dataset.drawn || !body.clientWidth) return;
    body.dataset.drawn = "1";
    draw(body, body.plot);
  }

  for (const part of document.querySelectorAll("[data-group]")) {
    const place = part.querySelector(".plots");
    for (const plot of data.groups[Number(part.dataset.group)].plots) {
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
    }
    part.addEventListener("toggle", () => part.querySelectorAll(".body").forEach(drawOnce));
  }
  // What the first windows show is drawn at once; the rest follows, while nothing else is to be done.
  const bodies = [...document.querySelectorAll(".plot .body")];
  bodies.slice(0, 24).forEach(drawOnce);
  const idle = window.requestIdleCallback ?? ((work) => setTimeout(work, 50));
  function drawNext() {
    const next = bodies.find((body) => !body.dataset.drawn && body.clientWidth);
    if (!next) return;
    drawOnce(next);
    idle(drawNext);
  }
  idle(drawNext);
  // Paper shows all that is folded on the screen.
  window.addEventListener("beforeprint", () => {
    for (const part of document.querySelectorAll("details.joint:not([open])")) part.open = true;
    bodies.forEach(drawOnce);
    charts.forEach((chart) => chart.setSize(PAPER));
  });
  window.addEventListener("afterprint", () => {
    for (const chart of charts) {
      const width = chart.root.parentElement.clientWidth;
      if (width) chart.setSize({ width, height: height(width) });
    }
  });
  window.asrsimCharts = charts;
})();
