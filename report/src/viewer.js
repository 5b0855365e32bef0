"use strict";
// Draws the view that stands in the page. Bodies fill pixels, each of which keeps what is nearest; edges, lines and points
// come after, faint or not at all where a body hides them.
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
  const [SKY, BLUE, ORANGE, YELLOW] = [[86, 180, 233], [0, 114, 178], [230, 159, 0], [240, 228, 66]];
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
    surface: { name: "surface as seen (TSDF)", rgb: () => BLUE, side: 0.0016, slack: 0.008 },
    contact: { name: "contacts", rgb: () => YELLOW, side: 0.0026, slack: 0.001, a: 1 },
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
    const ring = (face) => face.map((i) => body.corners_m[i]);
    const areas = (corners) => corners.map((p, i) => cross(less(p, corners[0]), less(corners[(i + 1) % corners.length], corners[0])));
    body.normals = body.faces.map((face) => unit(areas(ring(face)).reduce(add)));
    // Edges with the faces at both sides: what is round has none but its outline, and what is open has its rim.
    const sides = new Map();
    body.faces.forEach((face, i) => face.forEach((a, k) => {
      const b = face[(k + 1) % face.length], key = a < b ? `${a} ${b}` : `${b} ${a}`;
      sides.set(key, [...(sides.get(key) ?? [a, b]), i]);
    }));
    body.edges = [...sides.values()].map(([a, b, f, g]) => ({ a, b, f, g, sharp: g === undefined || dot(body.normals[f], body.normals[g]) < 0.9 }));
  }
  // Where a body is now: corners and the normals of its faces.
  function placed(body) {
    const pose = body.poses[Math.min(frame, body.poses.length - 1)];
    const at = pose.slice(0, 3), q = pose.slice(3);
    return { body, corners: body.corners_m.map((c) => add(turn(q, c), at)), normals: body.normals.map((n) => turn(q, n)) };
  }

  // The camera goes round a point. Home is where the workspace, or all that is shown, fills the picture.
  const around = (() => {
    const fixed = view.lines.filter((l) => l.class === "workspace").flatMap((l) => l.points_m);
    const ends = ({ corners_m, poses }) => [poses[0], poses.at(-1)].flatMap((pose) => corners_m.map((c) => add(turn(pose.slice(3), c), pose.slice(0, 3))));
    const all = fixed.length ? fixed : [...view.lines.filter((l) => shown.has(l.class)).flatMap((l) => l.points_m), ...view.bodies.flatMap(ends)];
    if (!all.length) all.push([0, 0, 0], [0.3, 0.3, 0.3]);
    const [low, high] = [Math.min, Math.max].map((end) => all.reduce((a, b) => a.map((x, i) => end(x, b[i]))));
    // In a workspace things lie low.
    return { all, middle: times(add(low, high), 0.5), radius: 0.5 * Math.hypot(...less(high, low)), sunk: fixed.length ? 0.24 : 0 };
  })();
  const axesAt = ({ yaw, pitch }) => {
    const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
    return [[-sy, cy, 0], [-sp * cy, -sp * sy, cp], [-cp * cy, -cp * sy, -sp]];
  };
  const home = () => {
    const look = { yaw: -1.05, pitch: 0.5, centre: add(around.middle, [0, 0, -around.sunk * around.radius]) };
    // So far away that a point is on the picture, whatever its form: see `focal`.
    const least = (p) => { const [x, y, z] = axesAt(look).map((axis) => dot(axis, less(p, look.centre))); return Math.max(2.7 * Math.abs(x), 3.2 * Math.abs(y)) - z; };
    return { ...look, away: around.sunk ? 2.7 * around.radius : Math.max(0.5 * around.radius, around.all.reduce((most, p) => Math.max(most, least(p)), 0)) };
  };
  let camera = home(), eye, right, up, ahead, focal, width, height, ratio;
  function aim() {
    [right, up, ahead] = axesAt(camera);
    eye = less(camera.centre, times(ahead, camera.away));
    focal = 1.28 * Math.min(width, height * 1.15);
  }
  function onScreen(p) {
    const off = less(p, eye), depth = Math.max(dot(off, ahead), 1e-3), scale = focal / depth;
    return [width / 2 + dot(off, right) * scale, height / 2 - dot(off, up) * scale, depth];
  }

  // Fills the pixels of a body's faces where they are nearer than what is there: `near` has 1 / depth, which is linear in a
  // picture. A lens has an eye, its axes, its focal lengths and its middle in pixels.
  const NEAR = 0.002;
  const beyondNear = (ring) => ring.flatMap((p, i) => {
    const q = ring[(i + 1) % ring.length], kept = p[2] >= NEAR ? [p] : [];
    if (p[2] >= NEAR !== q[2] >= NEAR) kept.push(add(p, times(less(q, p), (NEAR - p[2]) / (q[2] - p[2]))));
    return kept;
  });
  function fill({ eye, axes, size: [wide, high], focal: [fx, fy], middle: [cx, cy] }, near, { body, corners, normals }, put) {
    const inLens = (p) => axes.map((axis) => dot(axis, p)), seen = corners.map((c) => inLens(less(c, eye)));
    body.faces.forEach((face, number) => {
      const whole = face.map((i) => seen[i]), ring = whole.some((p) => p[2] < NEAR) ? beyondNear(whole) : whole;
      if (ring.length < 3) return;
      const [x, y, z] = inLens(normals[number]), off = dot([x, y, z], ring[0]);
      if (!off) return;
      const spots = ring.map((p) => [cx + (fx * p[0]) / p[2], cy + (fy * p[1]) / p[2], 1 / p[2]]);
      const ends = (axis) => [Math.min(...spots.map((p) => p[axis])), Math.max(...spots.map((p) => p[axis]))];
      const [[top, bottom], [least, most]] = [ends(1), ends(2)];
      for (let v = Math.max(0, Math.ceil(top - 0.5)); v < Math.min(high, bottom); v++) {
        const row = v + 0.5;
        let from = Infinity, to = -Infinity;
        for (let i = 0, j = spots.length - 1; i < spots.length; j = i++) {
          const a = spots[j], b = spots[i];
          if (a[1] <= row === b[1] <= row) continue;
          const column = a[0] + ((row - a[1]) / (b[1] - a[1])) * (b[0] - a[0]);
          [from, to] = [Math.min(from, column), Math.max(to, column)];
        }
        const end = Math.min(wide, Math.ceil(to - 0.5)), offRow = (y * (row - cy)) / fy + z;
        for (let u = Math.max(0, Math.ceil(from - 0.5)); u < end; u++) {
          const share = Math.min(most, Math.max(least, ((x * (u + 0.5 - cx)) / fx + offRow) / off));
          if (share > near[v * wide + u]) put(v * wide + u, share, number);
        }
      }
    });
  }

  // The picture: of each pixel 1 / depth, the number of the body, and the colour.
  let drawn = [], traced = [], picture = null;
  const LIGHT = unit([0.35, -0.5, 0.8]);
  const faces = ({ body, corners, normals }) => normals.map((n, i) => dot(n, less(eye, corners[body.faces[i][0]])) > 0);
  function drawBodies(things) {
    const [wide, high] = [canvas.width, canvas.height];
    if (picture?.image.width !== wide || picture.image.height !== high) {
      const image = pen.createImageData(wide, high);
      picture = { image, near: new Float32Array(wide * high), owners: new Int32Array(wide * high) };
    }
    const { image: { data }, near, owners } = picture;
    data.fill(0);
    near.fill(0);
    owners.fill(-1);
    const lens = { eye, axes: [right, up, ahead], size: [wide, high], focal: [focal * ratio, -focal * ratio], middle: [wide / 2, high / 2] };
    // What hides nothing comes last, and lets through what is behind it.
    const last = (thing) => (style(thing.body).a ? 1 : 0);
    drawn = [...things].sort((a, b) => last(a) - last(b));
    drawn.forEach((thing, owner) => {
      const { rgb, a = 1 } = style(thing.body), facing = faces(thing), colour = rgb();
      const colours = thing.normals.map((n, i) => times(colour, 0.7 + 0.32 * Math.max(0, dot(n, LIGHT) * (facing[i] ? 1 : -1))));
      fill(lens, near, thing, (at, share, face) => {
        if (a < 1 && !facing[face]) return;
        if (a === 1) near[at] = share;
        owners[at] = owner;
        const kept = data[4 * at + 3] ? 1 - a : 0;
        for (let i = 0; i < 3; i++) data[4 * at + i] = kept * data[4 * at + i] + (1 - kept) * colours[face][i];
        data[4 * at + 3] = Math.max(data[4 * at + 3], 255 * a);
      });
    });
    pen.putImageData(picture.image, 0, 0);
    drawn.forEach(drawEdges);
  }
  // Whether a body lies between a point and the eye, by more than some metres. A point of an outline has a free neighbour.
  function isHidden(p, slack) {
    const [x, y, depth] = onScreen(p), { near, image: { width: wide, height: high } } = picture;
    return [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]].every(([i, j]) => {
      const [u, v] = [Math.floor(x * ratio) + i, Math.floor(y * ratio) + j];
      return u >= 0 && v >= 0 && u < wide && v < high && near[v * wide + u] * (depth - slack) > 1;
    });
  }
  // Adds a line's pieces to the path of what is seen, or to that of what is hidden.
  function trace(paths, a, b, slack) {
    const [p, q] = [onScreen(a), onScreen(b)], way = less(b, a);
    const pieces = Math.max(1, Math.min(200, Math.ceil(Math.hypot(q[0] - p[0], q[1] - p[1]) / 4)));
    for (let k = 0, from = p; k < pieces; k++) {
      const to = onScreen(add(a, times(way, (k + 1) / pieces)));
      const path = paths[isHidden(add(a, times(way, (k + 0.5) / pieces)), slack) ? 1 : 0];
      path.moveTo(from[0], from[1]);
      path.lineTo(to[0], to[1]);
      from = to;
    }
  }
  function drawEdges(thing) {
    const { body, corners } = thing, look = style(body), facing = faces(thing), paths = [new Path2D(), new Path2D()];
    for (const { a, b, f, g, sharp } of body.edges) if (sharp || facing[f] !== facing[g]) trace(paths, corners[a], corners[b], 0.001);
    pen.strokeStyle = body === marked ? rgba(isDark.matches ? [255, 255, 255] : [0, 0, 0]) : rgba(times(look.rgb(), isDark.matches ? 0.45 : 0.62), look.a ? 0.8 : 1);
    pen.lineWidth = body === marked ? 2 : 1;
    pen.stroke(paths[0]);
  }
  const thin = Math.max(0.5, Math.min(1, Math.sqrt(60 / view.lines.length))); // many lines would hide what they are about
  function drawLine(line) {
    const look = style(line), near = [new Path2D(), new Path2D()], spots = line.points_m.map(onScreen);
    for (let i = 1; i < spots.length; i++) trace(near, line.points_m[i - 1], line.points_m[i], 0.001);
    pen.lineWidth = (look.wide ?? 1) * thin + (line === marked ? 2.2 : 0);
    pen.lineCap = "round";
    pen.strokeStyle = rgba(style(line).rgb(), line === marked ? 0.5 : 0.16);
    pen.stroke(near[1]);
    pen.strokeStyle = rgba(style(line).rgb(), 0.95);
    pen.stroke(near[0]);
    traced.push({ line, spots });
  }
  function drawPoints(points) {
    const look = style(points);
    for (const p of points.points_m) {
      const [x, y, depth] = onScreen(p);
      const side = Math.max(1.4, ((look.side ?? 0.0016) * focal) / depth);
      pen.fillStyle = rgba(look.rgb(), isHidden(p, look.slack ?? 0.008) ? 0.1 : look.a ?? 0.7);
      pen.fillRect(x - side / 2, y - side / 2, side, side);
    }
  }
  function draw() {
    waiting = false;
    ratio = Math.min(devicePixelRatio || 1, 3);
    [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineJoin = "round";
    aim();
    drawBodies(view.bodies.filter(isThere).map(placed));
    traced = [];
    for (const item of [...view.lines, ...view.points]) if (isThere(item)) (view.points.includes(item) ? drawPoints : drawLine)(item);
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
    const owner = picture?.owners[Math.floor(y * ratio) * canvas.width + Math.floor(x * ratio)] ?? -1, body = drawn[owner]?.body;
    return body?.label ? body : null;
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
  // Depth images: bodies as they fill the picture of a camera, whose pyramid goes from its eye through its corners; the table
  // has no end.
  function drawDepth(camera, image, caption) {
    const [eye, a, b, , , d] = camera.points_m, wide = 160;
    const [across, along] = [less(b, a), less(d, a)].map((side) => [Math.hypot(...side), unit(side)]);
    const ahead = unit(cross(across[1], along[1])), axes = [across[1], along[1], ahead], corner = axes.map((axis) => dot(axis, less(a, eye)));
    const high = Math.round((wide * along[0]) / across[0]), size = [wide, high], shares = new Float32Array(wide * high);
    // The corners are the middles of pixels.
    const focal = [across, along].map(([length], i) => ((size[i] - 1) * corner[2]) / length), middle = focal.map((f, i) => 0.5 - (f * corner[i]) / corner[2]);
    const still = view.bodies.filter((body) => body.class !== "gripper").map(placed);
    for (const thing of still) if (thing.body.class !== "table") fill({ eye, axes, size, focal, middle }, shares, thing, (at, share) => { shares[at] = share; });
    for (const { corners } of still.filter((thing) => thing.body.class === "table")) {
      const below = eye[2] - corners.reduce((top, c) => Math.max(top, c[2]), -Infinity);
      shares.forEach((share, at) => {
        const ray = [((at % wide) + 0.5 - middle[0]) / focal[0], (Math.floor(at / wide) + 0.5 - middle[1]) / focal[1], 1];
        const sinks = -ray.reduce((z, part, i) => z + part * axes[i][2], 0);
        if (below > 0) shares[at] = Math.max(share, sinks / below);
      });
    }
    const depths = shares.map((share) => 1 / share);
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
