"""What users see of a result: its JSON, words, figures and pages.

makers   `answer` (a result and its JSON as text), `headline` (one sentence, and the next command), `page` (HTML),
         `inline` (the script in a page), `folder` (a report's files), `curves` (a figure as curves that zoom),
         `drawing` (what figures share)
results  `identification` (JSON and words of judged windows), `comparison`, `comparisons`, `flights`
X_page   writes the report of X;  X_figures  draws X;  `paper` repeats the paper's experiments, with their table

Numbers with their deviation are put in words by `launchid.formatting`, which every room may use; this room stands above
all that compute, and below the commands.
"""
