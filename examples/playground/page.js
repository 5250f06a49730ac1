/* The page: controls, drawing, plots, and the pointer. The loop runs in a worker, so that a slow drawing never holds it up. */

const element = (id) => document.getElementById(id);
const COLOURS = Object.fromEntries(["ink", "quiet", "edge", "one", "two", "three", "four", "bad"].map((name) =>
  [name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim()]));
const SPARSE = 3; // of so many points a plot shows one: 0.6 pixels of it
const CURVES = ["one", "two", "ink", "three", "four"]; // colours of the curves of a plot
const KEPT = 20, TICK = 5; // s, of the plots and of the trace; between marks of the time
const FORBIDDEN = 0.05; // of det Phi over the product of its rows' norms
const CONTROLS = [ // setting, label, least, largest, step, unit
  ["speed", "desired speed", -2, 6, 0.1, "m/s"], ["turn", "desired yaw rate", -2, 2, 0.1, "rad/s"], ["size", "size of the curve", 2, 12, 0.5, "m"], ["angle", "angle of the line", -180, 180, 5, "°"],
  ["kp", "gain kp", 0, 8, 0.05, "1/s²"], ["kd", "gain kd", 0, 8, 0.05, "1/s"], ["kv", "gain kv", 0, 8, 0.05, "1/s"],
  ["L", "P_l ahead of the vehicle's point", -1, 2, 0.1, "m"], ["mu", "friction μ", 0.05, 1, 0.05, ""],
  ["believed", "mass that the law assumes", 10, 80, 1, "kg"], ["mass", "mass of the robot", 10, 80, 1, "kg"],
  ["believedTrailers", "mass of each trailer that the law assumes", 2, 60, 1, "kg"], ["trailers", "mass of each trailer", 2, 60, 1, "kg"],
  ["limit", "largest torque (0: none)", 0, 40, 1, "N m"],
];
const SCALED = { m: "size", "m/s": "size", kg: "heavy", "N m": "heavy" }; // by which a kind of robot has other ranges
const CHOICES = [ // setting, label, names for a robot, what is shown
  ["robot", "robot", () => Object.keys(ROBOTS), titleOf], ["law", "what is controlled", lawsOf, (law) => LAWS[law]],
  ["mode", "at a limit", modesOf, (mode) => MODES[mode]],
];
const USED = { // where a setting matters; the others always
  size: (s) => /circle|ellipse/.test(s.law), angle: (s) => movesOnLine(s.law) || /line/.test(s.law),
  mu: (s) => ROBOTS[s.robot].contacts.length, kp: (s) => s.law !== "drive", kd: (s) => s.law !== "drive", kv: (s) => /IV|drive/.test(s.law),
  turn: (s) => isOwn(s.law), L: (s) => !isOwn(s.law),
  trailers: (s) => trailersOf(s.robot) > 0, believedTrailers: (s) => trailersOf(s.robot) > 0,
};
const MEANING = {
  ok: "the law is in force", saturated: "a torque is at its limit", grip: "held back so that the wheels roll", slipping: "slip was noticed", will_slip: "no torque keeps the wheels rolling",
  singular: "singular: the law has no torque here. Drag the robot or press an arrow key", bad_path: "the robot cannot follow this path: draw smoother",
};

const makeWorker = () => new Worker(URL.createObjectURL(new Blob([element("model").textContent, "serve();"], { type: "text/javascript" })));
const worker = makeWorker();
let settings = defaultsOf(DEFAULTS.robot), run = 0, now = null, going = false, waiting = false; // for the worker
let regular = [], turned = false; // at headings all around; whether the start of the run is another than was asked for
let paused = false, drawing = null, grabbed = null, clock = 0, last = 0, trace = [];

/* -- settings ---------------------------------------------------------------------------------------------------------- */

function makeControls() {
  const form = element("controls");
  for (const [name, label] of CHOICES) form.insertAdjacentHTML("beforeend", `<label>${label}<select name="${name}"></select></label>`);
  for (const [name, label] of CONTROLS) {
    form.insertAdjacentHTML("beforeend", `<label>${label}<output></output><input type="range" name="${name}"></label>`);
  }
  form.addEventListener("input", ({ target }) => {
    if (target.name === "robot") choose(target.value);
    else change({ [target.name]: target.type === "range" ? +target.value : target.value }, target.type !== "range");
  });
  form.addEventListener("change", () => { if (!going) change({}); });
}

