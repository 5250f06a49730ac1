/* The page: controls, drawing, plots, and the pointer. */

const element = (id) => document.getElementById(id);
const COLOURS = Object.fromEntries(["ink", "quiet", "edge", "one", "two", "bad"].map((name) =>
  [name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim()]));
const KEPT = 20; // s, of the plots and of the trace
const CONTROLS = [ // setting, label, least, largest, step, unit
  ["speed", "desired speed", -2, 6, 0.1, "m/s"], ["size", "size of the curve", 2, 12, 0.5, "m"], ["angle", "angle of the line", -180, 180, 5, "°"],
  ["kp", "gain kp", 0, 8, 0.1, "1/s²"], ["kd", "gain kd", 0, 8, 0.1, "1/s"], ["kv", "gain kv", 0, 8, 0.1, "1/s"],
  ["L", "P_l ahead of the centre of mass", -1, 2, 0.1, "m"], ["mu", "friction μ", 0.05, 1, 0.05, ""],
  ["believed", "mass that the law assumes", 10, 80, 1, "kg"], ["mass", "mass of the robot", 10, 80, 1, "kg"],
  ["limit", "largest torque (0: none)", 0, 40, 1, "N m"],
];
const CHOICES = [["law", "law and path", LAWS], ["mode", "at a limit", MODES]];
const USED = { size: /circle|ellipse/, angle: /^I+$|line/, kv: /IV/, mode: /./ }; // by laws; the others always
const MEANING = {
  ok: "the law is in force", saturated: "a torque is at its limit", grip: "held back so that the wheels roll", slipping: "slip was noticed", will_slip: "no torque keeps the wheels rolling",
  singular: "singular: the law has no torque here. Drag the robot away", bad_path: "the robot cannot follow this path: draw smoother",
};

const loop = new Loop();
let settings = { ...DEFAULTS }, running = false, paused = false, drawing = null, grabbed = null, clock = 0, last = 0, trace = [];

/* -- settings ---------------------------------------------------------------------------------------------------------- */

function makeControls() {
  const form = element("controls");
  for (const [name, label, names] of CHOICES) {
    form.insertAdjacentHTML("beforeend", `<label>${label}<select name="${name}">${names.map((n) => `<option>${n}</option>`).join("")}</select></label>`);
  }
  for (const [name, label, min, max, step] of CONTROLS) {
    form.insertAdjacentHTML("beforeend", `<label>${label}<output></output><input type="range" name="${name}" min="${min}" max="${max}" step="${step}"></label>`);
  }
  form.addEventListener("input", ({ target }) => change({ [target.name]: target.type === "range" ? +target.value : target.value }));
}

function showControls() {
  for (const input of element("controls").elements) {
    if (!input.name) continue;
    const used = !USED[input.name] || USED[input.name].test(settings.law);
    input.value = settings[input.name];
    input.parentElement.hidden = !used;
    const control = CONTROLS.find(([name]) => name === input.name);
    if (control) input.previousElementSibling.textContent = `${settings[input.name]} ${control[5]}`;
  }
}

/* Change settings, and start a run from where the robot is. */
function change(changes) {
  const target = settings.along + settings.speed * loop.get("t"), x = changes.x || loop.get("x");
  x[2] = Math.atan2(Math.sin(x[2]), Math.cos(x[2]));
  settings = { ...settings, along: target, ...changes, x };
  if (settings.law === "IV path" && settings.speed <= 0) settings.speed = DEFAULTS.speed; // a path has a direction
  if (settings.law === "IV path" && !settings.drawn.length) settings = { ...settings, drawn: arcsThrough(EIGHT, true), closed: true };
  begin();
}

const EIGHT = Array.from({ length: 16 }, (_, k) => [7 * Math.sin((k * Math.PI) / 8), 3.5 * Math.sin((k * Math.PI) / 4)]);

function begin() {
  running = loop.start(settings);
  clock = 0;
  showControls();
  remember();
  const hash = `#${encodeURIComponent(JSON.stringify(settings))}`;
  if (location.hash !== hash) history.replaceState(null, "", hash);
}

/* Start the run that the address holds; without one, or if it cannot be read, that of the defaults. */

