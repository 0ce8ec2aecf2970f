"""Logs of simulated control runs, as a machine's recorder would have written them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tdfscal.files.saving import make_folder, replacing
from tdfscal.files.writers import documents, mcap_log, table_log
from tdfscal.files.writers.campaign import LogFormat
from tdfscal.records import Log, Rig

_WRITERS = {
    "csv": (table_log.write_csv, table_log.csv_block),
    "parquet": (table_log.write_parquet, table_log.parquet_block),
    "mcap": (mcap_log.write_mcap, mcap_log.mcap_block),
}


def write_control_logs(
    folder: Path, rig: Rig, logs: Sequence[tuple[str, Log]], form: LogFormat
) -> list[str]:
    """Write `<name>.<form>` of each log, and the rig.yaml that reads them; returns their names.

    Raises UsageError where the folder cannot be written.
    """
    write, block = _WRITERS[form]
    make_folder(folder)
    names = []
    for name, log in logs:
        path = folder / f"{name}.{form}"
        with replacing(path) as beside:
            write(beside, log)
        names.append(path.name)
    documents.write_yaml(folder / "rig.yaml", documents.rig_document(rig, block(logs[0][1])))
    return [*names, "rig.yaml"]
