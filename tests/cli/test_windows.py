r"""A laptop with Windows: no module of POSIX alone, backslashes in paths, a console of cp1252."""

import os
import subprocess
import sys
from pathlib import Path

import yaml

#: Modules and functions that Windows' Python lacks.
_LACKING = ("fcntl", "grp", "posix_spawn", "pty", "pwd", "resource", "syslog", "termios", "tty")
_MISSING = ("fork", "getuid", "geteuid", "getgid", "mkfifo", "chown", "killpg", "sched_getaffinity")
_LESS = ("pthread_sigmask", "SIGHUP", "SIGALRM", "SIGKILL", "SIGPIPE", "SIGUSR1", "SIGQUIT")
_RUN = f"""
import os, signal, sys
for name in {_LACKING}:
    sys.modules[name] = None
for name in {_MISSING}:
    if hasattr(os, name):
        delattr(os, name)
for name in {_LESS}:
    delattr(signal, name)
from tdfscal.cli import main
for line in sys.argv[1:]:
    sys.argv = ["tdfscal", *line.split("|")]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
"""


def test_the_main_commands_run_without_posix(tmp_path: Path) -> None:
    """From no file at all to contact wrenches; every path holds a backslash and a letter beyond
    ASCII, and the console shows no letter that cp1252 lacks."""
    folder = "Prüf\\stand"
    lines = (
        f"simulate|{folder}|--postures|8|--rate|25|--seed|1|-q",
        f"init|{folder}/log.csv|-o|draft.yaml",
        f"calibrate|{folder}|--trials|0|-o|c\\1.yaml|-v",
        f"apply|c\\1.yaml|{folder}|-o|w\\1.csv",
    )
    done = subprocess.run(
        [sys.executable, "-c", _RUN, *lines],
        cwd=tmp_path,
        env={**os.environ, "PYTHONIOENCODING": "cp1252", "PYTHONUTF8": "0", "LC_ALL": "C.UTF-8"},
        capture_output=True,
    )
    said = done.stdout.decode("cp1252")
    assert done.returncode == 0, done.stderr.decode("cp1252", "replace")
    assert said.count("ACCEPTED") == 1
    assert "wrote c\\1.yaml" in said
    content = yaml.safe_load((tmp_path / "c\\1.yaml").read_text(encoding="utf-8"))
    assert content["inputs"][0]["path"] == f"{folder}/log.csv"
    assert (tmp_path / "w\\1.csv").stat().st_size > 10_000
