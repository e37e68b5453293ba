"""Folders of earlier fits that cannot be gone on with."""

import json

import pytest

from asrsim.errors import InputError
from asrsim.identification.write import FIT, begin_of


@pytest.mark.parametrize("estimate", [10**400, "x", None, []], ids=["no float", "a word", "nothing", "a list"])
def test_a_fit_whose_estimates_are_no_numbers_is_refused(tmp_path, estimate):
    (tmp_path / FIT).write_text(json.dumps({"names": ["spring_k"], "estimates": [{"estimate": estimate}]}), encoding="utf-8")
    with pytest.raises(InputError, match="is no fit of asrsim's"):
        begin_of(tmp_path)
