"use strict";
/*
 * What the page simulates, without anything of the page: settings, the numbers that they mean for playground.c, the SPEC of the
 * same run, and the loop. Before this, build.py puts MODULES, LAYOUT and ROBOTS.
 */

const LAWS = { // what the outputs of each are, in words
  I: "x and y of a moving point", II: "x and heading", III: "y and heading", "IV line": "along a line", "IV circle": "along a circle",
  "IV ellipse": "along an ellipse", "IV path": "along a path that you draw", pose: "place and heading", drive: "speed and turn, upright",
};
const MODES = { cut: "cut the torque", slow: "slow down", grip: "keep rolling" }; // as noslip_on_limit
const PERIOD = 0.01, TOLERANCE = 1e-10, MARGIN = 0.05;
const AHEAD = 600, HUGE = 1e4; // a start that the law can leave lasts so many periods, with smaller torques, N m

const DEFAULTS = {
  robot: "labmate", law: "IV circle", kp: 1, kd: 2.5, kv: 2, speed: 1.4, turn: 0, L: 0, size: 5, angle: 0,
  believed: 30, mass: 30, believedTrailers: 80, trailers: 80, // kg; of each trailer
  mu: 0.7, limit: 0, mode: "cut",
  x: [7, -2, Math.PI / 2, 0, 0, 0, 0], // at the start of the run: coordinates and quasi-velocities
  along: 0, // m, of the desired point on the line, at the start, where it moves
  drawn: [], closed: false, // arcs [x, y, heading, radius, angle] of the drawn path
};

/* How robots differ, by the first part of their names: the parameter that is the mass, other defaults, by how much larger ranges of
 * lengths, speeds and masses are than the LABMATE's, where the handle to turn the robot is (m ahead of the first coordinates), and which
 * lines are the wheels of each contact, and how far the direction of `along` there is turned to the left of the wheel's, rad. */
const KINDS = {
  labmate: { title: "LABMATE", mass: "m_c", size: 1, heavy: 1, handle: 1, wheels: [[1], [2]] },
  car: {
    title: "car", mass: "m", size: 3, heavy: 40, handle: 3.4, wheels: [[1, 2], [3]],
    defaults: { L: 1, size: 15, speed: 5, kp: 0.25, kd: 1, kv: 0.5, believed: 1200, mass: 1200, x: [17, -5, Math.PI / 2, 0, 0, 0, 0] },
  },
  forklift: {
    title: "forklift", mass: "m", size: 1.5, heavy: 15, handle: 1.8, wheels: [[1, 2], [3]],
    defaults: { L: 0.4, speed: 0.8, believed: 600, mass: 600, mu: 0.7 },
  },
  mecanum: {
    title: "mecanum platform", mass: "m", size: 0.5, heavy: 1, handle: 0.45, wheels: [[1], [2], [3], [4]], across: [1, -1, -1, 1].map((k) => (k * Math.PI) / 4),
    defaults: { law: "pose", speed: 0.3, turn: 0.3, angle: 60, believed: 20, mass: 20, x: [0.5, -0.4, 0, 0, 0, 0, 0, 0, 0, 0] },
  },
  balancer: {
    title: "balancer", mass: "m", size: 0.5, heavy: 0.2, handle: 0.3, wheels: [[1], [2]],
    defaults: { law: "drive", speed: 0.6, turn: 0.5, limit: 4, believed: 5, mass: 5, x: [0, 0, 0, 0.3, 0, 0, 0, 0, 0] },
  },
  tractor_trailer: {
    title: "tractor", mass: "m", size: 1, heavy: 5, handle: 1, wheels: [[1], [2], [5, 6], [9, 10], [13, 14]],
    defaults: { L: 0.5, speed: 1, believed: 150, mass: 150 },
  },
};

const kindOf = (robot) => KINDS[robot.split(":")[0]];
const trailersOf = (robot) => +(robot.split(":")[1] || 0);
const titleOf = (robot) => {
  const count = trailersOf(robot);
  return kindOf(robot).title + (robot.includes(":") ? ` with ${count} trailer${count === 1 ? "" : "s"}` : "");
};
const nameInC = (law) => law.replace(/^I.*/, (type) => `type_${type.toLowerCase().replace(" ", "_").replace("path", "segment")}`);
const lawsOf = (robot) => Object.keys(LAWS).filter((law) => nameInC(law) in ROBOTS[robot].laws);
const modesOf = (robot) => Object.keys(MODES).filter((mode) => mode !== "grip" || ROBOTS[robot].grips);
const isOwn = (law) => !law.startsWith("I"); // of the outputs that only this robot has
const movesOnLine = (law) => /^I+$|pose/.test(law); // the desired point moves along a line