function showControls() {
  const { elements } = element("controls"), kind = kindOf(settings.robot);
  for (const [name, , names, shown] of CHOICES) {
    elements[name].replaceChildren(...names(settings.robot).map((value) => new Option(shown(value), value)));
    elements[name].value = settings[name];
  }
  for (const [name, , least, most, step, unit] of CONTROLS) {
    const input = elements[name], factor = kind[SCALED[unit]] || 1;
    Object.assign(input, { min: least * factor, max: most * factor, step, value: settings[name] });
    input.previousElementSibling.textContent = `${settings[name]} ${unit}`;
    input.parentElement.hidden = !(USED[name]?.(settings) ?? true);
  }
  element("use").parentElement.hidden = !ROBOTS[settings.robot].contacts.length;
  element("draw").hidden = !lawsOf(settings.robot).includes("IV path");
}

/* Change settings, and start a run from where the robot is; once a gesture has ended, from where the law can go on. */
function change(changes, free = true) {
  const target = settings.along + settings.speed * now.t, x = [...(changes.x || now.x)], trailers = trailersOf(settings.robot);
  for (const k of [2, ...Array.from({ length: trailers }, (_, trailer) => 5 + trailer)]) x[k] = Math.atan2(Math.sin(x[k]), Math.cos(x[k])); // headings
  settings = { ...settings, along: target, ...changes, x };
  if (settings.law === "IV path" && settings.speed <= 0) settings.speed = DEFAULTS.speed; // a path has a direction
  if (settings.law === "IV path" && !settings.drawn.length) settings = { ...settings, drawn: arcsThrough(eight(kindOf(settings.robot).size), true), closed: true };
  begin(free);
}

const eight = (size) => Array.from({ length: 16 }, (_, k) => [7 * size * Math.sin((k * Math.PI) / 8), 3.5 * size * Math.sin((k * Math.PI) / 4)]);

/* Go on with another robot, on the same kind of path. */
function choose(robot) {
  const usual = defaultsOf(robot), law = lawsOf(robot).includes(settings.law) ? settings.law : usual.law;
  settings = { ...usual, law, mu: settings.mu };
  trace = [];
  now = { x: settings.x, t: 0 };
  change({ along: 0 });
}

function begin(free = false) {
  run += 1;
  worker.postMessage({ run, settings, free });
  waiting = true;
  clock = 0;
  turned = false;
  showControls();
  showAddress();
}

function showAddress() {
  const hash = `#${encodeURIComponent(JSON.stringify(settings))}`;
  if (!grabbed && location.hash !== hash) history.replaceState(null, "", hash);
}

/* Start the run that the address holds; without one, or if it cannot be read, that of the defaults. */
function restore() {
  settings = defaultsOf(DEFAULTS.robot);
  try {
    const given = location.hash.length > 1 ? JSON.parse(decodeURIComponent(location.hash.slice(1))) : {};
    const usual = defaultsOf(given.robot || DEFAULTS.robot);
    const read = { ...usual, ...Object.fromEntries(Object.entries(given).filter(([name]) => name in usual)) };
    const fits = Object.entries(usual).every(([name, value]) => typeof read[name] === typeof value);
    if (fits && read.x.length === usual.x.length && lawsOf(read.robot).includes(read.law)) settings = read;
  } catch { /* not of this page */ }
  trace = [];
  begin();
}

/* -- time -------------------------------------------------------------------------------------------------------------- */

/* What the worker answers; the answer of a run that is over is dropped. */
worker.onmessage = ({ data }) => {
  if (data.run !== run) return;
  waiting = false;
  ({ going, regular } = data);
  if (data.rows[0]?.t === 0 && settings.x.some((value, k) => value !== data.x[k])) {
    turned = true;
    settings.x = data.x;
    showAddress();
  }
  now = data.rows.at(-1) || now;
  if (!grabbed) data.rows.forEach(remember);
};

/* P_l, for a law that has it, else the vehicle's point. */
function controlledPoint([x, y, heading]) {
  const L = isOwn(settings.law) ? 0 : settings.L;
  return [x + L * Math.cos(heading), y + L * Math.sin(heading)];
}

/* A point of the trace; times go on from run to run. */
function remember({ motion, error, tau, use, status }) {
  const time = (trace.at(-1)?.now || 0) + PERIOD, [x, y] = controlledPoint(motion);
  const series = { error, tau, use }, most = Object.fromEntries(Object.entries(series).map(([name, all]) => [name, Math.max(...all.map(Math.abs))]));
  trace.push({ now: time, x, y, ...series, most, status });
  if (trace.length > KEPT / PERIOD) trace.shift();
}

