import dataclasses
import types

import numpy as np
from tests.view.conftest import drain

from cablecast.runs.progress import Progress
from cablecast.setup import Setup, StrikeConfig
from cablecast.view.desk import Desk
from cablecast.view.tasks import PageLanding, PageTask
from cablecast.view.words import plan_text, status_text, tour_text, tries_text
from cablecast.view.worker import Worker, WorkState
from cablecast.workspace import Workspace

TARGET = np.array([0.3, 1.15])
IDLE = WorkState()


def test_a_plan_and_its_cast_are_stated_in_the_units_of_a_person(desk, own):
    preview = desk.aim(TARGET)
    plan = plan_text(preview, desk)
    assert "| target | 1.188 m, 14.6°, try 1 |" in plan
    proposal = preview.proposal
    most = 100 * desk.setup.cable.length * proposal.expected.miss_within(proposal.goal, 0.9)
    assert f"| nine of ten | within {most:.1f} cm (" in plan
    assert f"| chance of a hit | {100 * proposal.hit_chance:.0f} %, within 6 tries " in plan
    assert f"{preview.proposal.trajectory.duration:.2f} s" in plan
    desk.cast(desk.preview)
    miss = np.linalg.norm(own.offset)
    miss_pct = 100 * miss / desk.setup.cable.length
    assert f"| 1 | 1.19 m, 15° | {100 * miss:.1f} cm ({miss_pct:.1f} %) |" in tries_text(desk)
    landing = plan_text(preview, desk)
    assert f"| missed by | {100 * miss:.1f} cm ({miss_pct:.1f} %) |" in landing
    # What was expected is said of the landing, not of the target that it missed.
    assert f"| error of the forecast | {100 * miss:.1f} cm" in landing
    assert f"Landed: {100 * miss:.1f} cm ({miss_pct:.1f} %)" in status_text(desk, IDLE)
    desk.undo()
    assert f"~~{100 * miss:.1f} cm ({miss_pct:.1f} %)~~" in tries_text(desk)


def test_a_hit_is_marked_and_all_tries_at_the_target_are_in_the_table(desk, own):
    own.offset = np.array([0.05, 0.0])
    for _ in range(7):
        desk.cast(desk.aim(TARGET))
    assert tries_text(desk).count("1.19 m, 15°") == 7
    first, second = tries_text(desk).splitlines()[2:4]
    assert "✓" not in first
    # Corrections bring it onto the target.
    assert "✓ **" in second
    desk.cast(desk.aim(TARGET * [-1, 1]))
    # Of tries at other targets there are the last few.
    assert tries_text(desk).count("1.19 m, 15°") == 4


def test_work_under_way_says_how_far_it_is(desk):
    progress = Progress(task="2/4 fit", done=3, total=8, unit="steps")
    state = WorkState(name="getting ready", progress=progress, seconds_left=40.0)
    assert status_text(desk, state) == (
        "**Getting ready is under way.**\n\n2/4 fit: 3 of 8 steps, about 40 s left"
    )


def test_the_tour_leads_to_the_first_cast_and_ends_there(desk):
    assert tour_text(desk, IDLE).count("✓") == 3
    desk.aim(TARGET)
    assert "▶ **Cast.**" in tour_text(desk, IDLE)
    desk.cast(desk.preview)
    assert tour_text(desk, IDLE) == ""


def test_the_tour_follows_the_steps_of_the_work(rig, engine):
    desk, worker = Desk(rig, engine), Worker()
    assert "▶" not in tour_text(desk, worker.state)
    seen = []

    def work(report):
        for task in ("1/4 casts", "Casting", "2/4 fit", "Tuning 1.5 %"):
            report(Progress(task=task))
            seen.append(tour_text(desk, worker.state))

    worker.submit("getting ready", work)
    drain(worker)
    assert ["▶ **Cast a few" in text for text in seen] == [True, True, False, False]
    assert ["▶ **Fit" in text for text in seen] == [False, False, True, True]


def test_the_legend_ends_at_a_quarter_of_the_cable(engine):
    cable = dataclasses.replace(Setup().cable, length=1.0)
    legend = PageLanding(Setup(cable=cable), engine).legend()
    assert "<span>0 cm</span><span>12 cm</span><span>25 cm and more</span>" in legend


def test_a_name_in_a_sentence_is_no_html(desk):
    desk.message = "no casts in <img src=x>: name another folder"
    assert "No casts in &lt;img src=x&gt;: name" in status_text(desk, IDLE)
    work = WorkState(name="a cast", progress=Progress(task="Casting <b>rope", total=2))
    assert "Casting &lt;b" in status_text(desk, work)


def test_the_numbers_to_type_begin_within_their_range_where_the_reach_is_short(engine):
    small = Setup(
        workspace=Workspace(r_max=0.5, reset_y=0.3),
        cable=dataclasses.replace(Setup().cable, length=0.4),
    )
    swings = dataclasses.replace(small, workspace=Workspace(), strike=StrikeConfig())
    for setup in (small, swings):
        for _, value, low, high, _ in PageTask.of(setup, engine).fields():
            assert low <= value <= high


def test_the_angle_of_a_place_behind_the_base_can_be_typed_where_the_table_is_there(engine):
    around = PageLanding(Setup(workspace=Workspace(table_near_y=-0.4, table_depth=2.0)), engine)
    for place in ([0.5, -0.2], [-0.5, -0.2]):
        typed = around.to_typed(np.array(place))
        for value, (_, _, low, high, _) in zip(typed, around.fields(), strict=True):
            assert low <= value <= high
    assert PageLanding(Setup(), engine).fields()[1][2:4] == (-90.0, 90.0)


def test_a_joint_of_any_name_leaves_the_table_of_a_plan_whole(desk):
    preview = desk.aim(TARGET)
    names = ["a|b<img src=x>"] * len(desk.setup.arm.joint_names)
    arm = types.SimpleNamespace(joint_names=names)
    named = types.SimpleNamespace(
        setup=types.SimpleNamespace(arm=arm, cable=desk.setup.cable),
        phase=desk.phase,
        session=desk.session,
        task=desk.task,
    )
    plan = plan_text(preview, named)
    assert "(a&#124;b&lt;img src=x&gt;)" in plan
    assert {line.count("|") for line in plan.splitlines()} == {3}
