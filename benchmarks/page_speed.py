"""Measure the live page in a browser: time to the first picture, and of a frame by quality.

    python -m benchmarks.page_speed bags/mine          # drawn on the CPU
    python -m benchmarks.page_speed bags/mine --gpu

The first picture is the first frame with the whole terrain and a machine, from the request of the
page in a new window of a running browser. The time of a frame is that of drawing it and of reading
one pixel of it, with the bag at its start; the page's limit of the resolution is off.
"""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from viewer.address import page_address
from viewer.bag_server import start_bag_server
from viewer.rendering.browser import find_browser
from viewer.rendering.page_renderer import QUALITIES

if TYPE_CHECKING:
    from playwright.sync_api import Browser

SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
GPU = ("--ignore-gpu-blocklist", "--enable-gpu")
TIMEOUT = 120e3  # ms

WATCH_FIRST_PICTURE = """() => {
    const watch = () => {
        const state = window.viewer ? window.viewer.state() : {};
        const isComplete = state.ready && Object.keys(state.machines).length > 0;
        if (isComplete && window.completeAt === undefined) window.completeAt = state.frames;
        if (isComplete && state.frames > window.completeAt) window.firstPicture = performance.now();
        else setTimeout(watch, 5);
    };
    watch();
}"""

DRAW_FRAMES = """(count) => {
    const { stage } = window.viewer;
    const gl = stage.renderer.getContext();
    const pixel = new Uint8Array(4);
    stage.renderer.setAnimationLoop(null);
    const times = [];
    for (let k = 0; k < count + 2; k++) {  // the first ones compile
        const start = performance.now();
        stage.drawFrame(0.02);
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
        if (k >= 2) times.push(performance.now() - start);
    }
    return times;
}"""


def measure_page(
    browser: Browser, address: str, size: tuple[int, int], frames: int
) -> tuple[float, list[float]]:
    """Open the page in a new window; return the time of the first picture and of frames [ms]."""
    width, height = size
    with browser.new_context(viewport={"width": width, "height": height}) as context:
        page = context.new_page()
        page.add_init_script(f"({WATCH_FIRST_PICTURE})()")
        page.goto(address, wait_until="commit")
        page.wait_for_function("() => window.firstPicture !== undefined", timeout=TIMEOUT)
        first: float = page.evaluate("() => window.firstPicture")
        times: list[float] = page.evaluate(DRAW_FRAMES, frames)
    return first, times


def main() -> None:
    """Measure and print."""
    from playwright.sync_api import sync_playwright

    parser = make_parser(__doc__, runs=3)
    parser.add_argument("bag", type=Path, help="a bag")
    parser.add_argument("--gpu", action="store_true", help="draw with the GPU")
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 720), help="of the window")
    parser.add_argument("--frames", type=int, default=5, help="number of frames (default: 5)")
    options = parser.parse_args()
    table = ResultTable((Column("first picture"), Column("frame")), as_json=options.json)
    table.print_note(describe_load())
    table.print_header("ms")
    server = start_bag_server(options.bag, 0)
    try:
        address = page_address("127.0.0.1", server.port)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=find_browser(), args=GPU if options.gpu else SOFTWARE
            )
            measure_page(browser, f"{address}?help=no", options.size, 1)  # starts the drawing
            for quality in QUALITIES:
                url = f"{address}?help=no&quality={quality}"
                runs = [
                    measure_page(browser, url, options.size, options.frames)
                    for _ in range(options.runs)
                ]
                frames = [each for _, times in runs for each in times]
                first = statistics.median(first for first, _ in runs)
                table.print_row(quality, [first, statistics.median(frames)])
            browser.close()
    finally:
        server.stop()


if __name__ == "__main__":
    main()
