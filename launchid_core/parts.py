"""Parts of a kernel become machine code once, inside the entry that Python calls.

numba alone optimises every function with all that it calls, makes machine code of it, and does both again in whoever
calls it: a kernel five calls deep is optimised and written five times, which was a third of the time to the first
`Estimator`.  A part (`inner`, `once`, `shared` of `kernels`) stays in the compiler's language until an entry is
compiled; that one holds all of it, and is optimised and written once, in one pass where numba alone makes three: over
each function, quickly over the whole, and over the whole (a third of what then was left).  A part is compiled once
for all its callers and all integers.  The operations and their order are the same, so are the bits.

Not part of what flies, as `kernel_cache`.  It uses what is no public part of numba; with a numba that is another than
it expects it does without, which costs time and nothing else.
"""

import contextlib
import gc
from collections.abc import Iterator
from typing import Any

import numba.core.codegen
import numba.core.compiler
from numba.core import types
from numba.core.typing import templates

codegen: Any = numba.core.codegen
compiler: Any = numba.core.compiler

# numba's passes that find nothing in a kernel without its run time: what they look for allocates, or is Python
IDLE = frozenset({"WithLifting", "InlineClosureLikes", "RewriteDynamicRaises", "MakeFunctionToJitFunction",
                  "FindLiterallyCalls", "LiteralUnroll", "LiteralPropagationSubPipelinePass", "InlineOverloads",
                  "NopythonRewrites", "NoPythonSupportedFeatureValidation", "DumpParforDiagnostics"})
SPEED, INLINED = 2, 25    # LLVM's level; how large, in its measure, a part is that it may put into a caller unasked
GARBAGE = (100_000, 20, 20)  # new objects, and rounds of the young, between two looks
OWN = f"{len(__package__)}{__package__}"  # in the name of compiled code that comes from here
KIND = "part"  # of what is kept on disk, beside numba's "object"

KNOWN = (all(hasattr(codegen, name) for name in ("JITCodeLibrary", "ll"))
         and all(hasattr(codegen.ll, f"create_new_{kind}_pass_manager") for kind in ("function", "module"))
         and all(hasattr(codegen.ll, f"create_{what}") for what in ("pass_builder", "pipeline_tuning_options"))
         and hasattr(codegen, "_parse_refprune_flags")
         and all(hasattr(codegen.JITCodeLibrary, name)
                 for name in ("finalize", "_get_module_for_linking", "get_pointer_to_function", "codegen",
                              "serialize_using_object_code", "_optimize_functions", "_optimize_final_module"))
         and all(hasattr(compiler, name) for name in ("Compiler", "CompileResult", "CR_FIELDS"))
         and hasattr(types, "BaseFunction") and hasattr(types.BaseFunction, "get_call_type"))


def _sweep(library: Any, module: Any) -> None:
    """What no one uses is taken out, above all addresses of this process; all else waits for the entry."""
    module.data_layout = library._codegen._data_layout
    passes = codegen.ll.create_new_function_pass_manager()
    passes.add_dead_code_elimination_pass()
    builder = library._codegen._pass_builder()
    for function in module.functions:
        if not function.is_declaration:
            passes.run(function, builder)


def _holds_address(library: Any) -> bool:
    """Of this process."""
    return any(each.name.startswith("numba.dynamic.globals") for each in library._final_module.global_variables)


def _tuning() -> Any:
    """What LLVM is asked for.

    Loops along a column are in vectors as written (`lanes`), each in its own order: to unroll them, to run two turns of
    one beside another or to put large parts into their callers makes more code that is no faster, and took a third of
    LLVM's time.
    """
    tuning = codegen.ll.create_pipeline_tuning_options(min(int(codegen.config.OPT), SPEED))
    tuning.loop_vectorization = bool(codegen.config.LOOP_VECTORIZE)
    tuning.slp_vectorization = bool(codegen.config.SLP_VECTORIZE)
    tuning.loop_unrolling = tuning.loop_interleaving = False
    tuning.inlining_threshold = INLINED
    return tuning


