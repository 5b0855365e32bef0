"use strict";
// Chooses among the scenes of scenes.js, and shows replays. Choice and replay stand in the page's address, so that links
// and the way back keep them.
(() => {
  const { shelf, scenes } = listing;
  const byId = (id) => document.getElementById(id);
  const wanted = new URLSearchParams(location.hash.slice(1));
  const outcome = () => wanted.get("outcome");
  const isChosen = ([, own]) => !outcome() || own === outcome();
  const matching = (scene) => scene.attempts.filter(isChosen);
  // The choice as the end of an address.
  const hash = (...more) => {
    const text = [...(outcome() ? [`outcome=${encodeURIComponent(outcome())}`] : []), ...more].join("&");
    return text && `#${text}`;
  };
  const byFile = new Map(scenes.map((scene) => [scene.file, scene]));
  const here = byFile.get(location.pathname.split("/").at(-1));

  // All scenes: the cards of those with a wanted attempt.
  function showCards() {
    let count = 0, shown = 0;
    for (const figure of document.querySelectorAll(".gallery figure")) {
      const link = figure.querySelector("a").getAttribute("href").replace(/#.*/, "");
      const found = matching(byFile.get(link)).length;
      figure.hidden = !found;
      shown += found ? 1 : 0;
      count += found;
      figure.querySelector("a").setAttribute("href", link + hash());
    }
    byId("found").textContent = `${count.toLocaleString("en")} ${shelf === "scenes" ? "attempts in" : "grasps of"} ${shown} of ${scenes.length} ${shelf}`;
  }
  const form = byId("filter");
  if (form) {
    form.hidden = false;
    for (const select of form.querySelectorAll("select")) {
      select.value = wanted.get(select.name) ?? "";
      select.onchange = () => {
        wanted.set(select.name, select.value);
        history.replaceState(null, "", hash() || location.pathname);
        showCards();
      };
    }
    showCards();
  }

  // A scene, or the replay of the attempt that the address names: the next and the previous that are wanted, and the
  // list of wanted attempts.
  if (!here) return;
  const attempt = byId(`replay-${wanted.get("attempt")}`) && Number(wanted.get("attempt"));
  const isReplay = attempt !== null;
  const play = (id) => hash(`attempt=${id}`, "play=1");
  globalThis.addressOf = play;
  addEventListener("hashchange", () => location.reload());
  // All places in the order of their lists, and those before and after this one that are wanted.
  const places = scenes.flatMap((scene) =>
    isReplay ? scene.attempts.map((one) => [scene, one[0], isChosen(one)]) : [[scene, null, matching(scene).length > 0]]);
  const at = places.findIndex(([scene, id]) => scene === here && id === attempt);
  const lead = (name, place) => {
    byId(name).hidden = !place;
    if (place) byId(name).href = place[0].file + (isReplay ? play(place[1]) : hash());
  };
  lead("next", places.slice(at + 1).find((place) => place[2]));
  lead("previous", places.slice(0, Math.max(0, at)).findLast((place) => place[2]));
  for (const link of document.querySelectorAll("header a:not(#next, #previous, #scene)")) link.href = link.getAttribute("href") + hash();
  const wantedHere = new Set(matching(here).map(([id]) => id));
  globalThis.isWanted = (id) => wantedHere.has(Number(id));
  for (const row of document.querySelectorAll("#attempts li")) {
    row.hidden = !wantedHere.has(Number(row.dataset.attempt));
    const link = row.querySelector("a");
    if (link) link.href = play(row.dataset.attempt);
  }
  if (byId("chosen")) byId("chosen").textContent = outcome() ? `${wantedHere.size} of ${outcome()}` : "";
  addEventListener("keydown", (event) => {
    const link = { n: byId("next"), p: byId("previous") }[event.key];
    if (link && !link.hidden && !event.ctrlKey && !event.metaKey && !event.altKey) location.href = link.href;
  });
  if (!isReplay) return;

  // The replay in the page of its scene, which has the shapes of what lies there.
  const element = (name, properties, ...content) => {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...content);
    return made;
  };
  function tell({ title, frames, events, facts }) {
    document.title = document.querySelector("h1").textContent = title;
    Object.assign(byId("scene"), { hidden: false, href: here.file + hash(), textContent: here.name });
    byId("list").hidden = true;
    byId("happens").hidden = false;
    byId("player").hidden = frames.length < 2;
    byId("events").append(...events.map(({ frame, kind, text }) => {
      const button = element("button", { type: "button" }, element("span", { className: "time" }, `${frames[frame].time_s.toFixed(2)} s`), ` ${text}`);
      button.dataset.frame = frame;
      return element("li", { className: kind }, button);
    }));
    byId("facts").replaceChildren(...facts.map(({ key, value }) => element("div", {}, element("dt", {}, key), element("dd", {}, value))));
  }
  globalThis.replayIn = async (scene) => {
    const bytes = Uint8Array.from(atob(byId(`replay-${attempt}`).textContent), (letter) => letter.charCodeAt(0));
    const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const replay = await new Response(inflated).json();
    replay.bodies = replay.bodies.map((body, at) => (body.corners_m.length ? body : { ...scene.bodies[at], class: body.class, poses: body.poses }));
    replay.bodies.forEach((body) => {
      const pose = [0, 0, 0, 0, 0, 0, 0];
      if (body.poses.length > 1) body.poses = body.poses.map((steps) => steps.map((step, i) => (pose[i] += step) / 1e5));
    });
    tell(replay);
    return replay;
  };
})();
