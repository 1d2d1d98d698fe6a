"""The loop over cheap cases hides nothing: each failure by name, none swallowed, no empty loop."""

import pytest
from every import every


def test_every_case_runs_and_every_failure_is_named():
    seen = []

    @every(("x", "y"), [(1, "a"), (2, "b"), (3, "c"), (4, "d")])
    def law(x, y):
        seen.append(x)
        assert x != 2
        if x == 3:
            with pytest.raises(ValueError):
                int("7")

    with pytest.raises(AssertionError, match=r"^2 of 4 cases:\n2, 'b': AssertionError: .*\n3, 'c': Failed: .*RAISE"):
        law()
    assert seen == [1, 2, 3, 4]


def test_loops_nest_and_name_both_cases():
    @every("y", [10, 20])
    @every("x", [1, 2])
    def law(x, y):
        assert x * y != 40

    with pytest.raises(AssertionError, match=r"^1 of 2 cases:\n20: AssertionError: 1 of 2 cases:\n2: AssertionError"):
        law()


def test_an_empty_loop_fails():
    @every("x", [])
    def law(x):
        pass

    with pytest.raises(AssertionError, match="no case"):
        law()


def test_a_name_that_the_check_does_not_take_is_refused():
    with pytest.raises(AssertionError, match="does not take"):
        every("z", [1])(lambda x: None)


@every("x", ["kept"])
def test_fixtures_reach_the_check(tmp_path, x):
    (tmp_path / x).write_text(x)
    assert [path.name for path in tmp_path.iterdir()] == [x]
