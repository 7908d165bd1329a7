"""Looks at the service's page in a headless Chromium, as its users do: uploads the sample street, waits for the result, and asserts that the
cloud and both range images are drawn, that divider, colours, seeds and download work, and that the console has no error. The wide page is that
of a service with a token, which it asks for.

    python scripts/look_at_page.py SERVER [FOLDER]

SERVER is the binary `realbeam-server`, started where the folder `models` is; FOLDER gets screenshots (default build/page). Needs
`pip install playwright` and a Chromium: the system's, or that of `playwright install chromium`. Where either is missing it says so and
is skipped, with exit status 0, unless REALBEAM_BROWSER=required.
"""

import os
import re
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

WIDTHS = {"wide": (1280, 800), "narrow": (390, 844)}
WAIT_MS = 120_000
TOKEN = "the-token-of-this-look"

# Share of a canvas that is not its most frequent colour, and how many colours it has (in steps of 16).
INK = """id => {
  const canvas = document.getElementById(id);
  const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
  copy.drawImage(canvas, 0, 0);
  const pixels = new Uint32Array(copy.getImageData(0, 0, canvas.width, canvas.height).data.buffer);
  const counts = new Map();
  for (const pixel of pixels) counts.set(pixel & 0xf0f0f0, (counts.get(pixel & 0xf0f0f0) ?? 0) + 1);
  return { share: 1 - Math.max(...counts.values()) / pixels.length, colours: counts.size };
}"""


def skip(why):
    print(f"skipped: {why}")
    sys.exit(1 if os.environ.get("REALBEAM_BROWSER") == "required" else 0)


def launch(playwright):
    """A browser that draws WebGL without a graphics card."""
    system = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    arguments = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
    try:
        return playwright.chromium.launch(executable_path=system, args=arguments)
    except Exception as error:
        skip(f"no Chromium starts: {str(error).splitlines()[0]}")


def shown(page, act):
    """Does something and waits for the answer that follows."""
    page.evaluate("if (document.body.dataset.state !== 'empty') document.body.dataset.state = 'waiting'")
    act()
    page.wait_for_selector(":is(body[data-state=shown], body[data-state=failed]):not([data-busy])")
    assert page.get_attribute("body", "data-state") == "shown", page.inner_text("#status")


def ink(page, canvas):
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return page.evaluate(INK, canvas)


def unlock(page, folder):
    """Gives a wrong token, then the right one."""
    page.wait_for_selector("body[data-token=asked]")
    page.screenshot(path=folder / "locked.png")
    page.fill("#token", "not-the-token-of-this-look")
    page.click("#unlock")
    page.wait_for_selector("#status.bad")
    page.fill("#token", TOKEN)
    page.press("#token", "Enter")


def look(browser, address, folder, name, size, locked):
    problems = []
    page = browser.new_page(viewport={"width": size[0], "height": size[1]}, accept_downloads=True)
    page.set_default_timeout(WAIT_MS)
    page.on("console", lambda message: problems.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.goto(address)
    if locked:
        unlock(page, folder)
    page.wait_for_selector("#model option", state="attached")
    page.screenshot(path=folder / f"{name}-empty.png")

    shown(page, lambda: page.click("#sample"))
    sample = folder / "street.ply"
    sample.write_bytes(page.request.get(f"{address}/sample", headers={"authorization": f"Bearer {TOKEN}"}).body())
    shown(page, lambda: page.set_input_files("#file", sample))
    page.screenshot(path=folder / f"{name}.png", full_page=True)
    for canvas in ("view", "image-before", "image-after"):
        found = ink(page, canvas)
        assert found["share"] > 0.1 and found["colours"] > 50, f"{canvas} is blank: {found}"
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "the page is wider than the window"
    assert int(page.inner_text("#counts dd >> nth=0").replace(",", "")) > 50_000

    before = page.evaluate("document.getElementById('view').toDataURL()")
    box = page.locator("#divider").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(size[0] / 4, box["y"] + 60)
    page.mouse.up()
    for by in ("reflectance", "label", "fate"):
        page.click(f"#colouring label:has(input[value={by}])")
        assert ink(page, "view")["share"] > 0.1, by
        page.screenshot(path=folder / f"{name}-{by}.png")
    assert int(page.get_attribute("#divider", "aria-valuenow")) < 45
    assert page.evaluate("document.getElementById('view').toDataURL()") != before

    shown(page, lambda: page.click("#reseed"))
    shown(page, lambda: page.select_option("#model", index=0))
    with page.expect_download() as download:
        page.click("#download")
    assert Path(download.value.path()).read_bytes().startswith(b"ply\n")
    page.set_input_files("#file", {"name": "scan.bin", "mimeType": "", "buffer": b"seventeen bytes.."})
    page.wait_for_selector("body[data-state=failed]:not([data-busy])")
    assert "17" in page.inner_text("#status.bad"), page.inner_text("#status")
    # The service's refusals are in the console of every browser.
    problems = [problem for problem in problems if not re.search("status of 40[01]", problem)]
    assert not problems, problems
    page.close()


@contextmanager
def serving(binary, locked):
    """The address of a service, with or without a token."""
    environment = os.environ | ({"REALBEAM_TOKEN": TOKEN} if locked else {})
    server = subprocess.Popen([binary, "serve", "--addr", "127.0.0.1:0"], stderr=subprocess.PIPE, text=True, env=environment)
    try:
        found = next(filter(None, (re.search(r"listening at (http://\S+)", line) for line in server.stderr)), None)
        assert found, "the service does not listen"
        yield found.group(1)
    finally:
        server.terminate()
        server.wait()


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        skip("no playwright; pip install playwright")
    folder = Path(sys.argv[2] if len(sys.argv) == 3 else "build/page")
    folder.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = launch(playwright)
        for name, size in WIDTHS.items():
            locked = name == "wide"
            with serving(sys.argv[1], locked) as address:
                look(browser, address, folder, name, size, locked)
            print(f"{name}: as it should be; see {folder / name}.png")
        browser.close()


if __name__ == "__main__":
    main()
