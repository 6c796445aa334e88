"""How long is it from a slider that is moved to the new picture, in the browser, and from the command to a drawn page?

`orbits explore` is served, a headless Chromium opens the page, and a slider is moved 100 times by JavaScript: of a
hopper, and of a runner, whose numbers are tuned for each speed. What is measured is the time from the input event until
the figure of the heights has painted the new motion, with the machine moving, as people see it, and the processor time
of the page's own thread, which other programs hardly change. Needs the extras `explore` and `browser`, Chromium and
chromedriver.
"""

import argparse
import shutil
import subprocess
import sys
import time

import numpy as np

# 1,200 x 900 pixels, as on a small screen.
SWITCHES = ("headless=new", "no-sandbox", "disable-gpu", "window-size=1200,900", "no-first-run", "disable-sync")
DRAWN = "return document.body.dataset.shown > 0 && Bokeh.documents[0].is_idle"
NOTHING_ELSE = "return ['map-text', 'family-text'].every(text => !/being|growing/.test(explorer.state[text]))"
MACHINES = {"hopper": ("beta",), "runner": ("speed", "--machine", "runner")}  # the slider, and options of the command
# Moves the slider, waits for the first paint after the data of the masses are others, and moves it again.
MOVES = """
const [name, count, low, high] = arguments, done = arguments[arguments.length - 1];
const {figures} = window.explorer, slider = document.getElementById(`slider-${name}`);
const masses = figures.heights.renderers.map(r => r.data_source).find(s => s.data.colour && s.data.height[0]?.length);
const view = Bokeh.index.get(figures.heights), paint = view._actual_paint.bind(view), times = [];
let before = null, began = 0, k = 0;
view._actual_paint = () => {
  paint();
  if (before !== null && masses.data !== before) {
    times.push(performance.now() - began);
    before = null;
    setTimeout(move, 20 + 60 * ((k * 0.618) % 1));
  }
};
function move() {
  if (times.length >= count) {
    view._actual_paint = paint;
    done(times);
    return;
  }
  k += 1;
  before = masses.data;
  began = performance.now();
  slider.valueAsNumber = low + (k * 37) % (high - low);
  slider.dispatchEvent(new Event("input", {bubbles: true}));
}
move();
"""


def new_driver():
    """A headless Chromium."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for switch in SWITCHES:
        options.add_argument(f"--{switch}")
    return webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))


def waited(driver, script: str, seconds: float = 60.0) -> None:
    """Wait until a script says yes."""
    end = time.perf_counter() + seconds
    while not driver.execute_script(script):
        if time.perf_counter() > end:
            raise SystemExit(f"not so after {seconds:g} s: {script}")
        time.sleep(0.02)


def thread_time(driver) -> float:
    """Seconds of processor time that the page's own thread has taken so far."""
    driver.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})
    metrics = driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
    return next(each["value"] for each in metrics if each["name"] == "TaskDuration")


def measured(moves: int, slider: str, *options: str) -> tuple[float, float, np.ndarray, float]:
    """Seconds until the page is served, until it is drawn, from each move of a slider to its picture, and of the
    page's thread for a move."""
    command = [
        sys.executable,
        "-c",
        "from problems.command.cli import main; main()",
        "explore",
        "--no-browser",
        "--port",
        "0",
        *options,
    ]
    driver = new_driver()
    try:
        began = time.perf_counter()
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                address = process.stdout.readline().split(" ")[0]
                served = time.perf_counter() - began
                driver.get(address)
                waited(driver, DRAWN)
                drawn = time.perf_counter() - began
                waited(driver, NOTHING_ELSE, 240.0)  # they have the lowest priority
                driver.set_script_timeout(120)
                before = thread_time(driver)
                times = driver.execute_async_script(MOVES, slider, moves, 100, 400)
                busy = (thread_time(driver) - before) / moves
            finally:
                process.terminate()
    finally:
        driver.quit()
    return served, drawn, np.array(times) / 1e3, busy


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="ten moves")
    moves = 10 if parser.parse_args().quick else 100
    for machine, (slider, *options) in MACHINES.items():
        served, drawn, times, busy = measured(moves, slider, *options)
        print(f"{machine}: served after {served:.2f} s, drawn after {drawn:.2f} s")
        print(f"slider to picture, {len(times)} moves: median {1e3 * np.median(times):.0f} ms", end=", ")
        print(f"95 % below {1e3 * np.percentile(times, 95):.0f} ms, shortest {1e3 * times.min():.0f} ms")
        print(f"processor time of the page's thread: {1e3 * busy:.0f} ms a move")


if __name__ == "__main__":
    main()
