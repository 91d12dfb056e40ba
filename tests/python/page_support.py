"""What tests of pages share: a static server, and a Chromium with WebGPU that needs no GPU and no screen."""

import contextlib
import functools
import http.server
import os
import shutil
import threading

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

# Where it is required, tests fail without it.
HAS_CHROMIUM = CHROMIUM is not None or "chromium" in os.environ.get("CLOUDPARITY_REQUIRE", "").split(",")

FLAGS = [
    "--no-sandbox",
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]

# A unit in the last place of f32, relative to the value, at most.
ULP = 2.0**-23

# Milliseconds until something that would never end is given up; nothing is timed.
PATIENCE = 180_000


class QuietHandler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@contextlib.contextmanager
def served(folder):
    """The address of a folder."""
    handler = functools.partial(QuietHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


@contextlib.contextmanager
def launched():
    """A browser."""
    from playwright.sync_api import sync_playwright

    with (
        sync_playwright() as playwright,
        contextlib.closing(playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)) as opened,
    ):
        yield opened


@contextlib.contextmanager
def listening(browser, address, ready, size):
    """The page of an address when it is ready, or has failed; what the console says is kept in `said`."""
    opened = browser.new_page(viewport={"width": size[0], "height": size[1]})
    opened.said = []
    opened.on("console", lambda message: opened.said.append(f"{message.type}: {message.text}"))
    opened.on("pageerror", lambda error: opened.said.append(f"error: {error}"))
    opened.goto(address)
    opened.wait_for_function(f"{ready} || document.querySelector('#status.failed')", timeout=PATIENCE)
    yield opened
    opened.close()