function frame(time) {
  clock += paused || grabbed || drawing ? 0 : Math.min(0.1, (time - last) / 1000);
  last = time;
  const steps = Math.floor(clock / PERIOD), { size, heavy } = kindOf(settings.robot);
  if (going && !waiting && steps) {
    worker.postMessage({ run, steps });
    waiting = true;
    clock -= steps * PERIOD;
  }
  clock = Math.min(clock, 0.1);
  if (now?.lines && trace.length) {
    drawFloor();
    plot("error", 0.1, 20 * size);
    plot("tau", 1, 100 * heavy);
    if (now.use.length) plot("use", 1.2, 4, 1);
    showStatus();
  }
  requestAnimationFrame(frame);
}

function showStatus() {
  const slips = going && Math.max(...now.use) > 1, { status } = now;
  const text = `${turned ? "stopped and turned to where the law can go on; " : ""}${MEANING[status] || status}${slips ? ", and the wheels would slip here" : ""}`;
  const shown = element("status");
  if (shown.textContent !== text) shown.textContent = text;
  shown.className = slips || !going ? "bad" : "";
  const lateral = lateralError();
  element("measures").textContent = [...(lateral === null ? [] : [`lateral error ${lateral.toFixed(2)} m`]),
    ...(now.use.length ? [`friction use ${Math.max(...now.use).toFixed(2)}`] : [])].join(" · ");
}

/* How far P_l is to the left of the path, m; null without a path. */
function lateralError() {
  const { law, angle } = settings, [x, y] = controlledPoint(now.motion), direction = (angle * Math.PI) / 180;
  if (!movesOnLine(law)) return isOwn(law) ? null : now.error[0];
  return Math.cos(direction) * y - Math.sin(direction) * x;
}

/* -- drawing ----------------------------------------------------------------------------------------------------------- */

const middle = { x: 0, y: 0 };
let scale = 30; // pixels per metre
let far = 0; // the farthest point of the robot from the middle, m

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
  const { context: c, width, height } = fresh(element("floor")), { x } = now, { size } = kindOf(settings.robot);
  const onLine = isOwn(settings.law) || movesOnLine(settings.law) || /line/.test(settings.law), room = 3 * size;
  const reach = { "IV path": 11 * size, "IV circle": settings.size + room, "IV ellipse": 1.5 * settings.size + room }[settings.law] || 8 * size;
  middle.x = onLine ? x[0] : 0;
  middle.y = onLine ? x[1] : 0;
  if (!grabbed) far = Math.max(Math.abs(x[0] - middle.x), Math.abs(x[1] - middle.y)) + size; // fixed while the robot is dragged
  scale = Math.min(width, height) / 2 / Math.max(reach, far);
  c.translate(width / 2, height / 2);
  c.scale(scale, -scale);
  c.translate(-middle.x, -middle.y);
  drawGrid(c, width / scale / 2, height / scale / 2);
  c.lineWidth = 2 / scale;
  drawPath(c);
  drawTrace(c);
  drawRobot(c);
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
  } else if (law !== "drive") {
    const reach = Math.hypot(middle.x, middle.y) + 50;
    c.moveTo(-reach * Math.cos(angle), -reach * Math.sin(angle));
    c.lineTo(reach * Math.cos(angle), reach * Math.sin(angle));
  }
  c.stroke();
  c.setLineDash([]);
  if (movesOnLine(law)) { // the desired point moves along the line
    const along = settings.along + settings.speed * now.t;
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
  for (const slips of [false, true]) {
    c.strokeStyle = slips ? COLOURS.bad : COLOURS.one;
    c.beginPath();
    for (let k = 1; k < trace.length; k++) {
      const [p, q] = [trace[k - 1], trace[k]];
      if (Math.hypot(q.x - p.x, q.y - p.y) > 1 || q.most.use > 1 !== slips) continue; // it was carried, or the other colour
      c.moveTo(p.x, p.y);
      c.lineTo(q.x, q.y);
    }
    c.stroke();
  }
  trace.filter(({ status }) => status === "singular").forEach((p) => dot(c, p.x, p.y, 6, COLOURS.bad));
}

