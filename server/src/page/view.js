// The point clouds in WebGL 2: one camera, before to the left of the divider and after to its right.

const VERTEX = `#version 300 es
layout(location = 0) in vec3 place;
layout(location = 1) in vec4 colour;
uniform mat4 clip_from_sensor;
uniform vec2 size; // pixels of a point at one metre, least pixels
out vec4 tint;
flat out float pixels;
void main() {
  gl_Position = clip_from_sensor * vec4(place, 1.0);
  pixels = clamp(size.x / gl_Position.w, size.y, 3.0 * size.y);
  gl_PointSize = pixels;
  tint = colour;
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec4 tint;
flat in float pixels;
out vec4 shown;
void main() {
  vec2 from_middle = gl_PointCoord - 0.5;
  if (pixels > 3.0 && dot(from_middle, from_middle) > 0.25) discard;
  shown = tint;
}`;

const FIELD_OF_VIEW = 0.85;
const CIRCLES_M = [10, 20, 40, 80];
const CIRCLE_STEPS = 128;

/** A view on a canvas; `undefined` where the browser has no WebGL 2. */
function create_view(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) return undefined;
  const program = link(gl);
  const uniform = (name) => gl.getUniformLocation(program, name);
  const [clip_from_sensor, size] = [uniform("clip_from_sensor"), uniform("size")];
  const layers = { before: layer(gl), after: layer(gl), circles: layer(gl) };
  const camera = { ...start() };
  let split = 0.5;
  let planned = false;

  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  gl.clearColor(0.027, 0.035, 0.051, 1);

  function start() {
    const narrow = canvas.clientWidth < canvas.clientHeight;
    return { target: [narrow ? 4 : 7, 0, -1], yaw: Math.PI + 0.38, pitch: 0.42, distance: narrow ? 34 : 30 };
  }

  function draw() {
    planned = false;
    const [width, height] = [canvas.width, canvas.height];
    const left = Math.round(split * width);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(clip_from_sensor, false, projection(camera, width / height));
    gl.uniform2f(size, 0.055 * height, 1.6 * height / canvas.clientHeight);
    gl.enable(gl.SCISSOR_TEST);
    for (const [cloud, from, to] of [[layers.before, 0, left], [layers.after, left, width]]) {
      if (to <= from) continue;
      gl.scissor(from, 0, to - from, height);
      gl.bindVertexArray(cloud.array);
      gl.drawArrays(gl.POINTS, 0, cloud.points);
    }
    gl.disable(gl.SCISSOR_TEST);
    gl.bindVertexArray(layers.circles.array);
    for (let k = 0; k * CIRCLE_STEPS < layers.circles.points; k++) gl.drawArrays(gl.LINE_LOOP, k * CIRCLE_STEPS, CIRCLE_STEPS);
  }

  function plan() {
    if (!planned) requestAnimationFrame(draw);
    planned = true;
  }

  function resize() {
    const scale = Math.min(devicePixelRatio, 2);
    [canvas.width, canvas.height] = [canvas.clientWidth, canvas.clientHeight].map((pixels) => Math.max(1, Math.round(pixels * scale)));
    draw();
  }

  new ResizeObserver(resize).observe(canvas);
  steer(canvas, camera, plan, () => { Object.assign(camera, start()); plan(); });

  return {
    show(before, after) {
      fill(gl, layers.before, before.place);
      fill(gl, layers.after, after.place);
      fill(gl, layers.circles, circles(before));
      colour(gl, layers.circles, new Uint8Array(4 * layers.circles.points).map((_, i) => (i % 4 === 3 ? 46 : 255)));
    },
    paint(before, after) {
      colour(gl, layers.before, before);
      colour(gl, layers.after, after);
      plan();
    },
    split_at(share) {
      split = share;
      plan();
    },
    reset() {
      Object.assign(camera, start());
      plan();
    },
  };
}

function link(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`shaders: ${gl.getProgramInfoLog(program)}`);
  return program;
}

function layer(gl) {
  const [array, place, tint] = [gl.createVertexArray(), gl.createBuffer(), gl.createBuffer()];
  gl.bindVertexArray(array);
  gl.bindBuffer(gl.ARRAY_BUFFER, place);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
  gl.bindBuffer(gl.ARRAY_BUFFER, tint);
  gl.enableVertexAttribArray(1);
  gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, 0, 0);
  return { array, place, tint, points: 0 };
}

