"""The page in headless Chromium, opened from a file: what the picture's own scene says, and what a hand on the controls does."""

import shutil
from io import BytesIO
from time import monotonic

import numpy as np
import pytest
import trimesh
from view_robots import AXIS, ORANGE, chain, visual

from robodyn.arithmetic.vectors import rotation
from robodyn.model import Box, Cylinder, Link, Mesh, Sphere, Visual
from robodyn.view import write_html

playwright = pytest.importorskip("playwright.sync_api", reason="the page is tested with playwright: pip install playwright")

EPS32 = float(np.finfo(np.float32).eps)
FLAGS = (
    "--no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync"
)


@pytest.fixture(scope="module")
def browser():
    found = [path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))]
    if not found:
        pytest.skip("the page is tested in Chromium, and none is installed: apt install chromium")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found[0], args=FLAGS.split())
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser, tmp_path):
    """Writes a page and opens it; in the end nothing may have been said on the console, and nothing fetched."""
    pages, said, asked = [], [], []

    def opened(mechanism, before="", **arguments):
        path = tmp_path / "run.html"
        write_html(path, mechanism, **arguments)
        page = browser.new_page(viewport={"width": 640, "height": 480})
        page.set_default_timeout(20_000)
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("dialog", lambda dialog: said.append(dialog.message))
        page.on("request", lambda request: asked.append(request.url))
        page.on("websocket", lambda socket: asked.append(socket.url))
        page.add_init_script(before)
        page.goto(path.as_uri())
        pages.append(page)
        return page

    yield opened
    for page in pages:
        page.close()
    assert said == []
    assert {url.split(":")[0] for url in asked} <= {"file", "data"}


