"""What `aim` prints can be pasted into a shell."""

import pathlib
import shlex
import types

import numpy as np

from cablecast.cli.aim import Aim, _view_command
from cablecast.cli.tries import TableTries
from cablecast.setup import Setup


def test_the_next_command_names_folders_with_spaces_whole():
    out, lab = pathlib.Path("my runs/it's"), pathlib.Path("the lab.yaml")
    words = shlex.split(_view_command(Aim(setup=lab, out=out, candidate_count=77, fast=True)))
    assert words[:4] == ["cablecast", "view", "--rig", "virtual"]
    assert words[words.index("--setup") + 1] == str(lab)
    assert words[words.index("--out") + 1] == str(out)
    assert words[words.index("--candidate-count") + 1] == "77"
    assert words[-1] == "--fast"


def test_a_target_that_is_out_of_reach_counts_among_those_that_were_asked_for(capsys):
    hit = types.SimpleNamespace(landed=True, miss_pct=1.0, hit=True)
    result = types.SimpleNamespace(
        target_xy=np.array([[0.1, 1.0]]),
        casts=[[hit]],
        stops=[""],
        hit=np.array([True]),
        session=types.SimpleNamespace(setup=Setup()),
    )
    TableTries(result.session).print_result(result, beyond_count=1)
    assert "1 of 2 targets were hit; 1 is out of reach." in capsys.readouterr().out
