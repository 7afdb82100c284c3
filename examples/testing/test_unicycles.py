"""Tests of a swarm under network faults: pytest examples/testing"""

import pytest
from phalanx_testing import partition


@pytest.mark.phalanx(seeds=2)
def test_robots_stay_safe_while_one_hears_nothing(phalanx_run):
    cut = partition(["1"], at=0.5, for_=0.5)
    run = phalanx_run("unicycles", loss=0.3, faults=[cut], overrides={"duration": 2.0})
    run.assert_safe()
    run.assert_never_closer(0.5)
    run.assert_network_matters()
