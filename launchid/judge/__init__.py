"""Judge logs and windows. Every reason for which an answer is refused is one line of `table.TESTS`.

    table      the tests: name, what each assumes, statistic, limit, source
    nominal, line      once for a log and its nominal: another vehicle, an undeclared mode
    question, input, terms     once for a log without a nominal: when beta acts, placebos, further terms (`lack`)
    window     of a window: whether the log's lacks move its numbers, whiteness, agreement
    windows    all windows of a log, by these;  refusal  what a refused estimate is;  scale  k1 between two scales
"""
