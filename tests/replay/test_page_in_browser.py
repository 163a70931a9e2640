"""The replay page in real browsers without a screen, Chromium and Firefox, that play, seek, hover, zoom and click."""

import csv
import math
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from replay.marionette import Firefox
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.actions.pointer_input import PointerInput
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait

from slrl_sumo.formats.fcd.table import read_table
from slrl_sumo.replay.page import centred, describe, write_replay
from slrl_sumo.sumo.scenario import find_scenario

NET = find_scenario("intersection").config.with_name("intersection.net.xml")
EVIL = "</script><script>window.hacked = 1</script><img src=x onerror='window.hacked = 1'>\"&'"
SECONDS, STEP = 20.0, 0.4
MODE = 13
SCHEME = "layout.css.prefers-color-scheme.content-override"
"""Firefox's preference: 0 dark, 1 light."""

Driver = webdriver.Chrome | Firefox


def programme(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        how = f"{name} is not there: apt-get install chromium chromium-driver firefox-esr"
        if os.environ.get("CI"):
            pytest.fail(how)
        pytest.skip(how)
    return found


@pytest.fixture(scope="module", params=["chromium", "firefox-esr"])
def browser(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driver]:
    profile = tmp_path_factory.mktemp("profile")
    driver = chromium(profile) if request.param == "chromium" else firefox(profile)
    try:
        driver.set_window_size(1200, 800)
        yield driver
    finally:
        driver.quit()


def chromium(profile: Path) -> webdriver.Chrome:
    options = Options()
    options.binary_location = programme("chromium")
    for word in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu"):
        options.add_argument(word)
    options.add_argument(f"--user-data-dir={profile}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options=options, service=Service(programme("chromedriver")))


def firefox(profile: Path) -> Firefox:
    preferences = {"browser.download.folderList": 2, SCHEME: 1, "browser.download.useDownloadDir": True}
    return Firefox(programme("firefox-esr"), profile, preferences)


def complaints(browser: Driver) -> list[Any]:
    """What the console says since the last call; Firefox keeps that to itself."""
    return [] if isinstance(browser, Firefox) else list(browser.get_log("browser"))


@contextmanager
def phone(browser: Driver) -> Iterator[None]:
    """A narrow screen with two pixels in one of CSS. Firefox's windows are 450 px wide at least."""
    if isinstance(browser, Firefox):
        browser.prefer("layout.css.devPixelsPerPx", "2.0")
        browser.set_window_size(450, 800)
    else:
        size = {"width": 420, "height": 800, "deviceScaleFactor": 2, "mobile": True}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        yield
    finally:
        if isinstance(browser, Firefox):
            browser.prefer("layout.css.devPixelsPerPx", "1.0")
            browser.set_window_size(1200, 800)
        else:
            browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def paint(browser: Driver, scheme: str) -> None:
    """Ask for a dark or light page."""
    if isinstance(browser, Firefox):
        browser.prefer(SCHEME, {"dark": 0, "light": 1}[scheme])
    else:
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def save_to(browser: Driver, folder: Path) -> None:
    """Let downloads go to a folder."""
    if isinstance(browser, Firefox):
        browser.prefer("browser.download.dir", str(folder))
    else:
        browser.execute_cdp_cmd("Page.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(folder)})


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A car that drives east into a standing one at 10 s and goes on, a learned bicycle with a mode, a walker, and one
    with a hostile name. A page lies beside it."""
    names = ("id", "x", "y", "angle", "type", "speed", "lane", "edge")
    file = tmp_path_factory.mktemp("page") / "tr<b>ace.csv"
    with open(file, "w", encoding="utf-8", newline="") as text:
        writer = csv.writer(text, delimiter=";")
        writer.writerow(["timestep_time", *(f"vehicle_{name}" for name in names), "mode", "learned"])
        for k in range(round(SECONDS / STEP) + 1):
            t = k * STEP
            for row in (
                ("runner", 20 + 8 * t, 93.4, 90, "passenger", 8, "a_0", "", "", 0),
                ("parked", 105, 93.4, 90, "passenger", 0, "a_0", "", "", 0),
                ("rider", 100, 20 + 4 * t, 0, "learned_bicycle", 4, "", "", MODE, 1),
                (EVIL, 60, 88, 45, EVIL, 1.25, "", "", "", 0),
                ("walker", 30 + t, 88.5, 90, "", 1, "", "b", "", 0),
            ):
                writer.writerow([round(100 + t, 2), *row])
    write_replay(file, str(NET), file.with_name("page.html"))
    return file


@pytest.fixture
def page(browser: Driver, trace: Path) -> Driver:
    """The page, freshly loaded."""
    complaints(browser)
    browser.get(trace.with_name("page.html").as_uri())
    WebDriverWait(browser, 30).until(lambda b: b.execute_script("return document.documentElement.dataset.ready"))
    return browser


def text(page: Driver, name: str) -> str:
    return page.find_element(By.ID, name).text


def time_of(page: Driver) -> float:
    """What the clock shows, s."""
    # The text itself: Firefox at times had none to show between two frames.
    minutes, seconds = page.find_element(By.ID, "clock").get_property("textContent").split(":")
    return 60 * int(minutes) + float(seconds)


def settle(page: Driver) -> None:
    """Until what was asked for is drawn."""
    page.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")


def on_screen(page: Driver, x: float, y: float) -> tuple[float, float]:
    """px of a place of the network, from the upper left corner of the scene."""
    script = "return page.toScreen(arguments[0] - page.trace.origin[0], arguments[1] - page.trace.origin[1])"
    px, py = page.execute_script(script, x, y)
    return px, py


def to_pointer(page: Driver, x: float, y: float) -> ActionChains:
    """Moves the mouse over a place of the network."""
    scene = page.find_element(By.ID, "scene")
    (px, py), size = on_screen(page, x, y), scene.size
    return ActionChains(page).move_to_element_with_offset(
        scene, round(px - size["width"] / 2), round(py - size["height"] / 2)
    )


def colour(page: Driver, x: float, y: float) -> list[int]:
    """RGB drawn at a place of the network."""
    px, py = on_screen(page, x, y)
    script = "return [...page.on.getImageData(arguments[0], arguments[1], 1, 1).data.slice(0, 3)]"
    return [int(v) for v in page.execute_script(script, round(px), round(py))]


def rgb(page: Driver, name: str) -> list[int]:
    """A colour of the page's palette."""
    value = page.execute_script("return page.colours[arguments[0]]", name)
    return [int(value[i : i + 2], 16) for i in (1, 3, 5)]


def test_it_loads_alone_and_without_complaint(page: Driver) -> None:
    assert complaints(page) == []
    assert page.execute_script("return performance.getEntriesByType('resource').length") == 0
    source = Path(page.current_url.removeprefix("file://")).read_text()
    assert "http://" not in source
    assert "https://" not in source


def test_names_of_a_trace_stay_text(page: Driver) -> None:
    assert page.execute_script("return window.hacked ?? null") is None
    assert page.find_elements(By.TAG_NAME, "img") == []
    assert page.execute_script("return document.scripts.length") == 1  # the data have been taken out
    assert text(page, "name") == "tr<b>ace.csv"
    to_pointer(page, 60 - 1.8, 88 - 1.8).perform()
    settle(page)
    name, kind, *_ = page.execute_script("return document.getElementById('tooltip').textContent").split("\n")
    assert name == EVIL
    assert kind == f"car ({EVIL})"


def test_scripts_of_others_are_refused(page: Driver) -> None:
    page.execute_script(
        "const s = document.createElement('script'); s.textContent = 'window.hacked = 1'; document.body.append(s);"
        "document.body.insertAdjacentHTML('beforeend', '<button id=trap onclick=\"window.hacked = 1\">x</button>');"
        "document.getElementById('trap').click()"
    )
    assert page.execute_script("return window.hacked ?? null") is None


def test_the_browser_unpacks_what_the_trace_holds(page: Driver, trace: Path) -> None:
    table, _ = read_table(trace)
    rows = centred(table, describe(table, {}, {}))
    names = ("user", "step", "x", "y", "heading", "speed", "state")
    script = "const t = page.trace; return [...arguments].map((name) => Array.from(t[name]))"
    got = dict(zip(names, map(np.array, page.execute_script(script, *names)), strict=True))
    x0, y0 = page.execute_script("return page.trace.origin")
    assert got["user"].tolist() == rows.user.tolist()
    assert got["step"].tolist() == rows.step.tolist()
    assert np.abs(got["x"] + x0 - rows.x).max() < 0.0051
    assert np.abs(got["y"] + y0 - rows.y).max() < 0.0051
    assert np.abs(np.cos(got["heading"]) - np.cos(rows.heading)).max() < 0.005
    assert np.abs(np.sin(got["heading"]) - np.sin(rows.heading)).max() < 0.005
    assert np.abs(got["speed"] - rows.speed).max() < 0.051
    assert got["state"].tolist() == rows.state.tolist()
    assert set(got["state"].tolist()) == {0, 2 + MODE}


def test_play_and_pause(page: Driver) -> None:
    assert time_of(page) == 100.0
    play = page.find_element(By.ID, "play")
    play.click()
    assert play.text == "pause"
    WebDriverWait(page, 20).until(lambda b: time_of(b) > 100.5)
    play.click()
    assert play.text == "play"
    settle(page)
    stopped = time_of(page)
    settle(page)
    assert 100.5 < time_of(page) == stopped < 100 + SECONDS
    # Twenty times as fast the rest takes a second; at the end it stops, and begins again when asked.
    Select(page.find_element(By.ID, "speed")).select_by_visible_text("20×")
    play.click()
    WebDriverWait(page, 20).until(lambda b: play.text == "play")
    assert time_of(page) == 100 + SECONDS
    Select(page.find_element(By.ID, "speed")).select_by_visible_text("0.25×")
    play.click()
    play.click()
    assert time_of(page) < 100 + SECONDS


def test_keys_step_and_seek(page: Driver) -> None:
    body = page.find_element(By.TAG_NAME, "body")
    for key, time in (
        (Keys.ARROW_RIGHT, 100.4),
        (Keys.ARROW_RIGHT, 100.8),
        (Keys.ARROW_LEFT, 100.4),
        (Keys.SHIFT + Keys.ARROW_RIGHT, 105.4),
        (Keys.END, 120.0),
        (Keys.ARROW_RIGHT, 120.0),
        (Keys.ARROW_LEFT, 119.6),
        (Keys.HOME, 100.0),
    ):
        body.send_keys(key)
        settle(page)
        assert time_of(page) == pytest.approx(time), key
    body.send_keys(" ")
    WebDriverWait(page, 20).until(lambda b: time_of(b) > 100.1)
    body.send_keys(" ")
    assert text(page, "play") == "play"


def test_the_slider_seeks_and_road_users_are_between_their_positions(page: Driver) -> None:
    slider = page.find_element(By.ID, "slider")
    ActionChains(page).move_to_element(slider).click().perform()
    settle(page)
    assert time_of(page) == pytest.approx(110.0, abs=0.2)
    # A quarter of the way between two steps: 8 m/s east, and the box reaches 5 m back from the front bumper.
    page.execute_script("page.zoom(8, ...page.toScreen(50 - page.trace.origin[0], 93 - page.trace.origin[1]))")
    page.execute_script("page.seek(104.1)")
    to_pointer(page, 20 + 8 * 4.1 - 4.5, 93.4).perform()
    settle(page)
    assert text(page, "tooltip").startswith("runner\n")
    to_pointer(page, 20 + 8 * 4.1 - 5.6, 93.4).perform()
    settle(page)
    assert not page.find_element(By.ID, "tooltip").is_displayed()


def test_hovering_tells_id_type_speed_and_mode(page: Driver) -> None:
    for (x, y), lines in {
        (100, 20 - 0.8): ["rider", "bicycle (learned_bicycle)", "4.0 m/s (14 km/h)", f"mode {MODE}", "learned"],
        (105 - 2.5, 93.4): ["parked", "car (passenger)", "0.0 m/s (0 km/h)", "moved by SUMO"],
        (30 - 0.1, 88.5): ["walker", "pedestrian", "1.0 m/s (4 km/h)", "moved by SUMO"],
    }.items():
        to_pointer(page, x, y).perform()
        settle(page)
        assert text(page, "tooltip").split("\n") == lines
    # A road user that is clicked stays described after the pointer has gone, also while moving.
    to_pointer(page, 100, 20 - 0.8).click().perform()
    to_pointer(page, 40, 30).perform()
    page.execute_script("page.seek(112)")
    settle(page)
    assert text(page, "tooltip").startswith("rider\n")


def test_a_click_on_a_conflict_goes_to_its_time_and_place(page: Driver) -> None:
    buttons = page.find_elements(By.CSS_SELECTOR, "#conflicts button")
    # The runner's front reaches the parked one's tail at 100 m after 10 s; boxes touch there, by rounding or not.
    assert buttons[0].text.split("\n")[0] == "1:50.0 collision"
    assert buttons[0].text.split("\n")[1:] == ["car × car, closing at 8.0 m/s", "runner × parked"]
    # Behind it: the rider, which rides through the runner's way (x = 100) and the walker, which meets none.
    assert not any("walker" in button.text for button in buttons)
    buttons[0].click()
    settle(page)
    assert time_of(page) == 110.0
    middle_x, middle_y = (100 - 2.5 + 105 - 2.5) / 2, 93.4
    size = page.find_element(By.ID, "scene").size
    px, py = on_screen(page, middle_x, middle_y)
    assert math.hypot(px - size["width"] / 2, py - size["height"] / 2) < 1
    assert "current" in buttons[0].get_attribute("class").split()
    assert colour(page, 100 - 2.5, 93.4) == rgb(page, "car")
    assert colour(page, 105 - 2.5, 93.4) == rgb(page, "car")
    # Other keys go on from there, and the filter empties the list.
    page.find_element(By.TAG_NAME, "body").send_keys("n")
    settle(page)
    current = page.find_elements(By.CSS_SELECTOR, "#conflicts button.current")
    assert [b.text for b in current] == [buttons[1 % len(buttons)].text]
    for box in page.find_elements(By.CSS_SELECTOR, "#filters input")[:2]:
        box.click()
    assert text(page, "conflicts") == "none"


def test_on_a_narrow_screen_the_list_opens_over_the_scene_and_gives_way(page: Driver) -> None:
    with phone(page):
        page.refresh()
        WebDriverWait(page, 30).until(lambda b: b.execute_script("return document.documentElement.dataset.ready"))
        assert not page.find_element(By.ID, "side").is_displayed()
        page.find_element(By.ID, "panel").click()
        page.find_element(By.CSS_SELECTOR, "#conflicts button").click()
        assert not page.find_element(By.ID, "side").is_displayed()
        settle(page)
        assert time_of(page) == 110.0
        assert page.execute_script("return page.ratio") == 2
        middle = page.execute_script("return [page.canvas.clientWidth / 2, page.canvas.clientHeight / 2]")
        assert on_screen(page, 100, 93.4) == pytest.approx(middle, abs=1)


def test_definitions_are_one_click_away(page: Driver) -> None:
    assert not page.find_element(By.ID, "definitions").is_displayed()
    page.find_element(By.ID, "explain").click()
    assert "Time to collision below 1.5 s" in text(page, "definitions")
    assert "boxes of two road users overlap" in text(page, "definitions")


def test_road_users_are_drawn_in_the_colour_of_their_type_on_their_surface(page: Driver) -> None:
    page.execute_script("page.zoom(6, ...page.toScreen(90 - page.trace.origin[0], 93 - page.trace.origin[1]))")
    page.execute_script("page.state.trail = 0; page.seek(117)")
    settle(page)
    assert colour(page, 105 - 2.5, 93.4) == rgb(page, "car")
    assert colour(page, 100, 20 + 4 * 17 - 0.8) == rgb(page, "bicycle")
    assert colour(page, 80, 93.4) == rgb(page, "road")
    assert colour(page, 75, 106) == rgb(page, "back")
    # The learned one has an outline, half a metre from whose middle is the box's side.
    px, py = on_screen(page, 100 - 0.325, 20 + 4 * 17 - 0.8)
    assert (
        int(page.execute_script("return page.on.getImageData(arguments[0], arguments[1], 1, 1).data[2]", px, py)) < 90
    )


def test_wheel_drag_and_fit(page: Driver) -> None:
    before = page.execute_script("return {...page.view}")
    scene = page.find_element(By.ID, "scene")
    px, py = on_screen(page, 60, 93)
    origin = ScrollOrigin.from_element(scene, round(px - scene.size["width"] / 2), round(py - scene.size["height"] / 2))
    ActionChains(page).scroll_from_origin(origin, 0, -300).perform()
    settle(page)
    assert page.execute_script("return page.view.scale") > 1.2 * before["scale"]
    assert on_screen(page, 60, 93) == pytest.approx((px, py), abs=2.5)  # stays under the pointer
    ActionChains(page).move_to_element(scene).click_and_hold().move_by_offset(80, -50).release().perform()
    settle(page)
    assert on_screen(page, 60, 93) == pytest.approx((px + 80, py - 50), abs=3)
    page.find_element(By.ID, "fit").click()
    assert page.execute_script("return {...page.view}") == before


def test_two_fingers_zoom(page: Driver) -> None:
    scene = page.find_element(By.ID, "scene")
    middle = page.execute_script("return [page.canvas.clientWidth / 2, page.canvas.clientHeight / 2]")
    scale = page.execute_script("return page.view.scale")
    place = page.execute_script("return page.toGround(...arguments[0])", middle)
    fingers = []
    for name, side in (("one", -1), ("other", 1)):
        finger = PointerInput("touch", name)
        finger.create_pointer_move(0, round(middle[0] + 60 * side), round(middle[1]))
        finger.create_pointer_down(button=0)
        finger.create_pointer_move(100, round(middle[0] + 120 * side), round(middle[1]))
        finger.create_pointer_up(button=0)
        fingers.append(finger)
    actions: Any = ActionBuilder(page)
    actions.devices = fingers
    actions.perform()
    settle(page)
    assert scene.is_displayed()
    assert page.execute_script("return page.view.scale") == pytest.approx(2 * scale, rel=0.05)
    after = page.execute_script("return page.toGround(...arguments[0])", middle)
    assert after == pytest.approx(place, abs=1.0)


def test_light_and_dark(page: Driver) -> None:
    light = (colour(page, 80, 120), colour(page, 80, 93.4))
    paint(page, "dark")
    try:
        # Firefox tells the page of its preference later, on busy cores between two looks at it.
        WebDriverWait(page, 20).until(lambda b: colour(b, 80, 120) == rgb(b, "back") and max(rgb(b, "back")) < 80)
        settle(page)
        dark = (colour(page, 80, 120), colour(page, 80, 93.4))
        assert min(light[0] + light[1]) > 180
        assert max(dark[0] + dark[1]) < 80
        assert dark[0] == rgb(page, "back")
    finally:
        paint(page, "light")


def fresh(browser: Driver, trace: Path, fragment: str) -> Driver:
    browser.get("about:blank")
    browser.get(trace.with_name("page.html").as_uri() + fragment)
    WebDriverWait(browser, 30).until(lambda b: b.execute_script("return document.documentElement.dataset.ready"))
    settle(browser)
    return browser


def test_a_link_leads_to_a_moment_and_a_road_user(browser: Driver, trace: Path) -> None:
    page = fresh(browser, trace, "#t=112.4&id=rider&colour=speed")
    assert time_of(page) == pytest.approx(112.4)
    assert "rider" in text(page, "tooltip")
    assert Select(page.find_element(By.ID, "colour")).first_selected_option.text == "speed"
    px, py = on_screen(page, 100, 20 + 4 * 12.4 - 0.9)
    size = page.execute_script("return [page.canvas.clientWidth, page.canvas.clientHeight]")
    assert (px, py) == (pytest.approx(size[0] / 2, abs=12), pytest.approx(size[1] / 2, abs=12))
    page.execute_script("page.seek(115.2); page.view.x += 7; page.touch(); document.getElementById('link').click()")
    hash_ = page.execute_script("return location.hash")
    view = page.execute_script("return [page.view.x, page.view.y, page.view.scale]")
    assert "t=115.2" in hash_
    assert "id=rider" in hash_
    again = fresh(browser, trace, hash_)
    assert time_of(again) == pytest.approx(115.2)
    assert again.execute_script("return [page.view.x, page.view.y, page.view.scale]") == pytest.approx(view, abs=0.1)
    hostile = fresh(browser, trace, "#t=nonsense&id=<img src=x onerror=hacked>&x=1e999&colour=constructor")
    assert time_of(hostile) == pytest.approx(100.0)
    assert hostile.execute_script("return [page.state.selected, page.state.colour]") == [-1, "type"]


def test_signals_change_at_their_times(browser: Driver, tmp_path: Path) -> None:
    (tmp_path / "trace.csv").write_text(
        "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_angle\n"
        + "".join(f"{t};a;100;98;90\n" for t in range(31))
    )
    shown = ((5, "r"), (10, "G"), (20, "y"))
    states = "".join(f'<tlsState time="{t}" id="centre" state="{letter * 32}"/>' for t, letter in shown)
    (tmp_path / "trace.signals.xml").write_text(f"<tlsStates>{states}</tlsStates>")
    write_replay(tmp_path / "trace.csv", "signalised", tmp_path / "page.html")
    page = fresh(browser, tmp_path / "trace.csv", "")
    assert "signals" in text(page, "legend")
    x, y = page.execute_script(
        "const [, x0, y0, x1, y1] = page.signals.all[0].bars[0];"
        "page.view = {x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale: 30};"
        "return [(x0 + x1) / 2 + page.trace.origin[0], (y0 + y1) / 2 + page.trace.origin[1]]"
    )
    for time, name in (
        (4, "road"),
        (5, "stop"),
        (9.9, "stop"),
        (10, "go"),
        (20, "caution"),
        (30, "caution"),
        (7, "stop"),
    ):
        page.execute_script("page.seek(arguments[0])", time)
        settle(page)
        found = colour(page, x, y)
        assert (found in (rgb(page, "cycleway"), rgb(page, "road"))) if name == "road" else found == rgb(page, name)


def test_colours_say_type_speed_wait_learned_and_mode(page: Driver) -> None:
    of = (
        "page.state.colour = arguments[0]; page.fillLegend();"
        "const t = page.trace, row = [...t.user].findLastIndex((u) => t.users.id[u] === arguments[1]);"
        "return page.colourings[arguments[0]].of(page.scene, row, page.colours)"
    )
    legends = {}
    for colour in ("type", "speed", "waiting", "learned", "mode"):
        names = ("runner", "parked", "rider", "walker")
        seen = [page.execute_script(of, colour, name) for name in names]
        legends[colour] = text(page, "legend")
        assert all(seen)
        distinct = {"type": 3, "speed": 4, "waiting": 2, "learned": 2, "mode": 2}
        assert len(set(seen)) == distinct[colour], (colour, seen)
    assert "15 to 30 s stood" in legends["waiting"]
    assert f"mode {MODE}" in legends["mode"]
    assert "moved by SUMO" in legends["learned"]
    Select(page.find_element(By.ID, "colour")).select_by_visible_text("waiting")
    page.execute_script("page.select(page.trace.users.id.indexOf('parked')); page.seek(120)")
    settle(page)
    assert "has stood for 20 s" in text(page, "tooltip")


def test_pictures_and_videos_are_saved(page: Driver, tmp_path: Path) -> None:
    save_to(page, tmp_path)
    page.find_element(By.ID, "picture").click()
    # Firefox makes an empty file before it moves the whole one there.
    WebDriverWait(page, 20).until(lambda _: [f for f in tmp_path.glob("*.png") if f.stat().st_size])
    (picture,) = tmp_path.glob("*.png")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 5_000
    page.find_element(By.ID, "video").click()
    WebDriverWait(page, 20).until(lambda b: b.execute_script("return page.frames") > 10 and time_of(b) > 100.5)
    assert text(page, "video") == "stop"
    page.find_element(By.ID, "video").click()
    WebDriverWait(page, 20).until(lambda _: [f for f in tmp_path.glob("*.webm") if f.stat().st_size])
    (video,) = tmp_path.glob("*.webm")
    assert video.read_bytes().startswith(b"\x1aE\xdf\xa3")  # EBML
    assert text(page, "video") == "video"
