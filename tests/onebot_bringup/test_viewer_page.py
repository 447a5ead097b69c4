"""The script of the viewer's page in a real browser; test_steering_view has the page itself."""

from pathlib import Path

import pytest

from onebot_bringup.serving import rerun_proxy
from tests.support_browser import browser

pytestmark = pytest.mark.slow


HERE = Path(__file__)
REFRESH = 17.0  # ms


def scripted(folder: Path) -> str:
    """The address of an empty page with the script that Rerun's gets."""
    script = Path(rerun_proxy.__file__).with_name("rerun_page.js").read_text()
    (folder / "page.html").write_text(f"<body><script>{script}</script>")
    return (folder / "page.html").as_uri()


def test_rerun_reads_for_up_to_half_of_a_slow_frame(tmp_path):
    """Its clock, by which it reads for 10 ms, is slower there; it is right in fast frames."""
    with browser(tmp_path / "profile") as page:
        page.get(scripted(tmp_path))
        measured = page.execute_async_script(HERE.with_name("viewer_frames.js").read_text())
    frames = measured["found"]
    assert not measured["backward"]
    assert max(frame["before"] for frame in frames) >= 300
    for frame in frames:
        # The browser times frames by the screen's refreshes, so that each may be off by one.
        least, most = (
            frame["real"] / max(1.0, 0.5 * (frame["before"] + refresh) / 10)
            for refresh in (REFRESH, -REFRESH)
        )
        assert 0.9 * least - 2.0 < frame["own"] < 1.1 * most + 2.0, frames


def test_a_picture_begins_when_the_one_before_is_drawn_and_slow_ones_get_fewer_pixels(tmp_path):
    """Pictures that Chromium takes the commands of ahead are old before they are seen.

    Those of a fine screen have 1.5 million pixels at most from the beginning.
    """
    with browser(tmp_path / "profile", webgl=True) as page:
        page.get(scripted(tmp_path))
        found = page.execute_async_script(HERE.with_name("viewer_pictures.js").read_text())
        screen = {"width": 1400, "height": 900, "deviceScaleFactor": 2.0, "mobile": False}
        page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
        page.refresh()
        ratio = page.execute_script("return devicePixelRatio")
    assert 1400 * 900 * ratio**2 == pytest.approx(1.5e6, rel=0.01)
    assert found["early"] == 0 and 0.6 <= found["ratio"] < 1.0, found
    assert found["width"] == pytest.approx(found["ratio"], abs=0.01)
