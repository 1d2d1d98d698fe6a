"""The answers of the commands and of `import launchid`: one function a command, from logs and nominals in memory to a
result that can be said, drawn, put into a table or written.

A result's `report` is the command's JSON, `warnings` are lines for the user beside it.
"""
