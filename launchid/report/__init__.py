"""What users see of a result: its JSON, words, figures and pages.

makers   `answer` (a command's result and its JSON), `page` (HTML), `curves` (a figure as curves that zoom), `folder` (a
         report's files), `inline` (the script in a page); numbers in words are made by `launchid.formatting`
results  `comparison`, `comparisons`, `flights`: what several commands return
pages    `X_page` writes a report, `X_figures` draws, for each kind of result X

A result knows its own figures; the rooms that compute know nothing of this one.
"""
