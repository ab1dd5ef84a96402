"""What each mode is called and looks like: one table for lights, bands, strips and figures.

Colours are Okabe and Ito's (https://jfly.uni-koeln.de/color/) where those reach, and one of Tol's
(https://sronpersonalpages.nl/~pault/): told apart by colour-blind eyes, and never without the word.
"""

from dataclasses import dataclass

from rtstack.samples import Mode


@dataclass(frozen=True, slots=True)
class ModeStyle:
    """A mode's word, what it means, and its colour, "#rrggbb"; `light` on a light ground, where that has to differ."""

    mode: Mode
    word: str
    meaning: str
    colour: str
    light: str


def _style(mode: Mode, meaning: str, colour: str, light: str = "") -> ModeStyle:
    return ModeStyle(mode, mode.name.lower().replace("_", "-"), meaning, colour, light or colour)


MODE_STYLES: dict[Mode, ModeStyle] = {
    style.mode: style
    for style in (
        _style(Mode.IDLE, "follows no reference", "#8b949e", "#6b7683"),
        _style(Mode.TELEOPERATION, "by hand, or the scripted operator", "#cc79a7"),
        _style(Mode.ANTE_IMPACT, "before the contact: the ante-impact reference", "#0072b2"),
        _style(Mode.INTERIM, "between the first contact and the last one", "#e69f00"),
        _style(Mode.POST_IMPACT, "both pads in contact: the post-impact reference", "#009e73"),
        _style(Mode.STOPPING, "the judge brakes", "#d55e00"),
        _style(Mode.STOPPED, "the judge has stopped the arms and holds them", "#b45f3a", "#9c4a26"),
        _style(Mode.HOLDING, "reaction to an impact that was not meant: stays where it is", "#f0e442", "#857b00"),
        _style(Mode.RETREATING, "reaction to an impact that was not meant: back the way it came", "#aa80d8", "#7a4fb0"),
    )
}
