"""The commands, one file each: options (`add`), run (`run`), the Python function, the class of its result.

Inputs are read, outputs that cannot be written are refused, then the result is computed.  What a command needs is
imported when it runs; its files are read before anything is that compiles.
"""