/* The lines of the robot: bodies, hitches, and wheels, thick, red where they would slip; the forces at the wheels. */
function drawRobot(c) {
  const { wheels, handle, across } = kindOf(settings.robot), { lines, use, forces, motion, x } = now;
  const contactOf = Object.fromEntries(use.flatMap((_, contact) => wheels[contact].map((line) => [line, contact])));
  const ends = [];
  let place = 0;
  ROBOTS[settings.robot].lines.forEach((count, line) => {
    const contact = contactOf[line];
    c.beginPath();
    for (let k = 0; k < count; k++) c.lineTo(lines[place + 2 * k], lines[place + 2 * k + 1]);
    ends[line] = lines.slice(place, place + 4);
    place += 2 * count;
    c.lineWidth = (contact === undefined ? 2 : 6) / scale;
    c.strokeStyle = use[contact] > 1 ? COLOURS.bad : COLOURS.ink;
    if (count > 2) { c.fillStyle = "#dfe9f5cc"; c.fill(); }
    c.stroke();
  });
  c.lineWidth = 2 / scale;
  use.forEach((_, contact) => drawForce(c, wheels[contact].map((line) => ends[line]), use[contact], forces.slice(2 * contact, 2 * contact + 2), across?.[contact]));
  drawForbidden(c, x, handle);
  dot(c, x[0] + handle * Math.cos(x[2]), x[1] + handle * Math.sin(x[2]), 7, COLOURS.one);
  if (!isOwn(settings.law)) dot(c, ...controlledPoint(motion), 4, COLOURS.ink);
}

/* The headings at which the law has no torque or hardly one, on the circle of the handle. */
function drawForbidden(c, [x, y], handle) {
  const step = (2 * Math.PI) / regular.length;
  c.strokeStyle = COLOURS.bad;
  c.lineWidth = 8 / scale;
  c.beginPath();
  regular.forEach((value, k) => {
    if (Math.abs(value) > FORBIDDEN && value * regular[(k + 1) % regular.length] > 0) return;
    c.moveTo(x + handle * Math.cos(k * step), y + handle * Math.sin(k * step));
    c.arc(x, y, handle, k * step, (k + 1) * step);
  });
  c.stroke();
}

/* The force of the ground at a contact, between its wheels (ends x, y, x, y of each), as part of a ring, the limit of friction; `turned`: by
 * how much `along` is to the left of the wheel's direction. */
function drawForce(c, wheels, use, [along, across], turned = 0) {
  const mean = (k) => wheels.reduce((sum, ends) => sum + ends[k] + ends[k + 2], 0) / (2 * wheels.length), [x, y] = [mean(0), mean(1)];
  const [u, v, p, q] = wheels[0], direction = Math.atan2(q - v, p - u) + turned, [cos, sin] = [Math.cos(direction), Math.sin(direction)];
  const ring = 0.5 * kindOf(settings.robot).size, size = Math.hypot(along, across), reach = size ? (ring * Math.min(3, use)) / size : 0;
  c.strokeStyle = COLOURS.quiet;
  c.lineWidth = 1 / scale;
  c.beginPath();
  c.arc(x, y, ring, 0, 2 * Math.PI);
  c.stroke();
  c.strokeStyle = use > 1 ? COLOURS.bad : COLOURS.two;
  c.lineWidth = 3 / scale;
  c.beginPath();
  c.moveTo(x, y);
  c.lineTo(x + reach * (cos * along - sin * across), y + reach * (sin * along + cos * across));
  c.stroke();
}

function dot(c, x, y, pixels, colour) {
  c.fillStyle = colour;
  c.beginPath();
  c.arc(x, y, pixels / scale, 0, 2 * Math.PI);
  c.fill();
}

/* The curves of the trace over the last seconds; the axis reaches at least `least` and at most `limit`; a line at `mark`. */
function plot(name, least, limit, mark) {
  const { context: c, width, height } = fresh(element(name)), end = trace[trace.length - 1].now;
  const largest = trace.reduce((most, p) => Math.max(most, p.most[name]), least), names = NAMES[name]();
  const shown = trace.filter((p, k) => k + 1 === trace.length || Math.round(p.now / PERIOD) % SPARSE === 0);
  const most = Math.min(largest, limit), low = name === "use" ? 0 : -most;
  const across = (t) => width * (1 - (end - t) / KEPT), up = (value) => height - 14 - ((value - low) / (most - low)) * (height - 32);
  c.font = "11px system-ui, sans-serif";
  c.fillStyle = c.strokeStyle = COLOURS.quiet;
  c.fillText(`${+most.toPrecision(2)}`, 4, 12);
  c.strokeStyle = COLOURS.edge;
  for (let t = Math.ceil(Math.max(0, end - KEPT) / TICK) * TICK; t <= end; t += TICK) {
    c.beginPath();
    c.moveTo(across(t), 16);
    c.lineTo(across(t), height - 12);
    c.stroke();
    c.fillText(`${t} s`, Math.max(0, Math.min(across(t) - 8, width - 26)), height - 2);
  }
  [0, ...(mark ? [mark] : [])].forEach((value) => {
    c.strokeStyle = value ? COLOURS.bad : COLOURS.edge;
    c.beginPath();
    c.moveTo(0, up(value));
    c.lineTo(width, up(value));
    c.stroke();
  });
  names.forEach((label, k) => {
    c.strokeStyle = COLOURS[CURVES[k]];
    c.beginPath();
    shown.forEach((p) => c.lineTo(across(p.now), up(p[name][k])));
    c.stroke();
    c.fillStyle = COLOURS[CURVES[k]];
    c.fillText(label, 50 + ((width - 50) / names.length) * k, 12);
  });
}

