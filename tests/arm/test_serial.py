"""Arms from description files, against the analytic UR arm and against their own kinematics."""

import dataclasses
import functools
import pathlib

import numpy as np
import pytest

from cablecast.arm.description import _capsule, arm_from_dict
from cablecast.arm.shape import self_gaps
from cablecast.arm.ur import ArmUR
from cablecast.errors import IKError, InputError, UnknownNameError
from cablecast.motion.action import grid_actions
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import check_actions, feasible_ranges
from cablecast.motion.polar import PolarCast, PolarReach
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import Setup
from cablecast.workspace import Workspace

pytest.importorskip("mujoco")

# A file writes the numbers of the chain with all their digits; MuJoCo keeps them in doubles.
CHAIN = 1e-9
# The spline between the nodes of the table, see `_RADIUS_NODES`.
TABLE = 1e-6
# Central differences with a step of 1e-5 s, of angles that the spline has to its third derivative.
DIFFERENCE = 2e-4

UR5 = ArmUR()


def ur_urdf(arm: ArmUR) -> str:
    """Return a URDF of a UR arm by its DH table."""
    a = [0.0, -arm.lengths.upper_arm, -arm.lengths.forearm, 0.0, 0.0, 0.0]
    d = [arm.lengths.d1, 0.0, 0.0, arm.lengths.d4, arm.lengths.d5, arm.lengths.d6]
    twist = [np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0]
    text, origin = '<robot name="ur"><link name="base"/>', (0.0, 0.0, 0.0)
    for joint, name in enumerate(arm.joint_names):
        parent = "base" if joint == 0 else f"link{joint}"
        place = (0.0, 0.0, 0.0) if joint == 0 else (a[joint - 1], 0.0, d[joint - 1])
        # A joint stands where the DH step of the one before ends.
        turn = 0.0 if joint == 0 else twist[joint - 1]
        text += (
            f'<link name="link{joint + 1}"/><joint name="{name}" type="revolute">'
            f'<parent link="{parent}"/><child link="link{joint + 1}"/>'
            f'<origin xyz="{place[0]!r} {place[1]!r} {place[2]!r}" rpy="{turn!r} 0 0"/>'
            f'<axis xyz="0 0 1"/><limit lower="{-2 * np.pi!r}" upper="{2 * np.pi!r}" '
            f'velocity="{np.pi!r}" effort="150"/></joint>'
        )
    origin = f"{a[5]!r} 0 {d[5]!r}"
    return text + (
        '<link name="tool0"/><joint name="flange" type="fixed"><parent link="link6"/>'
        f'<child link="tool0"/><origin xyz="{origin}"/></joint></robot>'
    )


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    """Return the UR5 from a file, with the limits of the analytic one, in its branch."""
    path = tmp_path_factory.mktemp("arm") / "ur5.urdf"
    path.write_text(ur_urdf(UR5))
    return arm_from_dict(
        {
            "file": str(path),
            "tip": "tool0",
            "base_height": UR5.base_height,
            # A UR points along -x of its base where its joints are at zero.
            "base_yaw_deg": 180.0,
            "posture": UR5.inverse([[0.0, 0.55, 0.02, 0.0, 0.0]])[0].tolist(),
            "limits": {"acceleration": list(UR5.limits.acceleration)},
        }
    )


@functools.cache
def pybullet_arm(name):
    data = pytest.importorskip("pybullet_data").getDataPath()
    file, tip, more = {
        "panda": (
            "franka_panda/panda.urdf",
            "panda_grasptarget",
            {"cable_axis": "x", "gripper_length": 0.0},
        ),
        "iiwa": ("kuka_iiwa/model.urdf", "lbr_iiwa_link_7", {"limits": {"velocity": [1.7] * 7}}),
        "xarm6": ("xarm/xarm6_robot.urdf", "link6", {}),
    }[name]
    return arm_from_dict({"file": str(pathlib.Path(data) / file), "tip": tip, **more})


