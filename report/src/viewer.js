"use strict";
// Draws the view that stands in the page. Convex bodies are drawn from the back to the front, which planes between them decide;
// lines and points come after, faint where a body hides them.
(async () => {
  const scene = JSON.parse(document.getElementById("view").textContent);
  // In a folder the address may ask for the replay of one of the scene's attempts.
  const view = (await globalThis.replayIn?.(scene)) ?? scene;
  const byId = (id) => document.getElementById(id);
  const canvas = byId("canvas"), pen = canvas.getContext("2d"), tip = byId("tip");
  const isDark = matchMedia("(prefers-color-scheme: dark)");
  // In a folder clicks on grasps open the replays of their attempts.
  for (const line of view.lines) {
    const attempt = line.label.match(/^[\w.-]+\/(\d+)[ :]/)?.[1];
    if (byId(`replay-${attempt}`)) line.opens = attempt;
    line.attempt = attempt;
  }

  // Colours that stay apart for the colour-blind (Okabe and Ito, 2008); a: opacity of a body that hides nothing.
  const [SKY, BLUE, ORANGE] = [[86, 180, 233], [0, 114, 178], [230, 159, 0]];
  // Those of outcomes are the style's, as in tables.
  const hues = new Map();
  isDark.addEventListener("change", () => hues.clear());
  const hue = (name) => {
    if (!hues.has(name)) {
      const hex = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
      hues.set(name, [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16)));
    }
    return hues.get(name);
  };
  const grey = () => (isDark.matches ? [150, 160, 170] : [120, 130, 140]);
  const STYLES = {
    object: { name: "objects", rgb: () => (isDark.matches ? [139, 150, 161] : [186, 196, 205]) },
    target: { name: "target", rgb: () => SKY },
    hit: { name: "what was hit", rgb: () => ORANGE },
    gripper: { name: "gripper", rgb: () => (isDark.matches ? [205, 211, 217] : [92, 102, 112]) },
    held: { name: "held", rgb: () => hue("held"), wide: 2.2 },
    slipped: { name: "slipped", rgb: () => hue("slipped"), wide: 1.6 },
    hit_other: { name: "hit other", rgb: () => hue("hit_other"), wide: 1.6 },
    empty: { name: "empty", rgb: () => hue("empty"), wide: 1.6 },
    approach_collision: { name: "approach collision", rgb: () => hue("approach_collision"), wide: 1.1 },
    pregrasp_collision: { name: "pregrasp collision", rgb: () => hue("pregrasp_collision"), wide: 1.1 },
    surface: { name: "surface as seen (TSDF)", rgb: () => BLUE },
    axes: { name: "axes", rgb: () => ORANGE, wide: 2 },
    camera: { name: "cameras", rgb: grey },
    workspace: { name: "workspace", rgb: grey },
    container: { name: "container", rgb: grey, a: 0.35 },
    table: { name: "table", rgb: () => (isDark.matches ? [58, 66, 74] : [232, 235, 238]) },
  };
  const style = (item) => STYLES[item.class] ?? { name: item.class, rgb: grey };
  const rgba = ([r, g, b], alpha = 1) => `rgba(${r | 0},${g | 0},${b | 0},${alpha})`;

  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const less = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => times(a, 1 / (Math.hypot(...a) || 1));
  function turn([x, y, z, w], p) {
    const t = times(cross([x, y, z], p), 2);
    return add(add(p, times(t, w)), cross([x, y, z], t));
  }

  // What is shown, and the moment.
  const shown = new Set([...view.bodies, ...view.lines, ...view.points].map((item) => item.class));
  view.hidden.forEach((name) => shown.delete(name));
  // Of attempts those that the page before had chosen.
  const OUTCOMES = ["held", "slipped", "hit_other", "empty", "approach_collision", "pregrasp_collision"];
  const asked = new URLSearchParams(location.hash.slice(1)).get("outcome");
  if (asked) OUTCOMES.forEach((name) => shown[name === asked ? "add" : "delete"](name));
  // The legend can bring other outcomes back.
  for (const line of view.lines) line.isOther = line.attempt && globalThis.isWanted && (!asked || line.class === asked) && !isWanted(line.attempt);
  let frame = 0, marked = null;
  const isThere = (item) => shown.has(item.class) && !item.isOther && (!item.frames || (item.frames[0] <= frame && frame <= item.frames[1]));

  for (const body of view.bodies) {
    body.middle = times(body.corners_m.reduce(add), 1 / body.corners_m.length);
    body.radius = Math.max(...body.corners_m.map((c) => Math.hypot(...less(c, body.middle))));
    body.planes = body.faces.map(([a, b, c]) => {
      const [p, q, r] = [a, b, c].map((i) => body.corners_m[i]);
      return unit(cross(less(q, p), less(r, q)));
    });
    // Edges with the faces at both sides: what is round has none but its outline.
    const sides = new Map();
    body.faces.forEach((face, i) => face.forEach((a, k) => {
      const b = face[(k + 1) % face.length], key = a < b ? `${a} ${b}` : `${b} ${a}`;
      sides.set(key, [...(sides.get(key) ?? [a, b]), i]);
    }));
    body.edges = [...sides.values()].map(([a, b, f, g = f]) => ({ a, b, f, g, sharp: dot(body.planes[f], body.planes[g]) < 0.9 }));
  }
  // Where a body is now: corners, planes, middle.
  function placed(body) {
    const pose = body.poses[Math.min(frame, body.poses.length - 1)];
    const at = pose.slice(0, 3), q = pose.slice(3);
    const corners = body.corners_m.map((c) => add(turn(q, c), at));
    const planes = body.planes.map((n, i) => {
      const normal = turn(q, n);
      return [...normal, dot(normal, corners[body.faces[i][0]])];
    });
    return { body, corners, planes, middle: add(turn(q, body.middle), at), radius: body.radius };
  }

  // The camera goes round a point. Home is where the workspace, or all there is, fills the picture.
  const around = (() => {
    const fixed = view.lines.filter((l) => l.class === "workspace").flatMap((l) => l.points_m);
    const ends = ({ corners_m, poses }) => [poses[0], poses.at(-1)].flatMap((pose) => corners_m.map((c) => add(turn(pose.slice(3), c), pose.slice(0, 3))));
    const all = fixed.length ? fixed : [...view.lines.flatMap((l) => l.points_m), ...view.bodies.flatMap(ends)];
    if (!all.length) all.push([0, 0, 0], [0.3, 0.3, 0.3]);
    const low = [0, 1, 2].map((i) => Math.min(...all.map((p) => p[i])));
    const high = [0, 1, 2].map((i) => Math.max(...all.map((p) => p[i])));
    // In a workspace things lie low.
    return { middle: times(add(low, high), 0.5), radius: 0.5 * Math.hypot(...less(high, low)), sunk: fixed.length ? 0.24 : 0 };
  })();
  const home = () => ({ yaw: -1.05, pitch: 0.5, away: (around.sunk ? 2.7 : 2.3) * around.radius, centre: add(around.middle, [0, 0, -around.sunk * around.radius]) });
  let camera = home(), eye, right, up, ahead, focal, width, height;
  function aim() {
    const [sy, cy, sp, cp] = [Math.sin(camera.yaw), Math.cos(camera.yaw), Math.sin(camera.pitch), Math.cos(camera.pitch)];
    ahead = [-cp * cy, -cp * sy, -sp];
    right = [-sy, cy, 0];
    up = [-sp * cy, -sp * sy, cp];
    eye = less(camera.centre, times(ahead, camera.away));
    focal = 1.28 * Math.min(width, height * 1.15);
  }
  function onScreen(p) {
    const off = less(p, eye), depth = Math.max(dot(off, ahead), 1e-3), scale = focal / depth;
    return [width / 2 + dot(off, right) * scale, height / 2 - dot(off, up) * scale, depth];
  }

  // Which of two bodies covers the other: 1 if b may cover a, -1 if a may cover b, 0 if neither does.
  function order(a, b) {
    const reach = (p) => { const [x, y, depth] = onScreen(p.middle); return [x, y, (p.radius * focal) / Math.max(depth - p.radius, 0.01)]; };
    const [ax, ay, ar] = reach(a), [bx, by, br] = reach(b);
    if (Math.hypot(ax - bx, ay - by) > ar + br) return 0;
    let best = -0.006, found = 0;
    const look = (of, other, sign) => {
      for (const [x, y, z, d] of of.planes) {
        const gap = Math.min(...other.corners.map((c) => c[0] * x + c[1] * y + c[2] * z)) - d;
        if (gap > best) {
          best = gap;
          found = dot([x, y, z], eye) > d ? sign : -sign;
        }
      }
    };
    look(a, b, 1);
    look(b, a, -1);
    return found || Math.sign(Math.hypot(...less(a.middle, eye)) - Math.hypot(...less(b.middle, eye)));
  }
  function fromBackToFront(things) {
    const waits = things.map(() => new Set());
    for (let i = 0; i < things.length; i++) {
      for (let j = 0; j < i; j++) {
        const which = order(things[i], things[j]);
        if (which > 0) waits[j].add(i);
        if (which < 0) waits[i].add(j);
      }
    }
    const left = new Set(things.keys()), sorted = [];
    const far = (i) => Math.hypot(...less(things[i].middle, eye));
    while (left.size) {
      const free = [...left].filter((i) => [...waits[i]].every((j) => !left.has(j)));
      const next = (free.length ? free : [...left]).reduce((a, b) => (far(a) >= far(b) ? a : b));
      left.delete(next);
      sorted.push(things[next]);
    }
    return sorted;
  }
  // Whether a body lies between a point and the eye, by more than some metres of it.
  function isHidden(p, things, slack) {
    const way = less(eye, p), length = Math.hypot(...way);
    return things.some(({ planes, middle, radius }) => {
      const off = less(middle, p), along = dot(off, way) / length;
      if (along < -radius || dot(off, off) - along * along > radius * radius) return false;
      let enter = 0, leave = 1;
      for (const [x, y, z, d] of planes) {
        const speed = x * way[0] + y * way[1] + z * way[2], gap = d - (x * p[0] + y * p[1] + z * p[2]);
        if (Math.abs(speed) < 1e-9) { if (gap < 0) return false; continue; }
        const t = gap / speed;
        if (speed > 0) leave = Math.min(leave, t); else enter = Math.max(enter, t);
        if (enter >= leave) return false;
      }
      return (leave - enter) * length > slack;
    });
  }

  let drawn = [], traced = [];
  const LIGHT = unit([0.35, -0.5, 0.8]);
  function drawBody(thing) {
    const { body, planes } = thing, look = style(body), spots = thing.corners.map(onScreen);
    const faces = planes.map(([x, y, z, d]) => dot([x, y, z], eye) > d), rgb = look.rgb();
    thing.outlines = [];
    body.faces.forEach((face, i) => {
      if (!faces[i]) return;
      const path = new Path2D();
      face.forEach((c, k) => (k ? path.lineTo(spots[c][0], spots[c][1]) : path.moveTo(spots[c][0], spots[c][1])));
      path.closePath();
      pen.fillStyle = pen.strokeStyle = rgba(times(rgb, 0.7 + 0.32 * Math.max(0, dot(planes[i], LIGHT))), look.a ?? 1);
      pen.fill(path);
      pen.lineWidth = 0.7; // closes the seam between two faces
      if (!look.a) pen.stroke(path);
      thing.outlines.push(path);
    });
    const edges = new Path2D();
    for (const { a, b, f, g, sharp } of body.edges) {
      if (!(faces[f] || faces[g]) || (!sharp && faces[f] && faces[g])) continue;
      edges.moveTo(spots[a][0], spots[a][1]);
      edges.lineTo(spots[b][0], spots[b][1]);
    }
    pen.strokeStyle = body === marked ? rgba(isDark.matches ? [255, 255, 255] : [0, 0, 0]) : rgba(times(rgb, isDark.matches ? 0.45 : 0.62), look.a ? 0.8 : 1);
    pen.lineWidth = body === marked ? 2 : 1;
    pen.stroke(edges);
  }
  function drawLine(line, opaque) {
    const look = style(line), near = [new Path2D(), new Path2D()], spots = line.points_m.map(onScreen);
    const slack = 0.001;
    for (let i = 1; i < spots.length; i++) {
      const [a, b] = [line.points_m[i - 1], line.points_m[i]], way = less(b, a);
      const pieces = !opaque.length ? 1 : Math.min(40, Math.ceil(Math.hypot(...way) / 0.004));
      for (let k = 0; k < pieces; k++) {
        const hidden = isHidden(add(a, times(way, (k + 0.5) / pieces)), opaque, slack);
        const [p, q] = [onScreen(add(a, times(way, k / pieces))), onScreen(add(a, times(way, (k + 1) / pieces)))];
        near[hidden ? 1 : 0].moveTo(p[0], p[1]);
        near[hidden ? 1 : 0].lineTo(q[0], q[1]);
      }
    }
    pen.lineWidth = (look.wide ?? 1) + (line === marked ? 2.2 : 0);
    pen.lineCap = "round";
    pen.strokeStyle = rgba(style(line).rgb(), line === marked ? 0.5 : 0.16);
    pen.stroke(near[1]);
    pen.strokeStyle = rgba(style(line).rgb(), 0.95);
    pen.stroke(near[0]);
    traced.push({ line, spots });
  }
  function drawPoints(points, opaque) {
    const look = style(points);
    for (const p of points.points_m) {
      const [x, y, depth] = onScreen(p);
      const side = Math.max(1.4, (0.0016 * focal) / depth);
      pen.fillStyle = rgba(look.rgb(), isHidden(p, opaque, 0.008) ? 0.1 : 0.7);
      pen.fillRect(x - side / 2, y - side / 2, side, side);
    }
  }
  function draw() {
    waiting = false;
    const ratio = Math.min(devicePixelRatio || 1, 3);
    [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineJoin = "round";
    aim();
    const things = view.bodies.filter(isThere).map(placed);
    const opaque = things.filter((t) => !style(t.body).a);
    drawn = fromBackToFront(opaque);
    traced = [];
    drawn.forEach(drawBody);
    for (const points of view.points) if (isThere(points)) drawPoints(points, opaque);
    for (const line of view.lines) if (isThere(line)) drawLine(line, opaque);
    const clear = things.filter((t) => style(t.body).a);
    clear.forEach(drawBody);
    drawn.push(...clear);
  }
  let waiting = false;
  function redraw() {
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }

  // What lies under the pointer: a line within reach, else the front-most body.
  function under(x, y, reach) {
    let best = reach, found = null;
    for (const { line, spots } of traced) {
      if (!line.label || line.class === "workspace") continue;
      for (let i = 1; i < spots.length; i++) {
        const b = spots[i], a = spots[i - 1], way = [b[0] - a[0], b[1] - a[1]];
        const share = Math.min(1, Math.max(0, ((x - a[0]) * way[0] + (y - a[1]) * way[1]) / (way[0] ** 2 + way[1] ** 2 || 1)));
        const off = Math.hypot(x - a[0] - share * way[0], y - a[1] - share * way[1]);
        if (off < best) [best, found] = [off, line];
      }
    }
    if (found) return found;
    const ratio = canvas.width / width; // paths are asked for in pixels of the canvas
    return drawn.findLast((t) => t.body.label && t.outlines.some((path) => pen.isPointInPath(path, x * ratio, y * ratio)))?.body ?? null;
  }
  function point(event, reach) {
    const box = canvas.getBoundingClientRect(), [x, y] = [event.clientX - box.left, event.clientY - box.top];
    const found = under(x, y, reach);
    if (found !== marked) redraw();
    marked = found;
    tip.hidden = !found;
    canvas.classList.toggle("opens", Boolean(found?.opens));
    if (!found) return;
    tip.textContent = found.opens ? `${found.label}\nclick: replay` : found.label;
    tip.style.left = `${Math.max(4, Math.min(x + 14, width - tip.offsetWidth - 6))}px`;
    tip.style.top = `${y + 18 + tip.offsetHeight > height ? Math.max(4, y - tip.offsetHeight - 12) : y + 18}px`;
  }

  // The id of what is marked, such as 7/19, to the clipboard.
  function copy() {
    const id = marked?.label.match(/^[\w.-]+\/\d+/)?.[0];
    if (!id) return;
    navigator.clipboard?.writeText(id).then(() => { tip.textContent = `${id} copied`; }, () => {});
  }

  // One pointer turns, two zoom and shift.
  const pointers = new Map();
  let moved = 0;
  function shift(dx, dy) {
    const scale = camera.away / focal;
    camera.centre = add(camera.centre, add(times(right, -dx * scale), times(up, dy * scale)));
  }
  function zoom(by) { camera.away = Math.min(20 * around.radius, Math.max(0.25 * around.radius, camera.away * by)); }
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId), now = [event.clientX, event.clientY];
    if (!before) return point(event, 9);
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    moved += Math.hypot(dx, dy);
    pointers.set(event.pointerId, now);
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      zoom(Math.hypot(before[0] - other[0], before[1] - other[1]) / Math.max(8, Math.hypot(now[0] - other[0], now[1] - other[1])));
      shift(dx / 2, dy / 2);
    } else if (event.buttons & 6 || event.shiftKey) {
      shift(dx, dy);
    } else {
      camera.yaw -= dx * 0.008;
      camera.pitch = Math.min(1.55, Math.max(-1.2, camera.pitch + dy * 0.008));
    }
    tip.hidden = true;
    redraw();
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => {
      pointers.delete(event.pointerId);
      if (name !== "pointerup" || moved >= 6) return;
      const before = marked, isTouch = event.pointerType === "touch";
      point(event, isTouch ? 22 : 9);
      // A finger's first touch shows what is there, its second opens it.
      if (marked?.opens && (!isTouch || before === marked)) location.href = addressOf(marked.opens);
    });
  }
  canvas.addEventListener("pointerleave", (event) => {
    if (event.pointerType === "touch") return; // a finger that is lifted leaves what it showed
    tip.hidden = true;
    marked = null;
    redraw();
  });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(event.deltaY * 0.0012)); redraw(); }, { passive: false });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", () => { camera = home(); redraw(); });

  // How many things there are: an object of several pieces has one label, points count each.
  const number = (items) => {
    const points = items.filter((i) => view.points.includes(i)).reduce((sum, i) => sum + i.points_m.length, 0);
    return points + new Set(items.filter((i) => !view.points.includes(i)).map((i) => i.label)).size;
  };
  // The legend.
  const present = [...Object.keys(STYLES), ...new Set([...view.bodies, ...view.lines, ...view.points].map((i) => i.class))];
  for (const name of new Set(present)) {
    const items = [...view.bodies, ...view.lines, ...view.points].filter((item) => item.class === name);
    if (!items.length) continue;
    const row = document.createElement("label"), box = document.createElement("input"), spot = document.createElement("i");
    const count = document.createElement("span");
    box.type = "checkbox";
    box.checked = shown.has(name);
    box.onchange = () => { shown[box.checked ? "add" : "delete"](name); redraw(); };
    const paint = () => { spot.style.background = rgba(style(items[0]).rgb()); };
    isDark.addEventListener("change", () => { paint(); redraw(); });
    paint();
    count.className = "count";
    count.textContent = items.some((i) => i.frames) ? "" : number(items);
    row.append(box, spot, style(items[0]).name, count);
    byId("legend").append(row);
  }

  // The player.
  const last = view.frames.length - 1, rows = [...document.querySelectorAll("#events li")];
  let play = () => {}, go = () => {};
  if (last > 0) {
    const scrub = byId("scrub"), total = view.frames[last].time_s;
    let runs = false, then = 0, time = 0;
    scrub.max = last;
    view.events.forEach((event) => {
      const mark = document.createElement("b");
      mark.className = event.kind;
      mark.style.left = `${(100 * event.frame) / Math.max(1, last)}%`;
      mark.title = event.text;
      byId("marks").append(mark);
    });
    const show = () => {
      scrub.value = frame;
      byId("clock").textContent = `${view.frames[frame].time_s.toFixed(2)} of ${total.toFixed(2)} s`;
      const past = view.events.filter((event) => event.frame <= frame);
      const phase = past.findLast((event) => event.kind === "phase"), decided = past.findLast((event) => ["held", "failed"].includes(event.kind));
      byId("phase").textContent = [phase?.text, decided?.text].filter(Boolean).join(" · ");
      rows.forEach((row, i) => row.classList.toggle("past", view.events[i].frame <= frame));
      redraw();
    };
    const tick = (now) => {
      if (!runs) return;
      time += Math.max(0, (now - then) / 1000) * Number(byId("speed").value);
      then = now;
      while (frame < last && view.frames[frame + 1].time_s <= time) frame++;
      show();
      if (frame === last) return play(false);
      requestAnimationFrame(tick);
    };
    play = (on = !runs) => {
      runs = on;
      byId("play").textContent = on ? "❚❚" : "▶";
      if (!on) return;
      if (frame === last) frame = 0;
      [time, then] = [view.frames[frame].time_s, performance.now()];
      requestAnimationFrame(tick);
    };
    go = (to) => { play(false); frame = Math.min(last, Math.max(0, to)); show(); };
    scrub.oninput = () => go(Number(scrub.value));
    byId("play").onclick = () => play();
    show();
  }
  rows.forEach((row) => { row.firstElementChild.onclick = (event) => go(Number(event.currentTarget.dataset.frame)); });
  addEventListener("keydown", (event) => {
    const typed = event.target.closest?.("button, select, input");
    if (event.ctrlKey || event.metaKey || event.altKey || (typed && typed.id !== "scrub")) return;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === "c") copy();
    else if (event.key === " ") play();
    else if (step) go(frame + step * (event.shiftKey ? 10 : 1));
    else if (event.key === "Home") go(0);
    else if (event.key === "End") go(last);
    else return;
    event.preventDefault();
  });
  // Depth images: rays from a camera, whose pyramid goes from its eye through its corners, against the planes of bodies; the
  // table has no end.
  function drawDepth(camera, image, caption) {
    const [from, a, b, , , d] = camera.points_m, corner = less(a, from), across = less(b, a), along = less(d, a);
    const ahead = unit(cross(across, along)), scale = 1 / dot(corner, ahead);
    const wide = 160, high = Math.round((wide * Math.hypot(...along)) / Math.hypot(...across)), depths = new Float32Array(wide * high);
    const still = view.bodies.filter((body) => body.class !== "gripper").map(placed);
    for (let at = 0; at < depths.length; at++) {
      const [u, v] = [(at % wide) / (wide - 1), Math.floor(at / wide) / (high - 1)];
      const ray = times(add(corner, add(times(across, u), times(along, v))), scale), far = dot(ray, ray);
      let nearest = Infinity;
      for (const { body, planes, middle, radius } of still) {
        const off = less(middle, from), reach = dot(off, ray);
        if (body.class !== "table" && dot(off, off) - (reach * reach) / far > radius * radius) continue;
        let enter = 0, leave = Infinity;
        for (const [x, y, z, level] of planes) {
          if (body.class === "table" && z < 0.5) continue;
          const speed = x * ray[0] + y * ray[1] + z * ray[2], gap = level - (x * from[0] + y * from[1] + z * from[2]);
          if (speed < 0) enter = Math.max(enter, gap / speed);
          else if (speed > 0) leave = Math.min(leave, gap / speed);
          else if (gap < 0) leave = 0;
        }
        if (enter > 0 && enter < leave) nearest = Math.min(nearest, enter);
      }
      depths[at] = nearest;
    }
    const seen = depths.filter(Number.isFinite), near = seen.reduce((x, y) => Math.min(x, y), Infinity), most = seen.reduce((x, y) => Math.max(x, y), 0);
    [image.width, image.height] = [wide, high];
    const pixels = new ImageData(wide, high);
    depths.forEach((depth, at) => {
      const light = 235 - (205 * (depth - near)) / Math.max(most - near, 1e-6);
      if (Number.isFinite(depth)) pixels.data.set([light, light, light, 255], 4 * at);
    });
    image.getContext("2d").putImageData(pixels, 0, 0);
    const mm = (depth) => (Number.isFinite(depth) ? `${(1000 * depth).toFixed(0)} mm` : "nothing");
    const range = `${camera.label.split(":")[0]}: ${mm(near)} to ${mm(most)}`;
    caption.textContent = range;
    image.onpointermove = (event) => {
      const box = image.getBoundingClientRect(), share = (x, start, length, count) => Math.min(count - 1, Math.max(0, Math.floor(((x - start) / length) * count)));
      caption.textContent = mm(depths[share(event.clientY, box.top, box.height, high) * wide + share(event.clientX, box.left, box.width, wide)]);
    };
    image.onpointerleave = () => { caption.textContent = range; };
  }
  const cameras = view.lines.filter((line) => line.class === "camera" && line.points_m.length > 5);
  const drawNext = () => {
    const camera = cameras.shift();
    if (!camera) return;
    const figure = document.createElement("figure"), image = document.createElement("canvas"), caption = document.createElement("figcaption");
    image.setAttribute("role", "img");
    image.setAttribute("aria-label", `depth image of ${camera.label}`);
    figure.append(image, caption);
    byId("depth").hidden = false;
    byId("depth").querySelector("div").append(figure);
    drawDepth(camera, image, caption);
    setTimeout(drawNext);
  };
  setTimeout(drawNext);
  new ResizeObserver(redraw).observe(canvas);
  const wanted = new URLSearchParams(location.hash.slice(1)); // page.html#frame=40
  if (wanted.has("frame")) go(Number(wanted.get("frame")) || 0);
  if (wanted.has("play")) play();
  redraw();
})();
