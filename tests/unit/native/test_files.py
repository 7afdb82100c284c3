"""Files are written whole or not at all; no link is followed to a file or a folder."""

import ast
import os
from pathlib import Path

import pytest

from phalanx.native.files import real_folder, whole_file

ROOT = Path(__file__).parents[3]
WRITING = {"write_text", "write_bytes", "write_csv", "write_parquet", "savefig", "save", "saving"}
IN_NEW_FOLDERS = {
    "phalanx/launcher/run.py",
    "phalanx/recording/modules.py",
    "phalanx/native/library.py",
}
"""They write into folders that they or the launcher have just made."""


def test_a_link_is_replaced_and_its_target_stays(tmp_path: Path):
    target, link = tmp_path / "target", tmp_path / "report.html"
    target.write_text("precious")
    link.symlink_to(target)
    with whole_file(link) as part:
        part.write_text("report")
    assert (target.read_text(), link.read_text(), link.is_symlink()) == (
        "precious",
        "report",
        False,
    )


def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path):
    file = tmp_path / "rows"
    file.write_text("old")

    def fail():
        with whole_file(file) as part:
            part.write_text("hal")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_a_new_file_has_the_mode_of_any_other(tmp_path: Path):
    (tmp_path / "other").touch()
    with whole_file(tmp_path / "file") as part:
        part.touch()
    assert (tmp_path / "file").stat().st_mode == (tmp_path / "other").stat().st_mode


@pytest.mark.parametrize("kind", ["pipe", "folder", "link to a folder"])
def test_what_is_no_file_is_refused(tmp_path: Path, kind: str):
    path = tmp_path / "report.html"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to(tmp_path)
    before = path.lstat()
    with pytest.raises(FileExistsError, match=f"{path}: expected a file"), whole_file(path):
        pass
    assert path.lstat() == before


def test_a_folder_is_made_once_and_a_link_to_one_refused(tmp_path: Path):
    assert real_folder(real_folder(tmp_path / "figures")).is_dir()
    (tmp_path / "link").symlink_to(tmp_path / "figures")
    with pytest.raises(NotADirectoryError, match="found a link"):
        real_folder(tmp_path / "link")


@pytest.mark.slow
def test_every_writer_of_a_file_writes_it_whole():
    loose = []
    for folder in ("phalanx", "agent", "plant", "viewer"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            tree = ast.parse(file.read_text("utf-8"))
            fine = {"part"} | in_memory(tree)
            calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
            unsafe = [call for call in calls if writes(call) and not fine & names_of(call)]
            if unsafe and str(file.relative_to(ROOT)) not in IN_NEW_FOLDERS:
                loose += [f"{file.relative_to(ROOT)}:{call.lineno}" for call in unsafe]
    assert loose == []


def writes(call: ast.Call) -> bool:
    """Return whether it may write a file: by such a method, or by `open` in a mode that does."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else ""
    modes = [each.value for each in call.args if isinstance(each, ast.Constant)]
    return name in WRITING or (name == "open" and any(set(str(m)) & set("wx") for m in modes))


def in_memory(tree: ast.Module) -> set[str]:
    """Names of a module's variables that are files in memory."""
    made = [n for n in ast.walk(tree) if isinstance(n, ast.Assign) and "IO()" in ast.unparse(n)]
    return {target.id for n in made for target in n.targets if isinstance(target, ast.Name)}


def names_of(call: ast.Call) -> set[str]:
    """Names in the call's receiver and arguments."""
    nodes = [call.func, *call.args]
    return {n.id for node in nodes for n in ast.walk(node) if isinstance(n, ast.Name)}