def motion(times, radius, theta, wrist):
    """Return poses that sweep, reach and turn at once, shape [step, 5]."""
    r = radius + 0.05 * np.sin(2.0 * times)
    angle = theta * np.sin(1.5 * times)
    yaw = angle + wrist * np.sin(1.1 * times)
    level = np.full_like(times, 0.02)
    return np.stack([r * np.sin(angle), r * np.cos(angle), level, yaw, 0 * times], axis=-1)


def derivatives(path, times, step=1e-5):
    before, at, after = (path(times + shift) for shift in (-step, 0.0, step))
    return at, (after - before) / (2 * step), (after - 2 * at + before) / step**2


def test_a_ur5_from_a_file_stands_where_the_analytic_one_does(described):
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 6))
    np.testing.assert_allclose(described.forward(q), UR5.forward(q), atol=CHAIN)
    assert described.limits == UR5.limits


def test_a_ur5_from_a_file_moves_its_joints_as_the_analytic_one(described):
    times = np.linspace(0.0, 2.0, 100)
    poses, rates, bends = derivatives(lambda t: motion(t, 0.6, 1.1, 1.2), times)
    ours, theirs = (arm.inverse_motion(poses, rates, bends) for arm in (described, UR5))
    for name, tolerance in (("q", TABLE), ("qd", 1e-5), ("qdd", 1e-3)):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=tolerance)
    np.testing.assert_allclose(ours.radius, theirs.radius, atol=CHAIN)
    # The reach is searched to a tenth of a millimetre.
    np.testing.assert_allclose(ours.radius_max, theirs.radius_max, atol=2e-4)


def test_the_same_motions_are_feasible_for_both(described):
    grid = grid_actions(feasible_ranges(Setup()), (5, 5, 5, 3))
    analytic, tabulated = (check_actions(grid, Setup(arm=arm)) for arm in (UR5, described))
    assert 0.5 < analytic.mask.mean() < 1.0
    assert np.array_equal(analytic.mask, tabulated.mask)
    known = analytic.mask
    np.testing.assert_allclose(tabulated.peaks[known], analytic.peaks[known], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("name", ["panda", "iiwa", "xarm6"])
def test_joints_hold_the_grip_and_their_rates_are_its_derivatives(name):
    arm = pybullet_arm(name)
    times = np.linspace(0.0, 3.0, 200)

    def path(t):
        return motion(t, 0.5, 1.2, 1.3)

    poses, rates, bends = derivatives(path, times)
    found = arm.inverse_motion(poses, rates, bends)
    assert found.q.shape == (200, arm.joint_count)
    np.testing.assert_allclose(arm.grip_pose(found.q), poses, atol=TABLE)
    _, qd, qdd = derivatives(lambda t: arm.inverse(path(t)), times)
    np.testing.assert_allclose(found.qd, qd, atol=DIFFERENCE)
    np.testing.assert_allclose(found.qdd, qdd, atol=100 * DIFFERENCE)
    # One smooth function of the pose: a way out and back ends where it began.
    np.testing.assert_array_equal(arm.inverse(poses[::-1])[::-1], arm.inverse(poses))


@pytest.mark.parametrize("name", ["panda", "iiwa", "xarm6"])
def test_the_arm_works_above_the_table_and_within_its_ranges(name):
    arm = pybullet_arm(name)
    radius = np.linspace(0.45, 0.6, 20)
    poses = np.stack([0 * radius, radius, 0.02 + 0 * radius, 0 * radius, 0 * radius], axis=-1)
    q = arm.inverse(poses)
    assert np.all(np.abs(q - arm.limits.middle) <= arm.limits.position)
    links = arm.links(arm.frames(q))
    assert np.all(links.ends[:, 2:-1, :, 2] > links.safe[2:-1, None])


def test_no_point_of_a_link_lies_beyond_what_a_distance_is_kept_from():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(500, 3)) * [0.05, 0.03, 0.2] + [0.1, 0.0, 0.3]
    *ends, drawn, safe = _capsule(points, np.eye(4), np.eye(4), 0.05)
    start, end = np.reshape(ends, (2, 3))
    way = end - start
    share = np.clip((points - start) @ way / (way @ way), 0.0, 1.0)
    off = np.linalg.norm(points - start - share[:, None] * way, axis=1)
    assert safe == pytest.approx(off.max())
    assert 0.85 < np.mean(off <= drawn) < 1.0


