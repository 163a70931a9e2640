"""How smoothly a replay page plays in headless Chromium: python benchmarks/measure_replay.py PAGE

Needs the dev extra and Debian's chromium and chromium-driver. Prints the size of the page, the time until it can be
used, and the frames per second of 10 s of play, counted by requestAnimationFrame, with the longest time between two.
"""

import argparse
import json
import time
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.ui import WebDriverWait

COUNT = """
const done = arguments[0], gaps = [], start = performance.now();
let before = start, drawn = page.frames;
page.play(true);
function look(now) {
  gaps.push(now - before);
  before = now;
  if (now - start < 10000) return requestAnimationFrame(look);
  page.play(false);
  gaps.sort((a, b) => a - b);
  done({frames: page.frames - drawn, seconds: (now - start) / 1000, p95: gaps[Math.floor(0.95 * gaps.length)],
    longest: gaps[gaps.length - 1]});
}
requestAnimationFrame(look);
"""


def main() -> None:
    """Open, play, count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", type=Path)
    parser.add_argument("--size", default="1280,800", help="of the window, px")
    words = parser.parse_args()
    options = Options()
    options.binary_location = "/usr/bin/chromium"
    for word in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu"):
        options.add_argument(word)
    options.add_argument(f"--window-size={words.size}")
    driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
    try:
        driver.set_script_timeout(60)
        start = time.perf_counter()
        driver.get(words.page.resolve().as_uri())
        WebDriverWait(driver, 60).until(lambda d: d.execute_script("return document.documentElement.dataset.ready"))
        ready = time.perf_counter() - start
        rows, users = driver.execute_script("return [page.trace.rows.length, page.scene.row.length]")
        size = words.page.stat().st_size
        print(f"{size / 1e3:.0f} kB, {rows} rows, {size / rows:.2f} bytes a row, {users} at once", end=", ")
        print(f"ready in {ready:.1f} s")
        views = {
            "whole network": "page.fit(); page.seek((page.begin + page.end) / 2)",
            "close": "page.zoom(6); page.seek((page.begin + page.end) / 2)",
            "zooming": "page.fit(); setInterval(() => page.zoom(1.01), 16)",
        }
        for name, script in views.items():
            driver.execute_script(script)
            found = driver.execute_async_script(COUNT)
            print(name, json.dumps({key: round(value, 1) for key, value in found.items()}), end=" ")
            print(f"{found['frames'] / found['seconds']:.1f} frames/s")
    finally:
        driver.quit()


if __name__ == "__main__":
    main()
