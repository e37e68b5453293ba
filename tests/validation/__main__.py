"""Run all checks, and write docs/validation.md.

Usage: PYTHONPATH=tests python -m validation --out docs/validation.md
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from validation.document import document, measure
from validation.sections import SECTIONS


def main() -> int:
    """Run all checks and write the page. Returns 1 if a check failed, otherwise 0."""
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    parser.add_argument("--out", type=Path, help="write the page here (Markdown)")
    arguments = parser.parse_args()
    results, failed = [], False
    for section, by_engine in measure(SECTIONS):
        checks = [check for listed in by_engine.values() for check in listed]
        missed = [check for check in checks if not check.passed]
        sys.stdout.write(f"{section.title}: {len(checks) - len(missed)} of {len(checks)} hold\n")
        sys.stdout.writelines(f"  {check}\n" for check in missed)
        sys.stdout.flush()
        failed = failed or bool(missed)
        results.append((section, by_engine))
    if arguments.out is not None:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(document(results), encoding="utf-8")
        sys.stdout.write(f"{arguments.out}\n")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