def test_a_redundant_arm_leaves_its_middle_no_farther_than_it_must():
    arm = pybullet_arm("iiwa")
    q = arm.inverse([[0.1, 0.5, 0.02, 0.3, 0.0]])[0]
    rows, columns = np.arange(6), np.arange(7)
    # Its self-motion is the one direction that does not move the grip.
    step = 1e-6
    moved = np.array([arm.forward(q + step * np.eye(7)[joint]) for joint in columns])
    rates = ((moved - arm.forward(q)) / step).reshape(7, 16).T
    free = np.linalg.svd(rates)[2][6]
    assert np.linalg.norm(rates @ free) < 1e-4
    weights = np.array(arm.limits.position) ** -2.0
    weights[[0, -1]] = 0.0
    assert len(rows) == 6
    assert abs(np.sum(weights * (q - arm.limits.middle) * free)) < 1e-4


def test_a_seven_joint_arm_plans_an_action_and_travels_with_its_results():
    arm = pybullet_arm("iiwa")
    workspace = Workspace(r_max=0.75, reset_y=0.5, support_depth=0.4)
    setup = Setup(arm=arm, workspace=workspace).with_motion(r0=0.5, v_max=0.8)
    trajectory = plan_trajectory(Action(-0.5, 0.5, 0.55, 0.6), setup)
    assert trajectory.joint_path.q.shape[1] == 7
    poses = arm.grip_pose(trajectory.joint_path.q)
    planned = trajectory.grip_path.evaluate(trajectory.joint_path.times)[0]
    np.testing.assert_allclose(poses, planned, atol=TABLE)
    assert Setup.from_dict(setup.to_dict()) == setup


def test_a_polar_cast_moves_the_joints_of_a_described_arm_as_the_analytic_one(described):
    path = PolarCast.back_to((0.1, 1.3), PolarReach.of(Setup())).grip_path(Setup())
    motion = [path.evaluate(np.linspace(0.0, path.duration[0], 80), order)[0] for order in range(3)]
    ours, theirs = (arm.inverse_motion(*motion) for arm in (described, UR5))
    # Lifted postures are solved to rounding; their rates are central differences.
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-8)
    np.testing.assert_allclose(ours.qd, theirs.qd, atol=DIFFERENCE)
    np.testing.assert_allclose(ours.qdd, theirs.qdd, atol=10 * DIFFERENCE)


def test_a_redundant_arm_lifts_and_tilts_its_grip():
    arm = pybullet_arm("iiwa")
    times = np.linspace(0.0, 2.0, 40)
    poses = motion(times, 0.5, 0.8, 0.9)
    poses[:, 2] += 0.2 * (1.0 - np.cos(times))
    poses[:, 4] = 0.4 * np.sin(times)
    np.testing.assert_allclose(arm.grip_pose(arm.inverse(poses)), poses, atol=TABLE)


def test_a_lifted_grip_out_of_reach_is_named():
    high = np.array([[0.0, 0.5, 0.02, 0.0, 0.0], [0.0, 0.6, 1.2, 0.0, 0.0]])
    with pytest.raises(IKError, match=r"does not reach the grip at .* 1.2\] m"):
        pybullet_arm("iiwa").inverse(high)


def test_a_turned_base_moves_only_the_first_joint():
    arm = pybullet_arm("xarm6")
    turned = dataclasses.replace(arm, base_yaw_deg=40.0)
    poses = motion(np.linspace(0.0, 1.0, 10), 0.5, 0.8, 0.5)
    q, q_turned = arm.inverse(poses), turned.inverse(poses)
    np.testing.assert_allclose(turned.grip_pose(q_turned), poses, atol=TABLE)
    np.testing.assert_allclose(q_turned[:, 1:], q[:, 1:], atol=TABLE)
    np.testing.assert_allclose(q_turned[:, 0] - q[:, 0], np.radians(40.0), atol=TABLE)


