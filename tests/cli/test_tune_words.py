"""Words of `cablecast tune` about the material that it found."""

from cablecast.cable import load_cable
from cablecast.cli.tune import material_words

HAS = "besides the ten parameters, the cable has "


def words_of(**material):
    return material_words(load_cable("cable_1").with_params(**material).params, 0.5)


def test_what_was_found_beside_the_ten_parameters_is_said_with_units():
    words = words_of(damping_time=0.01, rest_curvature=0.8, attachment_arm=0.02)
    expected = "a damping time of 10 ms, a curl of 0.4 rad over the cable, an attachment of 30 mm"
    assert words == HAS + expected
    assert words_of(drag_coefficient=1.1) == f"{HAS}a drag coefficient of 1.1"
    words = words_of(yield_curvature=20.31, yield_time=0.4)
    assert words == f"{HAS}bends that stay if they are sharper than 20 1/m"
    words = words_of(friction_ratio=1.0512)
    assert words == f"{HAS}friction along it 1.05 times that across"
    words = words_of(attachment_friction_ratio=2.0, drag_ratio=0.12)
    expected = "an attachment with 2.00 times its friction, drag along it 0.12 times that across"
    assert words == HAS + expected
    assert words_of(grip_compliance=1.25) == f"{HAS}a grip that gives by 1.2 rad/(N·m)"


def test_what_was_not_found_is_not_said():
    assert words_of(attachment_arm=0.02) == f"{HAS}an attachment of 30 mm"


def test_that_there_is_no_material_is_said():
    assert words_of().startswith("the casts are likelier without a material")
