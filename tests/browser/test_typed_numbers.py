"""A number typed into a real Chromium, in any country's writing, is sent as it was typed or refused with a sentence."""

import json
import random
from collections import Counter

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser
OF_A_LOCALE = 125  # numbers on each page
LOCALES = ("en-US", "de-DE", "fr-FR", "de-CH")
SHIFT, SEED = "#trial [name=displacement_mm]", "#trial [name=seed]"
SHIFTS, SEEDS = "#trial [name=displacements_mm]", "#trial [name=seeds]"
REFUSED = "refused"
SUBMIT = """(name) => {
    const field = document.querySelector(name);
    field.form.requestSubmit();
    return [field.name, field.validity.valid];
}"""
FORMAT = """(numbers) => numbers.map(([value, locale, useGrouping]) =>
    new Intl.NumberFormat(locale, { useGrouping, maximumFractionDigits: 3 }).format(value))"""


class Form:
    """A form of the console that is filled by the keyboard; what it sends is caught before it reaches the server."""

    def __init__(self, page, address, path, fields):
        self.page, self.fields, self.sent = page, fields, []
        page.route(f"**{path}", self._catch)
        page.goto(address)
        if address == "/":
            page.click("#tab-trial")
        expect(page.locator("#trial [name=reference]")).not_to_have_value("")

    def _catch(self, route):
        self.sent.append(json.loads(route.request.post_data))
        route.fulfill(status=409, json={"error": "caught"})

    def type(self, field, text):
        """Type a text in the place of what is there, and send the form; return what is sent, or REFUSED."""
        self.sent.clear()
        self.page.focus(field)
        self.page.keyboard.press("ControlOrMeta+a")
        self.page.keyboard.press("Delete")
        self.page.keyboard.type(text)
        name, valid = self.page.evaluate(SUBMIT, field)
        if not valid:
            self.page.wait_for_timeout(20)  # what is sent has come here by then
            assert self.sent == []
            assert self.said
            return REFUSED
        while not self.sent:
            self.page.wait_for_timeout(5)
        return self.sent[0][name]

    @property
    def said(self):
        return " ".join(self.page.locator("#trial .number-wrong:visible").all_inner_texts())


@pytest.fixture(scope="module")
def trial(stage):
    return Form(stage.page, "/", "/api/jobs/trial", (SHIFT, SEED))


@pytest.mark.parametrize(
    ("field", "text", "sent"),
    [
        (SHIFT, "-12,5", -12.5), (SHIFT, "-12.5", -12.5), (SHIFT, "\u221212,5", -12.5), (SHIFT, "\u201312.5", -12.5),
        (SHIFT, "+30", 30), (SHIFT, ".5", 0.5), (SHIFT, "-0,125", -0.125), (SHIFT, "1e2", 100), (SHIFT, "030", 30),
        (SHIFT, "\u0661\u0662\u066b\u0665", 12.5), (SHIFT, "\u096a\u0968", 42), (SHIFT, "\u200e-12.5", -12.5),
        (SHIFT, "1,250", 1.25), (SEED, "1.000,0", 1000), (SEED, "1,000.0", 1000), (SEED, "1\u2019000", 1000),
        (SEED, "1\u202f000,0", 1000), (SEED, "1\u00a0000", 1000), (SEED, "1,250", 1250), (SEED, "1.000.000", 1000000),
        (SEED, "2,147,483,647", 2147483647), (SEED, "1'000", 1000),
        (SEED, "1,000", REFUSED), (SEED, "1.000", REFUSED), (SHIFT, "", REFUSED), (SHIFT, "-", REFUSED),
        (SHIFT, "ten", REFUSED), (SHIFT, "1,2,3", REFUSED), (SHIFT, "1.5mm", REFUSED), (SHIFT, "1001", REFUSED),
        (SHIFT, "191", REFUSED),
        (SHIFT, "12,34.5", REFUSED), (SHIFT, "1--2", REFUSED), (SHIFT, "Infinity", REFUSED), (SHIFT, "0x10", REFUSED),
        (SEED, "1.5", REFUSED), (SEED, "-1", REFUSED), (SEED, "2147483648", REFUSED), (SEED, "1,25", REFUSED),
    ],
)  # fmt: skip
def test_a_number_is_sent_as_it_was_typed_or_refused(trial, field, text, sent):
    found = trial.type(field, text)
    assert found == sent
    if found != REFUSED:
        assert trial.said == ""
    trial.page.fill(field, "0")


