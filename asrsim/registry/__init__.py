"""Registries: tables from names to actuators, signals, engines and so on, which users can extend without changing asrsim."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar
from weakref import WeakSet

from asrsim.errors import InputError, Problem, did_you_mean

T = TypeVar("T")


@contextmanager
def plugin_file(path: str) -> Iterator[None]:
    """Context in which a user's file runs: its registrations are recorded under the file's path."""
    before, Registry.file = Registry.file, path
    try:
        yield
    finally:
        Registry.file = before


@contextmanager
def all_or_none() -> Iterator[None]:
    """Context in which entries are added to registries: if it ends with an error, all of them are removed."""
    before = {one: one.state() for one in Registry.everyone}
    try:
        yield
    except BaseException:
        for one in list(Registry.everyone):
            if one in before:
                one.put(before[one])
            else:  # the user's file was the first to import the module of the registry
                one.forget_files()
        raise


@cache
def is_declared(group: str) -> bool:
    """Whether an installed package states this entry point group, read ten times faster than by `importlib.metadata`."""
    files = (file for place in sys.path for file in Path(place or ".").glob("*.dist-info/entry_points.txt"))
    return any(f"[{group}]" in file.read_text(encoding="utf-8", errors="replace") for file in files)


def result_fault(function: Callable[..., Any], message: str) -> InputError:
    """Error for a result that a function of a user must not return. message: what the function must return, and what it
    returns; file and line of the function are added."""
    runs = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]
    code = getattr(inspect.unwrap(runs), "__code__", None)
    place = "" if code is None else f" ({code.co_filename}:{code.co_firstlineno})"
    return InputError(message + place, code="wrong-result")


class Registry(Generic[T]):
    """Table of named entries; the error for an unknown name lists the known names.

    Installed packages add entries through an entry point group. These entries are loaded when a name is not
    found, so that they do not slow down the start. An entry is refused if it is not derived from `base`, is not an instance of
    `instance`, lacks an attribute that this class declares without a value, or states another name in its attribute `label`.
    `add` raises an error for such an entry. An entry of an installed package that is refused, or that cannot be loaded, is
    broken: `get` and `unknown` report it if its name is used, and `broken` lists it for code that uses all entries.
    """

    everyone: ClassVar[WeakSet[Registry[Any]]] = WeakSet()
    """All registries."""
    added: ClassVar[int] = 0
    """Number of entries that all registries together have received from plugin files so far."""
    file: ClassVar[str] = ""
    """Plugin file that is running; it may register its entries again when it runs again."""

    def __init__(
        self,
        noun: str,
        entry_point_group: str | None = None,
        *,
        base: type | None = None,
        instance: type | None = None,
        label: str = "",
    ) -> None:
        self.noun = noun
        self.base = base
        self.instance = instance
        self.label = label
        self._broken: dict[str, Problem] = {}
        self.entry_point_group = entry_point_group
        self._entries: dict[str, T] = {}
        self._files: dict[str, str] = {}
        """Plugin file that registered each entry, by name of the entry."""
        self._searched = entry_point_group is None
        Registry.everyone.add(self)

    def add(self, name: str, entry: T, *, replace: bool = False) -> T:
        """Register `entry`; raises InputError if the registry refuses it, or if the name is taken and `replace` is not set."""
        if fault := self._fault(name, entry):
            raise InputError(f"the {self.noun} '{name}' {fault}", code="broken-entry")
        again = bool(Registry.file) and self._files.get(name) == Registry.file
        if name in self._entries and not replace and not again:
            by = f" by {self._files[name]}" if self._files.get(name) else ""
            raise InputError(f"{self.noun} '{name}' is registered already{by}", hint="Choose another name", code="name-taken")
        self._files[name] = Registry.file
        Registry.added += bool(Registry.file)
        return self._take(name, entry)

    def own(self, name: str, entry: T) -> T:
        """Register an entry of asrsim itself: it belongs to no plugin file, even if such a file is the first to import it."""
        with plugin_file(""):
            return self.add(name, entry)

    def _fault(self, name: str, entry: object) -> str:
        """Why the registry refuses an entry, as the end of a sentence; empty if it takes the entry."""
        kind = self.base or self.instance
        if self.base is not None and not (isinstance(entry, type) and issubclass(entry, self.base)):
            return f"is not a class derived from {self.base.__module__}.{self.base.__name__}: {entry!r}"
        if self.instance is not None and not isinstance(entry, self.instance):
            return f"is not an instance of {self.instance.__module__}.{self.instance.__name__}: {entry!r}"
        missing = [one for one in inspect.get_annotations(kind) if not hasattr(entry, one)] if kind is not None else []
        if missing:
            return f"lacks the attribute `{missing[0]}`"
        if self.label and getattr(entry, self.label) != name:
            return f"calls itself '{getattr(entry, self.label)}' in `{self.label}`: the two names must be the same"
        return ""

    def _take(self, name: str, entry: T) -> T:
        """Keep an entry, whether a program or an installed package adds it."""
        self._entries[name] = entry
        return entry

    def state(self) -> Any:
        """A copy of what the registry contains, for `put`."""
        return dict(self._entries), dict(self._files), dict(self._broken), self._searched

    def put(self, state: Any) -> None:
        """Restore this earlier state of the registry."""
        self._entries, self._files, self._broken, self._searched = state

    def forget_files(self) -> None:
        """Remove the entries of plugin files."""
        for name in [name for name, file in self._files.items() if file]:
            del self._files[name]
            self._entries.pop(name, None)

    def get(self, name: str) -> T:
        """Entry with this name; raises InputError that lists the known names."""
        if name not in self._entries:
            self._search_entry_points()
        try:
            return self._entries[name]
        except KeyError:
            raise InputError(self.unknown(name)) from None

    def unknown(self, name: str) -> Problem:
        """Problem of a name that is not in the registry: its entry is broken, or there is no entry."""
        known = self.names()
        if name in self._broken:
            return self._broken[name]
        hints = did_you_mean(name, known), self.remedy
        return Problem(
            f"no {self.noun} is called '{name}'",
            choices=known,
            hint=" ".join(filter(None, hints)) or None,
            code="unknown-name",
        )

    def broken(self) -> tuple[Problem, ...]:
        """Problems of the entries of installed packages that are refused, or that cannot be loaded."""
        self._search_entry_points()
        return tuple(problem for name, problem in self._broken.items() if name not in self._entries)

    @property
    def remedy(self) -> str:
        """Hint for an unknown name."""
        return f"Your own {self.noun}s need --plugin FILE" if self.entry_point_group else ""

    def loaded(self) -> tuple[T, ...]:
        """Entries in the order of registration, without a search for installed packages."""
        return tuple(self._entries.values())

    def file_of(self, name: str) -> str:
        """Plugin file that registered the entry; empty for other entries."""
        return self._files.get(name, "")

    @classmethod
    def plugin_files(cls) -> set[str]:
        """Plugin files whose entries are in any registry."""
        return {file for one in cls.everyone for name, file in one._files.items() if file and name in one._entries}

    def names(self) -> tuple[str, ...]:
        """All names in the order of registration; numbers are sorted; entries of installed packages come last."""
        self._search_entry_points()
        return tuple(sorted(self._entries, key=lambda name: int(name) if name.isdecimal() else 0))

    def __contains__(self, name: object) -> bool:
        if name not in self._entries:
            self._search_entry_points()
        return name in self._entries

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def _search_entry_points(self) -> None:
        if self._searched:
            return
        self._searched = True
        from importlib.metadata import entry_points

        for point in entry_points(group=self.entry_point_group or ""):
            if point.name in self._entries:
                continue
            try:
                entry = point.load()
                fault = self._fault(point.name, entry)
            except (Exception, SystemExit) as error:  # other packages may raise any error
                fault = f"raised {type(error).__name__}: {error}"
            if fault:
                package = point.dist.name if point.dist else "an installed package"
                self._broken[point.name] = Problem(
                    f"the {self.noun} '{point.name}' of {package} cannot be used: {point.value} {fault}",
                    hint="Correct this entry point of the package, or uninstall the package",
                    code="broken-entry",
                )
            else:
                self._take(point.name, entry)
