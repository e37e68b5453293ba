"""Files that a robot file may read: files in its own folder, in its ROS package, and in packages that the user names.

A hostile file may name any path. All paths outside these folders are refused.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote


@dataclass(frozen=True, kw_only=True)
class Packages:
    """Folders that a robot file may read."""

    folder: Path
    """Folder of the file, absolute."""
    named: Mapping[str, Path]
    """Name of a package -> folder, from the user and from the file's own package."""
    searched: tuple[Path, ...]
    """Folders of packages in the environment variables ROS_PACKAGE_PATH and AMENT_PREFIX_PATH."""

    @property
    def roots(self) -> tuple[Path, ...]:
        """All readable folders, absolute, with symbolic links resolved."""
        return (self.folder, *(path.resolve() for path in self.named.values()), *self.searched)

    def find(self, name: str) -> Path | None:
        """Folder of a package; None if the package is unknown."""
        if name in self.named:
            return self.named[name].resolve()
        if not name or "/" in name or name in (".", ".."):
            return None
        for root in self.searched:
            candidates = [root / name, root / "share" / name]
            if root.name == name:
                candidates.insert(0, root)
            for candidate in candidates:
                if candidate.is_dir():
                    return candidate
        return None

    def allows(self, path: Path) -> bool:
        """Whether the path, with symbolic links resolved, lies in one of the readable folders."""
        resolved = path.resolve()
        return any(resolved.is_relative_to(root) for root in self.roots)

    def resolve(self, filename: str) -> Path | str:
        """Existing file for a name (package://, file://, absolute or relative), or the reason why no file is found."""
        if "\0" in filename:
            return "is not a file name"
        scheme, separator, rest = filename.partition("://")
        if not separator:
            path = self.folder / filename
        elif scheme == "file":
            path = Path(unquote(rest))
        elif scheme in ("package", "model"):
            name, _, inner = rest.lstrip("/").partition("/")
            package = self.find(name)
            # Also look for a folder with this name beside the robot file, since some robot files name such a folder as a
            # package.
            path = self.folder / name / inner if package is None else package / inner
            if package is None and not path.is_file():
                return f"package '{name}' is not known"
        else:
            return f"'{scheme}://' is not supported"
        try:
            if not self.allows(path):
                return "lies outside the robot's folder and the known packages"
            if not path.is_file():
                return "no such file"
            return path.resolve()
        except (OSError, RuntimeError, ValueError) as error:
            return f"cannot be read: {error}"


def package_name(filename: str) -> str | None:
    """Name of the package in a file name; None if the name has no package."""
    scheme, separator, rest = filename.partition("://")
    return (rest.lstrip("/").partition("/")[0] or None) if separator and scheme in ("package", "model") else None


def packages_of(path: Path, package_paths: Mapping[str, Path | str] | None = None) -> Packages:
    """Folders that the robot file at `path` may read."""
    folder = path.resolve().parent
    named: dict[str, Path] = {}
    own = _own_package(folder)
    if own is not None:
        # A package has two names, the name of its folder and the name in its package.xml. Robot files may use either name.
        named.update({own[1].name: own[1], own[0]: own[1]})
    named.update({name: Path(given) for name, given in (package_paths or {}).items()})
    searched = [
        Path(entry).resolve()
        for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
        for entry in os.environ.get(variable, "").split(os.pathsep)
        if entry
    ]
    return Packages(folder=folder, named=named, searched=tuple(entry for entry in searched if entry.is_dir()))


def _own_package(folder: Path) -> tuple[str, Path] | None:
    """Name and folder of the ROS package that contains the folder, by the nearest `package.xml` above."""
    from asrsim.errors import RobotError
    from asrsim.robot.xmlfile import elements, parse_xml, read_bytes, text_of

    for candidate in (folder, *folder.parents):
        manifest = candidate / "package.xml"
        if manifest.is_file():
            try:
                names = elements(parse_xml(read_bytes(manifest), manifest), "name")
            except RobotError:
                return None
            return (text_of(names[0]), candidate) if names else None
    return None
