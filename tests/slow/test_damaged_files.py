"""Thousands of damaged files of every kind: each command ends soon, with little memory, and says in words what is wrong."""

import os
import shutil

import pytest

from support.rough import KINDS, import_all, made, trials, tried

SEED = int(os.environ.get("ASRSIM_SEED", "0"))
COUNT = int(os.environ.get("ASRSIM_DAMAGED", "60"))
"""Number of damaged files of each kind."""

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    pytest.importorskip("pandas")
    return made(tmp_path_factory.mktemp("whole") / "base")


@pytest.mark.parametrize("kind", KINDS)
def test_every_command_reads_the_whole_file(base, tmp_path, kind):
    """Otherwise its damage would prove nothing."""
    if not (base / KINDS[kind].file).exists():
        pytest.skip("the library of this format is not installed")
    for line in KINDS[kind].commands:
        shutil.copytree(base, tmp_path / "whole", dirs_exist_ok=True)
        outcome = tried(tmp_path / "whole", line.format(KINDS[kind].file))
        assert outcome.code == 0, f"{line}: {outcome.text}"
        import_all(tmp_path / "whole")


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_read_or_refused_in_words(base, tmp_path, kind):
    if not (base / KINDS[kind].file).exists():
        pytest.skip("the library of this format is not installed")
    found = trials(base, tmp_path / "damaged", (kind,), COUNT, SEED)
    faults = {f"{number}: asrsim {line}: {outcome.fault}" for _, line, number, outcome in found if outcome.fault}
    assert not faults, "\n".join(sorted(faults))
