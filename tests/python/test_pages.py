"""The programs' pages in headless Chromium: no errors, no requests, and text that can be read on every screen."""

import io
import math
import os
import re
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from programs import DATASET, ROOT, run

playwright = pytest.importorskip("playwright.sync_api")

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
# Disables Chromium's own requests, which would be counted.
QUIET = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking", "--disable-component-update", "--disable-sync"]
SCREENS = {"desktop": (1280, 900), "phone": (390, 800)}
#: The other two are for long runs.
LOOKS = [("desktop", "light"), ("phone", "dark"), *(pytest.param(*look, marks=pytest.mark.long) for look in (("desktop", "dark"), ("phone", "light")))]
PAGES = ["report", "replay", "experiment", "index", "scene", "scene-replay"]


def held(data: Path) -> str:
    """An attempt that held, as `replay` takes it: its animation has every phase."""
    rows = pq.read_table(data / "attempts").to_pylist()
    row = next(row for row in rows if row["outcome"] == "held")
    return f"{row['scene_id']}/{row['attempt_id']}"


@pytest.fixture(scope="session")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every kind of page, made as a user makes it."""
    folder = tmp_path_factory.mktemp("pages")
    made = {name: folder / f"{name}.html" for name in PAGES}
    run("graspmill", "dataset", "report", DATASET, "--html", made["report"], code=0)
    run("generator", "replay", DATASET, "--attempt", held(DATASET), "--out", made["replay"], code=0)
    browsed, shown = folder / "browsed", held(DATASET).split("/")
    run("graspmill", "dataset", "browse", DATASET, "--out", browsed, "--scene", shown[0], "--scene", 1, "--scene", 2, code=0)
    made["index"], made["scene"] = browsed / "index.html", browsed / f"scene-{shown[0]}.html"
    made["scene-replay"] = made["scene"]
    pile = "run", ROOT / "configs/experiment/pile.toml", "--rounds", 1, "--set", "objects.count=2", "--out", folder / "pile"
    for words in (pile, ("report", folder / "pile", "--html", made["experiment"])):
        run("graspmill", "experiment", *words, code=0)
    return made


@pytest.fixture(scope="session")
def browser():
    if CHROMIUM is None:
        pytest.skip("no chromium here (Debian: apt-get install chromium)")
    with playwright.sync_playwright() as play:
        opened = play.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield opened
        opened.close()


def is_own(url: str, path: Path) -> bool:
    """What is written in the page, the page itself, or a script or a style beside it if it is one of a folder's pages."""
    folder = path.parent if (path.parent / "scenes.js").exists() else path
    return url.startswith("data:") or url.split("#")[0].startswith(folder.as_uri())


def opened(browser, pages: dict[str, Path], name: str, screen: str = "desktop", scheme: str = "light"):
    path = pages[name]
    replay = f"#attempt={held(DATASET).split('/')[1]}" if name == "scene-replay" else ""
    width, height = SCREENS[screen]
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme, has_touch=screen == "phone")
    page = context.new_page()
    said: list[str] = []
    page.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: said.append(f"error: {error}"))
    page.on("request", lambda request: said.append(f"request: {request.url}") if not is_own(request.url, path) else None)
    page.goto(path.as_uri() + replay)
    page.wait_for_load_state("load")
    page.wait_for_timeout(200)
    return page, said


CONTRAST = """() => {
  // Relative luminance and contrast as WCAG 2 has them.
  const channels = text => (text.match(/[\\d.]+/g) || []).map(Number);
  const light = ([r, g, b]) => [r, g, b].map(v => v / 255).map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = node => {
    for (; node; node = node.parentElement) {
      const colour = channels(getComputedStyle(node).backgroundColor);
      if (colour.length === 3 || colour[3] > 0.5) return colour.slice(0, 3);
    }
    return [255, 255, 255];
  };
  const worst = { ratio: 21, text: '' };
  for (const node of document.querySelectorAll('h1,h2,p,td,th,a,figcaption,span,b,li,label,button,svg text')) {
    if (!node.textContent.trim() || !node.getClientRects().length) continue;
    const style = getComputedStyle(node);
    const ink = channels(node.tagName.toLowerCase() === 'text' ? style.fill : style.color).slice(0, 3);
    const [a, b] = [light(ink), light(behind(node.closest('svg')?.parentElement || node))].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < worst.ratio) { worst.ratio = ratio; worst.text = node.tagName + ': ' + node.textContent.trim().slice(0, 60); }
  }
  return worst;
}"""


@pytest.mark.parametrize(("screen", "scheme"), LOOKS)
@pytest.mark.parametrize("name", PAGES)
def test_a_page_opens_and_can_be_read(browser, pages, name: str, screen: str, scheme: str) -> None:
    page, said = opened(browser, pages, name, screen, scheme)
    assert said == []
    wide = page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert wide[0] <= wide[1], f"{name} is wider than the screen: {wide}"
    worst = page.evaluate(CONTRAST)
    assert worst["ratio"] >= 4.5, f"{worst} in {name}, {scheme}"
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    level = sum(int(channel) for channel in re.findall(r"\d+", paper)[:3]) / 3
    assert (level > 200) == (scheme == "light"), paper
    keep = os.environ.get("GRASPMILL_SCREENSHOTS")
    picture = page.screenshot(full_page=True)
    if keep:
        (Path(keep) / f"{name}-{screen}-{scheme}.png").write_bytes(picture)
    assert colours(picture) > 20, "the picture is all but empty"
    page.context.close()


def colours(png: bytes) -> int:
    """How many different colours a picture has, of a sample of its pixels."""
    image = pytest.importorskip("PIL.Image").open(io.BytesIO(png)).convert("RGB")
    image.thumbnail((400, 4000))
    return len(set(image.get_flattened_data()))


