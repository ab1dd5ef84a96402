"""Every mode of the controller has a word and a colour of its own wherever modes are shown: none can be forgotten."""

import re
from pathlib import Path

import console
from hal.state import RobotMode
from rtstack.palette import MODE_STYLES
from rtstack.samples import Mode

LIGHTS = Path(__file__).parents[2] / "docs/runbook/lights.md"


def test_the_table_has_every_mode_and_tells_them_apart():
    assert list(MODE_STYLES) == list(Mode)
    for shade in ("colour", "light", "word", "meaning"):
        values = [getattr(style, shade) for style in MODE_STYLES.values()]
        assert len(set(values)) == len(Mode), shade
    assert all(
        re.fullmatch("#[0-9a-f]{6}", s.colour) and re.fullmatch("#[0-9a-f]{6}", s.light) for s in MODE_STYLES.values()
    )


def test_pages_and_programs_are_served_that_table(served):
    with served.signed_in() as (client, _):
        told = {mode["name"]: mode for mode in client.get("/api/modes").json()}
        sheet = client.get("/static/css/modes.css")
        page = client.get("/").text
    assert sheet.headers["content-type"].startswith("text/css")
    dark, light = re.findall(r":root[^{]*\{([^}]*)\}", sheet.text)
    for mode, style in MODE_STYLES.items():
        variable = f"--mode-{style.word}"
        assert (told[mode.name]["word"], told[mode.name]["colour"]) == (style.word, style.colour)
        assert f"{variable}: {style.colour};" in dark
        assert f"{variable}: {style.light};" in light
        assert f'[data-mode="{mode.name}"] {{ --mode: var({variable}); }}' in sheet.text
        assert f'"{mode.name}": "{style.word}"' in page


def test_no_script_style_or_page_keeps_a_list_of_its_own():
    own = Path(console.__file__).parent
    for path in [*own.glob("static/**/*.js"), *own.glob("pages/**/*.html")]:
        words = {mode.name for mode in Mode} - {mode.name for mode in RobotMode}
        found = {word for word in words if re.search(rf"\b{word}\b", path.read_text())}
        assert len(found) < 2, path  # one is a question: is it stopping, is it led by hand
    assert all(
        re.search(rf"^\| [^|]*\b{style.word}\b", LIGHTS.read_text(), re.MULTILINE) for style in MODE_STYLES.values()
    )