/* The settings with which a robot begins: at rest on the right of the circle, trailers behind it. */
function defaultsOf(robot) {
  const settings = { ...DEFAULTS, ...kindOf(robot).defaults, robot }, heading = settings.x[2];
  return { ...settings, x: settings.x.toSpliced(5, 0, ...Array(trailersOf(robot)).fill(heading)) };
}

/* The parameters that settings change, as the controller believes them and as they are, kg. */
function masses(s) {
  const { mass } = kindOf(s.robot), names = Array.from({ length: trailersOf(s.robot) }, (_, k) => `m_${k + 1}`);
  const all = (body, trailer) => ({ [mass]: body, ...Object.fromEntries(names.map((name) => [name, trailer])) });
  return { believed: all(s.believed, s.believedTrailers), plant: all(s.mass, s.trailers) };
}

/* The curve of the law, or what else its outputs have besides L, by the names of a SPEC. */
function curve(s) {
  const angle = (s.angle * Math.PI) / 180;
  return {
    "IV line": { A: -Math.sin(angle), B: Math.cos(angle), C: 0 },
    "IV circle": { x_f: 0, y_f: 0, R: s.size },
    "IV ellipse": { a: 1.5 * s.size, b: s.size },
    drive: { H: 1, k: 3 },
  }[s.law] || {};
}

