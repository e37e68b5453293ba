"use strict";
// The moving view: links and objects in WebGL, placed by their logged poses.
(() => {
  const place = document.getElementById("motion");
  const text = document.getElementById("motion-data");
  if (!place || !text) return;
  const data = JSON.parse(text.textContent);
  const canvas = place.querySelector("canvas");
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
  if (!gl) {
    const words = document.createElement("p");
    words.className = "bad";
    words.textContent = "The moving robot needs WebGL 2, which this browser lacks or has switched off: switch hardware acceleration on, or take a newer browser.";
    place.replaceChildren(words);
    return;
  }

  // 4x4 matrices, row by row.
  const multiply = (a, b) => {
    const c = new Array(16).fill(0);
    for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) for (let k = 0; k < 4; k++) c[4 * i + j] += a[4 * i + k] * b[4 * k + j];
    return c;
  };
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const minus = (a, b) => a.map((v, i) => v - b[i]);
  const unit = (a) => { const l = Math.hypot(...a) || 1; return a.map((v) => v / l); };

  function poseMatrix([px, py, pz, ...quaternion]) {
    const l = Math.hypot(...quaternion) || 1, [x, y, z, w] = quaternion.map((v) => v / l);
    return [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), px,
      2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), py,
      2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), pz, 0, 0, 0, 1];
  }

  function unpack(series, count) {
    if (!series.data) return new Float64Array(count).fill(series.low);
    const levels = new Uint16Array(Uint8Array.from(atob(series.data), (c) => c.charCodeAt(0)).buffer);
    return Float64Array.from(levels, (level) => series.low + (level / 65534) * (series.high - series.low));
  }
  const runs = data.runs.map((run) => {
    const time = unpack(run.time, run.count);
    const unpacked = ({ name, parent, pose }) => [name, { parent, pose: pose.map((series) => unpack(series, run.count)) }];
    const bodies = new Map(run.bodies.map(unpacked));
    return { ...run, time, bodies, start: time[0], end: time[run.count - 1] };
  });
  let run = runs[0];

  // Frame of each body in the world.
  function frames(time) {
    const after = run.time.findIndex((t) => t > time), last = run.count - 1;
    const j = after < 0 ? last : after, i = Math.max(j - 1, 0);
    const share = Math.min(Math.max((time - run.time[i]) / (run.time[j] - run.time[i] || 1), 0), 1);
    const found = new Map();
    // A file may list a body before its parent.
    function frame(name) {
      if (!found.has(name)) {
        const { parent, pose } = run.bodies.get(name);
        const local = poseMatrix(pose.map((series) => series[i] + share * (series[j] - series[i])));
        found.set(name, parent === null ? local : multiply(frame(parent), local));
      }
      return found.get(name);
    }
    for (const name of run.bodies.keys()) frame(name);
    return found;
  }

  function program(vertex, fragment) {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, "#version 300 es\nprecision highp float;\n" + source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    return made;
  }
  // Light as on the film strip: a lamp behind the camera, a weaker one from the other side; the side that faces the camera is lit.
  const solid = program(
    "in vec3 point, normal; uniform mat4 model, view; out vec3 place, facing;\n" +
    "void main() { vec4 p = model * vec4(point, 1.0); place = p.xyz; facing = mat3(model) * normal; gl_Position = view * p; }",
    "in vec3 place, facing; uniform vec3 colour, eye, sun, fill; out vec4 shown;\n" +
    "void main() { vec3 n = normalize(facing);\n" +
    "if (dot(n, eye - place) < 0.0) n = -n;\n" +
    "float light = 0.46 + 0.46 * max(dot(n, sun), 0.0) + 0.16 * max(dot(n, fill), 0.0);\n" +
    "shown = vec4(colour * min(light, 1.12), 1.0); }");
  const ground = program(
    "in vec3 point; uniform mat4 view; uniform vec3 middle; uniform float size; out vec2 place;\n" +
    "void main() { vec3 p = middle + size * point; place = p.xy; gl_Position = view * vec4(p, 1.0); }",
    "in vec2 place; uniform vec3 middle; uniform float size, tile; out vec4 shown;\n" +
    "void main() { float dark = mod(floor(place.x / tile) + floor(place.y / tile), 2.0);\n" +
    "float fade = clamp(2.0 - 2.0 * length(place - middle.xy) / size, 0.0, 1.0);\n" +
    "shown = vec4(mix(vec3(0.88), vec3(0.80), dark), fade); }");

  // The normal of a point is the mean of those of its triangles, weighted by their areas.
  function normalsOf(points, triangles) {
    const normals = new Float32Array(points.length);
    for (let t = 0; t < triangles.length; t += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => [...points.subarray(3 * triangles[t + k], 3 * triangles[t + k] + 3)]);
      const own = cross(minus(b, a), minus(c, a));
      for (let k = 0; k < 3; k++) for (let i = 0; i < 3; i++) normals[3 * triangles[t + k] + i] += own[i];
    }
    for (let p = 0; p < normals.length; p += 3) normals.set(unit([...normals.subarray(p, p + 3)]), p);
    return normals;
  }
  const scenes = data.scenes.map((parts) => parts.map((part) => {
    const array = gl.createVertexArray(), points = new Float32Array(unpack(part.points, part.count));
    const triangles = new Uint32Array(Uint8Array.from(atob(part.triangles), (c) => c.charCodeAt(0)).buffer);
    gl.bindVertexArray(array);
    for (const [name, values] of [["point", points], ["normal", normalsOf(points, triangles)]]) {
      const place = gl.getAttribLocation(solid, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
    return { body: part.body, colour: part.colour, corners: triangles.length, array };
  }));
  const floor = gl.createVertexArray();
  gl.bindVertexArray(floor);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0]), gl.STATIC_DRAW);
  gl.enableVertexAttribArray(gl.getAttribLocation(ground, "point"));
  gl.vertexAttribPointer(gl.getAttribLocation(ground, "point"), 3, gl.FLOAT, false, 0, 0);

  // The camera goes around its target: angles in rad, distance in m.
  const away = minus(data.camera.eye, data.camera.target), far = Math.hypot(...away);
  const home = { target: data.camera.target, turn: Math.atan2(away[1], away[0]), rise: Math.asin(away[2] / far), distance: far };
  let camera = { ...home };
  const towards = () => [Math.cos(camera.rise) * Math.cos(camera.turn), Math.cos(camera.rise) * Math.sin(camera.turn), Math.sin(camera.rise)];

  function draw() {
    const ratio = window.devicePixelRatio || 1, width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    const back = towards(), eye = camera.target.map((v, i) => v + camera.distance * back[i]);
    const right = unit(cross([0, 0, 1], back)), up = cross(back, right);
    const near = 0.02 * camera.distance, wide = 20 * camera.distance + 5 * far, f = 1 / Math.tan((data.camera.field * Math.PI) / 360);
    const look = [...right, -dot(right, eye), ...up, -dot(up, eye), ...back, -dot(back, eye), 0, 0, 0, 1];
    // A narrow picture must show as much as the film strip.
    const scale = f * Math.min(1, width / height / data.camera.aspect);
    const lens = [(scale * height) / width, 0, 0, 0, 0, scale, 0, 0, 0, 0, (near + wide) / (near - wide), (2 * near * wide) / (near - wide), 0, 0, -1, 0];
    const view = multiply(lens, look);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.945, 0.955, 0.972, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(solid);
    const name = (key) => gl.getUniformLocation(solid, key);
    gl.uniformMatrix4fv(name("view"), true, view);
    gl.uniform3fv(name("eye"), eye);
    gl.uniform3fv(name("sun"), unit(back.map((v, i) => 0.7 * v - 0.35 * right[i] + (i === 2 ? 0.9 : 0))));
    gl.uniform3fv(name("fill"), unit(back.map((v, i) => 0.2 * v + 0.9 * right[i] + (i === 2 ? 0.1 : 0))));
    const where = frames(clock);
    for (const part of scenes[run.scene]) {
      gl.bindVertexArray(part.array);
      gl.uniformMatrix4fv(name("model"), true, where.get(part.body));
      gl.uniform3fv(name("colour"), part.colour);
      gl.drawElements(gl.TRIANGLES, part.corners, gl.UNSIGNED_INT, 0);
    }
    if (run.ground !== null) {
      gl.useProgram(ground);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      gl.bindVertexArray(floor);
      gl.uniformMatrix4fv(gl.getUniformLocation(ground, "view"), true, view);
      gl.uniform3f(gl.getUniformLocation(ground, "middle"), home.target[0], home.target[1], run.ground);
      gl.uniform1f(gl.getUniformLocation(ground, "size"), 1.5 * far);
      gl.uniform1f(gl.getUniformLocation(ground, "tile"), 10 ** Math.floor(Math.log10(far / 3)));
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
      gl.disable(gl.BLEND);
    }
    shown.textContent = clock.toFixed(2) + " s";
    bar.value = String(clock);
  }

  const play = place.querySelector(".play"), bar = place.querySelector("input"), shown = place.querySelector(".clock");
  const choice = place.querySelector(".run"), speed = place.querySelector(".speed");
  const shared = window.asrsimClock;
  let clock = run.start, playing = false, last = 0, asked = false;
  const refresh = () => { if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; draw(); }); } };
  function choose(number) {
    run = runs[number];
    Object.assign(bar, { min: String(run.start), max: String(run.end), step: String((run.end - run.start) / 2000 || 0.001) });
    clock = Math.min(Math.max(clock, run.start), run.end);
    refresh();
  }
  function tick(now) {
    if (!playing) return;
    clock += (Math.min(now - last, 100) / 1000) * Number(speed.value);
    last = now;
    if (clock > run.end) clock = run.start;
    draw();
    shared.set(clock, "motion");
    requestAnimationFrame(tick);
  }
  play.addEventListener("click", () => {
    playing = !playing;
    play.textContent = playing ? "❚❚" : "▶";
    play.setAttribute("aria-label", playing ? "pause" : "play");
    last = performance.now();
    if (playing) requestAnimationFrame(tick);
  });
  bar.addEventListener("input", () => { clock = Number(bar.value); refresh(); shared.set(clock, "motion"); });
  // A plot under the cursor shows the robot at its time; a playing robot plays on.
  shared.listen("motion", (time) => { if (!playing && time !== null) { clock = Math.min(Math.max(time, run.start), run.end); refresh(); } });
  choice.addEventListener("change", () => choose(Number(choice.value)));

  const held = new Map();
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, event); });
  for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => held.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY, others = [...held.values()].filter((e) => e !== before);
    if (others.length) {
      // Two fingers: nearer and farther.
      const was = Math.hypot(before.clientX - others[0].clientX, before.clientY - others[0].clientY);
      const is = Math.hypot(event.clientX - others[0].clientX, event.clientY - others[0].clientY);
      zoom(was / Math.max(is, 1));
    } else if (event.shiftKey || event.buttons & 6) {
      const back = towards(), right = unit(cross([0, 0, 1], back)), up = cross(back, right), step = camera.distance / canvas.clientHeight;
      camera = { ...camera, target: camera.target.map((v, i) => v + 0.6 * step * (up[i] * dy - right[i] * dx)) };
    } else {
      camera = { ...camera, turn: camera.turn - 0.008 * dx, rise: Math.min(Math.max(camera.rise + 0.008 * dy, -1.55), 1.55) };
    }
    held.set(event.pointerId, event);
    refresh();
  });
  function zoom(factor) {
    camera = { ...camera, distance: Math.min(Math.max(camera.distance * factor, 0.05 * far), 10 * far) };
    refresh();
  }
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(0.001 * event.deltaY)); }, { passive: false });
  canvas.addEventListener("dblclick", () => { camera = { ...home }; refresh(); });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  new ResizeObserver(refresh).observe(canvas);

  runs.forEach((one, number) => choice.append(new Option(one.label || "run", String(number))));
  choice.hidden = runs.length < 2;
  choose(0);
  window.asrsimMotion = { frames: (time) => Object.fromEntries(frames(time)), draw };
})();