if KNOWN:
    class _Written:
        """numba's code generator, without the machine code that a part has not."""

        def __init__(self, made: Any) -> None:
            self._made = made

        def __getattr__(self, name: str) -> Any:
            return getattr(self._made, name)

        def set_env(self, name: str, env: Any) -> None:
            """There is no place for it, and no part asks for it: nothing in one is Python."""

    class Part(codegen.JITCodeLibrary):  # type: ignore[misc]
        """What numba keeps of a compiled function; of a part, what it does and which parts it calls."""

        _shared_module: Any
        _optimize_functions = _sweep

        @property
        def codegen(self) -> Any:
            """numba's code generator."""
            return _Written(self._codegen)

        def finalize(self) -> None:
            """No more comes: nothing is made of it."""
            self._raise_if_finalized()
            if _holds_address(self):  # still: what numba put down across branches needs more to be seen as unused
                passes = codegen.ll.create_new_module_pass_manager()
                passes.add_sroa_pass()
                passes.add_dead_code_elimination_pass()
                passes.add_global_dead_code_eliminate_pass()
                passes.run(self._final_module, self._codegen._pass_builder())
            self._finalized = True

        def get_pointer_to_function(self, name: str) -> int:
            """Python cannot call it."""
            return 0

        def parts(self) -> Iterator[Any]:
            """It and all that it calls, at any depth, each once."""
            todo, known = [self], {self}
            while todo:
                library = todo.pop()
                yield library
                if isinstance(library, Part):
                    new = [each for each in library._linking_libraries if each not in known]
                    known.update(new)
                    todo += new

        @property
        def has_dynamic_globals(self) -> bool:
            """It, or what it calls, holds an address of this process: then it is not for the disk."""
            self._ensure_finalized()
            return any(_holds_address(part) for part in self.parts())

        def _own_module(self) -> Any:
            module = self._final_module.clone()
            for function in module.functions:
                if not function.is_declaration and function.linkage == codegen.ll.Linkage.external:
                    function.linkage = "linkonce_odr"
            return module

        def _get_module_for_linking(self) -> Any:
            """It and all that it calls, for whoever calls it."""
            self._ensure_finalized()
            if self._shared_module is None:
                module = self._own_module()
                for library in self.parts():
                    if library is not self:
                        part = isinstance(library, Part)
                        module.link_in(library._own_module() if part else library._get_module_for_linking(),
                                       preserve=True)
                self._shared_module = module
            return self._shared_module

        def serialize_using_object_code(self) -> tuple[str, str, bytes]:
            """For the disk."""
            return self.name, KIND, self._get_module_for_linking().as_bitcode()

        @classmethod
        def kept(cls, made: Any, state: tuple[str, str, bytes]) -> "Part":
            """One from the disk."""
            name, _, bitcode = state
            part = cls(made, name)
            part._final_module = codegen.ll.parse_bitcode(bitcode)
            part._disable_inspection = part._finalized = True
            return part

    class Entry(codegen.JITCodeLibrary):  # type: ignore[misc]
        """Of an entry: it is optimised once, with all its parts in it; numba alone does it three times."""

        _optimize_functions = _sweep

        def _optimize_final_module(self) -> None:
            builder = codegen.ll.create_pass_builder(self._codegen._tm, _tuning())
            passes = builder.getModulePassManager()
            if codegen.config.LLVM_REFPRUNE_PASS:
                passes.add_refprune_pass(codegen._parse_refprune_flags())
            passes.run(self._final_module, builder)

    class _Lean(compiler.Compiler):  # type: ignore[misc]
        """numba's, without idle passes."""

        def define_pipelines(self) -> Any:
            """As numba's."""
            pipelines = super().define_pipelines()
            if not self.state.flags.nrt:
                for each in pipelines:
                    each.passes = [one for one in each.passes if one[0].__name__ not in IDLE]
                    each.finalize()
            return pipelines

    class PartCompiler(_Lean):
        """numba's, for a part."""

        def compile_extra(self, function: Any) -> Any:
            """As numba's."""
            self.state.library = Part(self.state.targetctx.codegen(), function.__qualname__)
            return super().compile_extra(function)

    class EntryCompiler(_Lean):
        """numba's, for an entry."""

        def compile_extra(self, function: Any) -> Any:
            """As numba's."""
            self.state.library = Entry(self.state.targetctx.codegen(), function.__qualname__)
            self.state.library.enable_object_caching()
            with remembering(), counting_from_the_first(), collecting_seldom():
                return super().compile_extra(function)