def drawn(page):
    """Waits until the next two pictures are on the screen."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def until(condition):
    """Waits for it (playwright's own waiting would need `eval`, which the page's policy refuses)."""
    end = monotonic() + 20.0
    while not condition():
        assert monotonic() < end


def poses(page, mechanism):
    return np.stack([np.reshape(page.evaluate("name => robodyn.linkPose(name)", name), (4, 4)) for name in mechanism.link_names])


def time(page):
    return float(page.input_value("#time"))


def picture(page):
    from PIL import Image

    return np.asarray(Image.open(BytesIO(page.screenshot())).convert("RGB")).astype(int)


def share_of(colour, image):
    """Which part of the image has this hue: its red, green and blue in the same proportion."""
    colour = np.array(colour[:3]) / np.linalg.norm(colour[:3])
    return ((image @ colour) / np.linalg.norm(image, axis=-1).clip(1) > 0.99).mean()


def test_links_stand_where_python_says(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    for t in run.times[[0, 11, 30]]:
        page.evaluate("t => robodyn.setTime(t)", t)
        assert abs(poses(page, run.mechanism) - run.pose(t)).max() <= 8 * EPS32  # a rotation from four rounded numbers; |r| < 1 m


def test_between_two_frames_links_turn_and_slide_steadily(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    for t in (0.01, 0.5001, 0.99):
        page.evaluate("t => robodyn.setTime(t)", t)
        assert abs(poses(page, run.mechanism) - run.pose(t)).max() <= 16 * EPS32  # two rounded frames


def test_frames_need_not_be_evenly_spaced(open_page, run):
    run.times = np.array([0.2, 0.2, 0.5, 0.55, 2.0])  # two frames at an instant, as at an impact
    page = open_page(run.mechanism, **run.arguments)
    for t in (0.2, 0.35, 0.55, 1.3, 2.0):
        page.evaluate("t => robodyn.setTime(t)", t)
        assert abs(poses(page, run.mechanism) - run.pose(t)).max() <= 16 * EPS32
    page.evaluate("robodyn.setTime(-1)")
    assert time(page) == 0.2
    page.evaluate("robodyn.setTime(9)")
    assert time(page) == 2.0


def test_the_slider_moves_the_robot_before_play_is_pressed(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    first = picture(page)
    page.fill("#time", "0.5")
    assert page.text_content("#clock") == "0.500 / 1.000 s"
    assert abs(poses(page, run.mechanism) - run.pose(0.5)).max() <= 8 * EPS32
    drawn(page)
    assert abs(picture(page)[60:400] - first[60:400]).max() > 50  # the picture, above the controls
    assert page.get_attribute("#play", "aria-label") == "Play"


def test_a_pointer_drags_the_slider(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    rail = page.locator("#time").bounding_box()
    page.mouse.move(rail["x"] + 8, rail["y"] + rail["height"] / 2)
    page.mouse.down()
    page.mouse.move(rail["x"] + rail["width"] / 2, rail["y"] + rail["height"] / 2)
    page.mouse.up()
    assert time(page) == pytest.approx(0.5, abs=0.02)  # the thumb's width


def test_the_picture_shows_the_robot(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    drawn(page)
    image = picture(page)[60:400]
    assert share_of(ORANGE, image) > 0.01
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 500


def test_play_pause_restart(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    assert time(page) == 0.0
    page.select_option("#speed", "0.25")
    page.click("#play")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    until(lambda: time(page) > 0.05)
    page.keyboard.press("Tab")  # away from the button, which space would press a second time
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Space")
    assert page.get_attribute("#play", "aria-label") == "Play"
    stopped = time(page)
    page.wait_for_timeout(150)
    assert time(page) == stopped
    assert abs(poses(page, run.mechanism) - run.pose(stopped)).max() <= 16 * EPS32
    page.click("#restart")
    assert time(page) == 0.0


def test_without_loop_play_stops_at_the_end_and_starts_again_from_the_beginning(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    page.click("#loop")
    assert page.get_attribute("#loop", "aria-pressed") == "false"
    page.select_option("#speed", "4")
    page.evaluate("robodyn.play()")
    until(lambda: time(page) == 1)
    until(lambda: page.get_attribute("#play", "aria-label") == "Play")
    page.select_option("#speed", "0.1")
    page.click("#play")
    assert time(page) < 0.5


def test_with_loop_play_goes_round(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    page.evaluate("robodyn.setTime(0.9)")
    page.evaluate("robodyn.play()")
    until(lambda: time(page) < 0.5)
    assert page.get_attribute("#play", "aria-label") == "Pause"
    page.evaluate("robodyn.pause()")
    assert page.get_attribute("#play", "aria-label") == "Play"


def test_one_instant_is_a_picture_without_controls(open_page, still):
    page = open_page(still.mechanism, **still.arguments)
    assert not page.is_visible("#controls")
    assert page.is_visible("#frame")
    drawn(page)
    assert share_of(ORANGE, picture(page)[60:]) > 0.01


def test_the_whole_motion_can_be_framed_again(open_page, still):
    page = open_page(still.mechanism, **still.arguments)
    drawn(page)
    before = picture(page)[60:]
    page.mouse.move(320, 200)
    for _ in range(6):
        page.mouse.wheel(0, 400)
    drawn(page)
    assert share_of(ORANGE, picture(page)[60:]) < 0.7 * share_of(ORANGE, before)
    page.click("#frame")
    page.mouse.move(320, 200)
    drawn(page)
    assert share_of(ORANGE, picture(page)[60:]) == pytest.approx(share_of(ORANGE, before), rel=0.01)


@pytest.fixture
def fall(run):
    """The same robot, falling 20 m while it moves."""
    run.times = np.linspace(0.0, 2.0, 41)
    poses = run.poses
    poses[..., 2, 3] -= 5.0 * run.times[:, None] ** 2
    return run.mechanism, {"times": run.times, "poses": poses}


def test_the_picture_goes_with_a_robot_that_falls(open_page, fall):
    """As large at every time as at the start; the whole fall on demand, with a speck in it; and the robot again."""
    mechanism, arguments = fall
    page = open_page(mechanism, **arguments)
    assert page.get_attribute("#follow", "aria-pressed") == "true"

    def size(t=None):
        if t is not None:
            page.evaluate("t => robodyn.setTime(t)", t)
        page.mouse.move(320, 200)
        drawn(page)
        return share_of(ORANGE, picture(page)[60:400])

    sizes = [size(t) for t in (0.0, 0.7, 1.4, 2.0)]  # the arm turns, and shows another side
    assert min(sizes) > 0.01
    assert max(sizes) < 3 * min(sizes)
    last = size(2.0)
    page.click("#frame")
    assert page.get_attribute("#follow", "aria-pressed") == "false"
    assert size() < 0.1 * last
    speck = size()
    size(0.0)
    assert 0 < size(2.0) == pytest.approx(speck, rel=0.01)  # the camera stands still
    page.click("#follow")
    assert page.get_attribute("#follow", "aria-pressed") == "true"
    assert size() == pytest.approx(last, rel=0.02)
    page.click("#follow")  # the camera stays, the robot goes
    assert size() == pytest.approx(last, rel=0.02)
    assert size(0.0) == 0
    # While it plays as well.
    page.click("#follow")
    page.evaluate("robodyn.play()")
    until(lambda: time(page) > 1.0)
    page.evaluate("robodyn.pause()")
    assert size() > 0.01


def test_a_robot_that_stays_is_not_followed(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    assert not page.is_visible("#follow")


def test_what_the_hand_turned_stays_turned_while_the_picture_goes_along(open_page, fall):
    mechanism, arguments = fall
    page = open_page(mechanism, **arguments)
    drawn(page)
    before = picture(page)[60:400]
    page.mouse.move(320, 200)
    for _ in range(3):
        page.mouse.wheel(0, 400)  # further away
    drawn(page)
    smaller = share_of(ORANGE, picture(page)[60:400])
    assert smaller < 0.8 * share_of(ORANGE, before)
    page.evaluate("robodyn.setTime(2)")
    page.evaluate("robodyn.setTime(0)")
    drawn(page)
    assert share_of(ORANGE, picture(page)[60:400]) == pytest.approx(smaller, rel=0.02)


def test_controls_fit_a_phone(open_page, run):
    page = open_page(run.mechanism, **run.arguments)
    page.set_viewport_size({"width": 360, "height": 640})
    for name in ("#time", "#restart", "#play", "#clock", "#loop", "#speed", "#frame"):
        box = page.locator(name).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 360
        assert box["y"] + box["height"] <= 640


@pytest.mark.parametrize(("kind", "colour"), [("stl", None), ("obj", None), ("dae", None), ("dae", (0.9, 0.1, 0.1, 1.0))])
def test_meshes_are_drawn_in_their_own_colour_or_the_robots(open_page, tmp_path, kind, colour):
    green = (0.1, 0.9, 0.1, 1.0)
    ball = trimesh.creation.icosphere(radius=500.0)
    ball.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(baseColorFactor=green))
    path = tmp_path / f"ball.{kind}"
    ball.export(path)
    robot = chain(Link("ball", visuals=(visual(Mesh(path.name, str(path), (1e-3, 1e-3, 1e-3)), colour),)))
    page = open_page(robot, times=[0.0], poses=np.eye(4)[None, None])
    drawn(page)
    image = picture(page)[60:]
    own = (0.80, 0.82, 0.85) if kind == "stl" else green  # an STL file has no colour
    assert share_of(colour or own, image) > 0.1


def test_meshes_and_primitives_of_the_same_shape_give_the_same_picture(open_page, tmp_path):
    shapes = {
        "box": (Box((0.2, 0.3, 0.5)), trimesh.creation.box((200, 300, 500))),
        "cylinder": (Cylinder(0.1, 0.5), trimesh.creation.cylinder(100, 500, sections=64)),
        "sphere": (Sphere(0.15), trimesh.creation.uv_sphere(150, count=[64, 64])),
    }
    tilted = rotation(AXIS, np.cos(1.0), np.sin(1.0))
    primitives, meshes = [], []
    for i, (name, (primitive, mesh)) in enumerate(shapes.items()):
        path = tmp_path / f"{name}.stl"
        mesh.export(path)
        for visuals, geometry in ((primitives, primitive), (meshes, Mesh(path.name, str(path), (1e-3, 1e-3, 1e-3)))):
            visuals.append(Visual(geometry, tilted, np.array([0.5 * i, 0.1 * i, 0.3]), ORANGE))

    images = []
    for visuals in (primitives, meshes):
        page = open_page(chain(Link("all", visuals=tuple(visuals))), times=[0.0], poses=np.eye(4)[None, None])
        drawn(page)
        images.append(picture(page))
    assert share_of(ORANGE, images[0]) > 0.05
    assert (abs(images[0] - images[1]).max(axis=-1) > 20).mean() < 0.002  # edges


def test_every_face_of_a_motley_mesh_has_its_colour(open_page, tmp_path):
    box = trimesh.creation.box()
    box.visual.face_colors = np.where(box.face_normals[:, 2:] > 0.5, [[220, 20, 20, 255]], [[20, 20, 220, 255]])
    path = tmp_path / "box.ply"
    box.export(path)
    robot = chain(Link("box", visuals=(visual(Mesh(path.name, str(path))),)))
    page = open_page(robot, times=[0.0], poses=np.eye(4)[None, None])
    drawn(page)
    assert share_of((220, 20, 20), picture(page)) > 0.02
    assert share_of((20, 20, 220), picture(page)) > 0.02


def test_hostile_names_are_names(open_page):
    names = ["</script><script>alert(1)</script>", "<!--<script>", "__proto__", "a/b", "<img src=x onerror=alert(1)>", ""]
    robot = chain(*(Link(name, visuals=(visual(Box((0.1, 0.1, 0.1))),)) for name in names))
    at = np.tile(np.eye(4), (len(names), 1, 1))
    at[:, 0, 3] = np.arange(len(names))
    page = open_page(robot, times=[0.0], poses=at[None], title=names[0])
    assert page.title() == page.text_content("h1") == names[0]
    assert abs(poses(page, robot) - at).max() <= EPS32


def test_a_robot_without_visuals_is_seen(open_page):
    robot = chain(Link("base"), Link("tip"))
    at = np.stack([np.eye(4)] * 2)
    at[1, 2, 3] = 0.2
    page = open_page(robot, times=[0.0], poses=at[None])
    drawn(page)
    image = picture(page)[60:]
    assert (image.max(axis=-1) < 80).mean() > 0.002  # the dark joints


def test_without_webgl_the_page_says_so(open_page, run):
    page = open_page(run.mechanism, before="HTMLCanvasElement.prototype.getContext = () => null", **run.arguments)
    assert "WebGL" in page.text_content("#failure")
    assert page.is_visible("#failure")
    assert not page.is_visible("#controls")


def test_the_policy_forbids_what_the_page_never_does(browser, run, tmp_path):
    write_html(tmp_path / "run.html", run.mechanism, **run.arguments)
    page = browser.new_page()
    page.goto((tmp_path / "run.html").as_uri())
    tried = """async () => {
      const refused = [];
      document.addEventListener("securitypolicyviolation", event => refused.push(event.effectiveDirective));
      try { await fetch("http://127.0.0.1:9/"); } catch {}
      try { new WebSocket("ws://127.0.0.1:9/"); } catch {}
      const script = document.createElement("script");
      script.textContent = "window.broken = true";
      document.body.append(script);
      await new Promise(done => setTimeout(done, 100));
      return [refused.sort(), window.broken];
    }"""
    assert page.evaluate(tried) == [["connect-src", "connect-src", "script-src-elem"], None]
    page.close()