def chain(base_axis="0 0 1", kind="revolute", limit=None):
    """Return a URDF of an arm of six joints; kind and limit are those of the third."""
    text = '<robot name="arm"><link name="base"/>'
    axes = [base_axis, "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1"]
    for number, axis in enumerate(axes):
        parent = f"link{number}" if number else "base"
        own, bound = (
            (kind, LIMIT if limit is None else limit) if number == 2 else ("revolute", LIMIT)
        )
        text += (
            f'<link name="link{number + 1}"/><joint name="joint{number + 1}" type="{own}">'
            f'<parent link="{parent}"/><child link="link{number + 1}"/>'
            f'<origin xyz="0 0 0.2"/><axis xyz="{axis}"/>{bound}</joint>'
        )
    return text + "</robot>"


LIMIT = '<limit lower="-3" upper="3" velocity="2"/>'
HANGING = (
    '<mujoco><worldbody><body name="base" quat="0 1 0 0"><geom size="0.1"/><body name="link1">'
    '<joint name="joint1" axis="0 0 1" range="-180 180"/><geom size="0.1"/></body></body>'
    "</worldbody></mujoco>"
)


@pytest.mark.parametrize(
    ("text", "changes", "words"),
    [
        (chain(limit=""), {}, "states no range of joint 'joint3'"),
        (chain(limit='<limit lower="-3" upper="3"/>'), {}, "states no speed of joint 'joint3'"),
        (
            chain(limit='<limit lower="0" upper="0" velocity="2"/>'),
            {},
            "no range of joint 'joint3'",
        ),
        (
            chain(limit='<limit lower="3" upper="-3" velocity="2"/>'),
            {},
            "no range of joint 'joint3', its limit has lower = 3, upper = -3: give position",
        ),
        (chain(limit='<limit velocity="2"/>'), {}, "states no range of joint 'joint3'"),
        (chain(limit='<limit lower="nan" upper="3" velocity="2"/>'), {}, "no range of joint 'joi"),
        (chain(limit='<limit lower="-3" upper="inf" velocity="2"/>'), {}, "no range of joint 'joi"),
        (chain(limit='<limit lower="-3" upper="3" velocity="inf"/>'), {}, "no speed of joint 'joi"),
        (chain(limit='<limit lower="low" velocity="2"/>'), {}, "lower of .*'low' is not a number"),
        (chain().replace("joint4", "joint3"), {}, "names two joints 'joint3'"),
        ('<?xml version="1.0" encoding="klingon"?><robot/>', {}, "is not XML: unknown encoding"),
        (chain(), {"tip": "hand"}, "has no frame 'hand' for the tip; it has base, link1"),
        (chain(), {"tip": "base"}, "no joint of .* moves the tip"),
        (chain(), {"base_joint": "waist"}, "no joint 'waist' moves the tip"),
        (chain(limit=LIMIT + '<mimic joint="joint2"/>'), {}, "'joint3' of .* with another one"),
        (chain(kind="prismatic"), {}, "joint 'joint3' of .* slides"),
        (chain(base_axis="0 0.3 1"), {}, "base axis, joint 'joint1' .* tilted by 16.7 deg"),
        (HANGING, {"tip": "link1"}, "the base of .* hangs"),
        ("robot: {}", {}, "is not XML: syntax error"),
        ("<sdf/>", {}, "neither URDF nor MJCF: it begins with <sdf>"),
        (
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:a/></robot>',
            {},
            "is a xacro file",
        ),
        (chain(), {"cable_axis": "z"}, "cable_axis = 'z': one of -y, x, y, -x"),
        (chain(), {"posture": [0.0, 1.0]}, "posture must be 6 angles"),
        (chain(), {"limits": {"velocity": [1.0]}}, "velocity limits .* must be 6 numbers"),
        (chain(), {"file": "none.urdf"}, "there is no arm description .*none.urdf"),
        (chain(), {"menagerie": "ufactory_xarm7"}, "both file and menagerie"),
        (chain(), {"tips": "link6"}, r"unknown keys \['tips'\]"),
    ],
)
def test_a_bad_description_is_refused_with_one_line(tmp_path, text, changes, words):
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises((InputError, UnknownNameError), match=words) as caught:
        arm_from_dict({"file": "arm.urdf", "tip": "link6", **changes}, tmp_path)
    assert "\n" not in str(caught.value)


