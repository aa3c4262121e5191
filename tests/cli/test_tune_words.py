"""Words of `cablecast tune` about the material that it found."""

from cablecast.cable import Material
from cablecast.cli.tune import material_words

HAS = "beside the ten parameters, the cable has "


def test_what_was_found_beside_the_ten_parameters_is_said_with_units():
    found = Material(damping_time=0.01, rest_curvature=0.8, attachment_arm=0.02)
    words = material_words(found, 0.5)
    expected = "a damping time of 10 ms, a curl of 0.4 rad over the cable, an attachment of 30 mm"
    assert words == HAS + expected
    assert material_words(Material(drag_coefficient=1.1), 0.5) == f"{HAS}a drag coefficient of 1.1"
    words = material_words(Material(yield_curvature=20.31, yield_time=0.4), 0.5)
    assert words == f"{HAS}bends that stay if they are sharper than 20 1/m"
    words = material_words(Material(friction_ratio=1.0512), 0.5)
    assert words == f"{HAS}friction along it 1.05 times that across"


def test_what_was_not_found_is_not_said():
    assert material_words(Material(attachment_arm=0.02), 0.5) == f"{HAS}an attachment of 30 mm"


def test_that_there_is_no_material_is_said():
    assert material_words(None, 0.5).startswith("the casts are likelier without a material")
