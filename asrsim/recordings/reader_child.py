"""Run as a script by :mod:`asrsim.confined`: reads a recording of a binary format, whose libraries damaged files crash.

Reads a request in JSON from stdin, and writes what :func:`asrsim.recordings.formats.pack` makes of the content to stdout.
"""

from __future__ import annotations

import json
import sys

if __name__ == "__main__":
    request = json.loads(sys.stdin.buffer.read())
    sys.path.insert(0, request["root"])
    from asrsim.recordings.formats import answer_of

    sys.stdout.buffer.write(answer_of(request))
