"""Parts of a kernel become machine code once, inside the entry that Python calls.

numba alone optimises every function with all that it calls, makes machine code of it, and does both again in whoever
calls it: a kernel five calls deep is optimised and written five times, which was a third of the time to the first
`Estimator`.  A part (`inner`, `once`, `shared` of `kernels`) stays in the compiler's language until an entry is
compiled; that one holds all of it, and is optimised and written once.  The operations and their order are the same,
so are the bits.

Not part of what flies, as `kernel_cache`.  It uses what is no public part of numba; with a numba that is another than
it expects it does without, which costs time and nothing else.
"""

from collections.abc import Iterator
from typing import Any

import numba.core.codegen
import numba.core.compiler

codegen: Any = numba.core.codegen
compiler: Any = numba.core.compiler

KIND = "part"  # of what is kept on disk, beside numba's "object"

KNOWN = (all(hasattr(codegen, name) for name in ("JITCodeLibrary", "ll"))
         and all(hasattr(codegen.JITCodeLibrary, name)
                 for name in ("finalize", "_get_module_for_linking", "get_pointer_to_function", "codegen",
                              "serialize_using_object_code", "_optimize_functions"))
         and all(hasattr(compiler, name) for name in ("Compiler", "CompileResult", "CR_FIELDS")))

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

        @property
        def codegen(self) -> Any:
            """numba's code generator."""
            return _Written(self._codegen)

        def finalize(self) -> None:
            """No more comes: nothing is made of it."""
            self._raise_if_finalized()
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
            return any(variable.name.startswith("numba.dynamic.globals") for part in self.parts()
                       for variable in part._final_module.global_variables)

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

    class PartCompiler(compiler.Compiler):  # type: ignore[misc]
        """numba's, for a part."""

        def compile_extra(self, function: Any) -> Any:
            """As numba's."""
            self.state.library = Part(self.state.targetctx.codegen(), function.__qualname__)
            return super().compile_extra(function)

OF_A_PART: dict[str, Any] = {"pipeline_class": PartCompiler} if KNOWN else {}


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
