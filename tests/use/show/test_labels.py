"""Labels: symbols as publications print them, and the same without TeX."""

import unicodedata

import numpy as np
import pytest

from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.use.result.presentation import Presentation
from pinarm.use.result.section import Curve, Graph
from pinarm.use.show.labels import axis_label, symbol, unicode_label
from pinarm.use.show.picture import graph


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("theta21d", r"$\dot{\theta}_{21}$"),
        ("rho", r"$\rho$"),
        ("X53", "$X_{53}$"),
        ("hdd", "hdd"),
        ("joint.theta.effort", "joint.theta.effort"),
        ("C_B$", r"C_B\$"),
    ],
)
def test_symbols_are_printed_as_publications_do(name: str, wanted: str) -> None:
    assert symbol(name) == wanted


@pytest.mark.parametrize(("label", "text"), [
    (r"$\theta_{21}$", "θ₂₁"), (r"$\ddot{\phi}$", "φ̈"), ("$C_{B}$ [N·m]", "C_B [N·m]"), (r"a \$ b", "a $ b"),
    (r"$\dot\psi_{12}^2$", "ψ̇₁₂^2"), ("plain_name", "plain_name"), (r"\\$ \$", r"\$ $"),
])  # fmt: skip
def test_labels_as_mere_text(label: str, text: str) -> None:
    assert unicodedata.normalize("NFC", unicode_label(label)) == unicodedata.normalize("NFC", text)


def test_an_axis_has_the_label_of_the_scenario_and_a_printed_unit() -> None:
    how = Presentation(labels={"psd": r"\dot\psi", "h": "height", "cost": "5 $"})
    assert axis_label("psd", unit("N*m^2"), how) == r"$\dot\psi$ [N·m²]"
    assert axis_label("h", unit("1"), how) == "height"
    assert unicode_label(axis_label("cost", None, how)) == "5 $ [?]"
    how = Presentation(labels={"C": "torque $C_A$", "F": "$F_1$"})
    assert axis_label("C", unit("N*m"), how) == "torque $C_A$ [N·m]"
    assert axis_label("F @ max", unit("N"), how) == "$F_1$ @ max [N]"
    assert axis_label("F @ max - F @ min", unit("N"), how) == "$F_1$ @ max - $F_1$ @ min [N]"
    assert how.label("F @ max / (C @ rms)") == "F₁ @ max / (torque C_A @ rms)"
    assert [how.label(name) for name in ("C", "F @ max")] == ["torque C_A", "F₁ @ max"]


def test_legends_have_the_labels_of_the_scenario() -> None:
    x, y = Series("x", unit("1"), np.arange(3.0)), Series("y", unit("1"), np.arange(3.0))
    how = Presentation(labels={"C": "$C_A$"})
    drawn = graph(Graph("g", "", [Curve(x, y, "C"), Curve(x, y, "other curve")]), how)
    assert [text.get_text() for text in drawn.axes[0].get_legend().get_texts()] == ["$C_A$", "other curve"]
