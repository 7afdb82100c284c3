"""Cameras show the swarm, or the agent that a visitor follows; unsafe pairs stand out."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from phalanx_viewer.feeds.replay import Replay, open_replay
from phalanx_viewer.scene.cameras import Camera, Framing, View
from phalanx_viewer.scene.colours import age_colour
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.server import SceneServer, in_loop, open_page
from PIL import Image

import phalanx
from phalanx.scenario.load import load
from phalanx.theory.arrays import Array
from tests.process.runs import free_port, wait_for
from tests.process.viewer.pages import (
    camera_message,
    chosen,
    labelled,
    served,
    set_display,
    visitor,
)

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.browser, pytest.mark.swarm, pytest.mark.nightly, pytest.mark.timeout(400)]


@pytest.fixture(scope="module")
def violated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run whose agents collide."""
    out = tmp_path_factory.mktemp("violated")
    return phalanx.run(load("surrounded", []), engine="in-process", out=out).folder


def open_tab(tab: "Tab", server: SceneServer) -> Callable[[], View]:
    """Go to the page; return a function for the visitor's view of the scene."""
    tab.goto(f"http://127.0.0.1:{server.get_port()}")
    wait_for(lambda: server.get_clients())

    def view() -> View:
        (client,) = server.get_clients().values()
        camera = client.camera
        return View(camera.position, camera.look_at, camera.up_direction, camera.fov, camera.aspect)

    return view


def keep(tab: "Tab", framing: Framing) -> None:
    """Choose what the cameras keep in sight."""
    set_display(tab)
    labelled(tab, "Keep in sight").click()
    tab.get_by_role("option", name=framing.value).click()


def pixel(tab: "Tab", view: View, at: Array) -> tuple[float, float]:
    """Pixel of the page where a point of the scene is drawn."""
    canvas = tab.locator("canvas").nth(1).bounding_box()
    assert canvas is not None
    right, up = view.project(at[None])[0] * min(canvas["width"], canvas["height"])
    middle = canvas["x"] + canvas["width"] / 2.0, canvas["y"] + canvas["height"] / 2.0
    return float(middle[0] + right), float(middle[1] - up)


def positions(replay: Replay) -> Array:
    """Positions of the agents at the cursor."""
    x = np.frombuffer(replay.frame(replay.t).x)
    return replay.model.kinematics.poses(x).positions


def paints(tab: "Tab", view: View, picture: Picture) -> bool:
    """True if the browser painted every agent's colour at its pixel."""
    return paints_at(tab, view, picture.positions, picture.colours)


def paints_at(tab: "Tab", view: View, points: Array, colours: Array) -> bool:
    page = np.array(Image.open(BytesIO(tab.screenshot())).convert("RGB"), dtype=float)
    for at, rgb in zip(points, colours, strict=True):
        across, down = (round(part) for part in pixel(tab, view, at))
        patch = page[down - 12 : down + 12, across - 12 : across + 12]
        lengths = np.linalg.norm(patch, axis=2) * np.linalg.norm(rgb)
        similar = patch @ rgb.astype(float) > 0.95 * lengths
        if not (similar & (np.ptp(patch, axis=2) > 60.0)).any():
            return False
    return True


@pytest.mark.parametrize("framing", [Framing.RUN, Framing.SWARM])
def test_the_camera_holds_all_agents_throughout(
    tab: "Tab", finished: Path, framing: Framing
) -> None:
    replay = open_replay(finished)
    with served(replay) as page:
        view = open_tab(tab, page.server)
        keep(tab, framing)
        for t in (0.0, replay.end / 2.0, replay.end, replay.worst_at):
            replay.seek(t)
            wait_for(lambda: view().holds(positions(replay)))
            wait_for(lambda: paints(tab, view(), Picture(replay.model, replay.frame(replay.t))))


def test_ghosts_of_the_chosen_agents_peers_have_the_colour_of_their_age_until_hidden(
    tab: "Tab", tmp_path: Path
) -> None:
    """Two robots without loss but one broadcast each in 1.75 s: they are not where they were."""
    two = {"agents.0.count": 2, "agents.0.start": [[4.0, 0.0, -2.0, 0.0], [-4.0, 0.0, 0.0, 2.0]]}
    few = {"agents.0.goal": [[-4.0, 0.0], [-4.0, 9.0]], "agents.0.radio.every": 50, "faults": []}
    scenario = phalanx.load("radio", {**two, **few, "duration": 1.5, "agents.0.spread": [0.0] * 4})
    replay = open_replay(phalanx.run(scenario, engine="in-process", out=tmp_path).folder)
    assert replay.radio is not None
    (belief,) = replay.radio.at(0, replay.end)
    centre = np.array([[*belief.centre, 0.0]])
    with served(replay) as page:
        view = open_tab(tab, page.server)
        replay.seek(replay.end)

        def shows_ghost() -> bool:
            return paints_at(tab, view(), centre, np.array([age_colour(belief.age)]))

        wait_for(shows_ghost)
        set_display(tab, "Beliefs by radio")
        wait_for(lambda: not shows_ghost())


