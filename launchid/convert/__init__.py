"""Convert flights as users have them to logs: file -> channels (`readers`) -> map (`mapping`) -> one clock (`columns`).

A channel is one number over the rows of its group (a topic, a table, a folder of a file), named GROUP/NAME.  Nothing is
made up: a row of the log holds what was measured nearest to it (or what the map asks for), or NaN.
"""
