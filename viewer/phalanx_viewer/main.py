"""The viewer's program: show a live run or a recording on a page until SIGINT or SIGTERM."""

import logging
import secrets
from collections.abc import Callable
from pathlib import Path

import numpy as np

from phalanx.messages.membership import Membership
from phalanx.recording.curves.series import Series
from phalanx_viewer.feeds import keep_up, stop_request
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import Replay, open_replay
from phalanx_viewer.page.page import Page
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.server import choose_port

log = logging.getLogger("phalanx.viewer")


def _print(url: str) -> None:
    print(f"viewer: {url}", flush=True)


def run(
    membership: Membership | None,
    recording: Path | None,
    *,
    command_secret: bytes = b"",
    token: str = "",
    host: str = "127.0.0.1",
    port: int | None = None,
    origins: tuple[str, ...] = (),
    trust: bool = False,
    effect: bool = False,
    announce: Callable[[str], None] = _print,
) -> int:
    """Show a live run, a recording, or one and then the other; return exit status 0.

    Args:
        membership: of the live run.
        recording: a run's folder or its recording; None: the live run's last frame stays.
        command_secret: seals commands to the run; empty: read-only.
        token: secret in the address of visitors that may command it; by default a new one.
        host: address to serve the page on.
        port: of the page; None takes 8080 or the next free one.
        origins: further origins whose pages may connect; needed behind a proxy only.
        trust: whether code that the run's scenario names may be imported.
        effect: whether to repeat a recording's run and plot its network effect.
        announce: called with the page's address once it is served.

    Raises HubError, NoRunError, UnreadableRecordingError, ValueError, and PortTakenError if the
    page cannot be served there.
    """
    stop_requested, page = stop_request(), None
    choose_port(host, port)  # raises before a run is waited for, or a long recording is read
    if membership is not None:
        with Live(membership, command_secret, trust) as live:
            if command_secret and not live.commandable:
                log.warning("the plant obeys no commands: it was started without a command secret")
            token = token or secrets.token_urlsafe(16)
            page = Page(host, port, origins, live, token)
            announce(_address(page) + (f"/?token={token}" if live.commandable else ""))
            keep_up(page.tick, lambda: stop_requested() or (recording is not None and live.over))
    if page is None:
        assert recording is not None
        page = Page(host, port, origins, _load(recording, trust, effect))
        announce(_address(page))
    elif recording is not None and not stop_requested():
        try:
            page.replay(_load(recording, trust, effect))
        except ValueError as error:  # a plant that was killed leaves none
            log.warning("no replay: %s", error)
    keep_up(page.tick, stop_requested)
    page.stop()
    return 0


def _load(recording: Path, trust: bool, effect: bool) -> Replay:
    log.info("reading %s", recording)
    replay = open_replay(recording, trust)
    if effect:
        log.info("repeating the run for its network effect")
        replay.effects = _effects(replay.model)
    pairs = len(replay.model.swarm.safe_set.pairs)
    log.info("evaluating h of %d pairs in a run of %d states", pairs, len(replay.times))
    _ = replay.history.pairs  # cached, or the first visitor would wait for it
    return replay


def _effects(model: SceneModel) -> dict[int, Series]:
    """Return by agent the network effect over time [%]. Raises ValueError if it has none."""
    from phalanx.launcher.network_effect import network_effect

    steps = [(e.agent, e.t, 100.0 * e.effect) for e in network_effect(model.scenario)]
    of_agents = {name: np.array([s[1:] for s in steps if s[0] == name]) for name in model.names}
    return {i: Series(*of.T) for i, of in enumerate(of_agents.values()) if len(of)}


def _address(page: Page) -> str:
    where = f"http://{page.server.get_host()}:{page.server.get_port()}"
    log.info("showing the run at %s", where)  # without the token: others read logs too
    return where