FROM_ABOVE = View(np.array([0.0, 0.0, 9.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.8, 1.5)


@contextmanager
def page_from_above(swarm: Array) -> Iterator[SceneServer]:
    """A page that begins with a view of a swarm, of shape (N, 3) [m]."""
    server = open_page("127.0.0.1", free_port(), "cameras")
    try:
        first, camera = FROM_ABOVE.fitted(swarm, 0.1), server.initial_camera
        camera.up, camera.fov = first.up, first.fov
        camera.position, camera.look_at = first.position, first.look_at
        server.admit()
        yield server
    finally:
        server.stop()


def camera_of(server: SceneServer, swarm: Array) -> Camera:
    """The camera of the page's only visitor, which expects a swarm."""
    (client,) = server.get_clients().values()
    return Camera(client, FROM_ABOVE, 0.1, swarm)


@contextmanager
def seen_from_above(
    tab: "Tab", swarm: Array
) -> Iterator[tuple[SceneServer, Camera, Callable[[], View]]]:
    """The same, and how a browser looks at it, once its camera is in place."""
    with page_from_above(swarm) as server:
        view = open_tab(tab, server)
        camera = camera_of(server, swarm)
        (client,) = server.get_clients().values()
        reports: list[View] = []
        # A view that was sent is the handle's at once: only a report says that the browser has it.
        client.camera.on_update(in_loop(lambda _: reports.append(view())))

        def in_place() -> bool:
            server.run(lambda: camera.show(swarm, None))
            server.run(camera.request_shape)
            return bool(reports) and holds_swarm(reports[-1])

        def holds_swarm(view: View) -> bool:
            # The point to look at may be reported with the position before.
            from_above = view.axes[2][2] < -0.999
            far = view.distance > 1.2 * view.fitted(swarm, 0.1).distance
            return from_above and far and view.holds(swarm)

        wait_for(in_place)  # a new browser's own camera is elsewhere, and then too near
        yield server, camera, view


TOGETHER = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def test_a_camera_that_follows_the_swarm_moves_away_when_an_agent_leaves(tab: "Tab") -> None:
    with seen_from_above(tab, TOGETHER) as (server, camera, view):

        def view_of(positions: Array) -> View | None:
            server.run(lambda: camera.show(positions, None))
            middle = (positions.min(axis=0) + positions.max(axis=0)) / 2.0
            looked = view()
            # The camera has a leash: it need not look at the very middle.
            there = np.allclose(looked.look_at[:2], middle[:2], atol=0.05 * looked.distance)
            return looked if there and looked.holds(positions) else None

        near = wait_for(lambda: view_of(TOGETHER)).distance
        elsewhere = wait_for(lambda: view_of(TOGETHER + np.array([5.0, 0.0, 0.0])))
        assert elsewhere.distance < 1.5 * near
        scattered = TOGETHER * np.array([[1.0], [20.0], [1.0]])
        assert wait_for(lambda: view_of(scattered)).distance > 5.0 * near
        wait_for(lambda: (back := view_of(TOGETHER)) and back.distance < 1.5 * near)


def test_a_browser_that_lags_behind_is_not_taken_for_a_visitor_who_zooms(tab: "Tab") -> None:
    with seen_from_above(tab, TOGETHER) as (server, camera, view):

        def distance(size: float) -> float:
            server.run(lambda: camera.show(size * TOGETHER, None))
            return view().distance

        near = distance(1.0)
        wait_for(lambda: distance(20.0) > 10.0 * near)
        (client,) = server.get_clients().values()

        def show_again(size: float) -> None:
            client.camera.fov *= 1.001 if size == 4.0 else 1.0 / 1.001  # it reports its view
            camera.show(size * TOGETHER, None)

        for size in (1.0, 4.0, 20.0) * 40:
            tab.evaluate("0")  # meanwhile it draws, or does not
            server.run(partial(show_again, size))
        for size in (20.0, 1.0):
            wait_for(lambda size=size: 0.8 < distance(size) / (size * near) < 1.2)  # type: ignore[misc]


def test_a_click_selects_the_agent_under_it(tab: "Tab", finished: Path) -> None:
    replay = open_replay(finished)
    with served(replay) as page:
        view = open_tab(tab, page.server)

        def clicked() -> bool:  # the first frames are slow in software
            tab.mouse.click(*pixel(tab, view(), positions(replay)[3]))
            return chosen(page) == 3

        wait_for(clicked)
        worst = replay.model.swarm.safe_set.pairs[replay.frame(0.0).pair].a
        assert worst != 3
        tab.get_by_role("button", name="Choose from the worst pair").click()
        wait_for(lambda: chosen(page) == worst)


def test_an_agent_that_a_visitor_follows_is_in_the_middle(tab: "Tab", finished: Path) -> None:
    replay = open_replay(finished)
    with served(replay) as page:
        view = open_tab(tab, page.server)
        (visitor,) = wait_for(page.visitors.copy).values()
        page.server.run(lambda: visitor.select(3))
        keep(tab, Framing.AGENT)

        def in_the_middle() -> bool:
            return float(np.abs(view().project(positions(replay)[3][None])).max()) < 0.02

        wait_for(in_the_middle)
        far = view().distance
        tab.mouse.move(*pixel(tab, view(), view().look_at))

        def zoomed() -> bool:
            tab.mouse.wheel(0, -300)
            return view().distance < 0.6 * far

        wait_for(zoomed)
        before = view().look_at
        replay.seek(replay.end)
        wait_for(lambda: np.linalg.norm(view().look_at - before) > 1.0)
        wait_for(in_the_middle)
        assert view().distance < 0.7 * far


def test_a_visitor_who_comes_while_an_agent_is_shown_sees_it_from_above_and_afar() -> None:
    with (
        page_from_above(TOGETHER) as server,
        # As from a browser that has not moved its camera yet to the view it was sent: from below.
        visitor(server.get_port(), position=[0.1, 0.0, -0.2], look_at=[0.1, 0.0, 0.0]),
    ):
        wait_for(server.get_clients)
        camera = camera_of(server, TOGETHER)
        camera.keep(Framing.AGENT)
        server.run(lambda: camera.show(TOGETHER, 1))
        (client,) = server.get_clients().values()
        assert client.camera.look_at == pytest.approx(TOGETHER[1])
        assert client.camera.position[2] > 1.0


def test_a_whole_run_stays_in_sight_beyond_what_was_known_and_after_the_view_is_reset() -> None:
    with (
        page_from_above(TOGETHER) as server,
        visitor(server.get_port(), position=[0.1, 0.0, -0.2], look_at=[0.1, 0.0, 0.0]) as browser,
    ):
        (client,) = wait_for(server.get_clients).values()
        camera, fov = camera_of(server, TOGETHER), FROM_ABOVE.fov
        camera.keep(Framing.RUN)

        def holds(swarm: Array) -> bool:
            server.run(lambda: camera.show(swarm, None))
            seat = client.camera
            return View(seat.position, seat.look_at, seat.up_direction, fov, 1.0).holds(swarm)

        assert holds(TOGETHER)
        assert holds(scattered := 20.0 * TOGETHER)
        first = server.initial_camera
        at, towards = (np.asarray(point).tolist() for point in (first.position, first.look_at))
        browser.send(camera_message(at, towards, (0.0, 1.0, 0.0, 0.0)))
        wait_for(lambda: client.camera.position == pytest.approx(first.position))
        assert holds(scattered)


def test_the_panel_of_a_narrow_page_covers_neither_agents_nor_its_own_end(
    tab: "Tab", finished: Path
) -> None:
    def box(selector: str) -> tuple[float, float]:
        """Top and bottom of an element."""
        box = tab.locator(selector).first.bounding_box()
        assert box is not None
        return box["y"], box["y"] + box["height"]

    with served(replay := open_replay(finished)) as page:
        tab.set_viewport_size({"width": 390, "height": 844})
        view = open_tab(tab, page.server)
        tab.locator("#phx-timeline").wait_for()
        for t in (0.0, replay.end):
            replay.seek(t)
            wait_for(lambda: view().holds(positions(replay)))
        scene, panel = box("#root"), box(".mantine-Paper-root")
        assert scene[1] <= panel[0] + 1.0
        assert panel[1] <= box("#phx-timeline")[0] + 1.0
        tab.get_by_text("Phalanx: unicycles").click()  # folds it
        wait_for(lambda: box("#root")[1] > scene[1] + 200.0)


def test_a_banner_sounds_the_alarm_while_a_pair_is_unsafe_which_is_a_click_away(
    tab: "Tab", violated: Path
) -> None:
    with served(replay := open_replay(violated)) as page:
        open_tab(tab, page.server)
        tab.get_by_text("Legend").wait_for()
        banner = tab.locator(".phalanx-alarm")
        assert banner.count() == 0
        tab.get_by_role("button", name="violation").click()
        wait_for(lambda: replay.t >= replay.violations[0].first)
        banner.get_by_text("1-2 unsafe: ").first.wait_for()
        replay.seek(1.5)
        banner.get_by_text("since t = 1.001 s").first.wait_for()
        notice = tab.locator(".mantine-Notification-root").bounding_box()  # of drawing in software
        alarm = banner.bounding_box()
        assert notice is None or (alarm and notice["y"] > alarm["y"] + alarm["height"])
        for k in range(2, 6):
            tab.get_by_role("listitem").filter(has_text=f"1-{k} left the safe set").wait_for()
        replay.seek(replay.worst_at)

        def names() -> set[str]:
            (client,) = page.server.get_clients().values()
            labels = [client.scene.get_handle_by_name(f"/labels/{k}") for k in range(6)]
            return {label.text for label in labels if label.visible}

        wait_for(lambda: set(replay.model.names) <= names())
        replay.seek(0.5)
        banner.wait_for(state="hidden")
