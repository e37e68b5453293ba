// Parallel coordinates of a study: a line a run; drag on an axis to keep a range, click a line to see its run.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const floats = text => new Float64Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
  const axes = data.axes.map(axis => ({...axis, values: floats(axis.values), range: null}));
  const runs = floats(data.runs), count = runs.length;
  const canvas = document.getElementById("lines"), draw = canvas.getContext("2d");
  const left = 24, right = 24, top = 46, bottom = 24;
  let width, height, chosen = -1, drag = null;
  for (const axis of axes) {
    const there = axis.values.filter(Number.isFinite);
    axis.low = there.reduce((a, b) => Math.min(a, b), Infinity);
    axis.high = there.reduce((a, b) => Math.max(a, b), -Infinity);
    if (!(axis.high > axis.low)) { axis.low -= 0.5; axis.high += 0.5; }
  }
  const colour = axes[axes.length - 1];
  const x = i => left + (width - left - right) * (axes.length > 1 ? i / (axes.length - 1) : 0.5);
  // A run that lacks a result goes to the bottom edge.
  const y = (axis, value) => Number.isFinite(value)
    ? height - bottom - (height - top - bottom) * (value - axis.low) / (axis.high - axis.low) : height - bottom + 12;
  const value = (axis, place) => axis.low + (height - bottom - place) / (height - top - bottom) * (axis.high - axis.low);
  const kept = run => axes.every(a => !a.range || (a.values[run] >= a.range[0] && a.values[run] <= a.range[1]));
  function line(run) {
    draw.beginPath();
    axes.forEach((axis, i) => draw[i ? "lineTo" : "moveTo"](x(i), y(axis, axis.values[run])));
    draw.stroke();
  }
  function paint() {
    const scale = window.devicePixelRatio || 1;
    width = canvas.clientWidth; height = canvas.clientHeight;
    canvas.width = width * scale; canvas.height = height * scale;
    draw.setTransform(scale, 0, 0, scale, 0, 0);
    draw.clearRect(0, 0, width, height);
    draw.lineWidth = 1;
    let shown = 0;
    for (let run = 0; run < count; run++) {
      if (!kept(run)) continue;
      shown++;
      const t = (colour.values[run] - colour.low) / (colour.high - colour.low);
      draw.strokeStyle = Number.isFinite(t) ? `hsla(${220 - 200 * t}, 75%, 45%, ${count > 800 ? 0.18 : 0.4})` : "rgba(120,120,120,0.4)";
      line(run);
    }
    if (chosen >= 0) { draw.strokeStyle = "#000"; draw.lineWidth = 2.5; line(chosen); }
    draw.font = "11px sans-serif"; draw.textAlign = "center"; draw.lineWidth = 1;
    axes.forEach((axis, i) => {
      draw.strokeStyle = "#555"; draw.fillStyle = "#222";
      draw.beginPath(); draw.moveTo(x(i), top); draw.lineTo(x(i), height - bottom); draw.stroke();
      // The outer ones stand inwards, so that nothing is cut off.
      draw.textAlign = i === 0 ? "left" : i === axes.length - 1 ? "right" : "center";
      const edge = i === 0 ? 2 : i === axes.length - 1 ? width - 2 : x(i);
      draw.fillText(axis.name, edge, i % 2 ? 12 : 26, 1.8 * (width - left - right) / axes.length);
      draw.fillText(axis.high.toPrecision(4), edge, top - 4);
      draw.fillText(axis.low.toPrecision(4), edge, height - 8);
      if (axis.range) {
        draw.fillStyle = "rgba(0,114,178,0.25)";
        const a = y(axis, axis.range[1]), b = y(axis, axis.range[0]);
        draw.fillRect(x(i) - 8, a, 16, b - a);
      }
    });
    document.getElementById("shown").textContent = `${shown} of ${count} lines`;
  }
  const place = event => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
  canvas.addEventListener("mousedown", event => {
    const [px, py] = place(event);
    const i = axes.findIndex((_, i) => Math.abs(x(i) - px) < 10);
    drag = i < 0 ? null : {axis: axes[i], from: py};
    if (i < 0) choose(px, py);
  });
  canvas.addEventListener("mousemove", event => {
    if (!drag) return;
    const ends = [value(drag.axis, place(event)[1]), value(drag.axis, drag.from)].sort((a, b) => a - b);
    drag.axis.range = ends;
    paint();
  });
  window.addEventListener("mouseup", event => {
    if (drag && Math.abs(place(event)[1] - drag.from) < 4) { drag.axis.range = null; paint(); }
    drag = null;
  });
  function choose(px, py) {
    let best = 12; chosen = -1;
    for (let run = 0; run < count; run++) {
      if (!kept(run)) continue;
      for (let i = 0; i + 1 < axes.length; i++) {
        if (px < x(i) || px > x(i + 1)) continue;
        const t = (px - x(i)) / (x(i + 1) - x(i));
        const at = (1 - t) * y(axes[i], axes[i].values[run]) + t * y(axes[i + 1], axes[i + 1].values[run]);
        if (Math.abs(at - py) < best) { best = Math.abs(at - py); chosen = run; }
      }
    }
    const box = document.getElementById("chosen");
    box.textContent = "";
    if (chosen >= 0) {
      const number = runs[chosen];
      const add = (tag, text) => { const e = document.createElement(tag); e.textContent = text; box.appendChild(e); };
      add("p", `Run ${number}: ` + axes.map(a => `${a.name} = ${a.values[chosen].toPrecision(6)}`).join(", "));
      add("p", "Do it again, with a log:");
      add("pre", `${data.again} --run ${number}`);
    }
    paint();
  }
  window.addEventListener("resize", paint);
  document.getElementById("all").addEventListener("click", () => { axes.forEach(a => { a.range = null; }); chosen = -1; paint(); });
  paint();
})();
