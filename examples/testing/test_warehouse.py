"""Tests of a swarm under network faults: pytest examples/testing"""

import pytest

from phalanx.testing import partition


@pytest.mark.phalanx(seeds=2)
def test_carts_stay_safe_while_one_hears_nothing(phalanx_run):
    run = phalanx_run(
        "warehouse-radio", loss=0.3, faults=[partition(["cart-1"], at=0.5, for_=0.5)],
        overrides={"duration": 2.0},
    )  # fmt: skip
    run.assert_safe()
    run.assert_network_matters()
