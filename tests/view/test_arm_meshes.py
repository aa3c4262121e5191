"""The meshes of a robot description, against the DH frames of the set-up's arm."""

import pathlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cablecast.arm.description import arm_from_dict
from cablecast.arm.ur import ArmUR
from cablecast.cli.view import _own_meshes
from cablecast.errors import InputError
from cablecast.motion.trajectory import JointPath
from cablecast.setup import Setup
from cablecast.view.arm_meshes import JOINT_NAMES, ArmMeshes
from cablecast.view.look import ShownCast
from cablecast.view.scene import Figure, start_server, stop_server

pytest.importorskip("mujoco")

# A file writes its numbers with this many digits.
DIGITS = 1e-6

TETRAHEDRON = "0.1 0 0  0 0.1 0  0 0 0.1  0 0 -0.05"

NO_BASE = {"name": "base", "pos": "0 0 0", "quat": "1 0 0 0"}


def description(arm, base=NO_BASE, mesh="part", prefix=""):
    """Return an MJCF file of an arm by its DH table, one mesh a body."""
    links = arm.lengths
    fixed = [
        (0.0, 0.0, 0.0),
        (0.0, links.d1, 90.0),
        (-links.upper_arm, 0.0, 0.0),
        (-links.forearm, 0.0, 0.0),
        (0.0, links.d4, 90.0),
        (0.0, links.d5, -90.0),
    ]
    text, ends = "", ""
    for name, (a, d, twist) in zip(JOINT_NAMES, fixed, strict=True):
        geom = f'<geom type="mesh" mesh="{mesh}" rgba="1 0.5 0 1"/>' if mesh else ""
        text += (
            f'<body name="{name[:-6]}" pos="{a} 0 {d}" euler="{twist} 0 0">'
            f'<joint name="{prefix}{name}" axis="0 0 1"/><inertial pos="0 0 0" mass="1" '
            f'diaginertia="1 1 1"/>{geom}'
        )
        ends += "</body>"
    body = f'<body name="{base["name"]}" pos="{base["pos"]}" quat="{base["quat"]}">{text}{ends}'
    asset = f'<asset><mesh name="part" vertex="{TETRAHEDRON}"/></asset>'
    return f"<mujoco>{asset}<worldbody>{body}</body></worldbody></mujoco>"


def written(folder, text):
    path = folder / "arm.xml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("model", "turned"), [("ur5", False), ("ur10e", True)])
def test_each_piece_is_where_its_frame_is(tmp_path, model, turned):
    arm = ArmUR(model=model)
    quat = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_quat(scalar_first=True)
    base = {"name": "base", "pos": "1 -2 0.3", "quat": " ".join(map(str, quat))}
    text = description(arm, base if turned else NO_BASE, prefix="left_")
    meshes = ArmMeshes(written(tmp_path, text), arm)
    assert [name[:-2] for name in meshes.pieces] == [name[:-6] for name in JOINT_NAMES]
    for q in np.random.default_rng(1).uniform(-3.0, 3.0, (5, 6)):
        quats, positions = meshes.poses(q)
        frames = arm.frames(q[None])
        for index, piece in enumerate(meshes.pieces.values()):
            # Each body turns with its joint: DH frame `index`, turned about its z.
            turn = frames[index][0, :3, :3] @ Rotation.from_euler("z", q[index]).as_matrix()
            corners = np.sort(piece.vertices @ turn.T + frames[index][0, :3, 3], axis=0)
            drawn = Rotation.from_quat(quats[index], scalar_first=True).as_matrix()
            mine = np.sort(piece.vertices @ drawn.T + positions[index], axis=0)
            assert np.allclose(mine, corners, atol=DIGITS)


def test_a_piece_has_the_file_s_vertices_and_colour(tmp_path):
    arm = ArmUR()
    piece = ArmMeshes(written(tmp_path, description(arm)), arm).pieces["shoulder_pan_0"]
    expected = np.array(TETRAHEDRON.split(), dtype=float).reshape(-1, 3)
    order = np.lexsort(piece.vertices.T.round(6))
    assert np.allclose(
        piece.vertices[order], expected[np.lexsort(expected.T.round(6))], atol=DIGITS
    )
    assert piece.color == (255, 128, 0)


UR5 = ArmUR(model="ur5")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "is not a file"),
        ("no xml", "arm.xml"),
        (description(UR5).replace("elbow_joint", "third"), "0 joints named 'elbow_joint'"),
        (description(UR5, mesh=""), "has no meshes"),
        (description(ArmUR(model="ur5e")), r"no ur5: its wrists are up to \d+ mm"),
    ],
    ids=["missing", "no xml", "no elbow", "no meshes", "another arm"],
)
def test_a_file_that_is_not_this_arm_is_refused(tmp_path, text, said):
    if text is not None:
        written(tmp_path, text)
    with pytest.raises(InputError, match=said):
        ArmMeshes(tmp_path / "arm.xml", UR5)


def test_the_meshes_of_a_lab_file_s_own_arm_are_found_in_its_package():
    data = pytest.importorskip("pybullet_data")
    urdf = pathlib.Path(data.getDataPath()) / "franka_panda" / "panda.urdf"
    arm = arm_from_dict({"file": str(urdf), "tip": "panda_link8", "gripper_length": 0.17})
    # Seven links, the foot, the hand and two fingers.
    assert len(ArmMeshes(urdf, arm).pieces) == 11


def test_a_lab_file_whose_arm_has_no_meshes_is_drawn_with_shapes(tmp_path):
    lab = tmp_path / "lab.yaml"
    lab.write_text("arm: {file: arm.xml, tip: link6}\n")
    written(tmp_path, description(ArmUR(), mesh=""))
    assert _own_meshes(lab, Setup()) is None
    written(tmp_path, description(ArmUR()))
    assert _own_meshes(lab, Setup()) is not None
    assert _own_meshes(None, Setup()) is None


def test_a_figure_moves_the_meshes_and_keeps_the_gripper(tmp_path, drawn):
    pytest.importorskip("viser")
    setup = Setup()
    meshes = ArmMeshes(written(tmp_path, description(setup.arm)), setup.arm)
    server = start_server("127.0.0.1", 0)
    try:
        figure = Figure(server, "/solid", setup, (0, 0, 255), meshes=meshes)
        q = setup.arm.inverse(np.array([[0.2, 0.6, 0.02, 0.1, 0.0], [0.0, 0.7, 0.02, 0.0, 0.0]]))
        times = np.array([0.0, 1.0])
        cast = ShownCast(
            times=times,
            path=np.zeros((2, 2)),
            joint_path=JointPath(times=times, q=q, qd=np.zeros_like(q)),
        )
        for time, pose in zip(cast.times, q, strict=True):
            figure.show(cast, time)
            piece = drawn(server)[f"/solid/meshes/{list(meshes.pieces)[3]}"]
            assert np.allclose(piece.position, meshes.poses(pose)[1][3])
        assert len(drawn(server)["/solid/arm/rods"].batched_positions) == 2
        figure.visible = False
        assert drawn(server).keys().isdisjoint({"/solid/arm/rods", piece.name})
    finally:
        stop_server(server)
