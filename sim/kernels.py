"""The decorators of the simulator's compiled functions; `launchid_core.kernels` has their common choices.

`kernel` is for what Python calls; `inner` for what a step calls, and Python cannot; `asked` for what both call; `apart`
for what several kernels call, or Python, that allocates nothing.  Their further choices, with reasons:

* ``forceinline=True``: handing a vehicle's arrays to a function costs more than what most of them do.
* ``_nrt=False``: without numba's run time no array's references are counted, which costs as much again
  (70 s of flight: 8.5 ms with, 5.5 ms without); what would allocate does not compile.
* ``no_cfunc_wrapper=True``: nobody calls them from C, and each such wrapper is compiled.
"""

from launchid_core import compiled

kernel = compiled(no_cfunc_wrapper=True)
inner = compiled(forceinline=True, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
asked = compiled(forceinline=True, _nrt=False, no_cfunc_wrapper=True)
apart = compiled(_nrt=False, no_cfunc_wrapper=True)
