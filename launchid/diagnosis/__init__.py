"""The diagnosis: where simulation and measurement part, why, and what the model should be instead.

A log's way, through each room once and back to none (a test holds it: a room imports only those before it):

    log -> data: masked, on a grid -> controller: its commands -> model: innovations under the nominal -> causes: what
    may be wrong -> search: which of it the log asks for -> judge: is that to be believed, what does it buy, what could
    have been seen -> report: JSON, words, page

`verdict` leads it through.
"""
