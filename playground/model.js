"use strict";
/*
 * What the page simulates, without anything of the page: settings, the numbers that they mean for playground.c, the SPEC of the
 * same run, and the loop. Before this, build.py puts MODULE, LAYOUT and PARAMETERS.
 */

const LAWS = ["I", "II", "III", "IV line", "IV circle", "IV ellipse", "IV path"]; // in the order of `laws` in playground.c
const MODES = ["cut", "slow", "grip"]; // as noslip_on_limit
const PERIOD = 0.01, TOLERANCE = 1e-10, MARGIN = 0.05;
const [B, D, RADIUS] = [PARAMETERS.b, PARAMETERS.d, PARAMETERS.r];

const DEFAULTS = {
  law: "IV circle", kp: 1, kd: 2.5, kv: 2, speed: 1.4, L: 0, size: 5, angle: 0,
  believed: 30, mass: 30, mu: 0.7, limit: 0, mode: "cut",
  x: [7, -2, Math.PI / 2, 0, 0, 0, 0], // at the start of the run: x_c, y_c, phi, theta_r, theta_l, thetadot_r, thetadot_l
  along: 0, // m, of the desired point of Types I to III on the line, at the start
  drawn: [], closed: false, // arcs [x, y, heading, radius, angle] of the drawn path
};

/* The curve of the law, by the names of a SPEC. */
function curve(s) {
  const angle = (s.angle * Math.PI) / 180;
  return {
    "IV line": { A: -Math.sin(angle), B: Math.cos(angle), C: 0 },
    "IV circle": { x_f: 0, y_f: 0, R: s.size },
    "IV ellipse": { a: 1.5 * s.size, b: s.size },
  }[s.law] || {};
}

/* Desired outputs of Types I to III: position and velocity. The heading is the one nearest to that of the start. */
function reference(s) {
  const angle = (s.angle * Math.PI) / 180, c = Math.cos(angle), d = Math.sin(angle), turn = 2 * Math.PI;
  const heading = angle + turn * Math.round((s.x[2] - angle) / turn);
  return {
    I: { position: [c * s.along, d * s.along], velocity: [c * s.speed, d * s.speed] },
    II: { position: [c * s.along, heading], velocity: [c * s.speed, 0] },
    III: { position: [d * s.along, heading], velocity: [d * s.speed, 0] },
  }[s.law];
}

/* The arcs of the drawn path from the one on which the robot is nearest. */
function route(s) {
  if (s.law !== "IV path") return [];
  const away = s.drawn.map(([x, y]) => Math.hypot(x - s.x[0], y - s.x[1])), first = away.indexOf(Math.min(...away));
  return [...s.drawn.slice(first), ...(s.closed ? s.drawn.slice(0, first) : [])];
}

/* What happens at a limit: "slow" needs an output of relative degree 1, which only Type IV has. */
function mode(s) {
  if (s.mode === "grip") return "grip";
  return s.limit > 0 && s.mode === "slow" && s.law.startsWith("IV") ? "slow" : "cut";
}

/* The numbers of playground.c, by name. */
function numbers(s) {
  const wanted = reference(s), parameters = Object.values(PARAMETERS), place = Object.keys(PARAMETERS).indexOf("m_c");
  const [p, v] = wanted ? [wanted.position, wanted.velocity] : [[0, s.speed], [0, 0]];
  const arcs = route(s).map(([x, y, heading, radius, angle]) => [x, y, heading, Math.sign(angle) / radius, radius * Math.abs(angle)]);
  return {
    law: LAWS.indexOf(s.law), believed: parameters.with(place, s.believed), plant: parameters.with(place, s.mass),
    L: s.L, config: Object.values(curve(s)), gains: wanted ? [s.kp, s.kd, s.kp, s.kd] : [s.kp, s.kd, s.kv, 0],
    limit: s.limit, mode: MODES.indexOf(mode(s)), mu: s.mu, margin: MARGIN,
    offset: [p[0], v[0], 0, p[1], v[1], 0], slope: [v[0], 0, 0, v[1], 0, 0],
    count: arcs.length, closed: +s.closed, segments: arcs.flat(), period: PERIOD, tolerance: TOLERANCE, x: s.x,
  };
}