FREE = (2 * np.pi, 0.0)


@pytest.mark.parametrize(
    "third",
    [
        {"kind": "continuous", "limit": '<limit velocity="2"/>'},
        {"kind": "continuous", "limit": '<limit lower="0" upper="0" velocity="2"/>'},
        {"limit": '<limit lower="-inf" upper="inf" velocity="2"/>'},
    ],
)
def test_a_joint_without_an_end_is_free_and_nothing_is_left_behind(
    third, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(chain(**third))
    with pytest.warns(UserWarning, match="does not state the inertia of each link"):
        limits = arm_from_dict({"file": "arm.urdf", "tip": "link6"}).limits
    assert (limits.position[2], limits.middle[2]) == FREE
    assert limits.position[:2] == (3.0, 3.0)
    assert [file.name for file in tmp_path.iterdir()] == ["arm.urdf"]
    assert capfd.readouterr() == ("", "")


RED = '<material name="red"><color rgba="1 0 0 1"/></material>'
INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="{}" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)


def with_inertia(ixx, effort):
    """Return a chain whose links state an inertia [kg m²] and whose joints a torque [Nm]."""
    text = chain().replace('velocity="2"', f'velocity="2" effort="{effort}"')
    for link in range(1, 7):
        own = INERTIAL.format(ixx if link == 3 else 0.1)
        text = text.replace(f'<link name="link{link}"/>', f'<link name="link{link}">{own}</link>')
    return text


@pytest.mark.parametrize(
    ("text", "words", "acceleration"),
    [
        (chain().replace("</robot>", f"{RED}{RED}</robot>"), "does not state the inertia", 20.0),
        (with_inertia(-1.0, 500), "does not state the inertia", 20.0),
        (with_inertia(0.1, 0.01), "joint2.* no torque beyond gravity", 1.0),
        ('<?xml version="1.0" encoding="latin-1"?><!-- Gerät -->' + chain(), "inertia", 20.0),
    ],
    ids=["a material twice", "no inertia", "no torque", "latin-1"],
)
def test_a_description_without_sound_dynamics_says_which_accelerations_are_assumed(
    text, words, acceleration, tmp_path
):
    (tmp_path / "arm.urdf").write_bytes(text.encode("latin-1"))
    with pytest.warns(UserWarning, match=words) as warned:
        limits = arm_from_dict({"file": "arm.urdf", "tip": "link6"}, tmp_path).limits
    assert limits.acceleration[1] == acceleration
    assert len(warned) == 1


def test_an_arm_too_short_for_its_gripper_says_so(tmp_path):
    (tmp_path / "arm.urdf").write_text(chain())
    arm = arm_from_dict({"file": "arm.urdf", "tip": "link6", "base_height": 1.9}, tmp_path)
    with pytest.raises(IKError, match="no posture within its limits and above the table"):
        arm.inverse([[0.0, 0.5, 0.02, 0.0, 0.0]])


def test_an_arm_whose_first_joint_does_not_turn_ahead_says_which_way_to_turn_it():
    arm = pybullet_arm("xarm6")
    q = arm.inverse([[0.0, 0.45, 0.02, 0.0, 0.0]])[0]
    # Near this posture, but for the first joint, which only turns backwards.
    limits = dataclasses.replace(
        arm.limits, middle=tuple((q + [np.pi, 0, 0, 0, 0, 0]).tolist()), position=(1.0,) * 6
    )
    turned = dataclasses.replace(arm, limits=limits)
    words = "straight ahead the joint joint1 of .* stands at -?[0-9]+ deg, outside .*base_yaw"
    with pytest.raises(IKError, match=words):
        turned.inverse([[0.0, 0.45, 0.02, 0.0, 0.0]])


