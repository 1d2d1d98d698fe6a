"""Where simulation and measurement part, why, and what the model should be instead.

The data's way: log -> `data_check` -> `record` (uniform rows) -> `predictor` (innovations under a model, the
simulator's own step) -> `noise` (levels, gains) -> `hypotheses`, `fit`, `selection` (causes) -> `goodness` (is it
believable) -> `extend`, `gain` (what the extension buys) -> `verdict` (words and JSON) -> `report` (pages).
"""