@pytest.mark.parametrize(
    ("field", "text", "says"),
    [
        (SEED, "1,000", '"1,000" may mean 1 or 1000: write 1 or 1000.'),
        (SHIFT, "1500", '"1500" is out of range: write a number from -190 to 190.'),
        (SHIFT, "ten", '"ten" is not a number: write one from -190 to 190.'),
        (SHIFT, "", "Write a number from -190 to 190."),
        (SEED, "1.5", '"1.5" is not a whole number: write one from 0 to 2147483647.'),
    ],
)
def test_one_sentence_stands_at_the_field_that_is_refused(trial, field, text, says):
    assert trial.type(field, text) == REFUSED
    assert trial.said == says
    expect(trial.page.locator(field)).to_be_focused()
    expect(trial.page.locator(field)).to_have_attribute("aria-invalid", "true")
    trial.page.fill(field, "0")
    assert trial.said == ""


def test_arrow_keys_step_and_the_field_shows_the_number_that_was_read(trial):
    field = trial.page.get_by_role("spinbutton", name="Shift y, mm")
    field.fill("-12,5")
    field.press("ArrowUp")
    expect(field).to_have_value("-11.5")
    field.fill("189.5")
    field.press("ArrowUp")
    expect(field).to_have_value("190")
    field.fill("-7,5")
    field.press("Tab")
    expect(field).to_have_value("-7.5")
    field.fill("0")


def test_the_range_is_that_of_the_chosen_object(trial):
    trial.page.fill(SHIFT, "205")
    trial.page.select_option("#trial [name=object]", "bottles")
    assert trial.said == ""
    expect(trial.page.locator(SHIFT)).to_have_attribute("aria-valuemax", "205")
    trial.page.select_option("#trial [name=object]", "rice_box")
    assert trial.said == '"205" is out of range: write a number from -190 to 190.'
    trial.page.fill(SHIFT, "0")


@pytest.fixture(scope="module")
def sweep(stage, trial):
    form = Form(stage.page, "/trials", "/api/queue/sweep", (SHIFTS, SEEDS))
    yield form
    stage.page.unroute("**/api/queue/sweep")


LISTS = [
    (SHIFTS, "-12.5, 5; 7 9", "-12.5 5 7 9"), (SHIFTS, "-60:10:60", "-60:10:60"), (SHIFTS, "\u221230; 0", "-30 0"),
    (SEEDS, "0:4", "0:4"), (SEEDS, "1\u2019000; 7", "1000 7"), (SHIFTS, "50 100 150", "50 100 150"),
    (SHIFTS, "-12,5", '"-12,5" may be -12.5 or two numbers: write -12.5 or -12; 5.'),
    (SHIFTS, "0:ten", '"0:ten" is not a list: write -12.5, 5 or -60:10:60.'),
    (SHIFTS, "-30,0,30", '"-30,0,30" is not a list: write -12.5, 5 or -60:10:60.'),
    (SHIFTS, "-300", '"-300" is out of range: write a number from -190 to 190.'),
    (SHIFTS, "0:10:300", '"300" is out of range: write a number from -190 to 190.'),
    (SEEDS, "1 250", '"1 250" may be 1250 or several numbers: write 1250 or 1; 250.'),
    (SEEDS, "1.000", '"1.000" may mean 1 or 1000: write 1 or 1000.'), (SEEDS, "", "Write a number."),
]  # fmt: skip


@pytest.mark.parametrize(("field", "text", "expected"), LISTS)
def test_a_list_is_sent_as_it_was_typed_or_refused(sweep, field, text, expected):
    found = sweep.type(field, text)
    assert (sweep.said if found == REFUSED else found) == expected
    if found == REFUSED:
        expect(sweep.page.locator("#trial button[type=submit]")).to_be_disabled()
        expect(sweep.page.locator("#trial [data-why]")).not_to_contain_text(" trial,")
    sweep.page.fill(field, "0")


@pytest.mark.long
@pytest.mark.parametrize("name", ["trial", "sweep"])
def test_a_thousand_numbers_in_four_writings_are_sent_as_typed_or_refused(request, name):
    form, chance, counts, most = request.getfixturevalue(name), random.Random(20261128), Counter(), 190

    def number(whole):
        return (
            chance.randint(0, 10 ** chance.randint(1, 9))
            if whole
            else round(chance.uniform(-most, most), chance.randint(0, 3))
        )

    asked = [(k % 5 < 2, locale, k % 2 == 0) for locale in LOCALES for k in range(OF_A_LOCALE)]
    numbers = [(number(whole), locale, grouped) for whole, locale, grouped in asked]
    for (whole, locale, grouped), (value, _, _), text in zip(
        asked, numbers, form.page.evaluate(FORMAT, numbers), strict=True
    ):
        sent = form.type(form.fields[whole], text)
        counts[f"{locale}{' grouped' * grouped} {'refused' if sent == REFUSED else 'sent'}"] += 1
        assert sent == REFUSED or float(sent) == value, (locale, text, value, sent)
        if sent == REFUSED:
            form.page.fill(form.fields[whole], "0")
    print(f"{name}: {counts.total()} numbers: {dict(counts)}")