def test_a_scene_turns_and_a_replay_plays(browser, pages) -> None:
    page, _ = opened(browser, pages, "scene")
    canvas = page.locator("canvas").first
    before = canvas.screenshot()
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 320, box["y"] + 240, steps=4)
    page.mouse.up()
    page.wait_for_timeout(100)
    assert canvas.screenshot() != before, "dragging turns the scene"

    page, said = opened(browser, pages, "replay")
    slider = page.locator("input[type=range]").first
    first = slider.input_value()
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(100)
    assert slider.input_value() != first, "an arrow key goes to the next frame"
    assert said == []


def test_an_outcome_chooses_scenes_and_leads_to_replays(browser, pages) -> None:
    page, said = opened(browser, pages, "index")
    cards = page.locator(".gallery figure:visible")
    assert cards.count() == len(list(pages["index"].parent.glob("scene-*.html")))
    page.select_option("select[name=outcome]", "held")
    found = page.locator("#found").inner_text()
    held = sum(map(int, re.findall(r"(\d+) of \d+ attempts held", " ".join(cards.all_inner_texts()))))
    assert found.startswith(f"{held} attempts in {cards.count()} of "), found
    cards.first.locator("a").first.click()
    page.wait_for_selector("#canvas")
    rows = page.locator("#attempts li:visible")
    assert rows.count() > 0 and set(rows.locator("span").all_inner_texts()) == {"held"}
    assert page.locator("#depth canvas").count() > 0, "depth images stand beside the scene"
    first = rows.first.locator("a").inner_text().split()[0]
    rows.first.locator("a").click()
    page.wait_for_function("document.title.includes(': held')")
    assert page.title().startswith(f"{first}: held")
    before = page.locator("#scrub").input_value()
    page.wait_for_timeout(400)
    assert page.locator("#scrub").input_value() != before, "it plays at once"
    page.locator("#next").click()
    page.wait_for_function("([first]) => !document.title.startsWith(first)", arg=[f"{first}:"])
    assert ": held" in page.title(), "the next one has the chosen outcome"
    page.get_by_text("all scenes").click()
    page.wait_for_selector("#filter")
    assert page.locator("select[name=outcome]").input_value() == "held"
    assert said == []


def test_a_click_on_a_grasp_opens_its_replay(browser, pages) -> None:
    page, _ = opened(browser, pages, "scene")
    box = page.locator("#canvas").bounding_box()
    for step in range(2500):  # a spiral from the middle, until the mouse rests on a grasp
        x, y = box["width"] / 2, box["height"] / 2
        angle, away = 0.4 * step, 0.1 * step
        at = [box["x"] + x + away * math.cos(angle), box["y"] + y + away * math.sin(angle)]
        page.mouse.move(*at)
        if "opens" in (page.locator("#canvas").get_attribute("class") or ""):
            break
    told = page.locator("#tip").inner_text()
    assert re.match(r"\d+/\d+ at object", told) and told.endswith("click: replay"), told
    page.mouse.down()
    page.mouse.up()
    page.wait_for_selector("#scrub")
    assert page.title().startswith(told.split()[0] + ": ")


def test_every_attempt_of_a_scene_is_replayed_from_the_file_of_its_scene(browser, pages) -> None:
    """`cli/tests/it` has the files, their sizes and the links of a whole dataset."""
    scene = int(held(DATASET).split("/")[0])
    rows = pq.read_table(DATASET / "attempts", columns=["scene_id", "attempt_id", "outcome"]).to_pylist()
    page, said = opened(browser, pages, "scene")
    scene_title = page.title()
    for row in [row for row in rows if row["scene_id"] == scene]:
        page.evaluate(f"location.hash = 'attempt={row['attempt_id']}'")
        start = f"{scene}/{row['attempt_id']}: {row['outcome']}"
        page.wait_for_function("start => document.title.startsWith(start)", arg=start)
    assert page.locator("#events li").count() >= 2 and page.locator("#facts div").count() >= 8
    page.get_by_text(f"scene {scene}", exact=True).click()
    page.wait_for_function("title => document.title === title", arg=scene_title)
    page.go_back()
    page.wait_for_function("start => document.title.startsWith(start)", arg=start)
    assert said == []


def test_a_replay_in_a_folder_moves_as_the_replay_of_a_single_file(browser, pages) -> None:
    pictures = []
    for name in ("replay", "scene-replay"):
        page, said = opened(browser, pages, name)
        assert page.locator("#player").is_visible()
        page.keyboard.press("End")
        page.wait_for_timeout(300)
        facts = page.evaluate("[...document.querySelectorAll('aside dl div, #events li')].map(line => line.textContent.replace(/\\s+/g, ' ').trim())")
        pictures.append((page.title(), facts, page.locator("#clock").inner_text()))
        assert said == []
    assert pictures[0] == pictures[1]


def test_depth_images_show_what_the_generator_renders(browser, pages) -> None:
    """The page casts its own rays: its depths must be those of the package, but for half a pixel at edges."""
    graspmill = pytest.importorskip("graspmill", reason="the wheel is not installed: scripts/test.sh builds it")
    page, _ = opened(browser, pages, "scene")
    page.wait_for_timeout(500)
    scene = int(re.search(r"scene-(\d+)", pages["scene"].name).group(1))
    told = page.locator("#depth figcaption").first.inner_text()
    near, far = (int(word) for word in re.findall(r"(\d+) mm", told))
    depth_m = graspmill.Dataset(DATASET)[scene].depth_images()[0]
    seen_mm = 1000 * depth_m[depth_m > 0]
    assert abs(near - seen_mm.min()) <= 6 and abs(far - seen_mm.max()) <= 6, (told, seen_mm.min(), seen_mm.max())