function restore() {
  try {
    const given = location.hash.length > 1 ? JSON.parse(decodeURIComponent(location.hash.slice(1))) : {};
    settings = { ...DEFAULTS, ...Object.fromEntries(Object.entries(given).filter(([name]) => name in DEFAULTS)) };
    trace = [];
    begin();
  } catch {
    settings = { ...DEFAULTS };
    begin();
  }
}

/* -- time -------------------------------------------------------------------------------------------------------------- */

/* A point of the trace; times go on from run to run. */
function remember() {
  const now = (trace.length ? trace[trace.length - 1].now : 0) + PERIOD, x = loop.get("x");
  trace.push({ now, x: x[0] + settings.L * Math.cos(x[2]), y: x[1] + settings.L * Math.sin(x[2]), errors: loop.get("error"),
    torques: loop.get("tau"), use: loop.get("use"), status: loop.status });
  if (trace.length > KEPT / PERIOD) trace.shift();
}

function frame(now) {
  clock += paused || grabbed || drawing ? 0 : Math.min(0.1, (now - last) / 1000);
  last = now;
  while (running && clock >= PERIOD) {
    clock -= PERIOD;
    running = loop.step();
    remember();
  }
  drawFloor();
  plot("errors", 0.1, 20);
  plot("torques", 1, 100);
  plot("use", 1.2, 4, 1);
  showStatus();
  requestAnimationFrame(frame);
}

function showStatus() {
  const slips = running && Math.max(...loop.get("use")) > 1, status = loop.status;
  const text = `${MEANING[status] || status}${slips ? ", and the wheels would slip here" : ""}`;
  const shown = element("status");
  if (shown.textContent !== text) shown.textContent = text;
  shown.className = slips || !running ? "bad" : "";
}

/* -- drawing ----------------------------------------------------------------------------------------------------------- */

const middle = { x: 0, y: 0 };
let scale = 30; // pixels per metre