function fill(gl, layer, place) {
  gl.bindBuffer(gl.ARRAY_BUFFER, layer.place);
  gl.bufferData(gl.ARRAY_BUFFER, place, gl.STATIC_DRAW);
  layer.points = place.length / 3;
}

function colour(gl, layer, bytes) {
  gl.bindBuffer(gl.ARRAY_BUFFER, layer.tint);
  gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
}

/** Circles around the sensor at the height of the ground: that of the lowest hundredth of the points nearby. */
function circles(cloud) {
  const heights = [];
  for (let i = 0; i < cloud.points; i++) if (cloud.range_m[i] < 25) heights.push(cloud.place[3 * i + 2]);
  heights.sort((a, b) => a - b);
  const ground = heights[Math.floor(heights.length / 100)] ?? 0;
  const corner = (radius, k) => [radius * Math.cos((2 * Math.PI * k) / CIRCLE_STEPS), radius * Math.sin((2 * Math.PI * k) / CIRCLE_STEPS), ground];
  return new Float32Array(CIRCLES_M.flatMap((radius) => Array.from({ length: CIRCLE_STEPS }, (_, k) => corner(radius, k)).flat()));
}

/** Directions of the camera: from the target to its eye, to its right, and up in the picture. */
function axes({ yaw, pitch }) {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return { back: [cp * cy, cp * sy, sp], right: [-sy, cy, 0], up: [-sp * cy, -sp * sy, cp] };
}

/** Clip coordinates from the sensor's frame, column by column. */
function projection(camera, aspect) {
  const { back, right, up } = axes(camera);
  const eye = camera.target.map((metres, k) => metres + camera.distance * back[k]);
  const along = (axis) => -(axis[0] * eye[0] + axis[1] * eye[1] + axis[2] * eye[2]);
  const [near, far, zoom] = [0.1, 500, 1 / Math.tan(FIELD_OF_VIEW / 2)];
  const [a, b] = [(far + near) / (near - far), (2 * far * near) / (near - far)];
  const column = (k) => [(zoom / aspect) * right[k], zoom * up[k], a * back[k], -back[k]];
  const last = [(zoom / aspect) * along(right), zoom * along(up), a * along(back) + b, -along(back)];
  return new Float32Array([...column(0), ...column(1), ...column(2), ...last]);
}

/** Turns, moves and zooms the camera by pointer, wheel and keys. */
function steer(canvas, camera, changed, reset) {
  const pointers = new Map();
  const turn = (dx, dy) => {
    camera.yaw -= dx * 0.006;
    camera.pitch = Math.min(1.55, Math.max(-0.3, camera.pitch + dy * 0.006));
  };
  const move = (dx, dy) => {
    const metres = (2 * camera.distance * Math.tan(FIELD_OF_VIEW / 2)) / canvas.clientHeight;
    const { right, up } = axes(camera);
    camera.target = camera.target.map((at, k) => at + metres * (dy * up[k] - dx * right[k]));
  };
  const zoom = (by) => { camera.distance = Math.min(250, Math.max(2, camera.distance * by)); };
  const middle = () => {
    const [a, b] = [...pointers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) };
  };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const from = pointers.get(event.pointerId);
    if (!from) return;
    const before = pointers.size === 2 ? middle() : undefined;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const [dx, dy] = [event.clientX - from.x, event.clientY - from.y];
    if (before) {
      const after = middle();
      move(after.x - before.x, after.y - before.y);
      zoom(before.apart / Math.max(1, after.apart));
    } else if (event.shiftKey || event.buttons > 1) {
      move(dx, dy);
    } else {
      turn(dx, dy);
    }
    changed();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", reset);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(event.deltaY * (event.deltaMode === 1 ? 0.04 : 0.0015)));
    changed();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const act = {
      ArrowLeft: () => turn(-20, 0), ArrowRight: () => turn(20, 0), ArrowUp: () => turn(0, 20), ArrowDown: () => turn(0, -20),
      "+": () => zoom(0.9), "-": () => zoom(1.1), 0: reset,
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
    changed();
  });
}
