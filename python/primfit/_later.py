"""Arrays that are made when someone asks for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")
D = TypeVar("D", bound="DataclassInstance")


class Later(Generic[T]):
    """A field of a dataclass that may be given as a function of nothing, called at first use."""

    def __init__(self, *default: T | Callable[[], T]) -> None:
        self._default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> T: ...
    @overload
    def __get__(self, instance: object, owner: type) -> T: ...
    def __get__(self, instance: object | None, owner: type) -> Any:
        if instance is None:
            # Where dataclasses look for a default.
            if not self._default:
                raise AttributeError(self._name)
            return self._default[0]
        value = vars(instance)[self._name]
        if callable(value):
            value = vars(instance)[self._name] = value()
        return value

    def __set__(self, instance: object, value: T | Callable[[], T]) -> None:
        vars(instance)[self._name] = value


def mapped(instance: object, name: str, change: Callable[[Any], T]) -> T | Callable[[], T]:
    """A field changed, now or, when its function was not called yet, when that is."""
    value = vars(instance)[name]
    return (lambda: change(value())) if callable(value) else change(value)


def replaced(instance: D, **changes: Any) -> D:
    """`dataclasses.replace`, but functions that were not called yet stay uncalled."""
    uncalled = {
        each.name: value
        for each in fields(instance)
        if callable(value := vars(instance)[each.name])
    }
    return replace(instance, **(uncalled | changes))


def called(instance: object) -> dict[str, Any]:
    """The state of an instance with every function called, to be copied or pickled."""
    return {name: getattr(instance, name) for name in vars(instance)}
