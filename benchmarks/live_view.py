"""The moving picture of README.md, docs/assets/live-view.webp: `python -m benchmarks.live_view`.

Photographs the page of the demo's second run in chromium (apt-get install chromium) and keeps 9 s of it.
"""

import io
import re
import tempfile
import time
from pathlib import Path

from PIL import Image

from tests.browser import Shown, installed_chromium
from tests.live_cell import Process, free_port
from tests.waiting import PATIENCE_S, wait_until

_PICTURE = Path(__file__).parents[1] / "docs" / "assets" / "live-view.webp"
_LINK = re.compile(r"dashboard at (http://\S+)\n")
_SIZE = 1024, 640  # px, of the 1280 x 800 of the page
_UNTIL_S = 240.0  # s for first run, diagnosis and start of the second run
_BEFORE_S, _LENGTH_S = 14.0, 9.0  # s of the second run: until its chart is full, and two strokes
_PERIOD_S = 0.25  # s between two pictures
_QUALITY = 55  # of WebP: texts stay sharp, the file below 2 MB


def main() -> None:
    """Writes the picture, and prints its size."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        demo = Process("demo", folder, "demo", "--out", "demo", "--port", str(free_port()))
        try:
            wait_until(lambda: _LINK.search(demo.text), PATIENCE_S, "the link of the page")
            with (
                installed_chromium(folder) as chromium,
                Shown(chromium, _LINK.findall(demo.text)[0]) as shown,
            ):
                shown.until(lambda: shown.text("scene").startswith("3"), "the second run", _UNTIL_S)
                shown.until(lambda: shown.text("gain") != "–", "the error of the prediction")
                shown.page.wait_for_timeout(1e3 * _BEFORE_S)
                frames = photographed(shown)
        finally:
            demo.kill()
    pictures = [Image.open(io.BytesIO(jpeg)).resize(_SIZE, Image.Resampling.LANCZOS) for jpeg, _ in frames]
    first, *others = pictures
    durations_ms = [round(1e3 * shown_s) for _, shown_s in frames]
    first.save(
        _PICTURE,
        save_all=True,
        append_images=others,
        duration=durations_ms,
        loop=0,
        quality=_QUALITY,
        method=6,
    )
    print(f"{_PICTURE}: {len(frames)} pictures, {_PICTURE.stat().st_size / 2**20:.2f} MB")


def photographed(shown: Shown) -> list[tuple[bytes, float]]:
    """Pictures of the page as JPEG, which costs it least, each with the s until the next one."""
    frames = list[tuple[bytes, float]]()
    end_s = time.monotonic() + _LENGTH_S
    while (start_s := time.monotonic()) < end_s:
        picture = shown.page.screenshot(type="jpeg", quality=95)
        shown.page.wait_for_timeout(max(0.0, 1e3 * (start_s + _PERIOD_S - time.monotonic())))
        frames.append((picture, time.monotonic() - start_s))
    return frames


if __name__ == "__main__":
    main()
