"""Pages as files: their size, what they carry, the links among them, and how a browser draws them."""

import json
import re
import shutil

import numpy as np
import plotly.graph_objects as go
import pytest
from command_line import maglev

from maglev_workbench.page import labelled_axis, page, rig_facts, table, write_page
from maglev_workbench.page_figures import figures_json
from maglev_workbench.record_page import _extremes, _of_bands

MOST_BYTES, MOST_BYTES_OF_RECORDINGS = 1_600_000, 3_000_000


def a_page(title="A page", figures=2, points=2000):
    """Two panels beside each other, a map, and a long table, as pages have."""
    rng = np.random.default_rng(0)
    two = go.Figure([go.Scatter(x=np.arange(points), y=rng.normal(size=points), line={"color": "#222"}, xaxis=f"x{i}")
                     for i in ("", "2")])  # fmt: skip
    two.update_layout(xaxis={"domain": [0, 0.45]}, xaxis2={"domain": [0.55, 1]}, height=300)
    cells = go.Figure(go.Heatmap(z=rng.normal(size=(9, 9)), colorbar={"title": {"text": "<b>score</b>"}}))
    wide = table([f"column {i}" for i in range(20)], [["1.2345"] * 20] * 3)
    return page(title, "The answer.", [("Table", wide), *[("Figure", f) for f in (two, cells)[:figures]]], {"Seed": 0})


def test_a_page_carries_the_library_once_and_stays_small():
    html = a_page()
    assert html.count("plotly.js v") == 1 and len(html.encode()) < MOST_BYTES / 2
    assert not re.search(r"""(?:src|href)=["'](?:https?:)?//""", html), "a page that is mailed must draw alone"
    assert 'name="viewport"' in html and html.index("The answer.") < html.index("<table")


def test_a_command_in_a_sentence_is_set_as_code_and_everything_is_escaped():
    made = page("t", "5 < 6; run `maglev check <x>`", [("", table(["a"], [["`new`"]]))], {})
    assert "5 &lt; 6; run <code>maglev check &lt;x&gt;</code>" in made and "<td><code>new</code></td>" in made


def test_the_effects_that_a_rig_states_are_among_its_facts():
    """A page had said "Effects none" of a rig whose file states a voltage limit."""
    rig = {"name": "mine", "magnet": "electromagnet_pair", "mass": 2.4, "effects": {}}
    assert "Effects of the rig" not in rig_facts(rig)
    stated = rig_facts(rig | {"effects": {"delay": {"time": 1e-4}}})
    assert stated["Effects of the rig"] == "delay: time = 0.0001"


def test_a_page_without_figures_carries_no_library():
    assert len(a_page(figures=0)) < 30_000


def test_equal_arrays_are_written_once_and_in_single_precision_where_it_shows_the_same():
    x, large = np.linspace(0, 1, 1000), np.array([1e-60, 1.0, 2.0])
    figure = go.Figure([go.Scatter(x=x, y=x**2), go.Scatter(x=x, y=-x), go.Scatter(y=large)])
    found = json.loads(figures_json([figure, figure]))
    assert len(found["arrays"]) == 4 and len(found["figures"]) == 2
    assert [one["dtype"] for one in found["arrays"]] == ["f4", "f4", "f4", "f8"]


def test_no_text_of_a_figure_ends_its_script():
    text = figures_json([go.Figure(layout={"title": {"text": "</script><script>alert(1)</script>"}})])
    assert "<" not in text and json.loads(text)["figures"][0]["layout"]["title"]["text"].startswith("</script>")


def test_drawn_samples_have_the_extremes_of_all_samples_in_order():
    values = np.sin(np.arange(20_000) * 1.234) * np.linspace(1, 2, 20_000)
    group = np.arange(20_000) // 40
    drawn = _extremes(values, group)
    assert len(drawn) <= 1000 and (np.diff(drawn) > 0).all()
    parts = [values[drawn][group[drawn] == i] for i in range(500)]
    np.testing.assert_array_equal([p.min() for p in parts], values.reshape(500, 40).min(axis=1))
    np.testing.assert_array_equal([p.max() for p in parts], values.reshape(500, 40).max(axis=1))


def test_every_line_is_drawn_where_lines_lie_apart():
    frequency = np.arange(1.0, 2501.0)
    drawn = _of_bands(frequency, np.random.default_rng(1).normal(size=2500))
    assert set(range(20)) <= set(drawn) and len(drawn) < 600


@pytest.mark.parametrize("ends", [(7400, 8400), (10.4, 19), (1, 1000), (4e-5, 7e-4), (700, 720), (0.9, 1.1), (5, 5)])
def test_a_logarithmic_axis_has_labels_where_its_values_are(ends):
    axis = labelled_axis("x", np.array(ends, float), True)
    assert [float(text) for text in axis["ticktext"]] == pytest.approx(axis["tickvals"])
    if ends[0] < ends[1]:
        inside = [tick for tick in axis["tickvals"] if ends[0] * 0.999 <= tick <= ends[1] * 1.001]
        assert 2 <= len(inside) <= 12


