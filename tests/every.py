"""Cheap cases of one law as one test: every case runs, and the failure names each that failed and what it said."""

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any

import pytest

FAILURES = (Exception, pytest.fail.Exception)  # a skip is none of them: it ends the test as a skip


def every(names: str | tuple[str, ...], cases: Iterable[Any], ids: Callable[[Any], str] = repr
          ) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The loop in place of `pytest.mark.parametrize`, with the same arguments: its cases share the test's fixtures, so
    none may leave behind what another one minds. No case at all is a failure."""
    words = tuple(names.replace(" ", "").split(",")) if isinstance(names, str) else names
    listed = list(cases)

    def decorated(check: Callable[..., None]) -> Callable[..., None]:
        signature = inspect.signature(check)
        assert set(words) <= set(signature.parameters), f"{check.__name__} does not take {words}"

        @functools.wraps(check)
        def loop(*args: Any, **fixtures: Any) -> None:
            assert listed, "no case"
            failed = []
            for case in listed:
                values = case if len(words) > 1 else (case,)
                try:
                    check(*args, **fixtures, **dict(zip(words, values, strict=True)))
                except FAILURES as error:
                    failed.append(f"{', '.join(ids(value) for value in values)}: {type(error).__name__}: {error}")
            if failed:
                raise AssertionError(f"{len(failed)} of {len(listed)} cases:\n" + "\n".join(failed))

        loop.__signature__ = signature.replace(  # type: ignore[attr-defined]
            parameters=[each for each in signature.parameters.values() if each.name not in words])
        return loop

    return decorated
