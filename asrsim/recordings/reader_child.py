"""Reads a recording of a binary format in a child process, since damaged files may crash the library of the format.

`asrsim.confined.run` runs this script. It reads a request in JSON from stdin and writes the bytes of
`asrsim.recordings.formats.pack` to stdout.
"""

from __future__ import annotations

import json
import sys
from contextlib import redirect_stdout

if __name__ == "__main__":
    request = json.loads(sys.stdin.buffer.read())
    sys.path.insert(0, request["root"])
    from asrsim.recordings.formats import answer_of

    # Redirect the output that a user's reader prints, since stdout transports the answer.
    with redirect_stdout(sys.stderr):
        answer = answer_of(request)
    sys.stdout.buffer.write(answer)
