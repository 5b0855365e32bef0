"use strict";
// Chooses among the scenes of scenes.js. The choice stands in the page's address, so that links and the way back keep it.
(() => {
  const { facets, scenes } = listing;
  const byId = (id) => document.getElementById(id);
  const wanted = new URLSearchParams(location.hash.slice(1));
  const chosen = () => facets.map(({ name, choices }) => choices.indexOf(wanted.get(name) ?? ""));
  const isWanted = ([, ...values]) => chosen().every((choice, at) => choice < 0 || values[at] === choice);
  const matching = (scene) => scene.attempts.filter(isWanted);
  // The choice as the end of an address.
  const hash = (more = "") => {
    const names = facets.map((facet) => facet.name).filter((name) => wanted.get(name));
    const text = [...names.map((name) => [name, wanted.get(name)].map(encodeURIComponent).join("=")), more].filter(Boolean).join("&");
    return text && `#${text}`;
  };
  const sceneFile = (id) => `scene-${id}.html`;
  const [, kind, here, attempt] = location.pathname.match(/(scene|replay)-(\d+)(?:-(\d+))?\.html$/) ?? [];

  // All scenes: the cards of those with a wanted attempt, whose other hands are faint.
  function showCards() {
    let count = 0, shown = 0;
    for (const figure of document.querySelectorAll(".gallery figure")) {
      const link = figure.querySelector("a").getAttribute("href").replace(/#.*/, "");
      const scene = scenes.find((one) => sceneFile(one.id) === link), found = new Set(matching(scene).map(([id]) => id));
      figure.hidden = !found.size;
      shown += found.size ? 1 : 0;
      count += found.size;
      for (const path of figure.querySelectorAll(".scene path")) {
        const isFound = found.has(Number(path.textContent.split(/[/ ]/)[1]));
        path.classList.toggle("other", !isFound);
        path.classList.toggle("chosen", isFound && chosen().some((choice) => choice >= 0));
      }
      for (const a of figure.querySelectorAll("a")) a.setAttribute("href", link + hash());
    }
    byId("found").textContent = `${count.toLocaleString("en")} attempts in ${shown} of ${scenes.length} scenes`;
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

  // One scene or replay: the next and the previous that are wanted, and the list of wanted attempts.
  if (kind) {
    const isReplay = kind === "replay";
    const all = isReplay
      ? scenes.flatMap((scene) => matching(scene).map(([id]) => [scene.id, id]))
      : scenes.filter((scene) => matching(scene).length).map((scene) => [scene.id, 0]);
    const own = [Number(here), Number(attempt ?? 0)];
    const isAfter = (a, b) => a[0] > b[0] || (a[0] === b[0] && a[1] > b[1]);
    const file = ([scene, id]) => (isReplay ? `replay-${scene}-${id}.html${hash("play=1")}` : sceneFile(scene) + hash());
    const lead = (name, place) => {
      const link = byId(name);
      link.hidden = !place;
      if (place) link.href = file(place);
    };
    lead("next", all.find((place) => isAfter(place, own)));
    lead("previous", all.findLast((place) => isAfter(own, place)));
    for (const link of document.querySelectorAll("header a:not(#next, #previous)")) link.href = link.getAttribute("href") + hash();
    const wantedHere = new Set(matching(scenes.find((scene) => scene.id === own[0]) ?? { attempts: [] }).map(([id]) => id));
    let count = 0;
    for (const row of document.querySelectorAll("#attempts li")) {
      row.hidden = !wantedHere.has(Number(row.dataset.attempt));
      count += row.hidden ? 0 : 1;
      const link = row.querySelector("a");
      if (link) link.href = link.getAttribute("href") + hash("play=1");
    }
    const names = facets.map((facet) => wanted.get(facet.name)).filter(Boolean);
    if (byId("chosen")) byId("chosen").textContent = names.length ? `${count} of ${names.join(", ")}` : "";
    addEventListener("keydown", (event) => {
      const link = { n: byId("next"), p: byId("previous") }[event.key];
      if (link && !link.hidden && !event.ctrlKey && !event.metaKey && !event.altKey) location.href = link.href;
    });
  }
})();
