"""The in-process engine, studies and pages need nothing that only Linux has."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

# As macOS with Python 3.11 is, in this interpreter and all that it starts.
WITHOUT_LINUX = '''
import builtins, ctypes, importlib, os, sys

ONLY_LINUX = {
    "os": """copy_file_range eventfd eventfd_read eventfd_write fdatasync getrandom getxattr
        listxattr memfd_create pidfd_open pipe2 posix_fadvise posix_fallocate removexattr
        sched_getaffinity sched_getparam sched_getscheduler sched_setaffinity sched_setparam
        sched_setscheduler setns setxattr splice unshare waitid waitid_result P_PID P_PIDFD WEXITED
        WNOWAIT O_DIRECT O_NOATIME O_PATH O_TMPFILE""",
    "select": "epoll EPOLLIN EPOLL_CLOEXEC",
    "signal": "pidfd_send_signal sigtimedwait sigwaitinfo SIGRTMIN SIGRTMAX SIGPWR",
    "socket": "AF_NETLINK AF_PACKET SO_PEERCRED SO_BINDTODEVICE SOCK_CLOEXEC SOCK_NONBLOCK",
    "resource": "prlimit RLIMIT_MSGQUEUE RLIMIT_NICE RLIMIT_RTPRIO RLIMIT_SIGPENDING",
}
for module, names in ONLY_LINUX.items():
    for name in names.split():
        vars(importlib.import_module(module)).pop(name, None)

def refused(function):
    def call(path, *arguments, **options):
        if str(path).startswith("/proc"):
            raise FileNotFoundError(2, "No such file or directory", path)
        return function(path, *arguments, **options)
    return call

builtins.open, os.open, os.listdir = map(refused, (builtins.open, os.open, os.listdir))
found = ctypes.CDLL.__getattr__
ctypes.CDLL.__getattr__ = lambda self, name: found(self, "no_" + name if name == "prctl" else name)
sys.modules.update({"spwd": None, "ossaudiodev": None, "pyinotify": None})
'''


def run(script: str, folder: Path) -> str:
    """Run a script where nothing is that only Linux has, and return what it prints."""
    (folder / "sitecustomize.py").write_text(WITHOUT_LINUX)
    env = {**os.environ, "PYTHONPATH": str(folder)}
    process = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, env=env, capture_output=True, text=True
    )
    assert process.returncode == 0, process.stderr
    return process.stdout


def test_what_only_linux_has_is_gone(tmp_path):
    gone = "import os, select; assert not hasattr(select, 'epoll'); os.sched_getaffinity(0)"
    with pytest.raises(AssertionError, match="no attribute 'sched_getaffinity'"):
        run(gone, tmp_path)


def test_a_run_in_process_its_report_and_its_page_need_nothing_that_only_linux_has(tmp_path):
    script = """
from urllib.request import urlopen
import phalanx
from phalanx.cli.app import status
assert status(["run", "pinned", "--engine", "in-process", "--set", "duration=0.2"]) in (0, 2)
assert status(["export", "runs/pinned-1", "--html", "pinned.html"]) == 0
assert status(["verify", "runs/pinned-1", "--engine", "in-process"]) == 0
with phalanx.open("runs/pinned-1").view() as page:
    assert urlopen(page.url).status == 200
"""
    run(script, tmp_path)
    assert (tmp_path / "runs" / "pinned-1" / "report.html").is_file()
    assert (tmp_path / "pinned.html").stat().st_size > 50_000


def test_a_study_with_its_workers_needs_nothing_that_only_linux_has(tmp_path):
    script = """
import phalanx
study = phalanx.study("pinned", seeds=2, overrides={"duration": 0.2})
print(len(study.frame), *study.frame["outcome"])
"""
    assert run(script, tmp_path).split()[0] == "2"
