"""Registries: names to variants (actuators, signals, engines, steppings), open to users without touching our files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar, Generic, TypeVar

from asrsim.errors import InputError

T = TypeVar("T")


@contextmanager
def plugin_file(path: str) -> Iterator[None]:
    """While a user's file runs: what it adds to registries is its own."""
    before, Registry.file = Registry.file, path
    try:
        yield
    finally:
        Registry.file = before


class Registry(Generic[T]):
    """A table of named variants; unknown names are errors that list the known ones.

    Installed packages add entries under the entry point group given; they are loaded at the first look-up that
    misses, so that start-up does not pay for them. One that cannot be loaded, is no class derived from `base`, or no
    object of the kind `instance`, is an error only for those who ask for it.
    """

    added: ClassVar[int] = 0
    """Number of entries that all registries together have taken so far."""
    file: ClassVar[str] = ""
    """Plugin file that is being run; it may add its entries again when it is run again."""

    def __init__(
        self, noun: str, entry_point_group: str | None = None, *, base: type | None = None, instance: type | None = None
    ) -> None:
        self.noun = noun
        self.base = base
        self.instance = instance
        self._broken: dict[str, str] = {}
        self.entry_point_group = entry_point_group
        self._entries: dict[str, T] = {}
        self._files: dict[str, str] = {}
        """Name of an entry -> the plugin file that added it."""
        self._searched = entry_point_group is None

    def add(self, name: str, entry: T, *, replace: bool = False) -> T:
        """Register `entry`; raises InputError if the name is taken and `replace` is not set."""
        again = bool(Registry.file) and self._files.get(name) == Registry.file
        if name in self._entries and not replace and not again:
            raise InputError(f"{self.noun} '{name}' is registered already", code="name-taken")
        self._entries[name] = entry
        self._files[name] = Registry.file
        Registry.added += 1
        return entry

    def get(self, name: str) -> T:
        """The entry of that name; raises InputError naming the known ones."""
        if name not in self._entries:
            self._search_entry_points()
        try:
            return self._entries[name]
        except KeyError:
            if name in self._broken:
                message = f"the {self.noun} '{name}' of an installed package cannot be used: {self._broken[name]}"
                raise InputError(message, code=f"broken-{self.noun}") from None
            known = self.names()
            raise InputError(
                f"no {self.noun} is called '{name}'", choices=known, meant=name, code=f"unknown-{self.noun}"
            ) from None

    def names(self) -> tuple[str, ...]:
        """All names, in the order of registration, numbers in theirs; installed ones last."""
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
            except (Exception, SystemExit) as error:  # a stranger's package may raise anything
                self._broken[point.name] = f"{point.value} raised {type(error).__name__}: {error}"
                continue
            if self.base is not None and not (isinstance(entry, type) and issubclass(entry, self.base)):
                self._broken[point.name] = f"{point.value} is no class derived from {self.base.__name__}"
                continue
            if self.instance is not None and not isinstance(entry, self.instance):
                self._broken[point.name] = f"{point.value} is no {self.instance.__module__}.{self.instance.__name__}"
                continue
            self._entries[point.name] = entry
