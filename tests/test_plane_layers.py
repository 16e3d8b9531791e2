"""Every plane-strain reference of these tests has the digits of one layer of cells in space, on the same cells."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import pytest

from fenics_contact import Method, solve

SPEC = importlib.util.spec_from_file_location("plane_cost", Path(__file__).parents[1] / "docs" / "plane_cost.py")
plane_cost = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(plane_cost)

pytestmark = pytest.mark.serial
EXACT = 1e-11  # of the force: where steps end, so that what they leave is far below the digits that are compared
DIGITS = 1e-9
SCENES = ["strip", "membrane", "block", "greco", pytest.param("cattaneo", marks=pytest.mark.slow), "ironed"]
STUDIED = ["tubes, 24 cells", "cylinder, 8 cells", "cylinder, 8 cells, mixed", "cylinder, 8 cells, degree 2"]


@pytest.mark.parametrize("scene", SCENES)
def test_a_plane_scene_has_the_forces_moments_pressures_and_energies_of_a_layer(scene):
    """At the end of the path, of the greatest of their unit: a layer's ends belong to its largest force, to which what is
    out of balance is compared, so that averages may be sampled in it one iterate later, which tells on steps in between."""
    plane, layer = (
        getattr(plane_cost, scene)(mesh, method=Method(tolerance=EXACT)).require().history for mesh in ("plane", "layer")
    )
    assert len(plane) == len(layer)
    for unit in ("N", "Nmm", "MPa"):
        both = [key for key in plane[-1] if key.rsplit("_", 1)[-1] == unit and key in layer[-1]]
        greatest = max((abs(row[key]) for row in plane for key in both), default=0.0)
        assert greatest > 0.0 or unit == "MPa"
        for key in both:
            assert plane[-1][key] == pytest.approx(layer[-1][key], abs=DIGITS * greatest), key


@pytest.mark.parametrize("case", STUDIED)
def test_a_studied_plane_case_has_the_digits_of_a_layer(case, monkeypatch):
    def exactly(scene, *, method, **options):
        return solve(scene, method=replace(method, tolerance=EXACT), **options)

    for study in (plane_cost.cylinder, plane_cost.tubes):
        monkeypatch.setattr(study, "solve", exactly)
    plane, layer = (plane_cost.CASES[case](mesh) for mesh in ("plane", "layer"))
    assert plane["converged"] and layer["converged"]
    assert plane["value"] == pytest.approx(layer["value"], rel=DIGITS)
    assert plane["error"] == pytest.approx(
        layer["error"], abs=DIGITS
    )  # of tubes the greater of pressure's and displacement's