def test_menagerie_without_its_package_says_what_to_install():
    with pytest.raises(InputError, match="pip install mujoco-menagerie"):
        arm_from_dict({"menagerie": "ufactory_xarm7", "tip": "link7"})


def test_an_arm_never_folds_into_itself_where_it_holds_the_grip():
    arm = pybullet_arm("xarm6")
    # So thick a fore-arm meets the base where the arm folds.
    thick = [
        (*row[:6], *((0.11, 0.11) if joint == 4 else row[6:]))
        for joint, row in enumerate(arm.capsules)
    ]
    thick = dataclasses.replace(arm, capsules=tuple(thick))
    pose = np.array([0.0, 0.45, 0.02, 0.0, 0.0])
    slim, stout = (one.inverse_motion(pose, 0 * pose, 0 * pose) for one in (arm, thick))
    assert stout.radius_min > slim.radius_min + 0.02
    near, far = float(stout.radius_min), float(stout.radius_max)
    radii = np.linspace(near + 1e-3, far - 1e-3, 200) + arm.grip_offset
    poses = np.tile(pose, (200, 1))
    poses[:, 1] = radii
    for pair, gap in self_gaps(thick, thick.inverse(poses)).items():
        # Between the nodes of the table it may be a little less.
        assert gap.min() > -2e-3 or gap.max() < 0.0, pair


def mjcf_chain(more="", gear=1.0):
    """Return an MJCF of an arm of six joints with motors of 20 Nm behind a gear, and more."""
    bodies = "".join(
        f'<body name="link{k}" pos="0.2 0 0.1"><joint name="j{k}" axis="0 {k > 1:d} {k == 1:d}" '
        'range="-3 3"/><geom type="sphere" size="0.05" mass="2"/>'
        for k in range(1, 7)
    )
    motors = "".join(
        f'<motor joint="j{k}" gear="{gear}" forcelimited="true" forcerange="-20 20"/>'
        for k in range(1, 7)
    )
    return (
        '<mujoco><compiler angle="radian"/><worldbody>'
        f"{bodies}{'</body>' * 6}</worldbody>{more}<actuator>{motors}</actuator></mujoco>"
    )


def test_torques_are_those_of_motors_at_the_joints_behind_their_gears(tmp_path):
    tendon = '<tendon><fixed name="fingers"><joint joint="j6" coef="1"/></fixed></tendon>'
    finger = '<motor tendon="fingers" forcelimited="true" forcerange="-1000 1000"/></actuator>'
    texts = {
        "plain": mjcf_chain(),
        "fingers": mjcf_chain(tendon).replace("</actuator>", finger),
        "geared": mjcf_chain(gear=100.0),
    }
    found = {}
    for name, text in texts.items():
        (tmp_path / "arm.xml").write_text(text)
        words = {"file": "arm.xml", "tip": "link6", "limits": {"velocity": [3.0] * 6}}
        found[name] = arm_from_dict(words, tmp_path).limits.acceleration
    assert found["fingers"] == found["plain"]
    assert found["geared"][0] > 2 * found["plain"][0]


def test_a_mesh_that_is_missing_costs_no_other_shape(tmp_path):
    shape = '<collision><geometry><cylinder radius="0.12" length="0.1"/></geometry></collision>'
    mesh = '<collision><geometry><mesh filename="package://x/none.stl"/></geometry></collision>'
    text = chain()
    for number in range(1, 7):
        found = mesh if number == 6 else shape
        text = text.replace(
            f'<link name="link{number}"/>', f'<link name="link{number}">{found}</link>'
        )
    assert text.count("cylinder") == 5
    (tmp_path / "arm.urdf").write_text(text)
    arm = arm_from_dict({"file": "arm.urdf", "tip": "link6"}, tmp_path)
    radii = [capsule[-1] for capsule in arm.capsules]
    assert min(radii[:5]) > 0.1
