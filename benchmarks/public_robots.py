"""Count the robot files of a folder that asrsim refuses, by reason, and ask MuJoCo and PyBullet about each of them.

    python benchmarks/public_robots.py FOLDER

The folder holds clones of public repositories. Equal files count once. The other readers get the file without shapes, so that
they need no meshes; each reads it in a process of its own, which a fault cannot take down with this one.
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from asrsim.cli.findings import robot_report

READERS = {
    "MuJoCo": "import sys, mujoco; mujoco.MjModel.from_xml_path(sys.argv[1])",
    "PyBullet": "import sys, pybullet; pybullet.connect(pybullet.DIRECT); sys.exit(pybullet.loadURDF(sys.argv[1]) < 0)",
    "lxml": "import sys; from lxml import etree; etree.parse(sys.argv[1])",
}
"""Programs that end with status 0 if they can read the robot file that they are given."""
BODIES = ("visual", "collision")
LIMIT = 60.0
"""Longest time of another reader, s."""


def main() -> None:
    """Print each refused file with its first reason and the programs that read it, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    files = [*distinct(parser.parse_args().folder)]
    refused = {path: report.errors for path in files if (report := robot_report(path)).errors}
    readable = 0
    for path, errors in refused.items():
        who = readers_of(path)
        readable += "MuJoCo" in who
        reasons = "; ".join(f"{error.key}: {error.message}" for error in errors[:3])
        print(f"{path}\n    {len(errors)} errors: {reasons}\n    read by {', '.join(who) or 'none'}")
    print(f"{len(files)} files, {len(files) - len(refused)} read, {len(refused)} refused, {readable} of these read by MuJoCo")


def distinct(folder: Path) -> Iterator[Path]:
    """Robot files with different contents, sorted."""
    seen = set()
    for path in sorted(folder.rglob("*.urdf")):
        if not path.is_file():
            continue
        digest = hashlib.sha256(path.read_bytes()).digest()
        if digest not in seen:
            seen.add(digest)
            yield path


def readers_of(path: Path) -> list[str]:
    """Names of the other programs that can read the robot file without its shapes."""
    with tempfile.TemporaryDirectory() as folder:
        bare = Path(folder) / "robot.urdf"
        bare.write_bytes(_without_shapes(path.read_bytes()))
        return [name for name, program in READERS.items() if _reads(program, bare)]


def _reads(program: str, path: Path) -> bool:
    try:
        ended = subprocess.run([sys.executable, "-c", program, str(path)], capture_output=True, check=False, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return False
    return ended.returncode == 0


def _without_shapes(data: bytes) -> bytes:
    from lxml import etree

    try:
        root = etree.fromstring(data)
    except etree.XMLSyntaxError:
        return data
    etree.strip_elements(root, *BODIES, with_tail=False)
    text: bytes = etree.tostring(root)
    return text


if __name__ == "__main__":
    main()
