"""The page: everything in it, nothing from outside, small, and drawn by a real browser."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import asrsim
from asrsim.cli.app import app
from asrsim.engines import default_engine
from asrsim.errors import InputError
from asrsim.log import LogWriter, read_log
from asrsim.quantities import QUANTITIES
from asrsim.render import Film
from asrsim.report import write_report
from asrsim.report.content import read_parameters
from asrsim.report.motion import motion_data
from asrsim.report.page import page_html
from asrsim.report.plots import joint_sections
from asrsim.report.series import pack, read_runs, unpack
from support.browser import CHROMIUM, Browser
from support.pages import Page
from support.paths import ROOT
from support.plot_example import made_up_log, simulated_log

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")


NO_WEBGL = """{
  const get = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind) { return kind === "webgl2" ? null : get.call(this, kind); };
}"""
"""Program that takes the 3-D interface from a browser."""


def page_data(page):
    return json.loads(re.search(r'id="data">(.*?)</script>', page.read_text(encoding="utf-8"), re.DOTALL)[1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    for variant in ("soft", "stiff"):
        simulated_log("step_2dof", folder / variant / "log.mcap", variant=variant, duration=0.3)
    return folder


@pytest.fixture(scope="module")
def page(folder):
    return write_report(folder)


def test_the_page_loads_nothing_from_anywhere(page):
    read = Page(page)
    assert read.addresses
    assert all(address.startswith("data:") for address in read.addresses)
    assert "default-src 'none'" in read.source


def test_the_page_says_what_ran_and_how_to_repeat_it(page, folder):
    text = " ".join(Page(page).text.split())
    for wanted in (
        "dof2_horizontal", "soft", "stiff", "leapfrog", default_engine(), "Numerical error", "spring_a_1", "1/rad", "tag <",
        "default", f"asrsim rerun {folder / 'soft' / 'log.mcap'}", f"asrsim rerun {folder / 'stiff' / 'log.mcap'}",
        "motor_1_inertia", "Scenario as read",
    ):  # fmt: skip
        assert wanted in text, wanted
    assert "log.mcap\nasrsim rerun" in page.read_text(encoding="utf-8")  # each command on a line of its own


@pytest.mark.parametrize("values", [[1.0, 1.0], [0.0, 3.0, -2.0, 1e-9], [np.nan, 2.0, 5.0, np.nan], [np.nan, 2.0], [np.nan]])
def test_packing_keeps_gaps_and_extremes(values):
    back = unpack(pack(np.array(values)), len(values))
    np.testing.assert_allclose(back, values, atol=1e-4)
    exact = np.isin(values, [np.nanmin([*values, 9.0]), np.nanmax([*values, -9.0])])
    np.testing.assert_array_equal(back[exact], np.array(values)[exact])


def test_a_short_push_is_on_the_page_at_its_time(tmp_path):
    """Of more samples than the page has places: the least and the largest of each place."""
    count = 30_001
    whole = read_log(made_up_log(tmp_path / "whole.mcap", count=count))
    force = np.zeros((count, 3))
    force[[2345, 6789], 1] = 5.0, -3.0
    with LogWriter(tmp_path / "log.mcap", whole.info) as writer:
        writer.write(replace(whole.samples, bodies={"box": np.zeros((count, 7))}, contacts={"box/robot": force}))
    grid, (run,) = read_runs([tmp_path / "log.mcap"], quantities=["link_position"])
    box = next(one for one in joint_sections([run], {}, grid.time) if one["name"] == "box")
    labels = [(plot["title"], [line["label"] for line in plot["series"]]) for plot in box["plots"]]
    assert labels == [("displacement", ["along x", "along y", "along z"]), ("contact force", ["without ground"])]
    shown = run.get("box", "force").values
    assert (grid.thinned, shown.max(), np.count_nonzero(shown)) == (True, 5.0, 2)
    assert np.abs(grid.time[shown > 0.0] - [2.345, 6.789]).max() < 2.0 * grid.step


def test_the_moving_view_puts_each_body_where_the_film_has_it(folder):
    film = Film(folder / "soft" / "log.mcap")
    (run,) = motion_data([film], ["soft"])["runs"]
    count, bodies = run["count"], {body["name"]: body for body in run["bodies"]}
    times = unpack(run["time"], count)

    def frame(name, number):
        *place, x, y, z, w = (unpack(column, count)[number] for column in bodies[name]["pose"])
        own = np.eye(4)
        own[:3, :3], own[:3, 3] = Rotation.from_quat([x, y, z, w]).as_matrix(), place
        parent = bodies[name]["parent"]
        return own if parent is None else frame(parent, number) @ own

    for number in (0, count // 2, count - 1):
        wanted = film.frames(int(np.abs(film.samples.time - times[number]).argmin()))
        assert bodies.keys() == wanted.keys()
        for name, place in wanted.items():
            np.testing.assert_allclose(frame(name, number), place, atol=1e-3, err_msg=name)
    assert np.abs(film.frames(0)["link_2"] - film.frames(len(film.samples.time) - 1)["link_2"]).max() > 0.02


def test_a_title_is_text():
    page = page_html("a <b> & c", ["<section></section>"], head="<p>head</p>", foot="foot")
    assert "<h1>a &lt;b&gt; &amp; c</h1><p>head</p>" in page
    assert "<b>" not in page
    assert page.index("head</p>") < page.index("<section>") < page.index("foot</footer>")


def test_twenty_seconds_of_five_joints_fit_in_two_megabytes(tmp_path):
    rng = np.random.default_rng(1)
    # Noise does not pack; the film strip, which is not drawn here, takes less than 0.2 MB.
    values = {name: rng.normal(size=20_001) for name in QUANTITIES}
    log = made_up_log(tmp_path / "log.mcap", joints=5, count=20_001, values=values)
    assert write_report(log.parent, film=False).stat().st_size < 1_800_000


def test_without_a_summary_the_measures_of_every_joint_follow_from_the_log(tmp_path):
    scenario = ROOT / "examples" / "scenarios" / "step_2dof.yaml"
    overrides = ["duration=0.3", "compiled=false", "expect=[]"]
    result = asrsim.run(scenario, variant="soft", overrides=overrides, out=tmp_path / "run")
    (tmp_path / "run" / "summary.json").unlink(missing_ok=True)
    text = " ".join(Page(write_report(tmp_path / "run", film=False)).text.split())
    for joint in result.summary.joints:
        assert f"{joint.name} qbmove, mode 6 {joint.measures.peak_deflection:.3g} " in text


HEAD = "source,joint,quantity,measure,value,unit\n"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (f"{HEAD}soft - lab.csv,joint_1,link_position,rmse,0.0123,rad\n", True),
        (f"{HEAD}soft - lab.csv,joint_1,link_position,rmse,0.0123 or so,rad\n", False),
        (f'{HEAD}soft - "lab.csv,joint_1\0', False),
        ("time,q\n0,0\n", False),
    ],
)
def test_readable_metrics_in_the_folder_are_shown(tmp_path, text, shown):
    log = made_up_log(tmp_path / "log.mcap", count=30)
    (tmp_path / "metrics.csv").write_text(text)
    words = Page(write_report(log.parent, film=False)).text
    assert ("Beside experiments" in words) == ("0.0123 rad" in words) == shown


def test_a_parameter_names_its_tag_and_line(folder):
    info = read_log(folder / "soft" / "log.mcap").info
    text = info.urdf.splitlines()
    found = [parameter for values in read_parameters(info).values() for parameter in values]
    named = [re.fullmatch(r"tag <(\w+)>, line (\d+)", one.origin) for one in found]
    assert [f"<{match[1]}>" in text[int(match[2]) - 1] for match in named if match] == [True] * 12
    assert not any("line" in one.origin for one, match in zip(found, named, strict=True) if not match)


def test_a_folder_without_log_is_an_error(tmp_path):
    with pytest.raises(InputError, match=r"contains no log.*Run a scenario first"):
        write_report(tmp_path)
    (tmp_path / "logs" / "run_000000").mkdir(parents=True)
    (tmp_path / "logs" / "run_000000" / "log.mcap").touch()
    with pytest.raises(InputError, match=r"Deeper folders contain logs: .*logs$"):
        write_report(tmp_path)


SCROLL = """(async () => {
  for (let y = 0; y < document.documentElement.scrollHeight; y += 500) {
    scrollTo(0, y); await new Promise((done) => setTimeout(done, 60));
  }
  await new Promise((done) => setTimeout(done, 200));
})()"""
INK = """[...document.querySelectorAll('.plots canvas')].map((canvas) => {
  const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    const colour = pixels.slice(i, i + 3);
    if (pixels[i + 3] > 200 && Math.max(...colour) - Math.min(...colour) > 60) count++;
  }
  return count;
})"""


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("width", [1200, 390])
def test_a_browser_draws_every_plot_without_complaint(browser, page, width):
    browser.open(page, width=width)
    browser.evaluate(SCROLL)
    assert browser.complaints == []
    assert browser.requests == [page.absolute().as_uri()]
    ink = browser.evaluate(INK)
    data = page_data(page)
    assert len(ink) == sum(len(joint["plots"]) for joint in data["groups"])
    titles = [plot["title"] for joint in data["groups"] for plot in joint["plots"]]
    # The residual's line is black; all others have colour.
    assert all(count > 100 for count, title in zip(ink, titles, strict=True) if title != "energy residual")
    assert browser.evaluate("document.documentElement.scrollWidth") == width
    ranges = browser.evaluate("asrsimCharts.map((chart) => [chart.scales.x.min, chart.scales.x.max])")
    assert ranges == [pytest.approx([0.0, 0.3], abs=1e-9)] * len(ink)


@needs_browser
@pytest.mark.slow
def test_hover_zoom_and_legend_work_in_a_browser(browser, page):
    browser.open(page, width=1200)
    browser.evaluate(SCROLL)
    browser.evaluate("document.querySelector('.u-over').scrollIntoView({block: 'center'})")
    box = browser.evaluate(
        "(({x, y, width, height}) => [x, y, width, height])(document.querySelector('.u-over').getBoundingClientRect())"
    )
    x, y, width, height = box

    def mouse(kind, share, **more):
        place = {"x": x + share * width, "y": y + 0.5 * height}
        browser.call("Input.dispatchMouseEvent", {"type": kind, **place, **more})
        browser.evaluate("new Promise((done) => setTimeout(done, 100))")

    mouse("mouseMoved", 0.4)
    assert re.search(r"soft -?\d\S* \| stiff -?\d\S* rad", browser.evaluate("document.querySelector('.legend').textContent"))
    assert browser.evaluate("document.querySelector('.time').textContent") == "0.120 s"
    mouse("mousePressed", 0.4, button="left", buttons=1, clickCount=1)
    mouse("mouseMoved", 0.5, button="left", buttons=1)
    mouse("mouseMoved", 0.6, button="left", buttons=1)
    mouse("mouseReleased", 0.6, button="left", clickCount=1)
    ranges = browser.evaluate("asrsimCharts.map((chart) => [chart.scales.x.min, chart.scales.x.max])")
    assert ranges[0] == pytest.approx([0.12, 0.18], abs=0.005)
    assert all(one == ranges[0] for one in ranges)
    browser.evaluate("document.querySelector('.legend button').click()")
    assert browser.evaluate("asrsimCharts[0].series.some((series) => !series.show)")
    browser.evaluate("document.querySelector('#runs button').click()")
    assert browser.evaluate(
        "asrsimCharts.every((chart) => chart.plot.series.every((s, i) => s.run !== 0 || !chart.series[i + 1].show))"
    )
    assert browser.complaints == []


def test_recorded_curves_and_comparisons_are_on_the_page(tmp_path):
    """As `asrsim plot` leaves them beside a variant."""
    log = made_up_log(tmp_path / "soft" / "log.mcap")
    made_up_log(tmp_path / "stiff" / "log.mcap", variant="stiff")
    lab = tmp_path / "lab.csv"
    lab.write_text("time,q\n" + "".join(f"{0.01 * i},{0.3 * np.sin(0.0628 * i)}\n" for i in range(100)))
    options = ["--experiment", str(lab), "--map", "q=joint_1.link_position [rad]", "--align", "off"]
    assert CliRunner().invoke(app, ["plot", str(log), *options]).exit_code == 0
    page = write_report(tmp_path, film=False)
    assert "Beside experiments" in Page(page).text
    data = page_data(page)
    position = next(p for p in data["groups"][0]["plots"] if p["title"] == "position")
    (recorded,) = (s for s in position["series"] if s["label"] == "link position, recorded")
    assert data["runs"][recorded["run"]]["label"] == "soft"
    assert recorded["high"] == pytest.approx(0.3, abs=1e-3)
    assert page.read_text(encoding="utf-8").count("data:image/png") >= 1


@pytest.mark.parametrize("most", [1, 2])
def test_a_page_of_many_runs_says_that_it_shows_the_first_ones(most, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("asrsim.report.content.STRIPS", most)
    page = write_report(folder, tmp_path / "report.html")
    text = page.read_text(encoding="utf-8")
    assert ("Of the first 1 runs." in text) == (most == 1)
    assert [f'alt="film strip of {name}"' in text for name in ("soft", "stiff")] == [True, most > 1]
    assert len(page_data(page)["runs"]) == 2


def test_warnings_of_all_runs_are_on_their_page_as_the_command_says_them(tiny, asrsim_command):
    """With file, line, key, value and remedy, where they have them; the file without its folder. Only the first run has the
    warning about gravity."""
    robot = tiny.robot.read_text().replace('mass value="0.5"', 'mass value="51"').replace('upper="3"', 'upper="90"')
    tiny.robot.write_text(robot)
    variants = "variants: {a: {gravity: [0, 0, 9.81]}, b: {}}\n"
    tiny.scenario.write_text(f"{tiny.scenario.read_text()}compiled: false\n{variants}")
    asrsim_command("run", tiny.scenario, "--no-plot", "-o", "out", "--set", "duration=0.2")
    told = " ".join(asrsim_command("check", tiny.scenario).out.replace(f"{tiny.folder}/", "").split())
    shown = " ".join(Page(write_report(tiny.folder / "out", film=False)).text.split())
    codes = ("heavy-link", "limit-in-degrees", "gravity")
    warnings = {one.code: one for one in asrsim.prepare(tiny.scenario, variant="a").warnings}
    for one in map(warnings.__getitem__, codes):
        assert one.file is not None
        text = str(replace(one, file=Path(one.file.name), value=None if one.value is None else str(one.value)))
        assert text in shown
        assert str(replace(one, file=Path(one.file.name))) in told


@pytest.mark.parametrize("command", ["plot", "report"])
def test_an_unreadable_log_is_left_out(tmp_path, asrsim_command, command):
    good = made_up_log(tmp_path / "a" / "log.mcap", count=20)
    for name, content in (("cut", b"\x89MCAP0\r\n"), ("empty", b"")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "log.mcap").write_bytes(content)
    # Of a run that was stopped before its first sample.
    (tmp_path / "early").mkdir()
    with LogWriter(tmp_path / "early" / "log.mcap", read_log(good).info):
        pass
    outcome = asrsim_command(command, tmp_path, "-q")
    assert outcome.code == 0
    for name, reason in (("empty", "the file is empty"), ("cut", ""), ("early", "the log contains no samples")):
        assert f"{name}/log.mcap: left out: {reason}" in outcome.err
    good.write_bytes(b"")
    assert asrsim_command(command, tmp_path).code == 1


def test_a_log_without_link_positions_has_a_page(tmp_path):
    whole = read_log(made_up_log(tmp_path / "whole.mcap", count=20))
    joints = tuple(replace(joint, quantities=("link_torque", "reference_1")) for joint in whole.info.joints)
    with LogWriter(tmp_path / "log.mcap", replace(whole.info, joints=joints)) as writer:
        writer.write(whole.samples)
    (joint,) = page_data(write_report(tmp_path / "log.mcap", film=False))["groups"]
    assert [plot["title"] for plot in joint["plots"]] == ["link torque"]


@needs_browser
@pytest.mark.slow
def test_the_robot_moves_in_a_browser(browser, tmp_path):
    log = simulated_log("box_push_5dof", tmp_path / "stiff" / "log.mcap", variant="stiff", duration=0.3)
    browser.open(write_report(log.parent), width=1000)
    film = Film(log)
    look = """(() => { asrsimMotion.draw(); const gl = document.querySelector('#motion canvas').getContext('webgl2');
      const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, p = new Uint8Array(4 * w * h);
      gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
      let brown = 0, sum = 0;
      for (let i = 0; i < p.length; i += 4) { brown += p[i] - p[i + 2] > 40; sum += p[i] * (i % 9973); }
      return [brown / (w * h), sum]; })()"""
    first = browser.evaluate(look)
    assert first[0] > 0.05  # the box is brown: much more red than blue
    row = len(film.samples.time) // 2
    theirs = browser.evaluate(f"asrsimMotion.frames({film.samples.time[row]})")
    for body, frame in film.frames(row).items():
        np.testing.assert_allclose(np.reshape(theirs[body], (4, 4)), frame, atol=2e-4)
    browser.evaluate("document.querySelector('#motion .play').click(); new Promise((done) => setTimeout(done, 200))")
    assert browser.evaluate(look) != first
    assert browser.complaints == []


@needs_browser
@pytest.mark.slow
def test_one_time_goes_through_the_moving_view_and_all_plots(browser, page):
    browser.open(page, width=1200)
    marked = (
        "asrsimCharts.filter((chart) => chart.across === 'time').map((chart) => chart.now.hidden ? null : "
        "chart.posToVal(new DOMMatrix(chart.now.style.transform).m41, 'x'))"
    )
    assert set(browser.evaluate(marked)) == {None}
    slider = "(() => { const bar = document.querySelector('#motion input'); bar.value = 0.2;"
    browser.evaluate(f"{slider} bar.dispatchEvent(new Event('input')); }})()")
    shown = browser.evaluate(marked)
    assert len(shown) > 4
    assert shown == [pytest.approx(0.2, abs=1e-3)] * len(shown)
    browser.evaluate("document.querySelector('.u-over').scrollIntoView({block: 'center'})")
    x, y, width, height = browser.evaluate(
        "(({x, y, width, height}) => [x, y, width, height])(document.querySelector('.u-over').getBoundingClientRect())"
    )
    for share in (0.3, 0.5):
        place = {"type": "mouseMoved", "x": x + share * width, "y": y + 0.5 * height}
        browser.call("Input.dispatchMouseEvent", place)
        browser.evaluate("new Promise((done) => setTimeout(done, 150))")
    assert browser.evaluate("document.querySelector('#motion .clock').textContent") == "0.15 s"
    assert browser.complaints == []


@needs_browser
@pytest.mark.slow
def test_paper_shows_every_plot_without_scrolling(browser, page):
    browser.open(page, width=1200)
    browser.evaluate("document.querySelectorAll('details.joint').forEach((part) => { part.open = false; })")
    browser.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert browser.evaluate("[...document.querySelectorAll('.plot .body')].every((body) => body.dataset.drawn)")
    assert all(browser.evaluate("[...document.querySelectorAll('details.joint')].map((part) => part.open)"))


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize(
    ("missing", "words"),
    [(NO_WEBGL, "The moving robot needs WebGL 2"), ("delete window.ResizeObserver", "need a newer browser")],
)
def test_a_browser_that_cannot_draw_says_so_in_words(tmp_path, page, missing, words):
    with Browser(tmp_path) as browser:
        browser.call("Page.addScriptToEvaluateOnNewDocument", {"source": missing})
        browser.open(page, width=1200)
        assert words in browser.evaluate("document.body.innerText")


@needs_browser
@pytest.mark.slow
def test_plots_stand_side_by_side_on_paper_and_keep_their_colours(browser, page):
    """Paper of A4 has about 700 pixels; backgrounds, which the colours of legends are, are left out unless the page asks for
    them."""
    browser.open(page, width=700)
    browser.call("Emulation.setEmulatedMedia", {"media": "print"})
    browser.evaluate("dispatchEvent(new Event('beforeprint'))")
    try:
        boxes = browser.evaluate(
            "[...document.querySelectorAll('.plot canvas')].map((one) => one.getBoundingClientRect().toJSON())"
        )
        assert boxes[0]["y"] == boxes[1]["y"]
        assert 300 < boxes[0]["width"] < 350
        assert browser.evaluate("document.documentElement.scrollWidth") <= 700
        assert browser.evaluate("getComputedStyle(document.querySelector('.legend button')).printColorAdjust") == "exact"
    finally:
        browser.call("Emulation.setEmulatedMedia", {"media": ""})
