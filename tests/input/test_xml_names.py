"""Names in XML files: a misprint is refused, any other unknown name is counted."""

import pytest

from pinarm.errors import ModelError
from pinarm.input.xml_text import UnknownName, check_names, counted, first_place, format_names, tree_of

KNOWN = format_names({
    "room": "> shelf* door",
    "shelf": "name > shelf* board sticker- lamp=board*",
    "board": "name width",
})  # fmt: skip


def check(text):
    return check_names(tree_of(text), KNOWN)


def test_known_names_pass_at_any_depth():
    text = '<room><shelf><shelf name="a"><board width="1"/><sticker x="1"><y/></sticker></shelf></shelf></room>'
    assert not check(text)


def test_unknown_names_are_counted_and_what_is_in_them_is_not_examined():
    unread = check('<room><fan widht="9"/><shelf colour="red"><board glue="x"/><lamp name="l"/><fan/></shelf></room>')
    assert counted(unread) == "<fan> (2), colour of <shelf>, glue of <board>"


def test_names_with_a_prefix_belong_to_others_declared_or_not():
    unread = check(
        '<room xmlns:o="urn:o"><o:door/><!-- --><shelf o:nme="oak"><p:board><bord/></p:board></shelf></room>'
    )
    assert unread == {"<o:door>": 1, "<p:board>": 1}


@pytest.mark.parametrize(("text", "message"), [
    ("<room><shelf><board/><sticker/><board/></shelf></room>", "<shelf>: it has 2 <board>"),
    ('<room><shelf name="s"><board/><board/></shelf></room>', "shelf 's': it has 2 <board>"),
])  # fmt: skip
def test_what_stands_twice_where_one_is_read_is_refused(text, message):
    check("<room><shelf/><shelf><board/><sticker/><sticker/><lamp/><lamp/></shelf></room>")
    with pytest.raises(ModelError, match=f"^{message}"):
        check(text)


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ('<room><shelf name="s"><bord/></shelf></room>', "<shelf> 's' contains no <bord>", "board"),
        ('<room><shelf name="s"><board widht="1"/></shelf></room>', "<board> in <shelf> 's' has no attribute 'widht'",
         "width"),
        ("<room><!-- --><sheelf/></room>", "<room> contains no <sheelf>", "shelf"),
        ("<room><Door/></room>", "<room> contains no <Door>", "door"),
    ],
)  # fmt: skip
def test_a_misprint_is_refused(text, message, hint):
    with pytest.raises(UnknownName) as caught:
        check(text)
    assert (caught.value.message, caught.value.hint) == (message, hint)
    assert hint in caught.value.expected


def test_its_place_is_that_of_the_element_around_it():
    """A comment is no place of it."""
    text = (
        '<room>\n<!-- <board nam="1"> -->\n <shelf name="x">\n <board\n  nam="1"/></shelf>\n <board name="1"/></room>'
    )
    with pytest.raises(UnknownName) as caught:
        check(text)
    place = first_place(caught.value.pattern, text, "room.xml")
    assert (place.source, place.line) == ("room.xml", 5)
    assert str(first_place(caught.value.pattern, "<room><shelf>\n  <board nam='1'/></shelf></room>", "f")) == "f:2:10"
    assert first_place(caught.value.pattern, "<room/>", "other.xml").line == 0
