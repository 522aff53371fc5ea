import pytest

from tests.crash.crash import crash


@pytest.mark.parametrize("job", ["measure", "calibrate"])
def test_a_few_kills_lose_nothing(tmp_path, job):
    done = crash(job, kills=1, seed=1, place=tmp_path)
    assert done.faults == [] and sum(done.states.values()) == 3