def test_pages_of_a_campaign_name_each_other_and_their_data(tmp_path):
    (tmp_path / "campaign.toml").touch()
    below = tmp_path / "diagnosis"
    below.mkdir()
    (tmp_path / "other.html").write_text("<title>not one of these</title>")
    write_page(tmp_path / "check.html", a_page("Check of <a>"), [tmp_path / "campaign.toml", None])
    assert 'href="' not in re.search(r'<span class="pages">(.*?)</span>', (tmp_path / "check.html").read_text())[1]
    write_page(below / "diagnosis.html", a_page("Diagnosis"), [below / "diagnosis.json", tmp_path / "campaign.toml"])
    first, second = (tmp_path / "check.html").read_text(), (below / "diagnosis.html").read_text()
    assert '<a href="diagnosis/diagnosis.html">Diagnosis</a>' in first and '<a href="campaign.toml">' in first
    assert '<a href="../check.html">Check of &lt;a&gt;</a>' in second and "<b>Diagnosis</b>" in second
    assert '<a href="diagnosis.json">' in second and "campaign.toml" not in second  # which is not below the page
    assert "other.html" not in first
    write_page(tmp_path / "check.html", a_page("Check of <a>"), [tmp_path / "campaign.toml"])
    assert (tmp_path / "check.html").read_text() == first


def test_the_title_of_a_page_from_elsewhere_is_text(tmp_path):
    evil = a_page("x", figures=0).replace("<title>x<", "<title><img src=x onerror=alert(1)><")
    (tmp_path / "evil.html").write_text(evil)
    write_page(tmp_path / "mine.html", a_page('Mine & "yours"', figures=0))
    mine = (tmp_path / "mine.html").read_text()
    assert "<img" not in mine and "&lt;img src=x onerror=alert(1)&gt;</a>" in mine
    assert "<b>Mine &amp; &quot;yours&quot;</b>" in mine


def test_a_damaged_page_beside_stays_as_it_is(tmp_path):
    whole = a_page("Whole", figures=0).replace("The answer.", "µ" * 40_000).encode()
    damaged = {"cut.html": whole[: whole.index(b"</span>")], "half.html": whole[: whole.index("µ".encode()) + 70_001]}
    for name, content in damaged.items():
        (tmp_path / name).write_bytes(content)
    write_page(tmp_path / "mine.html", a_page("Mine", figures=0))
    write_page(tmp_path / "other.html", a_page("Other", figures=0))
    assert {name: (tmp_path / name).read_bytes() for name in damaged} == damaged
    assert '<a href="other.html">Other</a>' in (tmp_path / "mine.html").read_text()


def test_pages_of_other_folders_stay_apart(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_page(tmp_path / name / "sweep.html", a_page(name))
    assert "two" not in (tmp_path / "one" / "sweep.html").read_text()[:20_000]


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright, and Debian's chromium or its own")
    with playwright.sync_playwright() as running:
        try:
            path = shutil.which("chromium") or shutil.which("google-chrome")
            chromium = running.chromium.launch(executable_path=path, args=["--no-sandbox"])
        except playwright.Error as error:
            pytest.skip(f"no Chromium: {error.message.splitlines()[0]}")
        yield chromium
        chromium.close()


@pytest.mark.slow
@pytest.mark.parametrize("width", [1400, 420])
@pytest.mark.parametrize("colours", ["light", "dark"])
def test_a_browser_draws_a_page_without_errors_and_without_sideways_scroll(browser, tmp_path, width, colours):
    write_page(tmp_path / "page.html", a_page())
    shown = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=colours)
    said = []
    shown.on("console", lambda message: said.append(message.text))
    shown.on("pageerror", lambda error: said.append(str(error)))
    shown.goto((tmp_path / "page.html").as_uri())
    for number in (1, 2):
        shown.locator(f"#figure-{number}").scroll_into_view_if_needed()
        shown.wait_for_selector(f"#figure-{number} .main-svg", state="attached")
    assert said == [] and shown.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    line = shown.evaluate("getComputedStyle(document.querySelector('#figure-1 .js-line')).stroke")
    ground = shown.evaluate("getComputedStyle(document.body).backgroundColor")
    ink, paper = (sum(map(int, re.findall(r"\d+", one)[:3])) for one in (line, ground))
    # Of 765: what is nearly black on paper is nearly white on a dark screen.
    assert (ink - paper if colours == "dark" else paper - ink) > 400
    with shown.expect_download() as download:
        shown.locator("#figure-1").locator(
            "xpath=ancestor::div[@class='scroll']/following-sibling::button"
        ).first.click()
    rows = download.value.path().read_text().splitlines()
    assert rows[0] == "trace,x axis,y axis,x,y,z" and len(rows) == 4001
    shown.close()


@pytest.mark.slow
def test_a_narrow_screen_has_the_legend_below_the_figure_and_scrolls_long_lines_inside(browser, tmp_path):
    curves = [go.Scatter(y=[1, 2, 3], name=f"what is known of case {i}") for i in range(3)]
    html = page("A page", "The answer.", [("", go.Figure(curves)), ("", f"<pre>{'long ' * 60}</pre>")], {})
    write_page(tmp_path / "page.html", html)
    shown = browser.new_page(viewport={"width": 420, "height": 900})
    shown.goto((tmp_path / "page.html").as_uri())
    shown.wait_for_selector("#figure-1 .legend", state="attached")
    legend, plot = (shown.locator(f"#figure-1 .{name}").first.bounding_box() for name in ("legend", "nsewdrag"))
    assert legend["y"] >= plot["y"] + plot["height"]
    assert plot["width"] > 200
    assert shown.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    shown.close()


@pytest.mark.slow
def test_the_page_of_six_recordings_is_small(tmp_path):
    out = tmp_path / "six"
    maglev("simulate", "--protocol", "diagnosis", "--out", str(out))
    assert (out / "recordings.html").stat().st_size < MOST_BYTES_OF_RECORDINGS / 2