/* Desired outputs, but of Type IV: position and velocity. The heading is the one nearest to that of the start. */
function reference(s) {
  const angle = (s.angle * Math.PI) / 180, c = Math.cos(angle), d = Math.sin(angle), turn = 2 * Math.PI;
  const heading = angle + turn * Math.round((s.x[2] - angle) / turn);
  return {
    I: { position: [c * s.along, d * s.along], velocity: [c * s.speed, d * s.speed] },
    II: { position: [c * s.along, heading], velocity: [c * s.speed, 0] },
    III: { position: [d * s.along, heading], velocity: [d * s.speed, 0] },
    pose: { position: [c * s.along, d * s.along, s.x[2]], velocity: [c * s.speed, d * s.speed, s.turn] },
    drive: { position: [s.speed, s.turn], velocity: [0, 0] },
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

/* The gains, by the names of a SPEC; those of each output, but for Type IV. */
const gainsOf = ({ law, kp, kd, kv }) => (law === "drive" ? { kv } : law.startsWith("IV") ? { kp, kd, kv } : { kp, kd });

/* The numbers of playground.c, by name. */
function numbers(s) {
  const wanted = reference(s), { believed, plant } = masses(s), { parameters, laws } = ROBOTS[s.robot], name = nameInC(s.law);
  const gains = Object.values(gainsOf(s));
  const [p, v] = wanted ? [wanted.position, wanted.velocity] : [[0, s.speed], [0, 0]], desired = laws[name];
  const offset = Array(9).fill(0), slope = Array(9).fill(0);
  desired.forEach((place, k) => { [offset[place], offset[place + 1], slope[place]] = [p[k], v[k], v[k]]; });
  const arcs = route(s).map(([x, y, heading, radius, angle]) => [x, y, heading, Math.sign(angle) / radius, radius * Math.abs(angle)]);
  return {
    law: Object.keys(laws).indexOf(name), believed: Object.values({ ...parameters, ...believed }), plant: Object.values({ ...parameters, ...plant }),
    config: [...(isOwn(s.law) ? [] : [s.L]), ...Object.values(curve(s))], gains: wanted ? desired.flatMap(() => gains) : gains,
    limit: s.limit, mode: Object.keys(MODES).indexOf(mode(s)), mu: s.mu, margin: MARGIN,
    offset, slope, desired,
    count: arcs.length, closed: +s.closed, segments: arcs.flat(), period: PERIOD, tolerance: TOLERANCE, x: s.x,
  };
}

/* A SPEC that `noslip simulate` runs with the same numbers, bit for bit. */
function spec(s, duration = 10) {
  const table = (entries) => `{ ${Object.entries(entries).map(([key, value]) => `${key} = ${value}`).join(", ")} }`;
  const list = (values) => `[${values.join(", ")}]`;
  const wanted = reference(s), [type, kind] = s.law.split(" "), { believed, plant } = masses(s), { coordinates } = ROBOTS[s.robot];
  const arcs = route(s).map(([x, y, heading, radius, angle]) =>
    `  ${table({ kind: '"arc"', from: list([x, y]), heading, radius, angle })},\n`);
  const own = isOwn(type), numbers = own && Object.keys(curve(s)).length ? [`parameters = ${table(curve(s))}`] : [];
  const path = arcs.length ? `{ kind = "composite", closed = ${s.closed}, segments = [\n${arcs.join("")}] }`
    : table({ kind: `"${kind}"`, ...curve(s) });
  const limits = [...(s.limit > 0 ? [`torque = ${s.limit} # N m`] : []), `mode = "${mode(s)}"`, ...(mode(s) === "grip" ? [`margin = ${MARGIN}`] : [])];
  return [
    "# A run of the playground: noslip simulate FILE -o run.csv --plot run.png", "",
    `robot = "${s.robot}"`, `parameters = ${table(believed)} # kg, as the controller knows them`, `plant = ${table(plant)}`,
    `gains = ${table(gainsOf(s))}`, "",
    "[output]", `type = "${type}"`, ...(own ? numbers : [`L = ${s.L} # m`]), ...(kind ? [`path = ${path}`] : []), "",
    "[reference]", ...(wanted ? [`position = ${list(wanted.position)}`, `velocity = ${list(wanted.velocity)}`] : [`speed = ${s.speed} # m/s`]), "",
    "[initial]", `q = ${list(s.x.slice(0, coordinates))}`, `nu = ${list(s.x.slice(coordinates))}`, "",
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

/* The loop of a robot in WebAssembly: its numbers by name. */
class Loop {
  /* The loop of a robot; a promise, since its module is compressed. */
  static async of(robot) {
    const bytes = Uint8Array.from(atob(MODULES[robot]), (letter) => letter.charCodeAt(0));
    const code = await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
    return new Loop(robot, (await WebAssembly.instantiate(code)).instance.exports);
  }

  constructor(robot, c) {
    const { states, contacts, lines, inputs, laws } = ROBOTS[robot], outputs = Object.values(laws)[0].length;
    this.c = c;
    this.doubles = new Float64Array(c.memory.buffer, c.playground_numbers());
    this.counts = { x: states, tau: inputs.length, y: outputs, error: outputs, use: contacts.length, forces: 2 * contacts.length, lines: 2 * lines.reduce((a, b) => a + b) };
  }

  /* A number, or the numbers that this robot has of an array. */
  get(name) {
    const [place, most] = LAYOUT[name], count = this.counts[name] ?? most;
    return most > 1 ? Array.from(this.doubles.subarray(place, place + count)) : this.doubles[place];
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

  /* How regular the law is at headings all around, -1 to 1; 0 is singular. */
  get regular() {
    this.c.playground_headings();
    return this.get("regular");
  }

  /* A start like that of settings from which the law has torques for a while: if need be the robot stands there, its wheels and trailers
   * straight, and is turned as little as possible. The start itself, if none has. */
  startFor(s) {
    const angle = Math.PI / 18, last = 5 + trailersOf(s.robot);
    const standing = (turn) => s.x.map((value, k) => (k < 2 ? value : k === 2 || (k >= 5 && k < last) ? s.x[2] + turn : 0));
    const turns = Array.from({ length: 36 }, (_, k) => angle * Math.ceil(k / 2) * (k % 2 ? 1 : -1));
    const lasts = (x) => {
      const goes = (good) => good && this.get("tau").every((torque) => Math.abs(torque) < HUGE);
      let good = goes(this.start({ ...s, x }));
      for (let k = 0; good && k < AHEAD; k++) good = goes(this.step());
      return good;
    };
    return [s.x, ...turns.map(standing)].find(lasts) || s.x;
  }

  get status() {
    const bytes = new Uint8Array(this.c.memory.buffer, this.c.noslip_status_name(this.get("status")));
    return String.fromCharCode(...bytes.subarray(0, bytes.indexOf(0)));
  }

  /* All that the page shows of now. */
  get now() {
    const names = ["t", "x", "tau", "error", "use", "forces", "motion", "lines"];
    return { ...Object.fromEntries(names.map((name) => [name, this.get(name)])), status: this.status };
  }
}

/* In a worker: answers what the page asks. { run, settings } starts a run, with `free` from where its law can go on; { run, steps } goes
 * on with it. The answer has the number of the run, its start, what there is to show after each step, the headings, and whether the law
 * gives torques. */
function serve() {
  const loops = {};
  let loop, x, going = false;
  const answer = async ({ data: { run, settings, steps, free } }) => {
    const rows = [];
    if (settings) {
      loop = loops[settings.robot] ??= await Loop.of(settings.robot);
      x = free ? loop.startFor(settings) : settings.x;
      going = loop.start({ ...settings, x });
      rows.push(loop.now);
    }
    for (let k = 0; going && k < steps; k++) {
      going = loop.step();
      rows.push(loop.now);
    }
    postMessage({ run, x, rows, regular: loop.regular, going });
  };
  let before = Promise.resolve(); // one after the other, also while a module is unpacked
  onmessage = (event) => { before = before.then(() => answer(event)); };
}
