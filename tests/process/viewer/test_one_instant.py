"""All parts of a page show one instant, however busy the machine is."""

import contextlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
import zstandard
from phalanx_viewer.feeds.replay import open_replay

from phalanx.theory.arrays import Array
from tests.process.runs import wait_for
from tests.process.viewer.pages import PATIENCE, served, visitor

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

pytestmark = [pytest.mark.swarm]


class Window:
    """Messages that viser sends a page at once, and the arrays in them."""

    def __init__(self, data: bytes) -> None:
        end = 16 + int.from_bytes(data[8:16], "little")
        parts = msgspec.msgpack.decode(zstandard.decompress(data[16:end]))
        self.messages: list[dict[str, Any]] = [m for m in parts["messages"] if isinstance(m, dict)]
        self._arrays = list[bytes]()
        for length in parts["binaryBufferLengths"]:
            end += -end % 8
            self._arrays.append(data[end : end + length])
            end += length

    def moved(self, node: str) -> Array | None:
        """New positions of a batch, shape (N, 3); None if it does not move."""
        for m in self.messages:
            if m.get("name") == node and "batched_positions" in m.get("updates", {}):
                index = m["updates"]["batched_positions"]["__binary_index"]
                return np.frombuffer(self._arrays[index], dtype="<f4").reshape(-1, 3)
        return None

    def times(self) -> list[str]:
        """Times that the panel, to milliseconds, and the clock show."""
        text = str(self.messages)
        panel = re.findall(r"<b>t = ([\d.]+) s</b>", text)
        return panel + re.findall(r'phalanx\.at\(JSON.parse\("{\\+"t\\+":([\d.]+)', text)


def test_bodies_panel_and_clock_of_one_message_are_of_one_instant(finished: Path) -> None:
    replay, clock, frames = open_replay(finished), "", 0
    with served(replay) as page, visitor(page.server.get_port()) as connection:
        # viser splits what is new to a visitor, with the first frame, of which this is the end.
        while clock != "0.0":
            clock = "".join(Window(bytes(connection.recv(PATIENCE))).times()[-1:])
        replay.set_speed(0.5)
        replay.play(True)
        while frames < 30:
            window = Window(bytes(connection.recv(PATIENCE)))
            if (bodies := window.moved("/agents/bodies")) is None:
                # Texts and clock never move alone.
                assert {*window.times()} <= {clock, f"{float(clock):.3f}"}
                continue
            panel, clock = window.times()
            assert panel == f"{float(clock):.3f}"
            recorded = replay.history.trajectory[replay.times == float(clock)][0]
            np.testing.assert_allclose(bodies, recorded, atol=1e-5)
            rims = window.moved("/agents/rims")
            np.testing.assert_array_equal(rims, bodies)
            frames += 1


PARTS = """
() => {
  const viewer = window.__viserMutable, node = name => viewer.nodeRefFromName[name];
  const first = (name, test) => {
    let found;
    node(name).traverse(part => { if (!found && test(part)) found = part; });
    return found;
  };
  // How many letters are drawn of each label, and how many it has; labels are found by position.
  const labels = () => {
    const nodes = window.__viserSceneTree.getState(), found = [], drawn = {};
    let places;
    viewer.scene.traverse(({ geometry, material }) => {
      const owners = geometry?.attributes?.aLabelIndex?.array;
      if (!owners || !material.uniforms.uAtlas) return;
      places = material.uniforms.uLabelData.value.image.data;
      owners.slice(0, geometry.instanceCount).forEach(k => { drawn[k] = (drawn[k] || 0) + 1; });
    });
    for (const [name, { message, effectiveVisibility }] of Object.entries(nodes)) {
      if (!name.startsWith("/labels/") || !effectiveVisibility) continue;
      const e = node("/labels").matrixWorld.elements, p = viewer.nodePoseData[name].position;
      const at = [0, 1, 2].map(r => e[r] * p[0] + e[4 + r] * p[1] + e[8 + r] * p[2] + e[12 + r]);
      let k = 0;
      while (places && k < 99 && at.some((v, r) => Math.abs(v - places[4 * k + r]) > 1e-4)) k++;
      found.push([drawn[k] || 0, message.props.text.replace(/ /g, "").length]);
    }
    return found;
  };
  window.seen = [];
  viewer.scene.onAfterRender = () => {
    const { x, y } = node("/selected").position;
    const bodies = first("/agents/bodies", part => part.matricesTexture).matricesTexture._data;
    const line = first("/worst pair", part => part.geometry?.attributes.instanceStart);
    const [a, b, , c, d] = line.geometry.attributes.instanceStart.data.array;
    const at = i => [bodies[16 * i + 12], bodies[16 * i + 13]];
    window.seen.push({
      ring: [x, y], bodies: [0, 1, 2, 3, 4].map(at), ends: [[a, b], [c, d]], labels: labels(),
    });
  };
}
"""
"""Note what is in each picture: ring, bodies, the worst pair's line, and letters of labels."""


@contextlib.contextmanager
def busy(programs: int) -> Iterator[None]:
    """A machine with programs that never rest."""
    started = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(programs)
    ]
    try:
        yield
    finally:
        for program in started:
            program.kill()
            program.wait()


@pytest.mark.browser
@pytest.mark.nightly
def test_rings_and_lines_stay_at_their_robots_on_a_busy_machine(tab: "Tab", finished: Path) -> None:
    replay = open_replay(finished)
    with served(replay) as page, busy(4):
        tab.goto(f"http://127.0.0.1:{page.server.get_port()}")
        tab.locator("#phx-plots canvas").first.wait_for()
        wait_for(lambda: tab.evaluate("!!window.__viserMutable?.nodeRefFromName['/selected']"))
        tab.evaluate(PARTS)
        # A new page has no letters in its first pictures.
        whole = "window.seen.at(-1)?.labels.every(([drawn, letters]) => drawn === letters)"
        wait_for(lambda: tab.evaluate(whole))
        tab.evaluate("window.seen = []")
        replay.set_speed(0.1)
        replay.play(True)
        wait_for(lambda: tab.evaluate("window.seen.length") > 20)
        pictures = tab.evaluate("window.seen")
    parts = ("ring", "bodies", "ends")
    ring, bodies, ends = (np.array([picture[part] for picture in pictures]) for part in parts)
    assert np.ptp(ring, axis=0).max() > 0.1  # it moved
    np.testing.assert_allclose(ring, bodies[:, 0], atol=1e-4)
    off = np.linalg.norm(bodies[:, None] - ends[:, :, None], axis=3).min(axis=2)
    assert off.max() < 1e-4  # each end of the worst pair's line is at a body
    assert all(drawn == letters for picture in pictures for drawn, letters in picture["labels"])
