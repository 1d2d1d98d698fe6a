"""The table of tests is what refuses: every line is asked somewhere, and every limit is a number."""

import math
from pathlib import Path

import launchid.judge
from launchid.judge.table import TESTS
from launchid.log.rates import FEWEST_SLOPES
from launchid.weakform.late import SHIFT
from launchid.weakform.pieces import PER_COEFFICIENT

# limits that the rooms below the judge need too, and hold
ELSEWHERE = {"rows enough": PER_COEFFICIENT, "beta at every row": FEWEST_SLOPES,
             "beta acts when it is logged": SHIFT, "one clock": SHIFT}


def test_every_line_is_asked_and_every_limit_is_a_number():
    room = Path(launchid.judge.__file__).parent
    asked = "".join(path.read_text() for path in room.glob("*.py") if path.name != "table.py")
    for name, test in TESTS.items():
        assert math.isfinite(test.limit) and test.limit > 0.0, name
        assert test.limit == ELSEWHERE[name] if name in ELSEWHERE else f'TESTS["{name}"].limit' in asked, name
