"""Flights as users have them, made logs: file -> channels (`readers`) -> map (`mapping`) -> one clock (`columns`).

A channel is one number over the rows of its group (a topic, a table, a folder of a file), named GROUP/NAME.  Nothing is
made up on the way: a row of the log holds what was measured nearest to it, or nothing.
"""
