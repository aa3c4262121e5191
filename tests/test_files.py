import ast
import json
import os
import pathlib

import pytest

import cablecast
from cablecast.errors import DamagedFileError, InputError, UnreadableFileError
from cablecast.files import (
    SIZE_MAX,
    parse_yaml,
    read_csv,
    read_json,
    read_numbers,
    read_sealed,
    read_text,
    read_yaml,
    remove_leftovers,
    seal,
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


def test_what_a_killed_process_left_is_removed_and_what_another_writes_stays(
    tmp_path, dead_process
):
    file = tmp_path / "a.csv"
    ours = temporary_prefix(file)
    gone = ours.replace(str(os.getpid()), str(dead_process))
    (tmp_path / f"{gone}x.tmp").write_text("half")
    (tmp_path / f"{gone}y.tmp").mkdir()
    alive = tmp_path / f"{ours}z.tmp"
    alive.write_text("half")
    other = tmp_path / f".b.csv.{dead_process}-x.tmp"
    other.write_text("of another file")
    remove_leftovers(file)
    assert set(tmp_path.iterdir()) == {alive, other}


def test_a_file_that_only_its_owner_may_read_stays_so(tmp_path):
    file = tmp_path / "lab.yaml"
    write_text(file, "first")
    assert file.stat().st_mode & 0o044
    file.chmod(0o600)
    write_text(file, "second")
    assert file.stat().st_mode & 0o777 == 0o600


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


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5e-2", 0.05),
        ("5.0e-2", 0.05),
        ("3e-4", 3e-4),
        ("-1E3", -1000.0),
        ("+2.", 2.0),
        (".5", 0.5),
        ("0.62", 0.62),
        ("12", 12),
        (".inf", float("inf")),
        ("1e5e5", "1e5e5"),
        ("e5", "e5"),
        ("cable_1", "cable_1"),
        ("'5e-2'", "5e-2"),
    ],
)
def test_yaml_numbers_are_the_numbers_that_a_person_means(tmp_path, text, value):
    (tmp_path / "a.yaml").write_text(f"mass: {text}\n")
    found = read_yaml(tmp_path / "a.yaml")["mass"]
    assert found == value
    assert type(found) is type(value)


# Each level names the one before nine times: 9^9 strings from a kilobyte.
BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{name}: &{name} [{','.join(['*' + before] * 9)}]\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BOMB, "aliases"),
        ("mass: 1\nlength: 2\nmass: 3\n", "'mass' appears twice, again in line 3"),
        ("a: [1, 2\nb: 3", "is not plain YAML"),
        ("- 1\n- 2\n", "must hold a mapping"),
        ("", "must hold a mapping"),
        ("just text", "must hold a mapping"),
        ("a: !!python/object/apply:os.system ['true']", "is not plain YAML"),
        ("{" * 5000, "is not plain YAML"),
        ("cable:\n\tmass: 1\n", "is not plain YAML: line 2: it has a tab, indent with spaces"),
        ("[a]: 1", "a key in line 1 is no name"),
        ("a: [1,\n", "is not plain YAML: line 2"),
        ("a: 9999-99-99", "is not plain YAML"),
    ],
    ids=lambda value: value[:16],
)
def test_yaml_that_is_not_plain_is_refused_in_one_line(tmp_path, text, words):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_yaml(tmp_path / "a.yaml")
    assert "\n" not in str(caught.value)


def test_text_is_utf_8_whatever_the_locale_with_or_without_a_byte_order_mark(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfN\xc2\xb7m")
    assert read_text(tmp_path / "a") == "N·m"
    (tmp_path / "a").write_bytes(b"N\xb7m")
    with pytest.raises(InputError, match=r"not text in UTF-8 \(byte 1\)"):
        read_text(tmp_path / "a")


def test_a_file_that_is_too_large_is_refused_before_it_fills_the_memory(tmp_path):
    (tmp_path / "a").write_bytes(b" " * (SIZE_MAX + 1))
    with pytest.raises(InputError, match=f"more than {SIZE_MAX} bytes"):
        read_text(tmp_path / "a")


def test_a_file_that_the_system_refuses_is_unreadable_not_damaged(tmp_path):
    with pytest.raises(UnreadableFileError, match="Is a directory"):
        read_json(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_json(tmp_path / "none")


@pytest.mark.parametrize("text", ["", "[]", "7", "null", "{", "[" * 10**6, '{"a": 1'])
def test_json_that_is_no_mapping_is_damaged(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(DamagedFileError, match="is damaged") as caught:
        read_json(tmp_path / "a.json")
    assert len(str(caught.value)) < 400


def test_a_sealed_file_is_read_back_and_any_change_is_noticed(tmp_path):
    file = tmp_path / "a.json"
    values = {"losses": [1.5, 2.25], "name": "weiß", "nested": {"a": None}}
    file.write_text(json.dumps(seal(values)))
    assert read_sealed(file) == values
    for old, new in (("1.5", "1.6"), ("weiß", "weis"), ("null", "0"), ("sha256", "sha255")):
        text = json.dumps(seal(values), ensure_ascii=False)
        assert old in text
        file.write_text(text.replace(old, new))
        with pytest.raises(DamagedFileError, match="checksum"):
            read_sealed(file)
    file.write_text('{"losses": ' + "[" * 900 + "]" * 900 + "}")
    with pytest.raises(DamagedFileError, match="is damaged"):
        read_sealed(file)


def test_csv_of_a_spreadsheet_is_read_and_empty_cells_beyond_its_columns_are_ignored(tmp_path):
    file = tmp_path / "a.csv"
    file.write_bytes("\ufeffx,y\r\n1,2,, \r\n3,4\r\n".encode())
    assert read_csv(file, ("x", "y")) == [{"x": "1", "y": "2"}, {"x": "3", "y": "4"}]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"x,z\n1,2\n", "lacks the columns y"),
        (b"x,y\n1\n", r"line 2 .* too few cells"),
        (b"x,y\n1,2\n1,5,2\n", r"line 3 .* too many cells"),
        ("x,y\n1,2\n".encode("utf-16-le"), r"not text in UTF-8 \(byte 0 in it\): save it in UTF-8"),
        (b"x,y\n1,2\n3,nan\n", "y = 'nan' in row 2 is no finite number"),
        (b"x,y\n1,2\n3,far\n", "y = 'far' in row 2 is no finite number"),
        (b"x,y\n1,2\n3,4\n", "at least 3 rows of finite numbers, not 2"),
    ],
)
def test_a_table_that_lacks_numbers_is_refused_with_the_place(tmp_path, content, words):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_numbers(tmp_path / "a.csv", ("x", "y"), 3)


def test_a_csv_file_may_be_as_large_as_its_reader_says(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("x\n" + "1\n" * 10)
    assert len(read_csv(file, ("x",), size_max=22)) == 10
    with pytest.raises(InputError, match="more than 21 bytes"):
        read_csv(file, ("x",), size_max=21)


@pytest.mark.parametrize("text", ["jerk: 060", "jerk: 08", "jerk: -07", "robot: {jerk: 0_60}"])
def test_a_number_with_a_leading_zero_is_no_octal_one(text):
    with pytest.raises(InputError, match=r"line 1: .* leading zero, which YAML reads as octal"):
        parse_yaml(text, "lab.yaml")
    assert parse_yaml("{a: 0, b: 0.60, c: -0, d: 0x10, e: 00.5}", "x") == {
        "a": 0,
        "b": 0.6,
        "c": 0,
        "d": 16,
        "e": 0.5,
    }
