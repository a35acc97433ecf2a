// Surfaces in a page, to be turned and zoomed. WebGL 2, nothing else.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("solids").textContent);
  const canvas = document.getElementById("solid");
  const caption = document.getElementById("solid-caption");
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) {
    caption.textContent = "This browser has no WebGL 2: the surface is in the pictures below.";
    canvas.remove();
    return;
  }
  const vertexShader = `#version 300 es
    in vec4 position; in vec4 normal; in vec4 colour;
    uniform mat4 model, view; out vec3 n, c, eye;
    void main() {
      vec4 p = model * vec4(position.xyz, 1.0);
      n = mat3(model) * normal.xyz; c = colour.rgb; eye = p.xyz;
      gl_Position = view * p;
    }`;
  // Light from above the left shoulder; insides in red, as in the pictures.
  const fragmentShader = `#version 300 es
    precision highp float; in vec3 n, c, eye; uniform float ambient; out vec4 result;
    void main() {
      bool front = gl_FrontFacing;
      vec3 m = normalize(front ? n : -n);
      float light = pow(0.5 + 0.5 * dot(m, normalize(vec3(-0.5, 0.6, 0.8))), 1.5);
      vec3 tint = front ? c : vec3(0.80, 0.43, 0.43);
      float shine = 0.15 * pow(max(dot(reflect(normalize(eye), m), vec3(-0.45, 0.54, 0.71)), 0.0), 20.0);
      result = vec4((ambient + (1.0 - ambient) * light) * tint + (front ? shine : 0.0), 1.0);
    }`;
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertexShader], [gl.FRAGMENT_SHADER, fragmentShader]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw gl.getShaderInfoLog(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  const at = (name) => gl.getUniformLocation(program, name);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

  const buffer = (target, values) => {
    const made = gl.createBuffer();
    gl.bindBuffer(target, made);
    gl.bufferData(target, values, gl.STATIC_DRAW);
    return made;
  };
  const attribute = (name, type, normalised) => {
    const place = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, 4, type, normalised, 0, 0);
  };
  const solids = data.solids.map((solid) => {
    const arrays = gl.createVertexArray();
    gl.bindVertexArray(arrays);
    buffer(gl.ARRAY_BUFFER, bytes(solid.position));
    attribute("position", gl.UNSIGNED_SHORT, true);
    buffer(gl.ARRAY_BUFFER, bytes(solid.normal));
    attribute("normal", gl.BYTE, true);
    buffer(gl.ELEMENT_ARRAY_BUFFER, bytes(solid.faces));
    const tints = {};
    for (const name of ["colour", "error"]) {
      if (solid[name]) tints[name] = buffer(gl.ARRAY_BUFFER, bytes(solid[name]));
    }
    return { ...solid, arrays, tints };
  });

  // The turn of the object: a 3 x 3 matrix, rows, from the object frame to that of the eye
  // (x right, y up, z towards us).
  let turn = data.turn, zoom = 1, pan = [0, 0], chosen = 0, tint = "plain";
  const times = (a, b) => a.map((row) => b[0].map((_, j) => row.reduce((s, x, k) => s + x * b[k][j], 0)));
  const about = (axis, angle) => {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    return axis ? [[c, 0, s], [0, 1, 0], [-s, 0, c]] : [[1, 0, 0], [0, c, -s], [0, s, c]];
  };

  const draw = () => {
    const scale = window.devicePixelRatio || 1;
    const [w, h] = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.round(x * scale));
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    gl.viewport(0, 0, w, h);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const solid = solids[chosen];
    const radius = Math.hypot(...solid.box) / 2;
    const distance = 2.9 * radius / zoom;
    const middle = solid.box.map((x, k) => x / 2 / solid.size);
    // Position in the box (0 to 1) -> eye.
    const m = turn.map((row) => row.map((x) => x * solid.size));
    const shift = m.map((row) => -row.reduce((s, x, k) => s + x * middle[k], 0));
    shift[0] += pan[0] * distance;
    shift[1] += pan[1] * distance;
    shift[2] -= distance;
    const model = [0, 1, 2, 3].flatMap((k) => (k < 3 ? [m[0][k], m[1][k], m[2][k], 0] : [...shift, 1]));
    const f = 2.4, near = Math.max(distance - 1.5 * radius, 0.02 * radius), far = distance + 3 * radius;
    const shorter = Math.min(w, h); // the object fits into the shorter side
    const view = [
      (f * shorter) / w, 0, 0, 0, 0, (f * shorter) / h, 0, 0,
      0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0,
    ];
    gl.uniformMatrix4fv(at("model"), false, model);
    gl.uniformMatrix4fv(at("view"), false, view);
    gl.bindVertexArray(solid.arrays);
    const place = gl.getAttribLocation(program, "colour");
    const own = solid.tints[tint];
    if (own) {
      gl.bindBuffer(gl.ARRAY_BUFFER, own);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 4, gl.UNSIGNED_BYTE, true, 0, 0);
    } else {
      gl.disableVertexAttribArray(place);
      gl.vertexAttrib4f(place, 0.63, 0.75, 0.84, 1);
    }
    gl.uniform1f(at("ambient"), own ? 0.55 : 0.25);
    gl.drawElements(gl.TRIANGLES, 3 * solid.shown, gl.UNSIGNED_INT, 0);
    const thin = solid.shown < solid.triangles ? ` (shown: ${solid.shown})` : "";
    const limit = own && tint === "error" ? `. Blue: inside the true surface; red: outside, ` +
      `full colour at ${solid.error_limit_mm.toPrecision(2)} mm` : "";
    caption.textContent = `${solid.name}: ${solid.triangles} triangles${thin}${limit}. ` +
      "Drag turns, wheel or two fingers zoom, shift and drag moves, double click puts it back.";
  };
  let waiting = false;
  const redraw = () => {
    if (!waiting) requestAnimationFrame(() => { waiting = false; draw(); });
    waiting = true;
  };

  const fingers = new Map();
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]) || 1;
  };
  canvas.addEventListener("pointerdown", (e) => {
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    canvas.setPointerCapture(e.pointerId);
  });
  canvas.addEventListener("pointermove", (e) => {
    const last = fingers.get(e.pointerId);
    if (!last) return;
    const [dx, dy] = [e.clientX - last[0], e.clientY - last[1]];
    const before = fingers.size > 1 ? spread() : 0;
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    if (before) zoom = Math.min(40, Math.max(0.2, (zoom * spread()) / before));
    else if (e.shiftKey || e.buttons & 2) {
      pan = [pan[0] + dx / canvas.clientHeight / 1.2, pan[1] - dy / canvas.clientHeight / 1.2];
    } else turn = times(times(about(0, dy / 180), about(1, dx / 180)), turn);
    redraw();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (e) => fingers.delete(e.pointerId));
  }
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    zoom = Math.min(40, Math.max(0.2, zoom * Math.exp(-e.deltaY / 600)));
    redraw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => {
    [turn, zoom, pan] = [data.turn, 1, [0, 0]];
    redraw();
  });

  const row = document.getElementById("solid-buttons");
  const choices = (values, current, choose) => {
    const group = document.createElement("span");
    for (const [value, text] of values) {
      const button = document.createElement("button");
      button.textContent = text;
      button.setAttribute("aria-pressed", value === current);
      button.addEventListener("click", () => {
        for (const other of group.children) other.setAttribute("aria-pressed", other === button);
        choose(value);
        redraw();
      });
      group.append(button);
    }
    if (values.length > 1) row.append(group);
  };
  choices(solids.map((s, k) => [k, s.name]), 0, (k) => { chosen = k; });
  const tints = [["plain", "plain"]];
  if (solids.some((s) => s.colour)) tints.push(["colour", "colour"]);
  if (solids.some((s) => s.error)) tints.push(["error", "error"]);
  choices(tints, "plain", (name) => { tint = name; });
  window.addEventListener("resize", redraw);
  window.addEventListener("beforeprint", draw);
  draw();
})();
