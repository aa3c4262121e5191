import ast
import os
import pathlib

import pytest

import cablecast
from cablecast.files import (
    remove_leftovers,
    temporary_prefix,
    write_bytes,
    write_json,
    write_text,
)


def test_a_file_is_replaced_whole_and_leaves_nothing_else_behind(tmp_path):
    file = tmp_path / "new" / "a.txt"
    write_text(file, "first, and longer")
    write_text(file, "second")
    assert file.read_text() == "second"
    assert [entry.name for entry in file.parent.iterdir()] == ["a.txt"]


def test_what_a_killed_process_left_is_removed_and_what_another_writes_stays(tmp_path):
    file = tmp_path / "a.csv"
    child = os.fork()
    if child == 0:
        (tmp_path / f"{temporary_prefix(file)}x.tmp").write_text("half")
        (tmp_path / f"{temporary_prefix(file)}y.tmp").mkdir()
        os._exit(0)
    os.waitpid(child, 0)
    alive = tmp_path / f"{temporary_prefix(file)}z.tmp"
    alive.write_text("half")
    other = tmp_path / f".b.csv.{child}-x.tmp"
    other.write_text("of another file")
    remove_leftovers(file)
    assert set(tmp_path.iterdir()) == {alive, other}


def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    file = tmp_path / "a.bin"
    write_bytes(file, b"old")

    def fail(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="no space"):
        write_bytes(file, b"new")
    assert file.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]


def test_a_number_that_json_cannot_hold_is_refused(tmp_path):
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(tmp_path / "a.json", {"error": float("nan")})
    assert not (tmp_path / "a.json").exists()


def test_a_written_file_can_be_read_by_whom_the_umask_allows(tmp_path):
    umask = os.umask(0o022)
    try:
        write_text(tmp_path / "a.txt", "shared")
    finally:
        os.umask(umask)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o644


def test_text_is_read_and_written_in_utf_8_whatever_the_locale():
    package = pathlib.Path(cablecast.__file__).parent
    without = []
    for file in sorted(package.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                is_text = node.func.attr in ("write_text", "read_text")
                names = {keyword.arg for keyword in node.keywords}
                if is_text and "encoding" not in names:
                    without.append(f"{file.relative_to(package)}:{node.lineno}")
    assert without == []
