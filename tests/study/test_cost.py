"""What docs/estimation.md says an entry costs, in what does not hang on the machine."""

from circumnav_mav.study.cost import entry_costs


def test_the_ring_of_an_entry_is_open_for_longer_than_the_first_seconds_and_two_filters_cost_more_than_one():
    alone, far, auto = entry_costs(entries=3, repeats=1)
    assert 5.0 < alone.open_s[1] < 75.0
    assert alone.open_s[1] <= far.open_s[1]
    assert auto.open_us > alone.open_us
