"""`tdfscal info`: options."""

from __future__ import annotations

from tdfscal.cli.app import Json, Paths, Quiet, RigFile, app


@app.command()
def info(paths: Paths, rig: RigFile = None, json: Json = False, quiet: Quiet = False) -> None:
    """Show what is in a log: fields, rates, gaps, dwells, problems, a mapping to paste."""
    from tdfscal.cli.inspecting import run

    run(paths, rig=rig, json=json, quiet=quiet)