/* A SPEC that `noslip simulate` runs with the same numbers, bit for bit. */
function spec(s, duration = 10) {
  const table = (entries) => `{ ${Object.entries(entries).map(([key, value]) => `${key} = ${value}`).join(", ")} }`;
  const list = (values) => `[${values.join(", ")}]`;
  const wanted = reference(s), [type, kind] = s.law.split(" ");
  const arcs = route(s).map(([x, y, heading, radius, angle]) =>
    `  ${table({ kind: '"arc"', from: list([x, y]), heading, radius, angle })},\n`);
  const path = arcs.length ? `{ kind = "composite", closed = ${s.closed}, segments = [\n${arcs.join("")}] }`
    : table({ kind: `"${kind}"`, ...curve(s) });
  const limits = [...(s.limit > 0 ? [`torque = ${s.limit} # N m`] : []), `mode = "${mode(s)}"`, ...(mode(s) === "grip" ? [`margin = ${MARGIN}`] : [])];
  return [
    "# A run of the playground: noslip simulate FILE -o run.csv --plot run.png", "",
    'robot = "labmate"', `parameters = { m_c = ${s.believed} } # kg, as the controller knows it`, `plant = { m_c = ${s.mass} }`,
    `gains = ${table(wanted ? { kp: s.kp, kd: s.kd } : { kp: s.kp, kd: s.kd, kv: s.kv })}`, "",
    "[output]", `type = "${type}"`, `L = ${s.L} # m`, ...(kind ? [`path = ${path}`] : []), "",
    "[reference]", ...(wanted ? [`position = ${list(wanted.position)}`, `velocity = ${list(wanted.velocity)}`] : [`speed = ${s.speed} # m/s`]), "",
    "[initial]", `q = ${list(s.x.slice(0, 5))}`, `nu = ${list(s.x.slice(5))} # rad/s`, "",
    ...(s.limit > 0 || s.mode === "grip" ? ["[limits]", ...limits, ""] : []),
    "[contact]", `mu = ${s.mu}`, "",
    "[simulation]", `duration = ${duration} # s`, `period = ${PERIOD} # s`, `output_step = ${PERIOD} # s`,
    `tolerance = ${TOLERANCE}`, 'backend = "c"', "",
  ].join("\n");
}

/* Arcs [x, y, heading, radius, angle] through points: two between neighbours, all tangent to each other. */
function arcsThrough(points, closed) {
  const n = points.length, at = (k) => points[closed ? (k + n) % n : Math.max(0, Math.min(n - 1, k))];
  const tangents = points.map((_, k) => {
    const dx = at(k + 1)[0] - at(k - 1)[0], dy = at(k + 1)[1] - at(k - 1)[1], length = Math.hypot(dx, dy);
    return [dx / length, dy / length];
  });
  const arc = ([x, y], [c, d], [u, v]) => {
    const along = c * (u - x) + d * (v - y), left = c * (v - y) - d * (u - x), straight = 1e-8; // rad
    const bend = 2 * Math.atan2(left, along), angle = Math.abs(bend) > straight ? bend : straight;
    return [x, y, Math.atan2(d, c), Math.hypot(along, left) / (2 * Math.sin(Math.abs(angle) / 2)), angle];
  };
  const arcs = [];
  for (let k = 0; k < (closed ? n : n - 1); k++) {
    const [p, q] = [at(k), at(k + 1)], [s, t] = [tangents[k], tangents[(k + 1) % n]];
    const v = [q[0] - p[0], q[1] - p[1]], vv = v[0] ** 2 + v[1] ** 2, vt = v[0] * (s[0] + t[0]) + v[1] * (s[1] + t[1]);
    const bend = 2 * (1 - s[0] * t[0] - s[1] * t[1]);
    const d = bend > 1e-9 ? (Math.sqrt(vt * vt + bend * vv) - vt) / bend : vv / (2 * vt); // length of both tangents to the join
    const join = [(p[0] + q[0] + d * (s[0] - t[0])) / 2, (p[1] + q[1] + d * (s[1] - t[1])) / 2];
    const first = arc(p, s, join), turned = first[2] + first[4];
    arcs.push(first, arc(join, [Math.cos(turned), Math.sin(turned)], q));
  }
  return arcs;
}

/* The loop in WebAssembly: its numbers by name. */
class Loop {
  constructor() {
    const bytes = Uint8Array.from(atob(MODULE), (letter) => letter.charCodeAt(0));
    this.c = new WebAssembly.Instance(new WebAssembly.Module(bytes)).exports;
    this.doubles = new Float64Array(this.c.memory.buffer, this.c.playground_numbers());
  }

  get(name) {
    const [place, count] = LAYOUT[name];
    return count > 1 ? Array.from(this.doubles.subarray(place, place + count)) : this.doubles[place];
  }

  /* Start a run with these settings; answers whether the law gives torques. */
  start(s) {
    for (const [name, value] of Object.entries(numbers(s))) this.doubles.set([value].flat(), LAYOUT[name][0]);
    return this.c.playground_start() >= 0;
  }

  /* Go on by a period. */
  step() {
    return this.c.playground_step() >= 0;
  }

  get status() {
    const bytes = new Uint8Array(this.c.memory.buffer, this.c.noslip_status_name(this.get("status")));
    return String.fromCharCode(...bytes.subarray(0, bytes.indexOf(0)));
  }
}