/* The context of a canvas, cleared, in CSS pixels. */
function fresh(canvas) {
  const ratio = devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

function drawFloor() {
  const { context: c, width, height } = fresh(element("floor")), x = loop.get("x"), onLine = /^I+$|line/.test(settings.law);
  const reach = { "IV path": 11, "IV circle": settings.size + 3, "IV ellipse": 1.5 * settings.size + 3 }[settings.law] || 8;
  middle.x = onLine ? x[0] : 0;
  middle.y = onLine ? x[1] : 0;
  scale = Math.min(width, height) / 2 / reach;
  c.translate(width / 2, height / 2);
  c.scale(scale, -scale);
  c.translate(-middle.x, -middle.y);
  drawGrid(c, width / scale / 2, height / scale / 2);
  c.lineWidth = 2 / scale;
  drawPath(c);
  drawTrace(c);
  drawRobot(c, x);
}

function drawGrid(c, wide, high) {
  c.strokeStyle = "#eee";
  c.lineWidth = 1 / scale;
  c.beginPath();
  for (let x = Math.ceil(middle.x - wide); x <= middle.x + wide; x++) { c.moveTo(x, middle.y - high); c.lineTo(x, middle.y + high); }
  for (let y = Math.ceil(middle.y - high); y <= middle.y + high; y++) { c.moveTo(middle.x - wide, y); c.lineTo(middle.x + wide, y); }
  c.stroke();
}

function drawPath(c) {
  const angle = (settings.angle * Math.PI) / 180, { size, law } = settings;
  c.strokeStyle = "#777";
  c.setLineDash([8 / scale, 6 / scale]);
  c.beginPath();
  if (law === "IV circle") c.arc(0, 0, size, 0, 2 * Math.PI);
  else if (law === "IV ellipse") c.ellipse(0, 0, 1.5 * size, size, 0, 0, 2 * Math.PI);
  else if (law === "IV path") for (const [x, y, heading, radius, turn] of settings.drawn) {
    const side = Math.sign(turn), from = heading - (side * Math.PI) / 2;
    c.arc(x - side * radius * Math.sin(heading), y + side * radius * Math.cos(heading), radius, from, from + turn, turn < 0);
  } else {
    const reach = Math.hypot(middle.x, middle.y) + 50;
    c.moveTo(-reach * Math.cos(angle), -reach * Math.sin(angle));
    c.lineTo(reach * Math.cos(angle), reach * Math.sin(angle));
  }
  c.stroke();
  c.setLineDash([]);
  if (/^I+$/.test(law)) { // the desired point moves along the line
    const along = settings.along + settings.speed * loop.get("t");
    dot(c, along * Math.cos(angle), along * Math.sin(angle), 6, COLOURS.quiet);
  }
  if (drawing) {
    c.strokeStyle = COLOURS.two;
    c.beginPath();
    drawing.forEach(([x, y]) => c.lineTo(x, y));
    c.stroke();
  }
}

function drawTrace(c) {
  for (let k = 1; k < trace.length; k++) {
    const [p, q] = [trace[k - 1], trace[k]], slips = Math.max(...q.use) > 1;
    if (Math.hypot(q.x - p.x, q.y - p.y) > 1) continue; // it was carried
    c.strokeStyle = slips ? COLOURS.bad : COLOURS.one;
    c.beginPath();
    c.moveTo(p.x, p.y);
    c.lineTo(q.x, q.y);
    c.stroke();
    if (q.status === "singular") dot(c, q.x, q.y, 6, COLOURS.bad);
  }
}

function drawRobot(c, x) {
  c.save();
  c.translate(x[0], x[1]);
  c.rotate(x[2]);
  c.fillStyle = "#dfe9f5cc";
  c.strokeStyle = COLOURS.ink;
  c.fillRect(-1, -0.6, 2, 1.2);
  c.strokeRect(-1, -0.6, 2, 1.2);
  const use = loop.get("use"), forces = loop.get("tau");
  [[-B, 0], [B, 1]].forEach(([side, wheel]) => {
    c.fillStyle = use[wheel] > 1 ? COLOURS.bad : COLOURS.ink;
    c.fillRect(-D - RADIUS, side - 0.06, 2 * RADIUS, 0.12);
    c.strokeStyle = COLOURS.two; // torque, an arrow along the wheel
    c.beginPath();
    c.moveTo(-D, side);
    c.lineTo(-D + Math.max(-3, Math.min(3, forces[wheel] / 8)), side);
    c.stroke();
  });
  c.restore();
  dot(c, x[0] + Math.cos(x[2]), x[1] + Math.sin(x[2]), 7, COLOURS.one);
  dot(c, x[0] + settings.L * Math.cos(x[2]), x[1] + settings.L * Math.sin(x[2]), 4, COLOURS.ink);
}

function dot(c, x, y, pixels, colour) {
  c.fillStyle = colour;
  c.beginPath();
  c.arc(x, y, pixels / scale, 0, 2 * Math.PI);
  c.fill();
}

/* Both series of the trace over the last seconds; the axis reaches at least `least` and at most `limit`; a line at `mark`. */
function plot(name, least, limit, mark) {
  const { context: c, width, height } = fresh(element(name)), end = trace[trace.length - 1].now;
  const largest = Math.max(least, ...trace.map((p) => Math.max(Math.abs(p[name][0]), Math.abs(p[name][1]))));
  const most = Math.min(largest, limit), low = name === "use" ? 0 : -most;
  const across = (t) => width * (1 - (end - t) / KEPT), up = (value) => height - ((value - low) / (most - low)) * (height - 16) - 4;
  c.font = "11px system-ui, sans-serif";
  c.fillStyle = c.strokeStyle = COLOURS.quiet;
  c.fillText(`${+most.toPrecision(2)}`, 4, 12);
  [0, ...(mark ? [mark] : [])].forEach((value) => {
    c.strokeStyle = value ? COLOURS.bad : COLOURS.edge;
    c.beginPath();
    c.moveTo(0, up(value));
    c.lineTo(width, up(value));
    c.stroke();
  });
  ["one", "two"].forEach((colour, k) => {
    c.strokeStyle = COLOURS[colour];
    c.beginPath();
    trace.forEach((p) => c.lineTo(across(p.now), up(p[name][k])));
    c.stroke();
    c.fillStyle = COLOURS[colour];
    c.fillText(NAMES[name]()[k], 60 + 110 * k, 12);
  });
}

const NAMES = {
  errors: () => ({ I: ["x (m)", "y (m)"], II: ["x (m)", "heading (rad)"], III: ["y (m)", "heading (rad)"] }[settings.law] || ["distance (m)", "speed (m/s)"]),
  torques: () => ["right", "left"],
  use: () => ["right wheel", "left wheel"],
};

/* -- pointer and buttons ----------------------------------------------------------------------------------------------- */

/* Where on the floor an event is, m. */
function place(event) {
  const { left, top, width, height } = element("floor").getBoundingClientRect();
  return [middle.x + (event.clientX - left - width / 2) / scale, middle.y - (event.clientY - top - height / 2) / scale];
}

function press(event) {
  const at = place(event), x = loop.get("x"), near = (px, py) => Math.hypot(at[0] - px, at[1] - py);
  element("floor").setPointerCapture(event.pointerId);
  if (drawing) drawing = [at];
  else if (near(x[0] + Math.cos(x[2]), x[1] + Math.sin(x[2])) < Math.max(0.5, 20 / scale)) grabbed = "nose";
  else if (near(x[0], x[1]) < Math.max(1.2, 30 / scale)) grabbed = [x[0] - at[0], x[1] - at[1]];
}

function move(event) {
  if (!event.buttons) return;
  const [x, y] = place(event), state = loop.get("x"), set = (k, value) => { loop.doubles[LAYOUT.x[0] + k] = value; };
  if (drawing?.length) {
    const [u, v] = drawing[drawing.length - 1];
    if (Math.hypot(x - u, y - v) > 0.8 && drawing.length < 90) drawing.push([x, y]);
  } else if (grabbed === "nose") {
    set(2, Math.atan2(y - state[1], x - state[0]));
  } else if (grabbed) {
    set(0, x + grabbed[0]);
    set(1, y + grabbed[1]);
  }
}

function release() {
  if (drawing?.length) followDrawn(drawing);
  else if (grabbed) { grabbed = null; change({ x: loop.get("x") }); }
  grabbed = null;
}

/* Arrow keys move the robot by 0.2 m; left and right with shift turn it. */
function key(event) {
  const way = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1 }[event.key], x = loop.get("x");
  if (!way) return;
  event.preventDefault();
  if (/Up|Down/.test(event.key)) x[1] += 0.2 * way;
  else if (event.shiftKey) x[2] -= 0.2 * way;
  else x[0] += 0.2 * way;
  change({ x });
}

