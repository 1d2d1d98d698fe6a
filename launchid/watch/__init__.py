"""Follow a log, or samples off a socket, while rows come, and show the estimates on a page of this machine.

The way of a row:

    source -> lines -> log of the rows that came -> estimator -> live (fixed size) -> message -> page

All up to `live` is one thread, the main one.  The page's threads only read `live`, whose parts are replaced or appended
to and never changed in place: there is no lock, nobody waits for a browser.
"""