const NAMES = {
  error: () => ({ pose: ["x (m)", "y (m)", "heading (rad)"], drive: ["speed and tilt (m/s)", "yaw rate (rad/s)"], I: ["x (m)", "y (m)"], II: ["x (m)", "heading (rad)"], III: ["y (m)", "heading (rad)"] }[settings.law] || ["distance (m)", "speed (m/s)"]),
  tau: () => ROBOTS[settings.robot].inputs,
  use: () => ROBOTS[settings.robot].contacts,
};

/* -- pointer and buttons ----------------------------------------------------------------------------------------------- */

/* Where on the floor an event is, m. */
function place(event) {
  const { left, top, width, height } = element("floor").getBoundingClientRect();
  return [middle.x + (event.clientX - left - width / 2) / scale, middle.y - (event.clientY - top - height / 2) / scale];
}

function press(event) {
  const at = place(event), { x } = now, { handle, size } = kindOf(settings.robot);
  const away = (px, py) => Math.hypot(at[0] - px, at[1] - py);
  const nose = away(x[0] + handle * Math.cos(x[2]), x[1] + handle * Math.sin(x[2])), body = away(x[0], x[1]);
  element("floor").setPointerCapture(event.pointerId);
  if (drawing) drawing = [at];
  else if (nose < Math.min(body, Math.max(0.5, 20 / scale))) grabbed = "nose";
  else if (body < Math.max(1.2 * size, 30 / scale)) grabbed = [x[0] - at[0], x[1] - at[1]];
}

/* Each move of a robot starts a run there, so that the page tells what the law does in that state. */
function move(event) {
  if (!event.buttons) return;
  const [x, y] = place(event), state = [...now.x];
  if (drawing?.length) {
    const [u, v] = drawing[drawing.length - 1];
    if (Math.hypot(x - u, y - v) > 0.8 * kindOf(settings.robot).size && drawing.length < 90) drawing.push([x, y]);
  } else if (grabbed === "nose") {
    state[2] = Math.atan2(y - state[1], x - state[0]);
    change({ x: state }, false);
  } else if (grabbed) {
    [state[0], state[1]] = [x + grabbed[0], y + grabbed[1]];
    change({ x: state }, false);
  }
}

function release() {
  const carried = grabbed;
  grabbed = null;
  if (drawing?.length) followDrawn(drawing);
  else if (carried) change({ x: settings.x });
}

/* Arrow keys move the robot; left and right with shift turn it. */
function key(event) {
  const way = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1 }[event.key], x = [...now.x];
  if (!way) return;
  event.preventDefault();
  if (/Up|Down/.test(event.key)) x[1] += 0.2 * way;
  else if (event.shiftKey) x[2] -= 0.2 * way;
  else x[0] += 0.2 * way;
  change({ x });
}

/* Follow the points drawn, smoothed; the path is closed if they end near where they began. */
function followDrawn(points) {
  const closed = points.length > 5 && Math.hypot(points[0][0] - points.at(-1)[0], points[0][1] - points.at(-1)[1]) < 2 * kindOf(settings.robot).size;
  const smooth = (list) => list.map((p, k) => {
    const [before, after] = closed ? [list.at(k - 1), list[(k + 1) % list.length]] : [list[k - 1] || p, list[k + 1] || p];
    return [(before[0] + 2 * p[0] + after[0]) / 4, (before[1] + 2 * p[1] + after[1]) / 4];
  });
  setDrawing(null);
  if (points.length < 3) return;
  const drawn = arcsThrough(smooth(smooth(smooth(points))), closed), [x, y, heading] = drawn[0];
  const rest = now.x.slice(5).map((_, k) => (k < trailersOf(settings.robot) ? heading : 0));
  change({ law: "IV path", drawn, closed, x: [x, y, heading, 0, 0, ...rest] });
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
element("again").addEventListener("click", () => { trace = []; change({ x: defaultsOf(settings.robot).x, along: 0 }); });
element("draw").addEventListener("click", () => setDrawing(drawing ? null : []));
element("spec").addEventListener("click", () => { change({}, false); copy(spec(settings)); });
element("link").addEventListener("click", () => { change({}, false); copy(location.href); });
addEventListener("hashchange", restore);
restore();
requestAnimationFrame(frame);