/* Follow the points drawn, smoothed; the path is closed if they end near where they began. */
function followDrawn(points) {
  const closed = points.length > 5 && Math.hypot(points[0][0] - points.at(-1)[0], points[0][1] - points.at(-1)[1]) < 2;
  const smooth = (list) => list.map((p, k) => {
    const [before, after] = closed ? [list.at(k - 1), list[(k + 1) % list.length]] : [list[k - 1] || p, list[k + 1] || p];
    return [(before[0] + 2 * p[0] + after[0]) / 4, (before[1] + 2 * p[1] + after[1]) / 4];
  });
  setDrawing(null);
  if (points.length < 3) return;
  const drawn = arcsThrough(smooth(smooth(smooth(points))), closed), [x, y, heading] = drawn[0];
  change({ law: "IV path", drawn, closed, x: [x, y, heading, 0, 0, 0, 0] });
}

function setDrawing(points) {
  drawing = points;
  element("draw").setAttribute("aria-pressed", String(!!points));
  element("floor").classList.toggle("drawing", !!points);
}

/* Show a text to be copied, and copy it where the browser allows that. */
function copy(text) {
  const box = element("copied");
  box.hidden = false;
  box.value = text;
  box.select();
  navigator.clipboard?.writeText(text).catch(() => {});
}

makeControls();
element("floor").addEventListener("pointerdown", press);
element("floor").addEventListener("keydown", key);
element("floor").addEventListener("pointermove", move);
element("floor").addEventListener("pointerup", release);
element("floor").addEventListener("pointercancel", release);
element("pause").addEventListener("click", ({ target }) => { paused = !paused; target.textContent = paused ? "Go on" : "Pause"; });
element("again").addEventListener("click", () => { trace = []; change({ x: [...DEFAULTS.x], along: 0 }); });
element("draw").addEventListener("click", () => setDrawing(drawing ? null : []));
element("spec").addEventListener("click", () => { change({}); copy(spec(settings)); });
element("link").addEventListener("click", () => { change({}); copy(location.href); });
addEventListener("hashchange", restore);
restore();
requestAnimationFrame(frame);
