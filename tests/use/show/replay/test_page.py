"""The page as a file: small, the same bytes each time, with nothing in it that leads out of it."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pinarm.errors import InputError
from pinarm.use.show.replay.page import replay_page
from pinarm.use.study.restore import restore


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("gen411_arm_vertical", {"arrows": ["all"], "traces": ["A", "com"]}),
        ("gen411_arm_equilibria", {}),
        pytest.param("panda_quintic", {"traces": ["panda_hand"]}, marks=pytest.mark.slow),
    ],
)
def test_a_result_and_its_folder_give_the_same_bytes(
    solved: Callable[..., Any], tmp_path: Path, name: str, options: dict[str, Any]
) -> None:
    result = solved(name)
    first = result.replay(**options).html
    assert first == result.replay(**options).html
    assert first == restore(result.save(tmp_path / "out", plots=False)).replay(**options).html


@pytest.mark.parametrize(("name", "size"), [("gen411_arm_vertical", 1.2e6), ("panda_quintic", 4e6)])
def test_a_page_is_small_enough_to_be_sent(solved: Callable[..., Any], name: str, size: float) -> None:
    assert len(solved(name).replay().html.encode()) < size


def test_nothing_leads_out_of_the_page(solved: Callable[..., Any]) -> None:
    html = solved("panda_quintic").replay().html
    assert not re.search(r"""(src|href|url|import|fetch)\s*[=(]\s*["']?\s*(https?:|//)""", html)
    assert "default-src 'none'" in html
    assert html.count("<script") == html.count("</script>") == 4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"traces": ["nowhere"]}, "no link 'nowhere'"),
        ({"arrows": ["wind"]}, "no arrows of 'wind'"),
        ({"plots": ["C_X"]}, "no quantity 'C_X'"),
    ],
)
def test_what_is_unknown_is_refused(solved: Callable[..., Any], options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replay_page(solved("gen411_arm_static"), **options)
