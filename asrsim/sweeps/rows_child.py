"""Script that `asrsim.confined.run` starts: reads a study's files of rows completely and reports the fault of each file.

It reads a JSON request from stdin and writes pairs (index of the file, fault) to stdout. It imports nothing from asrsim.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq


def fault_of(path: str, schema: Any, tables: list[Any]) -> str:
    """Fault of a file; an empty text for a file without a fault.

    tables: list that receives the rows of the file. The rows thus stay in memory, so that the memory limit applies to all files
    together.
    """
    try:
        file = pq.ParquetFile(path, page_checksum_verification=True)
        if not file.schema_arrow.equals(schema):
            return "its columns are not the columns of the study"
        tables.append(table := file.read(use_threads=False))
        table.validate(full=True)
    except MemoryError:
        return "cannot be read: it needs too much memory"
    except (OSError, ValueError, pa.ArrowException) as error:
        return f"cannot be read: {(str(error).splitlines() or [type(error).__name__])[0]}"
    return "" if len(table) == file.metadata.num_rows else "a column has another number of rows than the file"


if __name__ == "__main__":
    request = json.loads(sys.stdin.buffer.read())
    expected = pa.ipc.read_schema(pa.py_buffer(bytes.fromhex(request["schema"])))
    read: list[Any] = []
    faults = [(number, fault_of(path, expected, read)) for number, path in enumerate(request["files"])]
    sys.stdout.write(json.dumps([(number, fault) for number, fault in faults if fault]))
