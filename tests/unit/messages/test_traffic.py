"""Traffic in words: the size of the largest broadcast, and how often one is sent."""

import pytest

import phalanx
from phalanx.messages.seal import Sealer
from phalanx.messages.traffic import payload_bytes, traffic_in_words
from phalanx.network.inbox import BroadcastInbox
from phalanx.swarm.swarm import build_swarm


@pytest.mark.slow
@pytest.mark.parametrize("name", ["radio", "crossing"])
def test_the_size_is_that_of_the_largest_broadcast_of_a_run(name, monkeypatch):
    sizes, put = [], BroadcastInbox.put

    def measured(inbox, sender, message, *now):
        sizes.append(len(Sealer().seal("any", message)))
        return put(inbox, sender, message, *now)

    monkeypatch.setattr(BroadcastInbox, "put", measured)
    scenario = phalanx.load(name, {"duration": 1.2, "faults": [], "network.loss": 0.0})
    phalanx.run(scenario, engine="in-process")
    most = payload_bytes(build_swarm(scenario), 0)
    assert most - 20 <= max(sizes) <= most, "numbers of steps take a byte or three"


def test_words_name_each_kind_of_broadcast_and_nothing_where_none_is_heard():
    rogue = {"type": "give-way", "gains": [1.0], "speed": 1.5}
    of_one = {
        "radio": {"every": 5, "relays": 1},
        "goal": [[-6.0, 0.0]],
        "role": "normal",
        "law": rogue,
    }
    changes = {f"agents.1.{field}": value for field, value in of_one.items()}
    assert traffic_in_words(build_swarm(phalanx.load("crossing-radio", changes))) == (
        "4 a second and agent, of at most 409 bytes: 1.64 kB/s; "
        "4 a second and agent, of at most 213 bytes: 0.852 kB/s"
    )
    assert traffic_in_words(build_swarm(phalanx.load("centralised"))) == ""
