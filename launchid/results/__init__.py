"""Results of the commands and of `import launchid`, made from logs and nominals in memory: they can be printed, drawn,
put into a table or written.

A result's `report` is the command's JSON, `warnings` are lines for the user beside it.
"""
