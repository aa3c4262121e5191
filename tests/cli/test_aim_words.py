"""What `aim` prints can be pasted into a shell."""

import pathlib
import shlex

from cablecast.cli.aim import Aim, _view_command


def test_the_next_command_names_folders_with_spaces_whole():
    out, lab = pathlib.Path("my runs/it's"), pathlib.Path("the lab.yaml")
    words = shlex.split(_view_command(Aim(setup=lab, out=out, candidate_count=77)))
    assert words[:4] == ["cablecast", "view", "--rig", "virtual"]
    assert words[words.index("--setup") + 1] == str(lab)
    assert words[words.index("--out") + 1] == str(out)
    assert words[words.index("--candidate-count") + 1] == "77"
