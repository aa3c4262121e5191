import pytest

from cablecast.rigs.ur.twin.urscript import Program, ScriptError

TIMED = {"servoj", "sleep"}


def run(body, **instant):
    """Run a program with a body, and return the commands that it gives."""
    text = "def main():\n" + "".join(f"  {line}\n" for line in body.splitlines()) + "end\n"
    return [(name, values, named) for name, values, named in Program(text).run(instant, TIMED)]


def test_commands_come_in_order_with_their_arguments():
    assert run("servoj([1,2.5], t=0.008)\nsleep(1) # wait") == [
        ("servoj", ([1, 2.5],), {"t": 0.008}),
        ("sleep", (1,), {}),
    ]


def test_a_loop_counts_and_a_branch_chooses():
    body = """local k = 0
while k < 3:
  if k == 1:
    sleep(10)
  elif k == 2:
    sleep(20)
  else:
    sleep(0)
  end
  k = k + 1
end"""
    assert [values[0] for _, values, _ in run(body)] == [0, 10, 20]


def test_functions_have_arguments_of_their_own_and_share_globals():
    body = """global total = 0
def add(x):
  total = total + x
end
local x = 1
add(5)
add(2 * x)
sleep(total)
sleep(x)"""
    assert [values[0] for _, values, _ in run(body)] == [7, 1]


def test_built_in_functions_return_values_at_once():
    assert run("sleep(read(3) - 1)", read=lambda i: 10 * i) == [("sleep", (29,), {})]


def test_halt_ends_the_program_from_within_a_function():
    body = """def brake():
  sleep(1)
  halt
end
while True:
  brake()
end"""
    assert run(body) == [("sleep", (1,), {})]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("x = = 1", "line 2: .* is no statement"),
        ("while True:\n  x = 1", "ends before end"),
        ("hello", "line 2: 'hello' is no statement"),
        ("import os", "line 2: 'import os' is no statement"),
        ("def f(x=1):\nend", "is no definition"),
        ("end", "line 3: 'end' is no statement"),
        ("hello()", "there is no function 'hello'"),
        ("sleep(y)", "there is no name 'y'"),
        ("x = __import__", "there is no name"),
        ("x = (lambda: 1)()", "there is no function ''"),
        ("x = [1].append", "Attribute is not understood"),
        ("while True:\n  x = 1\nend", "an endless loop without a motion"),
        ("x = 1.0 / 0", "division by zero"),
        ("x = 4 / 2", "a whole number divided by a whole number"),
        ("x = [1, 2] + [3]", "a list stands where a number belongs"),
        ("x = [1, [2]]", "a list stands where a number belongs"),
        ("x = [1, 2]\nx = x[-1]", "index -1 of a list of 2"),
        ("x = [1, 2]\nx = x[1.0]", r"index 1\.0 of a list of 2"),
        ("x = [1, 2]\nx[0] = 3", "is no statement"),
        ("def f():\nreturn 1\nend", "line 3: 'return 1' is no statement"),
        ("x = sleep(1)", "takes time and has no value"),
    ],
)
def test_what_the_controller_does_not_know_stops_the_program_with_its_line(body, words):
    with pytest.raises(ScriptError, match=words):
        run(body)


def test_a_text_without_a_definition_is_no_program():
    with pytest.raises(ScriptError, match="one definition"):
        Program("sleep(1)\n")
