"""`python -m sim` is the command `launchid`."""

import runpy

runpy.run_module("launchid", run_name="__main__", alter_sys=True)
