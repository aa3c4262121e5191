"""Words of `cablecast tune` about the material that it found."""

from cablecast.cli.tune import material_words
from cablecast.material import Material


def test_what_was_found_beside_the_ten_parameters_is_said_with_units():
    found = Material(damping_time=0.01, rest_curvature=0.8, attachment_arm=0.02)
    words = material_words(found, 0.5)
    expected = "a damping time of 10 ms, a curl of 0.4 rad over the cable, an attachment of 30 mm"
    assert words == expected
    assert material_words(Material(drag_coefficient=1.1), 0.5) == "a drag coefficient of 1.1"
    words = material_words(Material(yield_curvature=20.31, yield_time=0.4), 0.5)
    assert words == "bends that stay if they are sharper than 20 1/m"
    words = material_words(Material(friction_ratio=1.0512), 0.5)
    assert words == "friction along it 1.05 times that across"


def test_what_was_not_found_is_not_said():
    assert material_words(Material(attachment_arm=0.02), 0.5) == "an attachment of 30 mm"