_PLAIN = (types.Number, types.Boolean, types.Array, types.SliceType, types.UniTuple)


@contextlib.contextmanager
def remembering() -> Iterator[None]:
    """Meanwhile what an operator makes of numbers and arrays is asked once.

    numba tries every meaning that an operator has (of strings, dates, sets ..) each time that it stands in a kernel: a
    fifth of a compilation.  It compiles one function at a time, whoever asks, and what calls this is within its lock.
    """
    functions: Any = types.BaseFunction
    usual, known = functions.get_call_type, {}

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if getattr(self.typing_key, "__module__", None) != "_operator" \
                or kws or not all(isinstance(each, _PLAIN) for each in args):
            return usual(self, context, args, kws)
        if (self, args) not in known:
            known[self, args] = usual(self, context, args, kws)
        return known[self, args]

    functions.get_call_type = get_call_type
    try:
        yield
    finally:
        functions.get_call_type = usual


@contextlib.contextmanager
def counting_from_the_first() -> Iterator[None]:
    """Meanwhile an index in a kernel of this package is taken as it is.

    numba alone adds an array's length to an index that is negative, and asks that of each one.  None is here, as none
    may be in C; a test that has every index asked un-jitted holds it, and numba's own checks of bounds see it.
    """
    from numba.np import arrayobj  # here: an import need not wait for it

    arrays: Any = arrayobj
    usual = getattr(arrays, "fix_integer_index", None)
    if usual is None:  # another numba: as it does it
        yield
        return

    def fix_integer_index(context: Any, builder: Any, kind: Any, index: Any, size: Any) -> Any:
        if OWN not in builder.function.name:
            return usual(context, builder, kind, index, size)
        return context.cast(builder, index, kind, types.intp if kind.signed else types.uintp)

    arrays.fix_integer_index = fix_integer_index
    try:
        yield
    finally:
        arrays.fix_integer_index = usual


@contextlib.contextmanager
def collecting_seldom() -> Iterator[None]:
    """Meanwhile Python looks for garbage after a hundred times as many new objects as usual.

    A compilation makes millions that stay; looking through them all, again and again, takes a tenth of its time, and
    seldom frees more than some megabytes.
    """
    usual = gc.get_threshold()
    gc.set_threshold(*(GARBAGE if usual[0] else usual))  # 0: switched off by the host
    try:
        yield
    finally:
        gc.set_threshold(*usual)


OF_A_PART: dict[str, Any] = {"pipeline_class": PartCompiler} if KNOWN else {}
OF_AN_ENTRY: dict[str, Any] = {"pipeline_class": EntryCompiler} if KNOWN else {}


def widened(made: Any) -> Any:
    """A jitted part that is compiled once for all integers; numba alone compiles it anew for each constant.

    An un-jitted one is returned as it is.
    """
    if hasattr(made, "get_call_template"):
        resolve = made.get_call_template

        def resolve_widened(args: Any, kws: Any) -> Any:
            return resolve(tuple(types.unliteral(each) for each in args),
                           {name: types.unliteral(each) for name, each in kws.items()})

        made.get_call_template = resolve_widened
    return made


def stand_in(function: Any, made: Any) -> None:
    """Where a kernel names this plain function, it means that jitted one.

    numba's own way (`overload`) compiles it anew for callers of another kind, and a wrapper for C each time.
    """
    if hasattr(made, "get_call_template"):
        _standing.append(made)
        templates.infer_global(function, types.Dispatcher(made))


_standing: list[Any] = []  # numba's types hold them weakly


def is_part(payload: Any) -> bool:
    """What the disk has is of a part."""
    return KNOWN and payload[0][1] == KIND


def rebuilt(target: Any, payload: Any) -> Any:
    """numba's record of a part from what the disk has, in the order of `CompileResult._reduce`."""
    state, described, env, signature, objectmode, lifted, annotation, reload_init, envs = payload
    for function in reload_init:
        function()
    part = Part.kept(target.codegen(), state)
    return compiler.CompileResult(
        target_context=target, typing_context=target.typing_context, library=part, environment=env,
        entry_point=target.get_executable(part, described, env), fndesc=described, type_annotation=annotation,
        signature=signature, objectmode=objectmode, lifted=lifted, typing_error=None, call_helper=None, metadata=None,
        reload_init=reload_init, referenced_envs=envs)
